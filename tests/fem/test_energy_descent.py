"""Descent of the energy: exact tangent, minima instead of saddles, both inverses agree."""

import numpy as np
import pytest

from fem import Material
from fem.contact.normals import ContactNormals
from fem.static.energy_descent import _conjugate_gradients, _Energy, minimise_energy
from fem.static.linear_step.linearisation import SparseStep
from fem.static.solve import StaticMethod, StaticOptions, solve_static
from fem.system.sector import largest_cyclic_orbits
from geometry import SineBlock
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import named_load
from tests.support.fem_problems import deformable_assembly

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
TSB1 = SineBlock(
    height=200.0,
    amplitude=20.0,
    frequency=1.5,
    shift=0.0,
    blocks_per_layer=4,
    inner_radius=120.0,
    thickness=40.0,
)


def tunnel(clearance, divisions=(12, 2, 4), **options):
    assembly = SineTube(TSB1, SineBlockDivisions(*divisions), 2).build()
    load = named_load("tunnel", 0.01).on(assembly)
    return deformable_assembly(assembly, load, CONCRETE, clearance=clearance, **options)


@pytest.fixture(scope="module")
def gapped():
    """Blocks that turn by 0.1 mm in their gaps before they press: normals decide."""
    return tunnel(0.1)


@pytest.fixture(scope="module")
def settled(gapped):
    return solve_static(gapped)


@pytest.fixture(scope="module")
def energy(gapped, settled):
    """Energy of the sector and its state at the solution."""
    system = gapped.in_sector(largest_cyclic_orbits(gapped))
    energy = _Energy(system, SparseStep(system), 1.0)
    return energy, energy(system.localised(settled.displacements))


def test_the_tunnel_with_gaps_reaches_an_equilibrium(settled):
    assert settled.converged
    assert settled.residual <= 1e-8
    assert settled.largest_displacement < 0.5


def test_negative_curvature_is_found_and_points_down():
    """H = diag(2, 1, -1) behind the preconditioner I: three products know the spectrum."""
    diagonal = np.array([[2.0, 1.0, -1.0]])
    right = np.array([[1.0, -3.0, 0.5]])
    found = _conjugate_gradients(lambda v: diagonal * v, lambda f: f, right, 1e-8)
    assert found.falls
    assert np.vdot(found.way, diagonal * found.way) < 0.0
    assert np.vdot(found.way, right) >= 0.0
    solved = _conjugate_gradients(lambda v: abs(diagonal) * v, lambda f: f, right, 1e-12)
    assert not solved.falls
    assert np.allclose(abs(diagonal) * solved.way, right)


def test_force_and_hessian_are_derivatives_of_the_energy(energy):
    """Central differences along a random way: h² from the third derivative of the exponential
    (1/c0 = 1e3 /mm: h/c0 squared = 1e-6 at h = 1e-6 mm), and 1e-16 E / h of rounding."""
    at, state = energy
    way = np.random.default_rng(3).standard_normal(state.force.shape)
    h = 1e-6
    plus, minus = at(state.displacement + h * way), at(state.displacement - h * way)
    product = at.hessian(state)(way)
    slope = (plus.force - minus.force) / (2 * h)
    assert np.abs(slope + product).max() < 1e-5 * np.abs(product).max()
    middle = at(state.displacement + 1e-3 * way)
    ahead, behind = (at(middle.displacement + sign * h * way) for sign in (1, -1))
    found = (ahead.energy - behind.energy) / (2 * h)
    assert found == pytest.approx(-np.vdot(middle.force, way), rel=1e-4)


def test_the_equilibrium_is_a_minimum(energy):
    """All eigenvalues of the dense Hessian are positive: nothing but a minimum is called one."""
    at, state = energy
    hessian = at.hessian(state)
    size = state.displacement.size
    dense = np.stack([hessian(row.reshape(-1, 3)).ravel() for row in np.eye(size)], axis=1)
    assert np.abs(dense - dense.T).max() < 1e-9 * np.abs(dense).max()
    assert np.linalg.eigvalsh(0.5 * (dense + dense.T))[0] > 0.0


def test_sparse_and_condensed_inverses_descend_to_the_same_energy(gapped, settled):
    """Mirror states of one energy; both were solved to 1e-8 of the load."""
    other = solve_static(gapped, StaticOptions(method=StaticMethod.SPARSE))
    assert other.converged
    for name in ("strain_energy", "external_work", "contact_energy"):
        assert getattr(other, name) == pytest.approx(getattr(settled, name), rel=1e-5)
    assert other.pressures.max() == pytest.approx(settled.pressures.max(), rel=1e-5)


def test_without_gap_the_descent_ends_where_the_iteration_does():
    """One minimum, two ways to it, each to 1e-8 of the load; conditioning takes two digits."""
    deformable = tunnel(0.0)
    plain = solve_static(deformable)
    system = deformable.in_sector(largest_cyclic_orbits(deformable))
    reference = solve_static(tunnel(0.0, normals=ContactNormals.REFERENCE))
    size = np.linalg.norm(system.external_force)
    descent = minimise_energy(
        system,
        SparseStep(system),
        system.localised(reference.displacements),
        residual=lambda force, _: float(np.linalg.norm(force) / size),
    )
    assert descent.converged
    assert descent.saddles == 0
    expected = system.localised(plain.displacements)
    assert np.abs(descent.displacement - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("clearance", [0.05, 0.1])
def test_contact_forces_come_to_rest_in_gaps_at_a_minimum(clearance):
    """Only the turning of normals holds blocks along joints that are open at the start.

    From there the descent leaves no step to take, and no direction in which the energy falls.
    """
    deformable = tunnel(clearance, (12, 1, 2), degree=2)
    found = solve_static(deformable)
    system = deformable.in_sector(largest_cyclic_orbits(deformable))
    size = np.linalg.norm(system.external_force)
    descent = minimise_energy(
        system,
        SparseStep(system),
        system.localised(found.displacements),
        residual=lambda force, _: float(np.linalg.norm(force) / size),
        tolerance=1e-6,
    )
    assert descent.converged
    assert len(descent.residuals) == 1
    assert descent.saddles == 0
