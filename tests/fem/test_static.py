"""Static contact: closed forms, patch test, balance, symmetry, methods against each other."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from fem import (
    CoulombFriction,
    ElementType,
    ExponentialLaw,
    Frames,
    LinearPenalty,
    Material,
)
from fem.contact.normals import ContactNormals
from fem.static.linear_step import condensed as flexibility
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.linear_step.linearisation import StaticError
from fem.static.solve import StaticMethod, StaticOptions, static_state
from fem.system.contact_state import contact_measures
from fem.system.sector import SymmetryError
from geometry.assembly import moved, renumbered
from geometry.loads import LoadCase, PressureLoad, named_load
from geometry.mesh import HexMesh
from mbd import Norm, Rigid, analyse
from tests.support.fem_problems import deformable_assembly
from tests.support.pressed_pipe import CONCRETE, column, pipe, sheared_column, top_load, tube

pytestmark = pytest.mark.quick

#: Without lateral strain a column is one-dimensional.
CORK = Material(density=2.4e-9, young_modulus=1000.0, poisson_ratio=0.0)


@pytest.fixture(scope="module")
def coarse():
    """TSB1 pipe, one layer, 96 elements a block, and its static state."""
    return static_state(pipe())


# ---------------------------------------------------------------------------------------------
# Columns of boxes


@pytest.mark.parametrize("law", [ExponentialLaw(), LinearPenalty(500.0)], ids=["exp", "linear"])
@pytest.mark.parametrize("pressure", [1e-3, 0.03, 0.3])
@pytest.mark.parametrize("method", list(StaticMethod))
def test_column_is_the_inverse_of_the_law(law, pressure, method):
    """Uniform pressure in every joint; the k-th block sinks by k inverse laws and shortens.

    u_top = -2 x(p) - p (h + h)/E for two blocks on a rigid one, nu = 0. The state is uniform, so
    the residual is the only error: 1e-8 in pressure, hence 1e-8 of p/k in overclosure, and the
    solution of the linear systems with eps · (E/h)/(k) · … < 1e-9 of either.
    """
    assembly = column(2)
    model = deformable_assembly(assembly, top_load(assembly, pressure=pressure), CORK, law=law)
    result = static_state(model, StaticOptions(method=method))
    assert result.pressures == pytest.approx(pressure, rel=3e-8)
    sink = float(law.overclosure(pressure))
    expected = -2 * sink - pressure * (20.0 + 20.0) / CORK.young_modulus
    top = model.assembly.shapes[0].faces["z+"]
    moved_by = result.displacements[0][-1][np.unique(top)][:, 2]
    assert moved_by == pytest.approx(expected, rel=3e-8)
    # A dead load loses twice the strain energy plus p x A in the joints.
    assert result.load_work == pytest.approx(-expected * pressure * 100.0, rel=3e-8)
    strain = 0.5 * pressure**2 / CORK.young_modulus * 100.0 * 40.0
    assert result.strain_energy == pytest.approx(strain, rel=1e-7)
    stored = 2 * 100.0 * float(law.stored_energy(sink))
    assert result.contact_energy == pytest.approx(stored, rel=1e-7)


@pytest.mark.parametrize("element", list(ElementType))
def test_patch_test_across_a_conforming_interface(element):
    """A uniform uniaxial stress passes an inclined interface of distorted meshes.

    The contact is frictionless, so the stress must press normally on the interface: with nu = 0
    and a slope, a hydrostatic state is the affine one: all outer faces carry the same pressure.
    Then every point of the interface has exactly that pressure (round-off of the solver times
    the stiffness ratio, below 1e-7 with a residual of 1e-10).
    """
    assembly = column(1, shear=0.3)
    shape = assembly.shapes[0]
    nodes = shape.mesh.nodes.copy()
    inner = np.flatnonzero(
        (np.abs(nodes[:, 0] - 5.0) < 1e-9)
        & (np.abs(nodes[:, 1] - 5.0) < 1e-9)
        & (np.abs(nodes[:, 2] - 0.3 * 5.0 - 10.0) < 1e-9)
    )
    nodes[inner] += [0.8, -0.7, 1.1]
    shape = dataclasses.replace(shape, mesh=HexMesh(nodes, shape.mesh.elements))
    assembly = dataclasses.replace(assembly, shapes=(shape,))
    block = np.array([1])
    faces = tuple(PressureLoad(block, name, 0.4) for name in shape.faces if name != "z-")
    load = LoadCase(assembly, "hydrostatic", faces, assembly.fixed)
    model = deformable_assembly(
        assembly, load, CONCRETE, element=element, normals=ContactNormals.REFERENCE
    )
    # Sliding along the slope and turning about the normal are free: hold nodes against that.
    model = held_tangentially(model, shape)
    result = static_state(model, StaticOptions(tolerance=1e-10))
    assert result.pressures == pytest.approx(0.4, rel=1e-7)


def held_tangentially(model, shape):
    """Hold one corner along the two tangents of the slope, and a neighbour across."""
    from fem.system.held import held_at

    slope = np.array([1.0, 0.0, 0.3]) / np.hypot(1.0, 0.3)
    across = np.array([0.0, 1.0, 0.0])
    nodes = shape.mesh.nodes
    first = int(np.argmin(np.abs(nodes).sum(axis=1)))
    second = int(np.argmin(np.abs(nodes - [10.0, 0.0, 3.0]).sum(axis=1)))
    directions = np.array([slope, across, across]) @ model.assembly.rotations[1]
    held = held_at(np.array([first, first, second]), directions)
    return dataclasses.replace(model, supports=held)


# ---------------------------------------------------------------------------------------------
# Tubes


def converges_fast(result):
    """Near the equilibrium each iteration of Newton's method leaves less than a tenth of the
    residual. The whole tangent squares it; without a part of it a share is left."""
    near = [(a, b) for a, b in pairwise(result.evidence.residuals) if 1e-8 < a < 1e-3]
    return result.converged and all(after < 0.1 * before for before, after in near)


def test_values_of_the_tube_with_960_elements_a_block():
    """TSB1, pipe, p = 0.01 MPa, one layer: u 0.0115 mm, point pressure 0.464 MPa from an
    independent program, given to three digits: half a unit of the third, plus the law's cap."""
    result = static_state(pipe(1, (24, 4, 10)))
    assert converges_fast(result)
    assert result.largest_displacement == pytest.approx(0.0115, abs=5.1e-5)
    measured = contact_measures(result.deformable.assembly, result.contact_state)
    assert measured.p_max_point == pytest.approx(0.464, abs=1.1e-3)


