"""Laws of rigid equilibrium: two solvers agree, certificates multiply out, closed forms hold."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry import Assembly
from geometry.assembly import moved
from geometry.block import Block
from geometry.families.boxes import BrickStack
from geometry.families.masonry import wall_of_rows
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import LoadCase, named_load
from geometry.mesh import HexMesh, grid_faces, structured_hexahedra
from mbd import Norm, Rigid, Solver, analyse, contact_jacobian
from mbd.equilibrium import column_weights, equilibrium, newton_equilibrium
from tests.support.blocks import random_rotation, tsb
from tests.support.matrix_jacobian import as_jacobian

pytestmark = pytest.mark.quick

by_cones = partial(equilibrium, solver=Solver.CLARABEL)


def random_jacobian(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    matrix = rng.standard_normal((rows, columns))
    return matrix / np.linalg.norm(matrix, axis=0)


@given(seed=st.integers(0, 10_000), rows=st.integers(2, 12), extra=st.integers(0, 60))
@settings(max_examples=60, deadline=None)
def test_newton_and_clarabel_find_the_same_forces(seed: int, rows: int, extra: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = random_jacobian(rng, rows, rows + extra)
    forces = np.maximum(rng.standard_normal(rows + extra), 0.0)
    load = -matrix @ forces
    ours, other = (
        newton_equilibrium(as_jacobian(matrix), load),
        by_cones(as_jacobian(matrix), load),
    )
    assert ours.holds
    assert ours.residual < 1e-9
    assert ours.forces.min(initial=0.0) >= 0.0
    assert other.holds
    # The minimum-norm force is unique; clarabel stops at 1e-12 of the objective, which is the
    # square of the distance: 1e-6.
    size = max(np.linalg.norm(ours.forces), 1e-300)
    assert np.linalg.norm(ours.forces - other.forces) < 1e-5 * size
    assert np.linalg.norm(ours.forces) <= np.linalg.norm(forces) * (1 + 1e-9)


@given(seed=st.integers(0, 10_000), rows=st.integers(2, 12), extra=st.integers(-1, 60))
@settings(max_examples=60, deadline=None)
def test_infeasible_loads_come_with_a_mechanism_that_multiplies_out(
    seed: int, rows: int, extra: int
) -> None:
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(rows)
    matrix = random_jacobian(rng, rows, rows + extra)
    matrix *= np.sign(direction @ matrix)  # the direction opens every contact …
    load = rng.standard_normal(rows)
    # … and the load drives it: its work along the direction is a tenth of the largest possible.
    unit = direction / np.linalg.norm(direction)
    load += (0.1 * np.linalg.norm(load) - load @ unit) * unit
    for result in (
        newton_equilibrium(as_jacobian(matrix), load),
        by_cones(as_jacobian(matrix), load),
    ):
        assert not result.holds
        assert result.mechanism is not None
        work = load @ result.mechanism / np.linalg.norm(load)
        closing = -min((matrix.T @ result.mechanism).min(), 0.0)
        assert work > 1e-7
        # Newton's ray is polished to 1e-10 of the work; clarabel's comes from a projection
        # solved to 1e-8.
        assert closing < 1e-6 * work


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_optimality_conditions_of_the_minimum_norm(seed: int) -> None:
    # λ is optimal if and only if λ = max(0, Gᵀy) for some y: complementarity, no tolerance but
    # round-off of one product.
    rng = np.random.default_rng(seed)
    matrix = random_jacobian(rng, 6, 40)
    load = -matrix @ rng.uniform(0, 1, 40)
    result = newton_equilibrium(as_jacobian(matrix), load)
    expected = np.maximum(matrix.T @ result.multiplier, 0.0)
    np.testing.assert_allclose(result.forces, expected, atol=1e-12 * expected.max())


def test_rank_deficient_and_duplicated_contacts_are_no_obstacle() -> None:
    # Twelve copies of two opposed contacts: rank 1 of 6; the force spreads evenly.
    column = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    matrix = np.column_stack([column] * 12 + [-column] * 12)
    result = newton_equilibrium(as_jacobian(matrix), np.array([0, 0, -6.0, 0, 0, 0]))
    assert result.holds
    np.testing.assert_allclose(result.forces[:12], 0.5, rtol=1e-11)
    np.testing.assert_allclose(result.forces[12:], 0.0)


def test_no_load_and_no_contacts() -> None:
    matrix = np.eye(6, 4)
    assert newton_equilibrium(as_jacobian(matrix), np.zeros(6)).holds
    free = newton_equilibrium(as_jacobian(np.zeros((6, 0))), np.ones(6))
    assert not free.holds
    assert free.mechanism is not None


@pytest.mark.parametrize("solve", [newton_equilibrium, by_cones])
@pytest.mark.parametrize(
    ("imbalance", "holds"), [(1e-2, False), (1e-4, False), (1e-5, False), (0.0, True)]
)
def test_a_hundred_thousandth_of_the_load_that_nothing_carries_is_no_equilibrium(
    solve, imbalance: float, holds: bool
) -> None:
    """Two opposed contacts along x; the paper's tolerance of the residual is 1e-6.

    The motion along y proves it: no forces leave less of the load than its work on a motion.
    """
    matrix = np.array([[1.0, -1.0], [0.0, 0.0]])
    found = solve(as_jacobian(matrix), np.array([1.0, imbalance]))
    assert found.holds is holds
    assert found.residual >= imbalance * (1.0 - 1e-3)
    if holds:
        assert found.residual <= 1e-9
    else:
        np.testing.assert_allclose(found.mechanism, [0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize(("aside", "holds"), [(0.95e-7, True), (1.05e-7, False)])
def test_from_a_ten_millionth_of_the_load_on_what_nothing_carries_is_a_motion(
    aside: float, holds: bool
) -> None:
    """A brick on a smooth floor, pushed aside by a part of its weight: it slides along the push."""
    brick = wall_of_rows((1.0, 1.0, 1.0), [[1.0]])
    wrenches = np.zeros((brick.n_blocks, 6))
    wrenches[~brick.fixed, :3] = 5.0 * np.array([0.6 * aside, 0.8 * aside, -1.0])
    load = LoadCase(brick, "push", (), brick.fixed, body_wrenches=wrenches)
    found = analyse(brick, load=load).details
    assert found.holds is holds
    assert found.equilibrium.residual == pytest.approx(aside, rel=1e-6)
    if not holds:
        assert found.driven == pytest.approx([0.6, 0.8, 0.0, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("case", ["pipe", "tunnel", "pillar", "beam", "shaft"])
@pytest.mark.parametrize("norm", list(Norm))
def test_contact_and_load_wrenches_balance_on_every_block(
    small_tube: Assembly, case: str, norm: Norm
) -> None:
    # Summed here block by block from points and normals, without G.
    load = named_load(case, 0.01).on(small_tube)
    result = analyse(small_tube, Rigid(norm=norm), load=load).details
    assert result.equilibrium.holds
    found = small_tube.interfaces
    index = result.contact_index
    push = result.contact_forces[:, None] * found.normals[index]
    for block in np.flatnonzero(~load.fixed):
        force, moment = np.zeros(3), np.zeros(3)
        for sign, owner in ((-1.0, found.block_m), (1.0, found.block_s)):
            mine = owner[index] == block
            arm = found.centroids[index][mine] - small_tube.centroids[block]
            force += sign * push[mine].sum(axis=0)
            moment += sign * np.cross(arm, push[mine]).sum(axis=0)
        mine = load.block == block
        arm = load.centroids[mine] - small_tube.centroids[block]
        force += load.facet_forces[mine].sum(axis=0)
        moment += np.cross(arm, load.facet_forces[mine]).sum(axis=0)
        scale = np.linalg.norm(load.facet_forces, axis=1).sum()
        # The solver's residual is below 1e-9 of ‖f‖, itself below the sum of the facet forces.
        assert np.abs(force).max() < 1e-9 * scale
        assert np.abs(moment).max() < 1e-9 * scale * small_tube.characteristic_length


def test_forces_on_blocks_do_not_depend_on_how_many_facets_are_placed_at_once(
    small_tube: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = named_load("pipe", 0.01).on(small_tube)
    parts = named_load("shaft", 0.01).on(small_tube)
    joints = analyse(small_tube, load=load).details.joints
    for module in ("geometry.loads", "geometry.parts.measures"):
        monkeypatch.setattr(f"{module}._AT_ONCE", 50)
    for whole in (load, parts):
        again = replace(whole, name="again")
        scale = 1e-13 * np.abs(whole.wrenches).max()
        np.testing.assert_allclose(again.wrenches, whole.wrenches, atol=scale)
        np.testing.assert_allclose(again.acting, whole.acting, rtol=1e-13)
        wrench = np.zeros((small_tube.n_blocks, 6))
        arm = whole.centroids - small_tube.centroids[whole.block]
        np.add.at(
            wrench,
            whole.block,
            np.hstack([whole.facet_forces, np.cross(arm, whole.facet_forces)]),
        )
        np.testing.assert_allclose(whole.wrenches, wrench, atol=10.0 * scale)
    small = analyse(small_tube, load=load).details.joints
    size = np.abs(joints.forces).max()
    np.testing.assert_allclose(small.forces, joints.forces, atol=1e-12 * size)
    np.testing.assert_allclose(small.normal_force, joints.normal_force, atol=1e-12 * size)
    np.testing.assert_allclose(small.shear_force, joints.shear_force, atol=1e-12 * size)
    moment = size * small_tube.characteristic_length
    np.testing.assert_allclose(small.moments, joints.moments, atol=1e-12 * moment)


# ---------------------------------------------------------------------------------------------
# Closed forms


@pytest.mark.parametrize("norm", list(Norm))
def test_plain_ring_under_external_pressure_carries_the_hoop_pressure(
    plain_ring: Assembly, norm: Norm
) -> None:
    # A block's outer pressure has the resultant of its chord; the two radial joints carry
    # p r_o h each, on t h: p r_o / t, exactly, whatever the polygon.
    result = analyse(
        plain_ring, Rigid(norm=norm), load=named_load("tunnel", 0.01).on(plain_ring)
    ).details
    found = plain_ring.interfaces
    sides = np.abs(found.normals[result.contact_index][:, 2]) < 0.5
    np.testing.assert_allclose(result.contact_pressures[sides], 0.01 * 160 / 40, rtol=1e-10)
    np.testing.assert_allclose(result.contact_pressures[~sides], 0.0, atol=1e-12)


def test_stack_of_bricks_carries_the_axial_pressure_in_every_joint(two_bricks: Assembly) -> None:
    result = analyse(two_bricks, load=named_load("pillar", 0.02).on(two_bricks)).details
    np.testing.assert_allclose(result.contact_pressures, 0.02, rtol=1e-11)


def wedge_assembly(half_angle: float) -> Assembly:
    """Wedge, narrow end down, between two fixed blocks; faces named as a tube block's."""
    divisions = (2, 3, 4)
    grid = np.stack(
        np.meshgrid(*[np.linspace(0, 1, n + 1) for n in divisions], indexing="ij"), axis=-1
    ).reshape(-1, 3)
    faces = grid_faces(*divisions)

    def block(name: str, left: float, right: float, contact: tuple[str, ...]) -> Block:
        z = 100.0 * grid[:, 2]
        half = 20.0 + z * np.tan(half_angle)
        edge = {-2.0: -300.0, -1.0: -half, 1.0: half, 2.0: 300.0}
        x = edge[left] * (1 - grid[:, 0]) + edge[right] * grid[:, 0]
        nodes = np.column_stack([x, 60.0 * grid[:, 1], z])
        return Block(name, HexMesh(nodes, structured_hexahedra(*divisions)), faces, contact)

    shapes = (
        block("wedge", -1.0, 1.0, ("u-", "u+")),
        block("left", -2.0, -1.0, ("u+",)),
        block("right", 1.0, 2.0, ("u-",)),
    )
    return Assembly(
        name="wedge",
        shapes=shapes,
        shape_of=np.arange(3),
        rotations=np.tile(np.eye(3), (3, 1, 1)),
        translations=np.zeros((3, 3)),
        layer=np.array([1, 0, 2]),
        fixed=np.array([False, True, True]),
    )


