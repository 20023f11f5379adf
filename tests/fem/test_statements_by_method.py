"""Which method takes which statement: the cells of the manual's table; decks and CalculiX."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem import (
    Explicit,
    ExponentialLaw,
    LinearPenalty,
    PairLaws,
    Problem,
    concrete,
    solve_explicit,
    solve_static,
    write_deck,
)
from fem.decks.deck import Flavour
from fem.decks.keywords import DeckError
from fem.decks.problem import problem_deck
from fem.problem import Motion
from geometry import Answer, HeldFace, LineLoad, LoadCase, PressureLoad, RefusedError
from mbd import analyse
from tests.support.answers import PLAIN
from tests.support.ccx import calculix_available
from tests.support.supports import ONE, TWO, A, X, Y, Z, case, pulled, roller, side
from tests.verification.calculix import (
    calculix_of,
    calculix_through_converter,
    converter_available,
)

pytestmark = pytest.mark.quick

needs_ccx = pytest.mark.skipif(not calculix_available(), reason="CalculiX (ccx) is not installed")
needs_converter = pytest.mark.skipif(not converter_available(), reason="abq2ccx is not installed")

PAGE = Path(__file__).parents[2] / "docs" / "theory" / "loads.md"
METHODS = ("rigid", "static", "explicit", "Abaqus deck", "CalculiX deck")

#: A cube on a fixed one, guided by rollers, and pressed from above where nothing else is stated.
GUIDES = tuple(roller(TWO, 1, -axis) for axis in (X, Y))
PRESSED = pulled(TWO, 1, Z, -0.1 * Z)
TOP = TWO.centroids[1] + 0.5 * A * np.ones(3)
MIDDLE = LineLoad(np.array([1]), TOP - [A / 2, A, 0], TOP - [A / 2, 0, 0], -3.0 * Z)
OBLIQUE = HeldFace(1, side(TWO, 1, -X), np.array([[0.6, 0.8, 0.0]]))
TABLE = ((0.0, 0.0), (0.002, 0.5), (0.004, 1.0))
LAWS = PairLaws(ExponentialLaw(), ((0, 1, LinearPenalty(500.0)),))
BED = roller(TWO, 1, X, spring=2.0)


def _moved(**stated: Any) -> HeldFace:
    return roller(TWO, 1, Z, displacement=-0.01 * Z, **stated)


def _loaded(*held: HeldFace, faces: tuple[Any, ...] = (PRESSED,)) -> LoadCase:
    return case(TWO, faces, (*GUIDES, *held))


PUSH = np.array([[0.0] * 6, [0.0, 0.0, -100.0, 0.0, 50.0, 0.0]])
PRESSURE = PressureLoad(np.array([1]), side(TWO, 1, Z), 0.1)
TURNING = replace(PRESSURE, follows_block=True)
#: Load case and further parts of the problem.
STATEMENTS: dict[str, tuple[LoadCase, dict[str, Any]]] = {
    "roller: a support along a world axis": (_loaded(), {}),
    "support along an oblique direction": (case(TWO, [PRESSED], (OBLIQUE, GUIDES[1])), {}),
    "support that moves": (_loaded(_moved(), faces=()), {}),
    "support that moves by a table": (_loaded(_moved(path=TABLE), faces=()), {}),
    "support that moves, blocks that turn by any angle": (
        _loaded(_moved(), faces=()),
        {"finite_rotation": True},
    ),
    "springs below a face": (_loaded(BED), {}),
    "springs, blocks that turn by any angle": (_loaded(BED), {"finite_rotation": True}),
    "pressure on a region": (_loaded(faces=(PRESSURE,)), {}),
    "pressure that turns with its block, on a region": (_loaded(faces=(TURNING,)), {}),
    "traction on a region": (_loaded(), {}),
    "line load": (case(TWO, (), GUIDES, [MIDDLE]), {}),
    "force and moment on a block": (_loaded(faces=()).with_wrenches(PUSH), {}),
    "gravity": (_loaded(faces=()), {"gravity": (0.0, 0.0, -9810.0)}),
    "friction": (_loaded(), {"friction": 0.3}),
    "contact law of a pair": (_loaded(), {"law": LAWS}),
    "clearance": (_loaded(), {"clearance": 0.01}),
    "motion at time 0": (_loaded(), {"motion": Motion(-10.0 * Z, np.zeros(3))}),
}


def _explicit(problem: Problem) -> Answer:
    if problem.motion is None:
        return solve_explicit(problem, Explicit())
    return solve_explicit(problem, Explicit(damping="none", ramp_time=1e-4, end_time=2e-4))


def _deck(program: Any) -> Callable[[Problem, Path], Any]:
    return lambda problem, path: write_deck(problem, path / "case.inp", program=program)


CALLS: dict[str, Callable[[Problem, Path], Any]] = {
    "rigid": lambda problem, _: analyse(problem),
    "static": lambda problem, _: solve_static(problem, PLAIN),
    "explicit": lambda problem, _: _explicit(problem),
    "Abaqus deck": _deck("abaqus"),
    "CalculiX deck": _deck("calculix"),
}


def table() -> dict[tuple[str, str], str]:
    """Cells of the table in the manual by statement and method."""
    lines = PAGE.read_text("utf-8").partition("## Which method takes which statement")[2]
    rows = [line.strip("| ").split(" | ") for line in lines.splitlines() if line.startswith("| ")]
    assert tuple(rows[0][1:]) == METHODS
    return {
        (row[0], method): cell
        for row in rows[1:]
        for method, cell in zip(METHODS, row[1:], strict=True)
    }


def test_every_statement_has_its_row() -> None:
    assert set(table()) == {(name, method) for name in STATEMENTS for method in METHODS}


@pytest.mark.parametrize(("name", "method"), [(n, m) for n in STATEMENTS for m in METHODS])
def test_a_method_takes_a_statement_or_rejects_it_with_these_words(
    name: str, method: str, tmp_path: Path
) -> None:
    load, stated = STATEMENTS[name]
    cell = table()[name, method]
    if cell == "yes":
        answer = CALLS[method](Problem(TWO, load, concrete, **stated), tmp_path)
        if method == "rigid":
            assert answer.report["carried"]
        elif method in {"static", "explicit"}:
            moved = answer.fields["displacement"]
            assert np.isfinite(moved).all()
            assert np.abs(moved).max() > 0.0
        else:
            text = answer.read_text("ascii").upper()
            assert "*BOUNDARY" in text
            assert text.rstrip().endswith("*END STEP")
        return
    assert cell.startswith("no: ")
    with pytest.raises(RefusedError) as caught:
        CALLS[method](Problem(TWO, load, concrete, **stated), tmp_path)
    assert cell.removeprefix("no: ") in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("before", "words"),
    [
        ((_loaded(), {"finite_rotation": True}), "^finite_rotation: got True"),
        ((_loaded(faces=(TURNING,)), {}), "got a pressure that turns with its block"),
        ((_loaded(), {"motion": Motion(Z, np.zeros(3))}), "^motion: a static state has none"),
    ],
)
def test_statics_reject_in_a_problem_before_what_they_reject_in_the_last(
    before: tuple[LoadCase, dict[str, Any]], words: str
) -> None:
    load, stated = before
    last = Problem(TWO, _loaded(), concrete, after=Problem(TWO, load, concrete, **stated))
    with pytest.raises(RefusedError, match=words):
        solve_static(last, PLAIN)


#: A roller on three sides, tractions on a plane, a line load and a motion by a table.
HELD = (
    *(roller(ONE, 0, -axis) for axis in (X, Y, Z)),
    roller(ONE, 0, X, displacement=0.01 * X, path=((0, 0), (1, 0.3), (3, 1))),
)
CORNER = ONE.centroids[0] + 0.5 * A * np.ones(3)
EDGE = LineLoad(np.array([0]), CORNER - A * Y, CORNER, np.array([1.0, 0.0, -3.0]))
ALL_AT_ONCE = case(ONE, [pulled(ONE, 0, Y, 0.1 * Y)], HELD, [EDGE])


@needs_ccx
def test_calculix_computes_supports_and_loads_as_we_do(tmp_path: Path) -> None:
    """Displacements to the seven printed digits; the force of the roller that carries the motion.

    The sums of CalculiX count the loads on the nodes of a set: none acts at x = -A/2.
    """
    problem = Problem(ONE, ALL_AT_ONCE, concrete)
    static = solve_static(problem, PLAIN)
    ours, found = static.fields["displacement"], calculix_of(_calculix(problem), tmp_path)
    assert np.abs(found.displacements - ours).max() <= 1e-6 * np.abs(ours).max()
    reactions = static.report["reactions"]
    wall = reactions[HELD[0].title]["force"][0]
    assert found.reactions["L01-B01_X-MIN-NODES"][0] == pytest.approx(wall, rel=1e-6)
    total = sum(np.array(each["force"]) for each in reactions.values())
    np.testing.assert_allclose(total, [-A, -0.1 * A * A, 3.0 * A], atol=1e-6 * abs(wall))


def _calculix(problem: Problem) -> Any:
    return problem_deck(problem, Flavour.CALCULIX)


@needs_ccx
@needs_converter
def test_the_deck_of_abaqus_is_the_same_problem(tmp_path: Path) -> None:
    """Instances, node sets and amplitudes, expanded by a converter of Abaqus decks."""
    problem = Problem(ONE, ALL_AT_ONCE, concrete)
    ours = solve_static(problem, PLAIN).fields["displacement"]
    found = calculix_through_converter(problem_deck(problem, Flavour.STANDARD), tmp_path)
    assert np.abs(found.displacements - ours).max() <= 1e-6 * np.abs(ours).max()


@needs_ccx
def test_a_block_sinks_into_springs_at_nodes_by_the_closed_form(tmp_path: Path) -> None:
    """A uniform state, u = p / k at the bottom: springs at nodes are exact there."""
    bed, pressed = roller(ONE, 0, -Z, spring=2.0), pulled(ONE, 0, Z, -0.5 * Z)
    load = case(ONE, [pressed], (*HELD[:2], bed))
    found = calculix_of(_calculix(Problem(ONE, load, concrete)), tmp_path).displacements
    bottom = np.isclose(ONE.nodes(0)[:, 2], ONE.nodes(0)[:, 2].min())
    np.testing.assert_allclose(found[bottom, 2], -0.5 / 2.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "program", "words"),
    [
        ({"held": (*HELD[:2], roller(ONE, 0, -Z, spring=2.0))}, "abaqus-explicit", "got springs"),
        (
            {"faces": (PressureLoad(np.array([0]), side(ONE, 0, Z), 0.1, follows_block=True),)},
            "calculix",
            "got a pressure that turns with its block on a region",
        ),
    ],
)
def test_what_only_some_decks_have_is_rejected(
    changes: dict[str, Any], program: Any, words: str, tmp_path: Path
) -> None:
    problem = Problem(ONE, replace(ALL_AT_ONCE, **changes), concrete)
    with pytest.raises(DeckError, match=words):
        write_deck(problem, tmp_path / "case.inp", program=program)
    assert not list(tmp_path.iterdir())