@pytest.mark.slow
def test_values_of_twelve_layers():
    """u 0.0269 mm, p_eff 0.347, p_max per face 0.586 MPa: half a unit of the third digit."""
    result = static_state(pipe(12, (24, 4, 10)))
    assert converges_fast(result)
    assert result.largest_displacement == pytest.approx(0.0269, abs=5.1e-5)
    measured = contact_measures(result.deformable.assembly, result.contact_state)
    assert measured.p_eff == pytest.approx(0.347, abs=5.1e-4)
    assert measured.p_max == pytest.approx(0.586, abs=5.1e-4)


def same(a, b, tolerance):
    """Displacements and pressures of two results agree relative to their largest."""
    largest = max(float(np.abs(u).max()) for u in a.displacements)
    for u, v in zip(a.displacements, b.displacements, strict=True):
        assert np.abs(u - v).max() <= tolerance * largest
    assert np.abs(a.pressures - b.pressures).max() <= tolerance * a.pressures.max()


def test_sector_is_the_whole(coarse):
    """Both stop at a residual of 1e-8 and converge quadratically, so the states agree far
    better; 1e-7 allows for a stiffness ratio of ten between force and pressure errors."""
    whole = static_state(coarse.deformable, StaticOptions(symmetry=1))
    assert coarse.system.orbits.order == 4
    assert whole.system.orbits.order == 1
    same(whole, coarse, 1e-7)
    assert coarse.strain_energy == pytest.approx(whole.strain_energy, rel=1e-7)
    assert coarse.contact_energy == pytest.approx(whole.contact_energy, rel=1e-7)
    assert coarse.load_work == pytest.approx(whole.load_work, rel=1e-7)


@pytest.mark.parametrize("case", ["pipe", "tunnel", "pillar", "shaft"])
def test_condensed_is_sparse(case):
    """The same equations solved in other unknowns: states agree as in the sector test."""
    model = pipe(2, case=case)
    options = StaticOptions(tolerance=1e-9)
    condensed = static_state(model, options)
    sparse = static_state(model, dataclasses.replace(options, method=StaticMethod.SPARSE))
    same(condensed, sparse, 1e-6)


