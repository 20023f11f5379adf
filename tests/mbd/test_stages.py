"""Stages of construction beside linear programs and sums of the tests' own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from fem import CoulombFriction, Problem, concrete
from geometry import SineBlock, tube
from geometry.errors import RefusedError
from geometry.families.masonry import CircularArch
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from mbd import analyse, stages
from mbd.building.stages import StagesError, Stands
from mbd.options import Along, Stages
from tests.support.assemblies import boxes
from tests.support.dome import hemisphere
from tests.support.limit_programs import Lune, arch

#: Gravity times density of concrete [N/mm³].
WEIGHT = 9810.0 * concrete.density
NONE, HOLDS = 1e-6, 1e-6


def problem(blocks: Any, friction: float | None) -> Problem:
    coulomb = None if friction is None else CoulombFriction(friction)
    return Problem(blocks, None, concrete, friction=coulomb, gravity=(0.0, 0.0, -9810.0))


def least_propping(lune: Lune, there: list[int], friction: float) -> float:
    """Of voussoirs (weights one over the volume) on a centering, by a program of the plane.

    Forces: two ends of each joint between what is there and the ground, one shear of each, and two
    ends of the chord inside of each voussoir, along its normal.
    """
    place = {voussoir: 2 * k for k, voussoir in enumerate(there)}
    columns: list[np.ndarray] = []
    cost, sheared = [], []

    def acts(force: np.ndarray, at: np.ndarray, voussoir: int) -> np.ndarray:
        column = np.zeros(3 * len(there))
        if voussoir in place:
            k = 3 * place[voussoir] // 2
            arm = at - lune.weights[voussoir][1]
            column[k : k + 2], column[k + 2] = force, arm[0] * force[1] - arm[1] * force[0]
        return column

    for joint in lune.joints:
        sides = {joint.first, joint.second}
        if not (sides & set(there)) or sides - set(there) - {-1}:
            continue
        normal, across = joint.normal, np.array([-joint.normal[1], joint.normal[0]])
        pressed = []
        for end in joint.ends:
            pressed.append(len(columns))
            pair = acts(normal, end, joint.second) + acts(-normal, end, joint.first)
            columns.append(pair)
            cost.append(0.0)
        sheared.append((len(columns), pressed))
        pair = acts(across, joint.ends[0], joint.second) + acts(-across, joint.ends[0], joint.first)
        columns.append(pair)
        cost.append(0.0)
    free = {k for k, _ in sheared}
    for voussoir in there:
        inside = [lune.joints[voussoir].ends[0], lune.joints[voussoir + 1].ends[0]]
        chord = inside[1] - inside[0]
        normal = np.array([-chord[1], chord[0]]) / np.hypot(*chord)
        normal *= np.sign(normal @ lune.weights[voussoir][1])
        for end in inside:
            columns.append(acts(normal, end, voussoir))
            cost.append(normal[1])
    load = np.zeros(3 * len(there))
    for voussoir, k in place.items():
        load[3 * k // 2 + 1] = -lune.weights[voussoir][0]
    rows = []
    for shear, pressed in sheared:
        for way in (1.0, -1.0):
            row = np.zeros(len(columns))
            row[shear], row[pressed] = way, -friction
            rows.append(row)
    bounds = [(None, None) if k in free else (0.0, None) for k in range(len(columns))]
    found = linprog(
        cost,
        A_ub=rows,
        b_ub=np.zeros(len(rows)),
        A_eq=np.array(columns).T,
        b_eq=-load,
        bounds=bounds,
    )
    assert found.status == 0
    return float(found.fun)


@pytest.mark.quick
def test_an_arch_needs_its_centering_as_a_program_of_its_own_says() -> None:
    """Eleven voussoirs from both springings to the keystone: the same force at every stage."""
    n, friction, thickness = 11, 0.7, 0.15
    blocks = CircularArch(1000.0, 1000.0 * thickness, 300.0, n).build(pieces=1)
    order = [[k, n + 1 - k] if k < n + 1 - k else [k] for k in range(1, 7)]
    found = stages(problem(blocks, friction), Stages(order=order, along=Along.NORMAL))
    own = arch(thickness, n)
    scale = WEIGHT * 1000.0**2 * 300.0
    there: list[int] = []
    for stage, new in zip(found, order, strict=True):
        # Numbered from the right here, from the left there.
        there += [n - k for k in new]
        expected = scale * least_propping(own, sorted(there), friction)
        weight = -stage.weight[2]
        assert stage.propping == pytest.approx(expected, abs=NONE * weight)
        assert (stage.stands is Stands.PROPS) == (expected > NONE * weight)
    assert found[0].stands is Stands.STANDS
    assert found[-2].stands is Stands.PROPS
    assert found[-1].stands is Stands.STANDS


def check_laws(given: Problem, found: Any) -> None:
    """Balance of what is placed, and the last stage is the problem's own verdict."""
    for stage in found:
        assert stage.residual <= HOLDS or np.isnan(stage.residual)
        weight = float(np.linalg.norm(stage.weight))
        assert (stage.stands is Stands.PROPS) == (stage.propping > NONE * weight)
        balanced = stage.answer.details.holds
        if stage.stands is not Stands.FALLS:
            assert balanced == (stage.propping <= NONE * weight)
    stands = found[-1].stands in {Stands.STANDS, Stands.PRESSED}
    assert analyse(given).details.holds == stands


