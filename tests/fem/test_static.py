"""Static contact: closed forms, patch test, balance, symmetry, methods against each other."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from fem import (
    CoulombFriction,
    ElementType,
    Frames,
    LinearPenalty,
    Material,
)
from fem.answer.forces import load_work
from fem.answer.pressures import contact_measures
from fem.contact.normals import ContactNormals
from fem.static.linear_step import condensed as flexibility
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.linear_step.linearisation import StaticError
from fem.static.solve import StaticMethod, StaticOptions, static_state
from fem.system.sector import SymmetryError
from geometry.loads import LoadCase, PressureLoad, named_load
from geometry.mesh import HexMesh
from mbd import Norm, Rigid, analyse
from tests.support.fem_problems import deformable_assembly
from tests.support.pressed_pipe import CONCRETE, column, pipe, top_load, tube

pytestmark = pytest.mark.quick

#: Without lateral strain a column is one-dimensional.
CORK = Material(density=2.4e-9, young_modulus=1000.0, poisson_ratio=0.0)


@pytest.fixture(scope="module")
def coarse():
    """TSB1 pipe, one layer, 96 elements a block, and its static state."""
    return static_state(pipe())


# ---------------------------------------------------------------------------------------------
# Columns of boxes


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
    from fem.system.rows import held_at

    slope = np.array([1.0, 0.0, 0.3]) / np.hypot(1.0, 0.3)
    across = np.array([0.0, 1.0, 0.0])
    nodes = shape.mesh.nodes
    first = int(np.argmin(np.abs(nodes).sum(axis=1)))
    second = int(np.argmin(np.abs(nodes - [10.0, 0.0, 3.0]).sum(axis=1)))
    directions = np.array([slope, across, across]) @ model.assembly.rotations[1]
    held = held_at(1, np.array([first, first, second]), directions)
    return dataclasses.replace(model, supports=held)


# ---------------------------------------------------------------------------------------------
# Tubes


def converges_fast(result):
    """Near the equilibrium each iteration of Newton's method leaves less than a tenth of the
    residual. The whole tangent squares it; without a part of it a share is left."""
    near = [(a, b) for a, b in pairwise(result.evidence.residuals) if 1e-8 < a < 1e-3]
    return result.evidence.converged and all(after < 0.1 * before for before, after in near)


def test_values_of_the_tube_with_960_elements_a_block():
    """TSB1, pipe, p = 0.01 MPa, one layer: u 0.0115 mm, point pressure 0.464 MPa from an
    independent program, given to three digits: half a unit of the third, plus the law's cap."""
    result = static_state(pipe(1, (24, 4, 10)))
    assert converges_fast(result)
    assert result.largest_displacement == pytest.approx(0.0115, abs=5.1e-5)
    measured = contact_measures(result)
    assert measured.p_max_point == pytest.approx(0.464, abs=1.1e-3)


@pytest.mark.slow
def test_values_of_twelve_layers():
    """u 0.0269 mm, p_eff 0.347, p_max per face 0.586 MPa: half a unit of the third digit."""
    result = static_state(pipe(12, (24, 4, 10)))
    assert converges_fast(result)
    assert result.largest_displacement == pytest.approx(0.0269, abs=5.1e-5)
    measured = contact_measures(result)
    assert measured.p_eff == pytest.approx(0.347, abs=5.1e-4)
    assert measured.p_max == pytest.approx(0.586, abs=5.1e-4)


def same(a, b, tolerance):
    """Displacements and pressures of two results agree relative to their largest."""
    largest = max(float(np.abs(u).max()) for u in a.displacements)
    for u, v in zip(a.displacements, b.displacements, strict=True):
        assert np.abs(u - v).max() <= tolerance * largest
    assert np.abs(a.pressures - b.pressures).max() <= tolerance * a.pressures.max()


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
    with pytest.raises(SymmetryError, match="the loads of blocks 8 and 9 differ"):
        static_state(model, StaticOptions(symmetry=4))
    with pytest.raises(SymmetryError, match="divides the number of blocks"):
        static_state(model, StaticOptions(symmetry=3))


def test_deformable_frames_are_softer_than_rigid_ones(coarse):
    """Clapeyron for dead loads without initial stress would give it; with a convex energy the
    work of the loads can only grow when supports are released."""
    held = static_state(pipe(frames=Frames.DEFORMABLE))
    assert load_work(held) > load_work(coarse)
    sparse = static_state(held.whole, StaticOptions(method=StaticMethod.SPARSE, symmetry=2))
    same(held, sparse, 1e-6)
    nodes = np.unique(held.whole.assembly.shapes[1].faces["bottom"])
    frame = int(held.whole.body_number[0])
    assert (held.displacements[frame][:, nodes] == 0.0).all()


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
    ours = contact_measures(result)
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
    assert not len(static_state(pipe()).evidence.loose_blocks)


def test_a_load_that_nothing_carries_is_refused():
    """A shear traction on the top of a frictionless column: it slides away."""
    assembly = column(2)
    load = top_load(assembly, traction=np.array([0.01, 0.0, -0.1]))
    with pytest.raises(StaticError, match="no resistance"):
        static_state(deformable_assembly(assembly, load, CORK))


# ---------------------------------------------------------------------------------------------
# Friction


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
