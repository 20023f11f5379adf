"""Laws of mechanism classes: certificates multiply out, HiGHS agrees, nothing depends on units."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry import Assembly
from geometry.assembly import moved, renumbered
from geometry.families.masonry import RunningBondWall
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import LoadCase, named_load
from geometry.parts.balance import joint_wrenches
from geometry.parts.measures import joint_resultants
from mbd import MechanismClass, RigidSystem, analyse, contact_jacobian
from mbd.equilibrium import newton_equilibrium
from mbd.mechanism import Mechanism, SelfStress, classify
from mbd.system import placed_motion
from tests.support.blocks import random_rotation, tsb
from tests.support.linear_programs import solve_linear_programs
from tests.support.matrix_jacobian import as_jacobian

pytestmark = pytest.mark.quick


@given(seed=st.integers(0, 10_000), rows=st.integers(2, 8), extra=st.integers(-1, 30))
@settings(max_examples=60, deadline=None)
def test_class_agrees_with_the_linear_programs_and_the_certificate_multiplies_out(
    seed: int, rows: int, extra: int
) -> None:
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((rows, rows + extra))
    matrix /= np.linalg.norm(matrix, axis=0)
    load = rng.standard_normal(rows)
    found = classify(as_jacobian(matrix), load)
    assert found.mechanism is solve_linear_programs(as_jacobian(matrix), load).mechanism
    if isinstance(found.certificate, SelfStress):
        forces = found.certificate.forces
        assert forces.min() >= 1.0
        assert np.linalg.norm(matrix @ forces) < 1e-9 * np.linalg.norm(forces)
        assert np.linalg.matrix_rank(matrix) == rows
    else:
        assert isinstance(found.certificate, Mechanism)
        motion = found.certificate.virtual_displacement.ravel()
        assert np.linalg.norm(motion) == pytest.approx(1.0)
        assert (matrix.T @ motion).min() > -1e-9


@pytest.mark.parametrize(
    ("load", "expected"),
    [
        ([0.0, -1.0], MechanismClass.SUPPRESSED),
        ([0.0, 1.0], MechanismClass.ACTIVATED),
        ([0.3, 0.0], MechanismClass.NEUTRAL),
    ],
)
def test_block_on_a_floor_between_walls(load: list[float], expected: MechanismClass) -> None:
    # Plane, rows (x, z): floor pushes up, walls push left and right. Only rising is admissible.
    matrix = np.array([[0.0, 1.0, -1.0], [1.0, 0.0, 0.0]])
    assert classify(as_jacobian(matrix), np.array(load)).mechanism is expected


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_work_of_a_mechanism_is_over_the_load(size: float) -> None:
    """A load (-4, 3) presses on a wall and lifts from the floor: it moves along the wall by 3/5."""
    jacobian = as_jacobian(np.array([[0.0, 1.0], [1.0, 0.0]]))
    found = classify(jacobian, size * np.array([-4.0, 3.0]))
    assert found.mechanism is MechanismClass.ACTIVATED
    assert isinstance(found.certificate, Mechanism)
    assert found.certificate.work == pytest.approx(0.6, rel=1e-9)


@given(seed=st.integers(0, 10_000), rows=st.integers(2, 14), extra=st.integers(-1, 30))
@settings(max_examples=60, deadline=None)
def test_what_an_equilibrium_proves_gives_the_same_class(seed: int, rows: int, extra: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((rows, rows + extra))
    # Loads that contacts carry, and not: motions of single blocks are found for the first.
    forces = np.maximum(rng.standard_normal(rows + extra), 0.0)
    load = -matrix @ forces if seed % 2 else rng.standard_normal(rows)
    jacobian = as_jacobian(matrix)
    found = classify(jacobian, load, newton_equilibrium(jacobian, load), many=True)
    assert found.mechanism is classify(jacobian, load).mechanism
    if isinstance(found.certificate, Mechanism):
        motion = found.certificate.virtual_displacement.ravel()
        assert (matrix.T @ motion).min() >= -1e-9
        assert np.sign(found.certificate.work) == {"activated": 1, "suppressed": -1}.get(
            str(found.mechanism), 0
        )


def test_of_many_blocks_the_motion_of_one_proves_the_class() -> None:
    """Bricks under their weight: the first that can be lifted, and nothing closes as it moves."""
    wall = RunningBondWall((240.0, 115.0, 71.0), 10, 10).build()
    weight = np.zeros((wall.n_blocks, 6))
    weight[:, 2] = -wall.volumes
    load = LoadCase(wall, "weight", (), wall.fixed, body_wrenches=weight)
    found = analyse(wall, load=load).details.classification
    assert found.mechanism is MechanismClass.SUPPRESSED
    motion = found.certificate.virtual_displacement
    assert motion.any(axis=1).sum() == 1
    rates = contact_jacobian(wall).jacobian.gap_rates(motion.ravel())
    assert rates.min() >= -1e-12 * np.linalg.norm(motion)
    assert found.certificate.work < 0.0


def test_strictly_positive_self_stress_without_full_rank_is_not_locked() -> None:
    # Two opposed contacts in x: a self-stress exists, z is free.
    matrix = np.array([[1.0, -1.0], [0.0, 0.0]])
    found = classify(as_jacobian(matrix), np.array([1.0, 0.0]))
    assert found.mechanism is MechanismClass.NEUTRAL
    assert isinstance(found.certificate, Mechanism)
    np.testing.assert_allclose(np.abs(found.certificate.virtual_displacement.ravel()), [0, 1])


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_sine_tube_is_locked_and_the_linear_programs_agree(shift: float) -> None:
    tube = SineTube(tsb(shift), SineBlockDivisions(12, 2, 2), 2).build()
    contacts = contact_jacobian(tube)
    load = named_load("pipe", 0.01).on(tube)
    force = contacts.rows(load.wrenches)
    found = classify(contacts.jacobian, force)
    assert found.locked
    assert isinstance(found.certificate, SelfStress)
    matrix = contacts.jacobian.to_matrix()
    assert np.linalg.norm(matrix @ found.certificate.forces) < 1e-10 * np.linalg.norm(
        found.certificate.forces
    )
    assert found.certificate.forces.min() >= 1.0
    programs = solve_linear_programs(contacts.jacobian, force)
    assert programs.mechanism is MechanismClass.LOCKED
    # The bound of HiGHS' feasibility tolerance, 1e-7 for each of the contacts.
    assert programs.opening < 1e-7 * matrix.shape[1]


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("pipe", MechanismClass.ACTIVATED),
        ("tunnel", MechanismClass.SUPPRESSED),
        ("pillar", MechanismClass.NEUTRAL),
        ("beam", MechanismClass.ACTIVATED),
        ("shaft", MechanismClass.ACTIVATED),
    ],
)
def test_plain_tube_is_not_locked(case: str, expected: MechanismClass) -> None:
    tube = SineTube(tsb(amplitude=0.0), SineBlockDivisions(12, 2, 4), 3).build()
    result = analyse(tube, load=named_load(case, 0.01).on(tube)).details
    assert result.mechanism is expected


def test_released_top_frame_can_lift_and_the_load_opposes_it(small_tube: Assembly) -> None:
    result = analyse(small_tube, load=named_load("pillar", 0.01).on(small_tube)).details
    assert result.mechanism is MechanismClass.LOCKED
    assert result.supported_classification.mechanism is MechanismClass.SUPPRESSED


def test_activated_mechanism_multiplies_out() -> None:
    tube = SineTube(tsb(amplitude=0.0), SineBlockDivisions(12, 2, 4), 2).build()
    load = named_load("shaft", 0.01).on(tube)
    result = analyse(tube, load=load).details
    motion = result.equilibrium.mechanism
    assert motion is not None
    contacts = contact_jacobian(tube, load.fixed)
    force = contacts.rows(load.wrenches)
    matrix = contacts.jacobian.to_matrix()
    work = force @ motion / np.linalg.norm(force)
    assert work > 1e-3
    # The solver certifies gaps to 1e-10 of the work.
    assert (matrix.T @ motion).min() >= -1e-10 * work


# ---------------------------------------------------------------------------------------------
# Invariance


def scaled(tube_scale: float) -> Assembly:
    """The small tube in another unit of length."""
    parameters = tsb(
        height=200.0 * tube_scale,
        amplitude=20.0 * tube_scale,
        inner_radius=120.0 * tube_scale,
        thickness=40.0 * tube_scale,
    )
    return SineTube(parameters, SineBlockDivisions(24, 3, 6), 3).build()


def numbers(result: RigidSystem) -> np.ndarray:
    assert result.measures is not None
    return np.array(dataclasses.astuple(result.measures))


@pytest.mark.parametrize("case", ["pipe", "pillar", "beam", "shaft"])
def test_rotation_and_translation_leave_every_measure_unchanged(
    small_tube: Assembly, case: str
) -> None:
    there = moved(small_tube, random_rotation(7), np.array([300.0, -200.0, 50.0]))
    a = analyse(small_tube, load=named_load(case, 0.01).on(small_tube)).details
    b = analyse(there, load=named_load(case, 0.01).on(there)).details
    assert a.mechanism is b.mechanism
    np.testing.assert_allclose(numbers(b), numbers(a), rtol=1e-9)


@pytest.mark.parametrize("length_unit", [1e-3, 1 / 25.4])
@pytest.mark.parametrize("force_unit", [1.0, 1e-6])
def test_units_leave_every_measure_unchanged(length_unit: float, force_unit: float) -> None:
    # Pressure = force / length²: a scene in other units, its pressures converted back.
    a, b = scaled(1.0), scaled(length_unit)
    pressure_unit = force_unit / length_unit**2
    here = numbers(analyse(a, load=named_load("shaft", 0.01).on(a)).details)
    there = numbers(analyse(b, load=named_load("shaft", 0.01 * pressure_unit).on(b)).details)
    there[3:] /= pressure_unit  # three percentages, then pressures
    np.testing.assert_allclose(there, here, rtol=1e-9)


@given(seed=st.integers(0, 1000))
@settings(max_examples=5, deadline=None)
def test_renumbering_the_blocks_leaves_every_measure_unchanged(
    small_tube: Assembly, seed: int
) -> None:
    order = np.random.default_rng(seed).permutation(small_tube.n_blocks)
    other = renumbered(small_tube, order)
    a = numbers(analyse(small_tube, load=named_load("tunnel", 0.01).on(small_tube)).details)
    b = numbers(analyse(other, load=named_load("tunnel", 0.01).on(other)).details)
    np.testing.assert_allclose(b, a, rtol=1e-9)


def test_pressures_scale_with_the_load_from_tiny_to_huge(small_tube: Assembly) -> None:
    base = numbers(analyse(small_tube, load=named_load("pipe", 1.0).on(small_tube)).details)
    for factor in (1e-12, 1e9):
        found = numbers(analyse(small_tube, load=named_load("pipe", factor).on(small_tube)).details)
        np.testing.assert_allclose(found[:3], base[:3], rtol=1e-12)
        np.testing.assert_allclose(found[3:], factor * base[3:], rtol=1e-12)


def test_motions_of_placed_blocks_are_in_mm_and_in_radians(small_tube: Assembly) -> None:
    """Rows of a Jacobian have rotations times the length of the assembly; fixed blocks rest."""
    free = ~small_tube.fixed
    rows = np.arange(6.0 * free.sum()) + 1.0
    found, given = placed_motion(small_tube, rows, free), rows.reshape(-1, 6)
    length = small_tube.characteristic_length
    assert found[free] == pytest.approx(given / np.repeat([1.0, length], 3))
    assert (found[small_tube.fixed] == 0.0).all()


def test_contacts_push_both_blocks_by_one_force(small_tube: Assembly) -> None:
    """Any forces: action and reaction leave no force and no moment about the origin."""
    index = np.arange(small_tube.interfaces.n_contacts)
    forces = np.random.default_rng(4).standard_normal((len(index), 3))
    joints = joint_resultants(small_tube.interfaces, index, forces)
    wrench = joint_wrenches(small_tube, joints, small_tube.centroids)
    moment = wrench[:, 3:] + np.cross(small_tube.centroids, wrench[:, :3])
    assert np.abs(wrench[:, :3]).max() > 1.0
    assert np.abs(wrench[:, :3].sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()
    assert np.abs(moment.sum(axis=0)).max() < 1e-12 * np.abs(wrench).sum() * 500.0