def test_beam_breaks_the_symmetry():
    model = pipe(2, case="beam")
    result = static_state(model)
    assert result.system.orbits.order == 1
    with pytest.raises(SymmetryError, match="differ by"):
        static_state(model, StaticOptions(symmetry=4))
    with pytest.raises(SymmetryError, match="divides the number of blocks"):
        static_state(model, StaticOptions(symmetry=3))


def test_deformable_frames_are_softer_than_rigid_ones(coarse):
    """Clapeyron for dead loads without initial stress would give it; with a convex energy the
    work of the loads can only grow when supports are released."""
    held = static_state(pipe(frames=Frames.DEFORMABLE))
    assert held.load_work > coarse.load_work
    sparse = static_state(held.deformable, StaticOptions(method=StaticMethod.SPARSE, symmetry=2))
    same(held, sparse, 1e-6)
    nodes = np.unique(held.deformable.assembly.shapes[1].faces["bottom"])
    frame = int(held.deformable.group_of[0])
    assert (held.displacements[frame][:, nodes] == 0.0).all()


def test_a_moved_and_renumbered_tube_gives_the_same(coarse):
    """Rotation by an arbitrary matrix, translation by metres, blocks in another order."""
    axis = np.array([0.3, -0.5, 0.8])
    axis /= np.linalg.norm(axis)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(1.1) * skew + (1 - np.cos(1.1)) * skew @ skew
    order = np.random.default_rng(3).permutation(12)
    assembly = renumbered(moved(tube(), turn, np.array([3e3, -2e3, 1e3])), order)
    model = deformable_assembly(assembly, named_load("pipe", 0.01).on(assembly), CONCRETE)
    result = static_state(model)
    assert result.system.orbits.order == 4
    # Coordinates of 4e3 mm carry 5e-13 mm, times 1000 MPa/mm against 0.5 MPa: 1e-9; the rest is
    # the residual, as above.
    there = contact_measures(model.assembly, result.contact_state)
    here = contact_measures(coarse.deformable.assembly, coarse.contact_state)
    assert there.p_eff == pytest.approx(here.p_eff, rel=1e-6)
    assert there.p_max_point == pytest.approx(here.p_max_point, rel=1e-6)
    assert result.largest_displacement == pytest.approx(coarse.largest_displacement, rel=1e-6)
    before = coarse.displacements[0][int(coarse.deformable.copy_of[5])]
    block = int(np.flatnonzero(order == 5)[0])
    after = result.displacements[0][int(model.copy_of[block])]
    assert np.abs(after - before @ turn.T).max() <= 1e-6 * np.abs(before).max()


def test_upper_and_lower_half_are_images_of_each_other():
    """A half turn about a horizontal axis through a zero of the wave maps even layers onto odd
    ones, so with an even number of layers the tube onto itself: layers k and L + 1 - k have
    equal pressures. Four blocks of a layer are equal by the quarter turn. (Solved without using
    either; residual of 1e-8, stiffness ratio of ten.)"""
    result = static_state(pipe(4), StaticOptions(symmetry=1))
    measured = contact_measures(result.deformable.assembly, result.contact_state)
    for values in (measured.per_block.p_max, measured.per_block.p_eff):
        layers = values.reshape(4, 4)
        assert layers == pytest.approx(layers[::-1], rel=1e-6)
        assert layers == pytest.approx(layers[:, [1, 2, 3, 0]], rel=1e-6)
    assert not np.allclose(layers[0], layers[1], rtol=1e-3)


def rigid_limit(divisions):
    """Measures of stiff blocks on linear springs and of rigid blocks, and their correlation."""
    assembly = tube(2, divisions)
    load = named_load("pipe", 0.01).on(assembly)
    model = deformable_assembly(
        assembly,
        load,
        Material(density=2.4e-9, young_modulus=33e4, poisson_ratio=0.2),
        law=LinearPenalty(1.0),
        normals=ContactNormals.REFERENCE,
    )
    result = static_state(model)
    rigid = analyse(assembly, Rigid(norm=Norm.PRESSURE), load=load).details
    ours = contact_measures(model.assembly, result.contact_state)
    where = np.searchsorted(model.surfaces.facet, rigid.contact_index)
    correlation = np.corrcoef(result.contact_state.pressures[where], rigid.contact_pressures)[0, 1]
    assert rigid.measures is not None
    return (
        ours.p_eff / rigid.measures.p_eff - 1,
        ours.p_max / rigid.measures.p_max - 1,
        (correlation),
    )