@pytest.mark.parametrize("degrees", [0.1, 5.0, 30.0, 80.0])
def test_wedge_between_two_planes(degrees: float) -> None:
    # Symmetry and vertical balance: 2 N sin α = F.
    alpha = np.radians(degrees)
    wedge = wedge_assembly(alpha)
    contacts = contact_jacobian(wedge)
    load = np.array([0.0, 0.0, -7.0, 0.0, 0.0, 0.0])
    result = newton_equilibrium(
        contacts.jacobian, load, weights=column_weights(Norm.PRESSURE, contacts.areas)
    )
    assert result.holds
    for side in (1, 2):
        total = result.forces[(contacts.block_s == side)].sum()
        assert total == pytest.approx(7.0 / (2 * np.sin(alpha)), rel=1e-8)
    assert not newton_equilibrium(contacts.jacobian, -load).holds


def test_smaller_amplitude_means_larger_pressure_down_to_a_thousandth_of_a_millimetre() -> None:
    # Interlocking forces grow as 1/slope: p_max a is constant in the limit (to first order in a).
    found = []
    for amplitude in (20.0, 5.0, 1.0, 0.1, 1e-2, 1e-3):
        tube = SineTube(tsb(amplitude=amplitude), SineBlockDivisions(24, 2, 6), 3).build()
        result = analyse(tube, load=named_load("pipe", 0.01).on(tube)).details
        assert result.mechanism == "locked"
        assert result.equilibrium.residual < 1e-9
        assert result.measures is not None
        found.append(result.measures.p_max)
    assert (np.diff(found) > 0).all()
    assert found[-1] * 1e-3 == pytest.approx(found[-2] * 1e-2, rel=1e-3)


