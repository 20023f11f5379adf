from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from fem import ElementType
from fem.element.kinds import block_stiffness, integration_points, nodal_stress, point_stress
from fem.element.material import (
    DisplacementShapeError,
    invariants,
    principal_stress,
    rotate_stress,
    stress_tensor,
    von_mises,
)
from geometry.block import box_block
from geometry.mesh import HexMesh
from tests.support.fem_problems import (
    CONCRETE,
    boundary_nodes,
    degrees_of_freedom,
    distorted_box,
    static_displacement,
)
from validation import load_case, solve

every_element = pytest.mark.parametrize("element", list(ElementType), ids=lambda e: e.value)


@every_element
def test_constant_stress_is_recovered_exactly_at_every_node(element: ElementType) -> None:
    mesh = distorted_box()
    gradient = 1e-3 * np.random.default_rng(4).normal(size=(3, 3))
    strain = 0.5 * (gradient + gradient.T)
    sigma = CONCRETE.lame_modulus * np.trace(strain) * np.eye(3)
    sigma += 2.0 * CONCRETE.shear_modulus * strain
    (stress,) = nodal_stress(mesh, CONCRETE, element, mesh.nodes[None] @ gradient.T)
    assert stress_tensor(stress) == pytest.approx(
        np.broadcast_to(sigma, (mesh.n_nodes, 3, 3)), abs=1e-12 * 30
    )


@every_element
def test_all_copies_are_the_copies_one_by_one(element: ElementType) -> None:
    mesh = distorted_box()
    u = np.random.default_rng(5).normal(size=(4, mesh.n_nodes, 3))
    at_points = point_stress(mesh, CONCRETE, element, u)
    at_nodes = nodal_stress(mesh, CONCRETE, element, u)
    scale = abs(at_points).max()
    for copy in range(4):
        one = u[copy : copy + 1]
        alone = point_stress(mesh, CONCRETE, element, one)[0]
        assert abs(at_points[copy] - alone).max() < 1e-14 * scale
        alone = nodal_stress(mesh, CONCRETE, element, one)[0]
        assert abs(at_nodes[copy] - alone).max() < 1e-14 * scale
    assert at_points.shape[1] == len(integration_points(mesh, element))
    assert at_points.shape[1] == mesh.n_elements * len(element.points)


def test_pure_bending_stress_of_incompatible_modes_is_exact_at_every_node() -> None:
    """nu = 0.2, end moments: sigma_xx = M z / I, linear, so extrapolation and mean keep it."""
    block = box_block((100.0, 10.0, 10.0), (5, 1, 1))
    mesh = block.mesh
    x, y, z = (mesh.nodes - np.array([0.0, 5.0, 5.0])).T
    curvature, nu = 1e-4, CONCRETE.poisson_ratio
    # Saint-Venant's exact solution of pure bending.
    exact = np.column_stack(
        [
            curvature * x * z,
            -nu * curvature * y * z,
            -0.5 * curvature * (x**2 - nu * (y**2 - z**2)),
        ]
    )
    ends = np.unique(np.concatenate([block.faces["x-"], block.faces["x+"]]))
    prescribed = np.union1d(3 * ends, degrees_of_freedom(np.unique(block.faces["x-"])))
    sigma = CONCRETE.young_modulus * curvature * z

    element = ElementType.INCOMPATIBLE
    u = static_displacement(
        block_stiffness(mesh, CONCRETE, element),
        np.zeros(exact.size),
        prescribed,
        exact.ravel()[prescribed],
    )
    (stress,) = nodal_stress(mesh, CONCRETE, element, u.reshape(1, -1, 3))
    # Round-off times the condition (L/h)⁴ = 1e4 of a slender beam.
    assert abs(stress[:, 0] - sigma).max() < 1e-11 * abs(sigma).max()
    assert abs(stress[:, 1:]).max() < 1e-11 * abs(sigma).max()


