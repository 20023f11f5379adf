"""Misuse from Python ends in the package's own errors, which say what was expected."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fem import Problem, concrete, solve_explicit, solve_static
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
        ({"layers": 1.5}, r"layers: got 1\.5, expected a whole number"),
        ({"layers": 2.0}, r"layers: got 2\.0, expected a whole number"),
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
    with pytest.raises(RefusedError, match=r"load\.pressure: got .* a finite number of MPa"):
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
            analyse(*arguments)  # type: ignore[arg-type]
    assert analyse(blocks, load).details.equilibrium.holds


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