def test_solvers_agree_on_a_tube(small_tube: Assembly) -> None:
    load = named_load("shaft", 0.01).on(small_tube)
    a = analyse(small_tube, Rigid(solver=Solver.NEWTON), load=load).details
    b = analyse(small_tube, Rigid(solver=Solver.CLARABEL), load=load).details
    difference = np.linalg.norm(a.contact_forces - b.contact_forces)
    assert difference < 1e-6 * np.linalg.norm(a.contact_forces)


def test_pressure_norm_is_the_uniform_foundation(small_tube: Assembly) -> None:
    # λ = A max(0, Gᵀy): pressures are the positive part of a rigid relative motion's gap, so
    # two contacts of one pair with equal gap carry equal pressure. Checked through y itself.
    load = named_load("tunnel", 0.01).on(small_tube)
    contacts = contact_jacobian(small_tube, load.fixed)
    force = contacts.rows(load.wrenches)
    weights = column_weights(Norm.PRESSURE, contacts.areas)
    result = newton_equilibrium(contacts.jacobian, force, weights=weights)
    gap = np.maximum(contacts.jacobian.gap_rates(result.multiplier), 0.0)
    pressure = result.forces / contacts.areas
    np.testing.assert_allclose(pressure * contacts.areas.mean(), gap, atol=1e-10 * gap.max())


