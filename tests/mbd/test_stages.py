"""Laws of the stages of a construction; programs of the tests' own are beside them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fem import CoulombFriction, Problem, concrete
from geometry.families.masonry import CircularArch
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from mbd import analyse, stages, take_out
from mbd.building.stages import Stands
from mbd.options import Along, Stages
from tests.support.assemblies import boxes
from tests.support.coarse_tubes import ring
from tests.support.dome import hemisphere

#: Gravity times density of concrete [N/mm³].
WEIGHT = 9810.0 * concrete.density
NONE, HOLDS = 1e-6, 1e-6


def problem(blocks: Any, friction: float | None) -> Problem:
    coulomb = None if friction is None else CoulombFriction(friction)
    return Problem(blocks, None, concrete, friction=coulomb, gravity=(0.0, 0.0, -9810.0))


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
def test_a_stack_needs_no_props() -> None:
    stack = boxes(*(((0, 0, 60 * k), (200, 100, 60 * k + 60)) for k in range(4)), fixed=1)
    found = stages(problem(stack, 0.6), [1, 2, 3])
    assert [stage.stands for stage in found] == [Stands.STANDS] * 3
    check_laws(problem(stack, 0.6), found)


@pytest.mark.quick
@pytest.mark.parametrize("reach", [0.999, 1.02])
def test_a_corbel_stands_at_each_stage_up_to_the_harmonic_overhang(reach: float) -> None:
    """Bricks of length L, offset by L / 2k below the k-th from the top, stand just so.

    Beyond, a prop at the far corner of the highest brick has the longest arm about the ends of all
    below: the joint that lacks most decides.
    """
    n, length = 5, 200.0
    starts = np.concatenate([[0.0], np.cumsum(reach * length / 2.0 / np.arange(n, 0, -1))])
    low = [(x, 0.0, 60.0 * k) for k, x in enumerate(starts)]
    corbel = boxes(*(((x, y, z), (x + length, y + 100.0, z + 60.0)) for x, y, z in low), fixed=1)
    brick, found = WEIGHT * length * 100.0 * 60.0, stages(problem(corbel, 0.5), [1, 2, 3, 4, 5])
    check_laws(problem(corbel, 0.5), found)
    for stage in found:
        top, needed = stage.number, 0.0
        for below in range(top):
            end = starts[below] + length
            moment = brick * (starts[below + 1 : top + 1] + length / 2.0 - end).sum()
            needed = max(needed, moment / (starts[top] + length - end))
        assert stage.propping == pytest.approx(needed, abs=NONE * n * brick)
        assert (needed > 0.0) == (reach > 1.0 and top == n)


@pytest.mark.quick
def test_only_blocks_that_may_be_propped_are_and_the_least_of_any_is_less() -> None:
    blocks = CircularArch(1000.0, 150.0, 300.0, 7).build(pieces=1)
    placed, given = [1, 7, 2, 6, 3, 5, 4], problem(blocks, 0.6)
    any_, some = (
        stages(given, Stages(order=placed, along=Along.NORMAL, props=props))
        for props in (None, (3, 5))
    )
    assert any(stage.propped for stage in some)
    for free, stage in zip(any_, some, strict=True):
        assert set(stage.propped) <= {3, 5}
        held = stage.stands is not Stands.FALLS
        assert not held or free.propping <= stage.propping + NONE * -stage.weight[2]


@pytest.mark.quick
def test_the_order_that_is_found_is_that_of_taking_out_in_reverse() -> None:
    given = problem(CircularArch(1000.0, 150.0, 300.0, 5).build(pieces=1), 0.6)
    found = stages(given, "found")
    assert tuple(stage.new for stage in found) == take_out(given.rigid_blocks).assembly_order
    assert not any(stage.blocked for stage in found)


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
    dome = hemisphere(0.15, 8, 4)
    given = problem(dome, 0.7)
    found = stages(given, Stages(order="layers", along=Along.NORMAL))
    assert len(found) == 4
    assert not any(stage.blocked for stage in found)
    check_laws(given, found)


@pytest.mark.quick
def test_a_tube_goes_together_layer_by_layer() -> None:
    """The last stage is the upper end ring; without it the rings come out from above."""
    given = problem(ring(3, (12, 2, 4)), None)
    found = stages(given, "layers")
    assert [len(stage.new) for stage in found] == [4, 4, 4, 4]
    assert not any(stage.blocked for stage in found)
    assert all(stage.stands is Stands.STANDS for stage in found)
    assert found[3].answer.details.mechanism == analyse(given).details.mechanism