@pytest.mark.slow
def test_rigid_limit_is_the_pressure_norm_of_rigid_blocks():
    """Stiff blocks on linear springs are the elastic foundation whose least energy is the
    pressure norm, min Σ λ²/A. Blocks deform by p h/E against p/k: k h/E = 1 · 200/33e4, less
    than 1e-3. What is left is quadrature: rigid contacts act at centroids, ours at 2 × 2 points,
    which differ by the second moment of a facet, (facet/wave)² = (251/24 / 84)² ~ 1.5 % times a
    factor of some units; at 2/3 of the size it falls to 4/9, with the discrete edge of the
    pressed region in between: less than 0.7.
    """
    eff, largest, correlation = rigid_limit((24, 4, 8))
    assert abs(eff) < 0.05
    assert abs(largest) < 0.05
    assert correlation > 0.999
    fine_eff, fine_largest, fine_correlation = rigid_limit((36, 6, 12))
    assert abs(fine_eff) < 0.7 * abs(eff)
    assert abs(fine_largest) < 0.7 * abs(largest)
    assert fine_correlation > correlation


def test_total_force_of_twice_the_load_from_the_first_state(coarse):
    """A start is only a start: from another state the same equilibrium is found."""
    model = pipe()
    blocks = model.assembly
    twice = deformable_assembly(blocks, named_load("pipe", 0.02).on(blocks), CONCRETE)
    cold = static_state(twice)
    warm = static_state(twice, start=coarse.displacements)
    same(cold, warm, 1e-6)


@pytest.mark.parametrize("kind", ["clearance", "spacing"])
def test_initial_gap_converges_without_load_steps(kind):
    result = static_state(pipe(2, (24, 4, 6), **{kind: 0.1}))
    assert converges_fast(result)
    without = static_state(pipe(2, (24, 4, 6)))
    assert result.largest_displacement > without.largest_displacement


def test_current_and_reference_normals_differ_little_without_gap(coarse):
    """Blocks turn by u/h ~ 0.01/100: normals turn by 1e-4, pressures follow with some gain."""
    fixed = static_state(pipe(normals=ContactNormals.REFERENCE))
    assert fixed.largest_displacement == pytest.approx(coarse.largest_displacement, rel=5e-3)
    assert fixed.largest_displacement != coarse.largest_displacement


def test_zero_load_leaves_the_prestress_of_the_law():
    """At zero clearance the law presses with p_c0 everywhere; on a closed surface that is
    almost in balance, so overclosures stay far below c0."""
    assembly = tube()
    load = named_load("pipe", 0.0).on(assembly)
    result = static_state(deformable_assembly(assembly, load, CONCRETE))
    assert np.abs(result.overclosures).max() < 1e-3
    assert result.pressures.mean() == pytest.approx(1e-4, rel=0.2)


@pytest.mark.parametrize("pressure", [1e-8, 1.0, 10.0])
def test_loads_of_any_size(pressure):
    assembly = tube()
    load = named_load("pipe", pressure).on(assembly)
    result = static_state(deformable_assembly(assembly, load, CONCRETE))
    assert result.residual <= 1e-8


def test_blocks_that_no_contact_holds_are_named():
    """A column of flat faces slides and turns freely: it stands, and the result says so."""
    assembly = column(2)
    result = static_state(deformable_assembly(assembly, top_load(assembly, pressure=0.01), CORK))
    assert result.evidence.loose_blocks.tolist() == [1, 2]
    assert "no contact holds blocks 1, 2" in result.evidence.status
    assert not len(static_state(pipe()).loose_blocks)


def test_a_load_that_nothing_carries_is_refused():
    """A shear traction on the top of a frictionless column: it slides away."""
    assembly = column(2)
    load = top_load(assembly, traction=np.array([0.01, 0.0, -0.1]))
    with pytest.raises(StaticError, match="no resistance"):
        static_state(deformable_assembly(assembly, load, CORK))


# ---------------------------------------------------------------------------------------------
# Friction