def test_refining_the_mesh_changes_the_force_norm_but_not_the_pressure_norm() -> None:
    # Only the wavy faces are refined: Σ λ² then shifts force between them and the flat sides
    # (more, smaller forces are cheaper); the limit of a uniform foundation does not. What is left
    # of its change is the geometry's: the facets follow the waves more closely.
    changes = {}
    for norm in Norm:
        values = []
        for around in (24, 48):
            tube = SineTube(tsb(), SineBlockDivisions(around, 4, 8), 1).build()
            load = named_load("tunnel", 0.01).on(tube)
            result = analyse(tube, Rigid(norm=norm), load=load).details
            flat = np.abs(tube.interfaces.normals[result.contact_index][:, 2]) < 1e-9
            values.append(result.contact_forces[flat].sum())
        changes[norm] = abs(values[1] / values[0] - 1)
    assert changes[Norm.FORCE] > 3 * changes[Norm.PRESSURE]


def test_one_brick_between_two() -> None:
    wall = BrickStack((100.0, 50.0, 40.0), (2, 2, 2), columns=2, layers=1).build()
    assert not analyse(wall, load=named_load("pipe", 0.01).on(wall)).details.equilibrium.holds


@pytest.mark.parametrize("solver", [newton_equilibrium, by_cones])
@pytest.mark.parametrize("size", [1e-290, 1e290])
def test_forces_grow_with_the_load_however_large_or_small(solver, size: float) -> None:
    """Equilibrium is homogeneous: s f needs s λ, also where s² is no number of the machine."""
    rng = np.random.default_rng(3)
    matrix = random_jacobian(rng, 6, 20)
    load = -matrix @ rng.uniform(0.5, 1.0, 20)
    one, other = solver(as_jacobian(matrix), load), solver(as_jacobian(matrix), size * load)
    assert one.holds
    assert other.holds
    # Unit loads differ by the rounding of the scale; clarabel keeps 1e-6 of the forces (above).
    np.testing.assert_allclose(other.forces / size, one.forces, rtol=0, atol=1e-5)