@pytest.mark.quick
def test_a_stack_needs_no_props_and_an_overhang_one_prop_by_hand() -> None:
    """Bricks of 200 mm. Of a corbel the second one, whose centre of mass is 50 mm beyond the rim
    of the first, needs W · 50 / 150 at its far corner, 150 mm beyond; both together lean about the
    rim of the plinth."""
    stack = boxes(*(((0, 0, 60 * k), (200, 100, 60 * k + 60)) for k in range(4)), fixed=1)
    found = stages(problem(stack, 0.6), [1, 2, 3])
    assert [stage.stands for stage in found] == [Stands.STANDS] * 3
    check_laws(problem(stack, 0.6), found)
    corbel = boxes(
        ((0, 0, 0), (200, 100, 60)),
        ((75, 0, 60), (275, 100, 120)),
        ((225, 0, 120), (425, 100, 180)),
        fixed=1,
    )
    given = problem(corbel, 0.6)
    found = stages(given, [1, 2])
    check_laws(given, found)
    assert found[0].stands is Stands.STANDS
    weight = WEIGHT * 200 * 100 * 60
    # Either brick may be propped at its free corners: the far ones of the upper one have the
    # longest arm about the rim of the lower one, whose own joint must not open either.
    assert found[1].stands is Stands.PROPS
    upper = weight * 50.0 / 150.0
    lower = max(0.0, (weight * (325.0 + 175.0 - 2 * 200.0)) / (425.0 - 200.0))
    assert found[1].propping == pytest.approx(max(upper, lower), rel=1e-6)


@pytest.mark.quick
def test_more_friction_never_needs_more_props() -> None:
    blocks = CircularArch(1000.0, 150.0, 300.0, 7).build(pieces=1)
    order = Stages(order=[1, 7, 2, 6, 3, 5, 4], along=Along.NORMAL)
    before = None
    for friction in (0.2, 0.4, 0.8, 1.6):
        found = stages(problem(blocks, friction), order)
        now = np.array([stage.propping for stage in found])
        weight = np.array([-stage.weight[2] for stage in found])
        if before is not None:
            assert (now <= before + 10 * NONE * weight).all()
        before = now


def renumbered(blocks: PolyhedralAssembly, order: np.ndarray, turn: np.ndarray, size: float) -> Any:
    placed = [
        (
            replace(blocks.shape(k), points=size * blocks.shape(k).points),
            turn @ blocks.rotations[k],
            size * (turn @ blocks.translations[k]),
        )
        for k in order
    ]
    return polyhedral_assembly("again", placed, blocks.fixed[order])


@pytest.mark.quick
@pytest.mark.parametrize("along", list(Along))
def test_propping_does_not_depend_on_numbers_orientation_or_size(along: Along) -> None:
    """Nor do its shares, thrust and joint forces: least squares to 1e-11 are forces to 3e-6."""
    blocks = CircularArch(1000.0, 150.0, 300.0, 7).build(pieces=1)
    placed = [1, 2, 7, 3, 6, 5, 4]
    found = stages(problem(blocks, 0.6), Stages(order=placed, along=along))
    rng = np.random.default_rng(64)
    order = rng.permutation(blocks.n_blocks)
    place = np.argsort(order)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    other = renumbered(blocks, order, turn, 2.0)
    again = stages(
        problem(other, 0.6),
        Stages(order=place[placed].tolist(), along=along),
    )
    assert any(stage.propped for stage in found)
    for one, two in zip(found, again, strict=True):
        assert one.stands is two.stands
        close = 1e-5 * -two.weight[2]
        assert two.propping == pytest.approx(8.0 * one.propping, abs=close)
        assert two.props[place] == pytest.approx(8.0 * one.props @ turn.T, abs=close)
        assert two.thrust == pytest.approx(8.0 * one.thrust, abs=close)
        assert two.largest_force == pytest.approx(8.0 * one.largest_force, abs=close)


def test_a_dome_rises_ring_by_ring_as_it_is_judged_whole() -> None:
    """A ring that is closed stands without centering; the rest is the verdict of the whole."""
    dome = hemisphere(0.15, 12, 5)
    given = problem(dome, 0.7)
    found = stages(given, Stages(order="layers", along=Along.NORMAL))
    assert len(found) == 5
    assert not any(stage.blocked for stage in found)
    check_laws(given, found)


@pytest.mark.quick
def test_a_tube_goes_together_layer_by_layer() -> None:
    """The last stage is the upper end ring; without it the rings come out from above."""
    block = SineBlock(
        height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
    )
    given = problem(tube(block, layers=3, mesh=(12, 2, 4)), None)
    found = stages(given, "layers")
    assert [len(stage.new) for stage in found] == [4, 4, 4, 4]
    assert not any(stage.blocked for stage in found)
    assert all(stage.stands is Stands.STANDS for stage in found)
    assert found[3].answer.details.mechanism == analyse(given).details.mechanism


@pytest.mark.quick
@pytest.mark.parametrize(
    ("order", "words"),
    [
        ([1, 2], "stages.order: block 3 is in no stage; expected every free block once"),
        ([1, 2, 2, 3], "stages.order: got block 2 twice; expected each once"),
        ([1, 2, 7, 3], "got block 7, but there are 4 blocks"),
        ([1, [], 2, 3], "stages.order: got a stage without blocks"),
        ("upwards", "expected a list of blocks by number or name"),
        (Stages(order=[3, 1, 2], props=[1]), "block 3 is placed where it touches nothing"),
    ],
)
def test_an_order_that_cannot_be_followed_is_one_line(order: Any, words: str) -> None:
    stack = boxes(*(((0, 0, 60 * k), (200, 100, 60 * k + 60)) for k in range(4)), fixed=1)
    with pytest.raises(RefusedError, match=words[:60]):
        stages(problem(stack, 0.6), order)
    with pytest.raises(StagesError, match="no weight"):
        stages(Problem(stack, None, concrete), "layers")