@pytest.mark.parametrize("method", list(StaticMethod))
def test_a_block_holds_below_the_friction_angle_and_slides_above(method):
    """Tangential over normal load of 0.8 mu: every point sticks and slips by tau/k elastically.

    The shear tilts the block: pressures vary by 6 tau h/b = 0.6 tau = 14 % of the mean across
    the joint, so the least limit, 0.86 mu p, is not reached. The mean slip is tau/k; the block
    shears by tau h/G = 5e-9 mm against 5e-4. At 0.97 mu some points slide and it holds; at
    1.02 mu nothing can.
    """
    friction = CoulombFriction(0.3, 50.0)
    options = StaticOptions(method=method, max_iterations=60)
    holds = static_state(sheared_column(0.24, friction), options)
    bottom = np.unique(holds.deformable.assembly.shapes[0].faces["z-"])
    assert holds.displacements[0][0][bottom, 0].mean() == pytest.approx(0.024 / 50.0, rel=1e-3)
    assert holds.frictional_dissipation == 0.0
    partly = static_state(sheared_column(0.291, friction), options)
    assert partly.frictional_dissipation > 0.0
    assert not slides_to_rest(sheared_column(0.306, friction), options)


def slides_to_rest(model, options):
    """Whether an equilibrium is found."""
    try:
        static_state(model, options)
    except StaticError:
        return False
    return True


@pytest.mark.slow
def test_friction_stiffens_the_tube_and_both_methods_agree():
    """The work of dead loads falls when sliding costs; the same equations in other unknowns."""
    free = static_state(pipe(2))
    model = pipe(2, friction=CoulombFriction(0.05))
    rough = static_state(model)
    assert 0.9 * free.load_work < rough.load_work < free.load_work
    assert rough.frictional_dissipation > 0.0
    sparse = static_state(model, StaticOptions(method=StaticMethod.SPARSE))
    same(rough, sparse, 1e-5)
    whole = static_state(model, StaticOptions(symmetry=1))
    same(rough, whole, 1e-6)
    assert whole.frictional_dissipation == pytest.approx(rough.frictional_dissipation, rel=1e-5)


@pytest.mark.parametrize("method", StaticMethod)
def test_newton_with_friction_converges_quadratically(method):
    """The tangent has all of the law, so in the end the residual is squared."""
    model = pipe(2, friction=CoulombFriction(0.5))
    for steps in (1, 2):
        found = static_state(model, StaticOptions(method=method, load_steps=steps))
        assert converges_fast(found)
    other = next(m for m in StaticMethod if m is not method)
    again = static_state(model, StaticOptions(method=other, load_steps=2))
    # Residuals of 1e-8 of two ways, times a gain below 100.
    for mine, theirs in zip(found.displacements, again.displacements, strict=True):
        assert np.abs(mine - theirs).max() < 1e-6 * found.largest_displacement


def test_vanishing_friction_is_none():
    """Friction forces are at most mu times pressures; 1e-6 of it changes displacements by some
    1e-6 times a gain below 100 (one per cent of friction changes them by one per cent)."""
    free = static_state(pipe(1))
    almost = static_state(pipe(1, friction=CoulombFriction(1e-6)))
    same(free, almost, 1e-4)


def test_options_and_starts_are_checked(coarse):
    with pytest.raises(StaticError, match="tolerance"):
        StaticOptions(tolerance=0.0)
    with pytest.raises(StaticError, match="max_iterations"):
        StaticOptions(max_iterations=0)
    with pytest.raises(StaticError, match="same model"):
        static_state(pipe(2), start=coarse.displacements)


def test_too_few_iterations_are_not_called_equilibrium():
    with pytest.raises(StaticError, match="no equilibrium found in"):
        static_state(pipe(), StaticOptions(max_iterations=2))


def test_blocks_that_are_the_same_are_condensed_once(monkeypatch):
    """Another gap and load, the same blocks: the same bits without a second condensation."""
    made = []
    real = flexibility.condense
    monkeypatch.setattr(flexibility, "condense", lambda *given: made.append(1) or real(*given))
    store = FlexibilityStore()
    static_state(pipe(), store=store)
    once = len(made)
    shared = static_state(pipe(clearance=0.01), store=store)
    assert len(made) == once
    alone = static_state(pipe(clearance=0.01))
    assert len(made) == 2 * once
    for a, b in zip(shared.displacements, alone.displacements, strict=True):
        assert a.tobytes() == b.tobytes()
    # Other blocks replace what was kept.
    static_state(pipe(divisions=(12, 1, 4)), store=store)
    static_state(pipe(), store=store)
    assert len(made) == 4 * once