def test_a_load_that_is_no_number_is_refused() -> None:
    matrix = as_jacobian(np.eye(2))
    for wrong in (np.inf, np.nan):
        with pytest.raises(ValueError, match="infs or NaNs"):
            newton_equilibrium(matrix, np.array([1.0, wrong]))


@pytest.mark.parametrize("kind", ["tube", "wall"])
def test_congruent_pairs_give_the_jacobian_of_each_contact(kind: str) -> None:
    """G from kinds of pairs, turned, against the wrench of every contact in world axes."""
    if kind == "tube":
        assembly = SineTube(tsb(0.3, blocks_per_layer=3), SineBlockDivisions(12, 2, 3), 3).build()
    else:
        assembly = BrickStack((100.0, 60.0, 50.0), (4, 3, 2), columns=2, layers=3).build()
    assembly = moved(assembly, random_rotation(5), np.array([30.0, -70.0, 20.0]))
    contacts = contact_jacobian(assembly)
    jacobian, found = contacts.jacobian, assembly.interfaces
    assert len(jacobian.contacts.kinds) < found.n_pairs
    number = np.full(assembly.n_blocks, -1)
    number[contacts.free_blocks] = np.arange(len(contacts.free_blocks))
    expected = np.zeros((len(contacts.free_blocks), 6, len(contacts.index)))
    for column, i in enumerate(contacts.index.tolist()):
        for block, sign in ((found.block_m[i], -1.0), (found.block_s[i], 1.0)):
            arm = (found.centroids[i] - assembly.centroids[block]) / contacts.length
            wrench = np.concatenate([found.normals[i], np.cross(arm, found.normals[i])])
            if number[block] >= 0:
                expected[number[block], :, column] += sign * wrench
    matrix = expected.reshape(-1, len(contacts.index))
    np.testing.assert_allclose(jacobian.to_matrix().toarray(), matrix, atol=1e-13)
    rng = np.random.default_rng(0)
    motion, weights = rng.standard_normal(len(matrix)), rng.random(matrix.shape[1])
    # Sums of n_contacts terms of order one.
    within = 1e-15 * matrix.shape[1] * 10
    np.testing.assert_allclose(jacobian.gap_rates(motion), matrix.T @ motion, atol=within)
    np.testing.assert_allclose(jacobian.resultant(weights), matrix @ weights, atol=within)
    solution = jacobian.normal_solver(weights, 1e-2)(motion)
    normal = matrix @ np.diag(weights) @ matrix.T + 1e-2 * np.eye(len(matrix))
    np.testing.assert_allclose(normal @ solution, motion, atol=1e-10 * np.abs(solution).max())
    motions = rng.standard_normal((len(matrix), 3))
    rates, few = matrix.T @ motions, jacobian.condensed_rates(motions)
    assert len(few) < matrix.shape[1]
    np.testing.assert_allclose(few.T @ few, rates.T @ rates, rtol=1e-12)
    for block in range(jacobian.n_free):
        own = matrix[6 * block : 6 * block + 6]
        touching = own[:, np.abs(own).sum(axis=0) > 0.0]
        np.testing.assert_allclose(jacobian.wrenches_on(block), touching, atol=1e-13)


def test_load_cases_share_the_jacobian_of_their_blocks_alone(
    small_tube: Assembly,
) -> None:
    """The class under each load is that of blocks that no other load was put on."""
    contacts = contact_jacobian(small_tube)
    assert contact_jacobian(small_tube) is contacts
    freed = replace(small_tube, fixed=np.zeros(small_tube.n_blocks, dtype=np.bool_))
    assert contact_jacobian(freed).jacobian.n_free == small_tube.n_blocks
    assert "kept" not in vars(pickle.loads(pickle.dumps(small_tube)))
    for case in ("pipe", "beam", "pillar"):
        fresh = replace(small_tube)
        results = [
            analyse(blocks, load=named_load(case, 0.01).on(blocks)).details
            for blocks in (small_tube, fresh)
        ]
        assert results[0].mechanism is results[1].mechanism
        assert results[0].classification.as_json() == results[1].classification.as_json()