def recovered_stress_error(n: int, element: ElementType) -> tuple[float, float]:
    """Largest error inside and on the boundary for a plane wave given at the nodes."""
    straight = box_block((1.0, 1.0, 1.0), (n, n, n)).mesh
    x = straight.nodes
    bulge = 0.15 * np.prod(np.sin(np.pi * x), axis=1, keepdims=True)
    mesh = HexMesh(x + bulge * np.array([1.0, -0.7, 0.4]), straight.elements)
    k, d = np.array([1.3, 0.9, 1.1]), np.array([1.0, 0.5, -0.8])
    phase = mesh.nodes @ k
    strain = np.cos(phase)[:, None, None] * 0.5 * (np.outer(d, k) + np.outer(k, d))
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
    exact = CONCRETE.lame_modulus * trace * np.eye(3) + 2.0 * CONCRETE.shear_modulus * strain
    stress = stress_tensor(
        nodal_stress(mesh, CONCRETE, element, (np.sin(phase)[:, None] * d)[None])[0]
    )
    error = abs(stress - exact).max(axis=(1, 2)) / abs(exact).max()
    outside = boundary_nodes(mesh)
    inside = np.setdiff1d(np.arange(mesh.n_nodes), outside)
    return error[inside].max(), error[outside].max()


@every_element
def test_recovered_stress_is_second_order_inside_and_first_order_on_the_boundary(
    element: ElementType,
) -> None:
    """Inside, the errors of the elements around a node cancel to O(h²); on the boundary there
    is nothing to cancel with: O(h). Observed on a curved mesh at n = 6 and 12: within 0.15."""
    coarse, fine = recovered_stress_error(6, element), recovered_stress_error(12, element)
    order = np.log2(np.array(coarse) / np.array(fine))
    assert order == pytest.approx([2.0, 1.0], abs=0.15)


#: Squares of smaller numbers underflow in LAPACK, which then loses digits of the large ones.
COMPONENTS = st.floats(-1e3, 1e3).map(lambda value: value if abs(value) > 1e-100 else 0.0)


@settings(max_examples=50, deadline=None)
@given(arrays(np.float64, (3, 6), elements=COMPONENTS), st.integers(0, 1000))
def test_principal_stresses_are_sorted_roots_and_do_not_turn(stress, seed: int) -> None:
    """Invariants: trace, determinant, sum of squares; the same in any axes."""
    principal = principal_stress(stress)
    tensor = stress_tensor(stress)
    scale = max(abs(stress).max(), 1.0)
    assert (np.diff(principal, axis=1) <= 0.0).all()
    assert abs(principal.sum(axis=1) - np.trace(tensor, axis1=1, axis2=2)).max() < 1e-13 * scale
    squares = (tensor**2).sum(axis=(1, 2))
    assert abs((principal**2).sum(axis=1) - squares).max() < 1e-13 * scale**2
    assert abs(principal.prod(axis=1) - np.linalg.det(tensor)).max() < 1e-12 * scale**3
    turn = Rotation.random(2, random_state=seed).as_matrix()
    turned = rotate_stress(np.repeat(stress[None], 2, axis=0), turn)
    assert abs(principal_stress(turned) - principal).max() < 1e-13 * scale


def test_mises_is_that_of_the_six_components() -> None:
    """σ_v² = ½ Σ (σ_i − σ_j)² + 3 Σ τ² = 3 J₂; 1e-12: round-off."""
    stress = np.random.default_rng(0).standard_normal((60, 6))
    xx, yy, zz, xy, yz, xz = stress.T
    squares = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    squares += 3.0 * (xy**2 + yz**2 + xz**2)
    np.testing.assert_allclose(3.0 * invariants(stress)[1], squares, rtol=1e-12)
    np.testing.assert_allclose(von_mises(principal_stress(stress)) ** 2, squares, rtol=1e-12)


def test_displacement_of_another_mesh_is_refused() -> None:
    mesh = distorted_box()
    with pytest.raises(DisplacementShapeError, match="got shape"):
        point_stress(mesh, CONCRETE, ElementType.FULL, np.zeros((1, 3, mesh.n_nodes)))
    with pytest.raises(DisplacementShapeError, match="got shape"):
        nodal_stress(mesh, CONCRETE, ElementType.FULL, np.zeros((1, mesh.n_nodes + 1, 3)))


@pytest.mark.parametrize(("radius", "of_element"), [(2.0, True), (40.0, False)])
def test_an_average_over_less_than_an_element_is_named_as_that_of_the_element(
    radius: float, of_element: bool
) -> None:
    """Inside elements of degree 1 nothing is averaged: 2 and 20 mm had one value, as of both."""
    coarse = {"mesh.divisions": [8, 1, 2], "fem.method": "static", "fem.degree": 1}
    coarse |= {"fem.error_estimate": False}
    case = load_case("cantilever", coarse | {"material.averaging_radius": radius})
    words = str(solve(case)).replace("│", " ")
    assert ("over an element, larger than" in " ".join(words.split())) == of_element
    assert f"a sphere of radius {radius:g} mm" in " ".join(words.split())
