"""Every built-in scene and many robustness cases from other points of view: far away, turned, in
metres, renumbered. Classes, verdicts and numbers are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from fem import ExponentialLaw, Material, Problem, Static, concrete, solve_static
from geometry import (
    Assembly,
    CircularArch,
    LoadCase,
    OctahedraLayer,
    PolyhedralAssembly,
    RunningBondWall,
    TetrahedraLayer,
)
from mbd import analyse
from tests.support.views import VIEWS, View, seen, seen_load
from validation import builtin_names, load_case, solve
from validation.stability.problems import CONCRETE, relative_difference, tsb1_tube
from validation.stability.rigid import TUBES, piped

_HERE = View("here")
#: Specific weight of assemblies that come without a load, along a direction like no other [N/mm³].
_WEIGHT = 2.4e-9 * 9810.0 * np.array([0.3, -0.2, -1.0])

#: An assembly, its load, and the friction that is asked for.
Subject = tuple[Assembly | PolyhedralAssembly, LoadCase, float | None]


@dataclass(frozen=True)
class _Answer:
    words: tuple[object, ...]
    """Classes, verdicts and counts: the same from everywhere, or not."""
    numbers: dict[str, np.ndarray]
    """Numbers by block, in their order in the original."""


def _by_original(values: np.ndarray, view: View) -> np.ndarray:
    """Values of blocks, (n_blocks, …), in the order of the original."""
    old = np.empty_like(values)
    old[view.order(len(values))] = values
    return old


def _by_block(blocks: np.ndarray, forces: np.ndarray, n_blocks: int, view: View) -> np.ndarray:
    """Sizes of forces of contacts (n, 3), summed by block of the original, (n_blocks,) [N]."""
    total, sizes = np.zeros(n_blocks), np.linalg.norm(forces, axis=1)
    for side in blocks.T:
        np.add.at(total, side, sizes)
    return _by_original(total, view)


def _rigid_answer(subject: Subject, view: View) -> _Answer:
    built, stated, friction = subject
    assembly = seen(built, view)
    load = seen_load(stated, assembly, view)
    result = analyse(assembly, load=load).details
    balance, faces = result.equilibrium, assembly.interfaces
    blocks = np.column_stack([faces.block_m, faces.block_s])[result.contact_index]
    classes = (str(result.mechanism), str(result.supported_classification.mechanism))
    words: tuple[object, ...] = (*classes, balance.holds, result.n_contacts)
    # What cannot be carried has no forces; how much of the load cannot is as unique as they are.
    numbers = {"residual": np.array([balance.residual])}
    if balance.holds:
        numbers = {"forces": _by_block(blocks, result.forces, assembly.n_blocks, view)}
    if friction is not None:
        given = Problem(assembly, load, concrete, friction=friction, check_units=False)
        rubbing = analyse(given).details
        words = (*words, rubbing.holds)
        if rubbing.holds:
            numbers["friction"] = _by_block(blocks, rubbing.forces, assembly.n_blocks, view)
    return _Answer(words, numbers)


#: Bounds on relative differences. Forces of least norm are unique; corners 1e6 mm away are rounded
#: to 1e-10 mm, 1e-12 of a block, which the condition of the pressing contacts multiplies. The cone
#: program of friction stops within 1e-11 of the least ½‖x‖² of a unit load: its forces are within
#: the root of twice that.
_BOUNDS = {"forces": 1e-9, "residual": 1e-9, "friction": 5e-6}


def _bound(name: str, view: View, size: float) -> float:
    """Bound of one number; gaps are off by what corners so far away are rounded to.

    Displacements follow them; the law presses e times as much after its c0.
    """
    if name in _BOUNDS:
        return _BOUNDS[name]
    length = size if name == "displacements" else ExponentialLaw().clearance_at_zero_pressure
    return 1e-9 + 4.0 * float(np.spacing(view.offset)) / length


def _same_from_everywhere(
    answer: Callable[[View], _Answer], views: tuple[View, ...] = VIEWS
) -> None:
    base = answer(_HERE)
    for view in views:
        found = answer(view)
        assert found.words == base.words, view.name
        for name, expected in base.numbers.items():
            apart = relative_difference(found.numbers[name], expected)
            bound = _bound(name, view, float(np.abs(expected).max()))
            assert apart <= bound, (view.name, name)


def _weighed(assembly: PolyhedralAssembly, friction: float | None = 0.6) -> Subject:
    """Blocks under a weight along z, or askew where friction is not asked for."""
    weight = _WEIGHT if friction is None else _WEIGHT * np.array([0.0, 0.0, 1.0])
    dead = np.zeros((assembly.n_blocks, 6))
    dead[:, :3] = assembly.volumes[:, None] * weight
    return assembly, LoadCase(assembly, "weight", (), assembly.fixed, body_wrenches=dead), friction


def _scene(name: str) -> Subject:
    """Blocks, load and friction of a built-in scene on a coarse mesh."""
    case = load_case(name, method="rigid")
    layers = getattr(getattr(case.scene, "assembly", None), "layers", 0)
    if layers > 2:
        case = case.changed({"assembly.layers": 2})
    result = solve(case.coarser(0.2) or case).details
    wrenches, blocks = result.load.wrenches, result.blocks
    if not wrenches.any():
        return _weighed(blocks, None)
    # Regions of surfaces do not turn with the blocks: what acts there is given block by block.
    load = LoadCase(blocks, "loads", (), result.load.fixed, body_wrenches=wrenches)
    friction = None if result.coulomb is None else result.coulomb.coefficient
    return blocks, load, friction


def _tube(build: Callable[[], Assembly]) -> Subject:
    assembly = build()
    return assembly, piped(assembly), None


_FRICTION: dict[str, Callable[[], PolyhedralAssembly]] = {
    "arch-that-stands": lambda: CircularArch(1000.0, 200.0, 200.0, 7, embrace=140.0).build(),
    "arch-too-thin": lambda: CircularArch(1000.0, 100.0, 300.0, 16).build(pieces=1),
    "wall-with-friction": lambda: RunningBondWall((240.0, 115.0, 71.0), 3, 3).build(),
    "tetrahedra-with-friction": lambda: TetrahedraLayer(100.0, 2, 2).build(),
    "octahedra-with-friction": lambda: OctahedraLayer(80.0, 1).build(),
}
_RIGID: dict[str, Callable[[], Subject]] = {
    **{
        f"view-{name}": partial(_scene, name)
        for name in builtin_names()
        if (scene := load_case(name).scene).block.type != "box"
        and not scene.moves
        and not any(support.spring for support in scene.supports)
    },
    # layers-200: six CPU seconds for what two layers show.
    **{f"view-{k}": partial(_tube, b) for k, (_, b) in TUBES.items() if k != "layers-200"},
    **{f"view-{name}": lambda b=blocks: _weighed(b()) for name, blocks in _FRICTION.items()},
}


@pytest.mark.parametrize("name", _RIGID)
def test_rigid_blocks_are_the_same_from_everywhere(name: str) -> None:
    _same_from_everywhere(partial(_rigid_answer, _RIGID[name]()))


@pytest.mark.parametrize(
    "view",
    [
        pytest.param(View("metres", scale=1e-3), id="units-metre-rigid"),
        pytest.param(View("inches", scale=1.0 / 25.4), id="units-inch-rigid"),
        pytest.param(View("away", offset=1e6), id="offset-1e6-mm-rigid"),
    ],
)
def test_a_tube_is_the_same_in_other_units_and_far_away(view: View) -> None:
    _same_from_everywhere(partial(_rigid_answer, _tube(tsb1_tube)), (view,))


def _static_answer(build: Callable[[], tuple[Assembly, LoadCase, Material]], view: View) -> _Answer:
    """Static state in the units of the view, told in those of the original."""
    built, stated, material = build()
    scale = view.scale
    law = ExponentialLaw()
    there = seen(built, view)
    answer = solve_static(
        Problem(
            there,
            seen_load(stated, there, view),
            # Forces in N and times in s stay: stresses go with 1/scale², masses with 1/scale.
            Material(
                density=material.density / scale**4,
                young_modulus=material.young_modulus / scale**2,
                poisson_ratio=material.poisson_ratio,
            ),
            law=ExponentialLaw(
                law.clearance_at_zero_pressure * scale, law.pressure_at_zero_clearance / scale**2
            ),
            check_units=False,
        ),
        Static(mesh="scene", symmetry="none", error_estimate=False),
    )
    moved = np.zeros((there.n_blocks, 3))
    there_moved = np.abs(answer.fields["displacement"] @ view.turn) / scale
    np.maximum.at(moved, answer.block_of_point, there_moved)
    contacts = answer.contacts
    pressing = _by_block(contacts["blocks"], contacts["force"], there.n_blocks, view)
    numbers = {"displacements": _by_original(moved, view), "pressing": pressing}
    return _Answer((), numbers)


def _static_scene(name: str) -> tuple[Assembly, LoadCase, Material]:
    assembly, load, _ = _scene(name)
    assert isinstance(assembly, Assembly)
    return assembly, load, CONCRETE


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("planar-sine", id="view-static-planar-sine"),
        pytest.param("tsb1-pipe", id="view-static-tsb1-pipe"),
        pytest.param("tsb2-tunnel", id="view-static-tsb2-tunnel", marks=pytest.mark.thorough),
    ],
)
def test_deformable_blocks_are_the_same_from_everywhere(name: str) -> None:
    _same_from_everywhere(partial(_static_answer, partial(_static_scene, name)))
