"""Misuse from Python ends in the package's own errors, which say what was expected."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

import validation
from fem import (
    CoulombFriction,
    ExponentialLaw,
    LinearPenalty,
    Material,
    Problem,
    Static,
    concrete,
    solve_explicit,
    solve_static,
    write_deck,
)
from fem.static.solve import StaticOptions
from geometry import SineBlock, pipe, tube
from geometry.errors import RefusedError
from mbd import analyse

SHAPE = SineBlock(
    height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
)


def built(**changed: Any) -> Any:
    return tube(**{"block": SHAPE, "layers": 1, "mesh": (12, 1, 2)} | changed)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"layers": 1.5}, r"layers: got 1\.5; expected a whole number"),
        ({"layers": 2.0}, r"layers: got 2\.0; expected a whole number"),
        ({"layers": True}, "layers: got True"),
        ({"layers": "2"}, "layers: got '2'"),
        ({"layers": 0}, "layers: got 0"),
        ({"mesh": 12}, r"mesh: got 12, expected 3 numbers of elements, such as \(24, 2, 4\)"),
        ({"mesh": (12, 1.5, 2)}, "mesh: got .* expected 3 numbers"),
        ({"mesh": (12, 1)}, "mesh: got .* expected 3 numbers"),
        ({"block": None}, "block: got NoneType, expected a SineBlock"),
    ],
)
def test_tubes(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        built(**changed)


@pytest.mark.parametrize("pressure", ["0.01", None, True, [0.01], float("nan")])
def test_loads(pressure: Any) -> None:
    with pytest.raises(RefusedError, match=r"^pressure: got .* a finite number of MPa"):
        pipe(pressure)


def test_arrays_of_other_shapes_and_kinds() -> None:
    blocks = built()
    n = blocks.n_blocks
    for what, values in (
        ("fixed", np.arange(n)),
        ("fixed", blocks.fixed[:-1]),
        ("fixed", [0, 1]),
        ("rotations", blocks.rotations[:, 0]),
        ("rotations", blocks.rotations[:-1]),
        ("translations", blocks.translations[:, :2]),
        ("translations", blocks.translations.astype(str)),
        ("shape_of", blocks.shape_of.astype(np.float64)),
    ):
        with pytest.raises(RefusedError, match=f"{what}: got .* expected .* of shape"):
            replace(blocks, **{what: values})
    with pytest.raises(RefusedError, match="fixed: got int64"):
        replace(pipe(0.01).on(blocks), fixed=np.flatnonzero(blocks.fixed))


def test_analyses() -> None:
    blocks = built()
    load = pipe(0.01).on(blocks)
    for arguments, words in (
        ((None,), "a NoneType"),
        ((blocks,), "blocks without a load case"),
        ((blocks, pipe(0.01)), "a Load"),
        ((load, blocks), "a LoadCase and a"),
        (("tsb1-pipe", load), "a str"),
    ):
        with pytest.raises(RefusedError, match=f"analyse: got .*{words}.*expected"):
            analyse(arguments[0], load=arguments[1] if arguments[1:] else None)  # type: ignore[arg-type]
    assert analyse(blocks, load=load).details.equilibrium.holds


@pytest.mark.parametrize(
    "changed",
    [
        {"blocks": None},
        {"load": 0.01},
        {"material": "concrete"},
        {"friction": "0.3"},
        {"friction": True},
        {"clearance": "0.1"},
        {"spacing": None},
        {"gravity": "down"},
        {"gravity": 9810.0},
    ],
)
def test_problems(changed: dict[str, Any]) -> None:
    right = {"blocks": built(), "load": pipe(0.01), "material": concrete}
    name = next(iter(changed))
    with pytest.raises(RefusedError, match=f"{name}: got "):
        Problem(**right | changed)
    Problem(**right)


@pytest.mark.parametrize("solve", [solve_static, solve_explicit])
def test_solvers(solve: Any) -> None:
    for wrong in (None, built(), "tsb1-pipe"):
        with pytest.raises(RefusedError, match=r"problem: got a .* expected Problem"):
            solve(wrong)


@pytest.mark.parametrize("wrong", ["1", None, True, float("nan")])
@pytest.mark.parametrize(
    ("kind", "right", "name", "words"),
    [
        (Material, {"density": 2.4e-9, "young_modulus": 3e4, "poisson_ratio": 0.2}, None, ""),
        (
            CoulombFriction,
            {"coefficient": 0.3, "stick_stiffness": 50.0},
            None,
            "(coefficient|stick_stiffness): ",
        ),
        (LinearPenalty, {"stiffness_per_area": 1e3}, None, "contact.stiffness"),
        (ExponentialLaw, {"clearance_at_zero_pressure": 1e-3}, None, "contact."),
        (StaticOptions, {"tolerance": 1e-8}, None, "fem.tolerance"),
        (SineBlock, asdict(SHAPE), "height", "height"),
        (SineBlock, asdict(SHAPE), "amplitude", "amplitude"),
        (SineBlock, asdict(SHAPE), "frequency", "frequency"),
        (SineBlock, asdict(SHAPE), "shift", "shift"),
    ],
)
def test_numbers(
    kind: Any, right: dict[str, Any], name: str | None, words: str, wrong: Any
) -> None:
    for key in right if name is None else (name,):
        with pytest.raises(RefusedError, match=f"{words}.*got.*{wrong}.*expected"):
            kind(**right | {key: wrong})
    kind(**right)


def test_a_block_without_waves_is_answered_with_their_numbers() -> None:
    with pytest.raises(RefusedError, match="frequency: got 0; expected greater than 0"):
        replace(SHAPE, frequency=0)
    with pytest.raises(RefusedError, match=r"0\.4 waves .* expected 2 f whole: try 0\.5"):
        replace(SHAPE, frequency=0.2)


def test_what_is_no_answer_no_scene_and_no_problem() -> None:
    blocks, plane = built(), ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    for call in (
        lambda: validation.write(blocks, "nowhere"),
        lambda: validation.plot(blocks, "u"),
        lambda: validation.section(blocks, *plane),
        lambda: validation.compare(blocks, blocks),
    ):
        with pytest.raises(RefusedError, match="answer: got a Assembly; expected what solve"):
            call()
    for call in (lambda: validation.cost(blocks), lambda: validation.sweep(blocks, {})):
        with pytest.raises(RefusedError, match="case: got a Assembly; expected a name, a file"):
            call()
    with pytest.raises(RefusedError, match="problem: got a Assembly; expected Problem"):
        write_deck(blocks, "nowhere.inp")


@pytest.mark.parametrize("accuracy", [0.05, "p_max", {"p_max": "5%"}, {"p_max": True}, {"p": 0.1}])
def test_accuracies(accuracy: Any) -> None:
    problem = Problem(built(), pipe(0.01), concrete)
    with pytest.raises(RefusedError, match=r"accuracy: got .*; expected "):
        solve_static(problem, Static(accuracy=accuracy))
