"""Frequencies of block stiffness and lumped mass against closed forms and scikit-fem."""

import math

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import diags_array
from scipy.sparse.linalg import eigsh

from fem import ElementType, Material
from fem.system.body import Body, placed_body
from geometry.block import box_block

SOLID = Material(density=2e-9, young_modulus=1000.0, poisson_ratio=0.3)


def nearest_mode(group: Body, omega: float, shape: np.ndarray) -> float:
    """Frequency of the mode nearest to ω that looks like ``shape``."""
    mass = np.repeat(group.lumped_mass, 3)
    square, modes = eigsh(
        group.stiffness.tocsc(), k=8, M=diags_array(mass).tocsc(), sigma=omega**2, v0=shape.ravel()
    )
    overlap = np.abs(modes.T @ (mass * shape.ravel()))
    return math.sqrt(square[np.argmax(overlap)])


@pytest.mark.parametrize("element", [ElementType.FULL, ElementType.B_BAR, ElementType.INCOMPATIBLE])
def test_lame_mode_of_a_free_cube_converges_with_order_two(element):
    # u = (cos πx sin πy, -sin πx cos πy, 0) leaves all faces of the unit cube free of stress and
    # rings at ω = √2 π c_s, whatever ν: Lamé's closed form.
    error = []
    for n in (8, 12):
        mesh = box_block((1.0, 1.0, 1.0), (n, n, n)).mesh
        x, y = np.pi * mesh.nodes[:, 0], np.pi * mesh.nodes[:, 1]
        shape = np.column_stack([np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y), 0.0 * x])
        exact = math.sqrt(2.0) * math.pi * math.sqrt(SOLID.shear_modulus / SOLID.density)
        error.append(
            nearest_mode(placed_body(mesh, SOLID, element=element), exact, shape) / exact - 1
        )
    order = math.log(error[0] / error[1]) / math.log(12 / 8)
    # The next term of the error, (π h)⁴, is still a tenth of it here.
    assert order == pytest.approx(2.0, abs=0.25)
    assert abs(error[-1]) < 0.02


def test_cantilever_bends_at_the_frequency_of_the_beam():
    # Euler and Bernoulli, β L = 1.8751; shear and rotary inertia lower a beam of L / h = 25 by
    # ½ (β r)² (1 + E / κ G) + … < 0.6 %; two elements over the height, 25 along, by ~0.3 %.
    length, height = 50.0, 2.0
    mesh = box_block((length, height, height), (25, 2, 2)).mesh
    material = Material(density=2e-9, young_modulus=1000.0, poisson_ratio=0.0)
    group = placed_body(mesh, material)
    free = np.setdiff1d(np.arange(group.n_nodes), np.flatnonzero(mesh.nodes[:, 0] == 0.0))
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    stiffness = group.stiffness.tocsr()[dofs][:, dofs].toarray()
    mass = np.diag(np.repeat(group.lumped_mass, 3)[dofs])
    found = math.sqrt(eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, 0])[0])
    radius = height / math.sqrt(12.0)
    exact = 1.8751041**2 * radius / length**2 * math.sqrt(1000.0 / 2e-9)
    assert found == pytest.approx(exact, rel=0.01)
    assert found < exact * 1.001


def test_free_cube_has_the_frequencies_of_scikit_fem():
    # Its stiffness by its own quadrature and assembly; the lumped mass as row sums of its
    # consistent mass. Two matrices equal to round-off.
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    axis = np.linspace(0.0, 1.0, 4)
    mesh = skfem.MeshHex.init_tensor(axis, axis, axis)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()), intorder=3)
    stiffness = linear_elasticity(*lame_parameters(1000.0, 0.3)).assemble(basis)
    density = skfem.BilinearForm(lambda u, v, _: 2e-9 * dot(u, v)).assemble(basis)
    lumped = np.asarray(density.sum(axis=1)).ravel()
    theirs = eigh(stiffness.toarray(), np.diag(lumped), eigvals_only=True)
    group = placed_body(box_block((1.0, 1.0, 1.0), (3, 3, 3)).mesh, SOLID, element=ElementType.FULL)
    ours = eigh(
        group.stiffness.toarray(), np.diag(np.repeat(group.lumped_mass, 3)), eigvals_only=True
    )
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * theirs[-1])
    # Six rigid motions and no more.
    assert (np.abs(ours[:6]) < 1e-11 * ours[-1]).all()
    assert ours[6] > 1e-4 * ours[-1]
