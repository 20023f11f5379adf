"""More friction never carries less, and friction that falls to zero is none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem import Problem, concrete
from geometry import Assembly, convex_polyhedron
from mbd import analyse
from mbd.results.parts import EdgesAndCorners
from tests.support.commands import command, set_words
from tests.support.rubbing import KINDS, balances, drawn, less_with_more

SAYS = "held by edges and corners alone: faces alone do not carry"


@pytest.mark.parametrize("kind", KINDS)
def test_where_forces_balance_they_balance_with_more_friction(kind: str) -> None:
    """By faces, and with edges and corners; friction of zero included."""
    rng = np.random.default_rng(KINDS.index(kind))
    problem = drawn(kind, rng)
    frictions = (0.0, *sorted(10.0 ** rng.uniform(-2.0, 0.1, 2)))
    assert less_with_more([balances(problem, mu) for mu in frictions], frictions) == []


@pytest.mark.parametrize("kind", ["octahedra", "cubes", "versatile", "voxel-puzzle", "tsb1-pipe"])
def test_forces_tend_to_those_without_friction_as_it_falls(kind: str) -> None:
    """Tangential forces are at most μ times the normal ones: a tenth of the friction changes the
    forces of least norm by a tenth, to first order, and solvers leave 1e-8."""
    problem = drawn(kind, np.random.default_rng(5))
    smooth = analyse(problem).details.forces
    far, near = (
        np.linalg.norm(analyse(replace(problem, friction=mu)).details.forces - smooth)
        for mu in (1e-3, 1e-4)
    )
    assert 0.0 < near <= 0.12 * far + 1e-8 * np.linalg.norm(smooth)


@pytest.mark.parametrize("kind", ["panel with a gap", "octahedra", "dome", "tsb1-pipe"])
def test_friction_of_zero_is_none(kind: str) -> None:
    problem = drawn(kind, np.random.default_rng(2))
    answers = [analyse(replace(problem, friction=mu)) for mu in (None, 0.0)]
    plain, zero = (answer.as_dict() | {"cpu_seconds": None, "work": None} for answer in answers)
    for data in (plain, zero):
        data["rows"] = [row for row in data["rows"] if row["group"] != "time"]
    assert json.dumps(plain) == json.dumps(zero)


@pytest.mark.parametrize("friction", [None, 0.0, 0.01, 0.3])
def test_what_edges_alone_hold_is_said_in_the_same_words_with_and_without_friction(
    friction: float | None,
) -> None:
    """A panel of tetrahedra with one missing falls by its faces: no friction makes it "locked"."""
    problem = drawn("panel with a gap", np.random.default_rng(0))
    problem = replace(problem, gravity=(0.0, 0.0, -9810.0), friction=friction)
    answer = analyse(problem)
    assert SAYS in answer.title
    assert SAYS in answer.details.words
    assert answer.as_dict()["mechanism"] == "activated"


def test_edges_that_spare_a_squeeze_are_said_to_change_the_verdict() -> None:
    """At 0.6 the panel is carried by faces if pressed beforehand, with edges it is carried."""
    problem = drawn("panel with a gap", np.random.default_rng(0))
    problem = replace(problem, gravity=(0.0, 0.0, -9810.0), friction=0.6)
    answer = analyse(problem)
    assert "if pressed beforehand (a hint, not proved)" in answer.title
    assert "with edges and corners: locked, carried" in answer.title
    beside = answer.parts["edges_and_corners"]
    assert isinstance(beside, EdgesAndCorners)
    assert "verdict: locked, carried" in beside.rows[0].words


def box(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    return np.array([np.where(at, high, low) for at in np.ndindex(2, 2, 2)], dtype=np.float64)


def on_the_edge(over: float) -> Assembly:
    """A bar of 400 mm on a table that ends so many mm before its middle."""
    table, bar = box((-500, 0, -100), (0, 100, 0)), box((over - 200, 0, 0), (over + 200, 100, 100))
    blocks = [convex_polyhedron(n, c) for n, c in (("table", table), ("bar", bar))]
    return Assembly.from_blocks(blocks, names=["table", "bar"], fixed=["table"])


@pytest.mark.parametrize("friction", [None, 0.6])
def test_a_bar_that_tips_is_named_with_its_way(friction: float | None) -> None:
    """About the edge of the table, with y from the reader: its middle is 10 mm beyond."""
    problem = Problem(
        on_the_edge(10.0), None, concrete, friction=friction, gravity=(0.0, 0.0, -9810.0)
    )
    answer = analyse(problem)
    (moved,) = answer.as_dict()["motion"]["blocks"]
    assert answer.as_dict()["motion"]["proved"]
    assert moved["block"] == 1
    assert "block 1 (bar) moves most" in answer.title
    assert "turns about y" in answer.title


def test_a_limit_load_where_the_dead_load_falls_is_none_with_the_whole_verdict(
    tmp_path: Path,
) -> None:
    """The arch is thinner than 0.1075 of its radius; the live load changes nothing."""
    words = ["block.thickness=90.0", "rigid.collapse=true", "load.acceleration=[98.1,0,0]"]
    settings = set_words(words)
    status, out, err = command("mbd", "arch", *settings, "-o", str(tmp_path))
    assert status == 0, err
    assert "not carried with friction" in out
    assert "none: the dead load alone is not carried" in out
    assert "blocks that move most" in out
    assert (tmp_path / "mechanism.png").exists()
