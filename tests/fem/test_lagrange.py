"""Curved elements of degree two and three: exact where they must be, and of their order."""

from __future__ import annotations

import numpy as np
import pytest
import skfem

from fem import ElementType, Problem, solve_static
from fem.element.functions import (
    gauss_functions,
    lagrange_basis,
    line_basis,
    lobatto_points,
)
from fem.element.kinds import block_internal_force, block_stiffness
from fem.element.lagrange import (
    Lagrange,
    LagrangeMesh,
    adjugates,
    slopes_of,
    sums_by_slopes,
    with_degree,
)
from fem.static.linear_step.columns import flexible_block
from fem.static.linear_step.grid_block import GridBlock, NodeFlexibility, grid_block
from fem.system.body import placed_body
from geometry import pipe
from geometry.mesh import FloatArray, MeshError, boundary_quads
from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse, ring
from tests.support.curved_blocks import CONCRETE, block, curved


def test_a_matrix_times_its_adjugate_is_its_determinant() -> None:
    """A adj(A) = det(A) I, singular matrices included; 1e-14: round-off of entries of order 1."""
    matrices = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 3, 3, 7))
    matrices[0, 2] = matrices[0, 0]
    adjugate, determinant = adjugates(matrices)
    product = np.einsum("nijm,njkm->nmik", matrices, adjugate)
    np.testing.assert_allclose(product, determinant[..., None, None] * np.eye(3), atol=1e-14)
    expected = np.linalg.det(np.moveaxis(matrices, 3, 1))
    np.testing.assert_allclose(determinant, expected, atol=1e-14)


def mesh_of(degree: int, counts: tuple[int, int, int] = (6, 1, 2)) -> LagrangeMesh:
    found = with_degree(block(counts), degree).mesh
    assert isinstance(found, LagrangeMesh)
    return found


def grid_of(degree: int, counts: tuple[int, int, int]) -> GridBlock:
    """In contact below, above, and at both ends."""
    faces = block(counts).faces
    touching = np.concatenate([faces[name] for name in ("bottom", "top", "left", "right")])
    found = grid_block(mesh_of(degree, counts), CONCRETE, touching)
    assert found is not None
    return found


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_polynomials_up_to_the_degree_are_exact(degree: int) -> None:
    x = np.linspace(-1.0, 1.0, 7)
    values, slopes = line_basis(degree, x)
    nodes = lobatto_points(degree)
    for power in range(degree + 1):
        # Sums of at most six terms of size one with Lebesgue constants below three.
        assert np.abs(values @ nodes**power - x**power).max() < 1e-13
        expected = power * x ** max(power - 1, 0)
        assert np.abs(slopes @ nodes**power - expected).max() < 1e-12


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("dimension", [2, 3])
def test_functions_are_those_of_scikit_fem(degree: int, dimension: int) -> None:
    """At its points, [0, 1] in each direction there; 1e-14: round-off of numbers up to 4."""
    at = gauss_functions(degree, degree + 1, dimension)
    kinds = {
        (1, 2): skfem.ElementQuad1,
        (2, 2): skfem.ElementQuad2,
        (1, 3): skfem.ElementHex1,
        (2, 3): skfem.ElementHex2,
    }
    element = kinds[degree, dimension]()
    points, weights = skfem.quadrature.get_quadrature(element, 2 * degree + 1)
    order, nodes = np.lexsort(points[::-1]), np.lexsort(element.doflocs.T[::-1])
    values, slopes = zip(*(element.lbasis(points[:, order], k) for k in nodes), strict=True)
    by_node = 0.5 * np.moveaxis(np.array(slopes), 2, 0)
    np.testing.assert_allclose(at.values, np.array(values).T, rtol=0, atol=1e-14)
    np.testing.assert_allclose(at.slopes, by_node, rtol=0, atol=1e-14)
    np.testing.assert_allclose(at.weights, 2.0**dimension * weights[order], rtol=1e-14)


def test_degree_one_is_the_trilinear_element() -> None:
    """The same functions, Gauss points and order of nodes but for the numbering."""
    nodes = block().mesh.nodes[block().mesh.elements]
    vtk = [0, 4, 6, 2, 1, 5, 7, 3]
    mine = Lagrange(1).stiffness(nodes[:, np.argsort(vtk)], CONCRETE)
    dofs = (3 * np.array(vtk)[:, None] + np.arange(3)).ravel()
    ours = ElementType.FULL.stiffness(nodes, CONCRETE)
    np.testing.assert_allclose(mine[:, dofs][:, :, dofs], ours, rtol=0, atol=1e-9 * ours.max())


@pytest.mark.parametrize("degree", [2, 3])
def test_affine_states_are_exact(degree: int) -> None:
    """Patch test: a constant strain on curved elements, its stress everywhere, no force inside."""
    mesh, element = mesh_of(degree), Lagrange(degree)
    gradient = 1e-4 * np.array([[1.0, 0.3, -0.2], [0.1, -0.5, 0.4], [0.0, 0.2, 0.7]])
    u = mesh.nodes @ gradient.T
    strain = 0.5 * (gradient + gradient.T)
    voigt = np.array([*np.diag(strain), *(2 * strain[[0, 1, 0], [1, 2, 2]])])
    expected = CONCRETE.elasticity_matrix() @ voigt
    at = gauss_functions(degree, degree)
    stress = element.stress_at(mesh.nodes[mesh.members], CONCRETE, u[None, mesh.members], at)
    # Differences of coordinates of 200 mm: 1e-14 of them over an element of 20 mm.
    np.testing.assert_allclose(
        stress, np.broadcast_to(expected, stress.shape), atol=1e-11 * 33e3 * 1e-4 * 100
    )
    force = (placed_body(mesh, CONCRETE).stiffness @ u.ravel()).reshape(-1, 3)
    boundary = np.unique(mesh.facet_nodes(boundary_quads(mesh)))
    inside = np.setdiff1d(np.arange(len(force)), boundary)
    assert len(inside) > 0
    assert np.abs(force[inside]).max() < 1e-9 * np.abs(force).max()


def test_forces_of_elements_are_those_of_the_stiffness() -> None:
    """Summed over points or over K: of sums of some hundred products in another order, rounding."""
    mesh = mesh_of(3)
    u = np.random.default_rng(3).random((2, mesh.n_nodes, 3))
    mine = block_internal_force(mesh, CONCRETE, u)
    expected = block_stiffness(mesh, CONCRETE, Lagrange(3)) @ u.reshape(2, -1).T
    assert np.abs(mine.reshape(2, -1).T - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize(("degree", "n"), [(1, 2), (2, 4), (5, 6)])
def test_products_of_directions_are_slopes_of_functions(degree: int, n: int) -> None:
    """And their transpose; of sums of at most 648 products in another order, rounding."""
    at, random = gauss_functions(degree, n), np.random.default_rng(4)
    values = random.random((7, (degree + 1) ** 3, 3))
    fluxes = random.random((7, 3, 3, n**3))
    slopes = np.einsum("pak,nai->nikp", at.slopes, values)
    sums = np.einsum("pak,nikp->nai", at.slopes, fluxes)
    mine = slopes_of(values, at), sums_by_slopes(fluxes, at)
    for one, expected in zip(mine, (slopes, sums), strict=True):
        np.testing.assert_allclose(one, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_faces_are_closed_and_look_outwards() -> None:
    """∮ x · ν dA = 3 V and ∮ ν dA = 0, the volume that of the stiffness' own quadrature."""
    mesh, element = mesh_of(3), Lagrange(3)
    basis = lagrange_basis(3)
    corners = mesh.nodes[mesh.facet_nodes(boundary_quads(mesh))]
    tangents = np.einsum("pak,fai->fpki", basis.slopes, corners)
    area = basis.weights[:, None] * np.cross(tangents[:, :, 0], tangents[:, :, 1])
    positions = np.einsum("pa,fai->fpi", basis.values, corners)
    flux, total = float(np.einsum("fpi,fpi->", area, positions)), area.sum(axis=(0, 1))
    fine = gauss_functions(3, 5)
    volume = float(element.gradients(mesh.nodes[mesh.members], fine)[1].sum())
    # Polynomials of degree 3 × 3 - 1 in each direction: five points integrate them exactly.
    assert flux == pytest.approx(3.0 * volume, rel=1e-12)
    assert np.abs(total).max() < 1e-9 * volume ** (2 / 3)
    assert volume == pytest.approx(np.pi / 4 * (160.0**2 - 120.0**2) * 200.0, rel=1e-4)


def test_pressure_and_weight_have_their_resultants() -> None:
    """P times the projected area of the exact inner face, a quarter of a circle of 120 mm.

    Density times exact volume times acceleration: cubic elements miss the sine by 1e-5.
    """
    problem = Problem(ring(), pipe(0.01), CONCRETE, degree=3, gravity=[0.0, 0.0, -9810.0])
    system = problem.system.computed
    first = system.nodal_forces()[system.nodes_of(0)]
    expected = 0.01 * 2 * 120.0 * np.sin(np.pi / 4) * 200.0
    volume = 0.5 * np.pi / 2.0 * (160.0**2 - 120.0**2) * 200.0
    weight = CONCRETE.density * volume * 9810.0
    resultant = first.sum(axis=0)
    assert np.linalg.norm(resultant[:2]) == pytest.approx(expected, rel=1e-6)
    assert resultant[2] == pytest.approx(-weight, rel=1e-4)


@pytest.mark.parametrize("counts", [(1, 1, 1), (5, 2, 1), (12, 1, 2)])
def test_columns_answer_as_the_whole_block(counts: tuple[int, int, int]) -> None:
    """Forces in balance on points and nodes, against the assembled stiffness without substructures.

    One column, columns that are not alike, and half waves within waves within the block.
    """
    grid = grid_of(2, counts)
    rigid = np.linalg.qr(grid.rigid)[0]
    # Conditions of the held stiffness of some 1e5.
    precision, n = 1e-9, rigid.shape[0]
    unknowns = (3 * grid.numbers.ravel()[:, None] + np.arange(3)).ravel()
    whole = placed_body(mesh_of(2, counts), CONCRETE).stiffness.toarray()
    whole = whole[np.ix_(unknowns, unknowns)]
    inverse = np.linalg.inv(whole + whole.diagonal().mean() * rigid @ rigid.T)
    motions_of_points = grid.outward @ grid.rigid

    def balanced(found: FloatArray, motions: FloatArray) -> FloatArray:
        return np.asarray(found - motions @ np.linalg.lstsq(motions, found)[0])

    rng = np.random.default_rng(1)
    for asked in (
        np.ones(grid.outward.shape[0], bool),
        rng.random(grid.outward.shape[0]) < 0.2,
    ):
        flexible = flexible_block(grid.columns, asked, grid.rigid)
        chosen = flexible.points
        assert sorted(chosen) == np.flatnonzero(asked).tolist()
        outward, motions = grid.outward[chosen], motions_of_points[chosen]
        expected = outward @ (outward @ inverse).T
        found = flexible.flexibility
        sides = (balanced(balanced(f, motions).T, motions) for f in (found, expected))
        np.testing.assert_allclose(*sides, rtol=0, atol=precision * np.abs(expected).max())
    forces = balanced(rng.standard_normal((n, 2)), rigid)
    moved = flexible.displacements(forces.T.reshape(2, -1, 3)).reshape(2, -1).T
    sides = (balanced(u, rigid) for u in (moved, inverse @ forces))
    np.testing.assert_allclose(*sides, rtol=0, atol=precision * np.abs(inverse @ forces).max())


def test_alike_columns_are_found() -> None:
    """Quarter waves of two elements, three of them, half a block; nothing in five elements."""
    assert grid_of(2, (24, 1, 1)).columns.alike_lengths == [2, 6, 12, 24]
    assert grid_of(2, (5, 1, 1)).columns.alike_lengths == [5]


@pytest.mark.parametrize("counts", [(5, 2, 1), (12, 1, 2)])
def test_forces_on_nodes_of_the_sides_answer_as_forces_on_all_nodes(
    counts: tuple[int, int, int],
) -> None:
    """Substitution in the columns moves every node: its answer at the sides is the flexibility's.

    Forces turn with each copy of a column here; those along normals do not.
    """
    grid = grid_of(2, counts)
    chosen = np.random.default_rng(1).permutation(np.unique(grid.side_nodes))[:40]
    flexible = NodeFlexibility(grid, grid.numbers.ravel()[chosen])
    rigid = flexible.rigid
    forces = np.random.default_rng(2).standard_normal(len(rigid))
    forces -= rigid @ np.linalg.lstsq(rigid, forces)[0]
    on_mesh = np.zeros((grid.numbers.size, 3))
    on_mesh.ravel()[flexible.degrees_of_freedom] = forces
    order = grid.numbers.ravel()
    moved = np.empty_like(on_mesh)
    moved[order] = flexible.displacements(on_mesh[order][None])[0]
    expected = moved.ravel()[flexible.degrees_of_freedom]
    found = flexible.inverse @ forces
    assert flexible.degrees_of_freedom[::3].tolist() == sorted(3 * order[chosen])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_an_element_that_folds_is_refused() -> None:
    nodes: FloatArray = mesh_of(2).nodes[mesh_of(2).members[:1]].copy()
    nodes[0, 13] += [0.0, 300.0, 0.0]
    with pytest.raises(MeshError, match=r"expected positive Jacobians"):
        Lagrange(2).stiffness(nodes, CONCRETE)


# ---------------------------------------------------------------------------------------------
# Tubes


GRAVITY = "effects.gravity=[0.0, 0.0, -9.81e5]"  # a hundredfold, so that weight is felt


def test_two_independent_discretisations_agree() -> None:
    """Degree two beside trilinear blocks with incompatible modes on meshes of 4 and 6 a wave.

    Both converge to the same state; the trilinear one, extrapolated from its two meshes with an
    error in proportion to the size of an element, is known to the size of that extrapolation.
    """
    answer = solve_static(curved(2, 1, GRAVITY))
    found = []
    for around, radial, axial in ((24, 2, 8), (36, 3, 12)):
        mesh = (f"mesh.around={around}", f"mesh.radial={radial}", f"mesh.axial={axial}")
        tube = on_its_mesh("tsb1-pipe", ("assembly.layers=1", *mesh, GRAVITY), method="static")
        found.append(tube.details.largest_displacement)
    step = 2.0 * abs(found[1] - found[0])
    measure = answer["max_displacement"]
    assert measure.error is not None
    assert abs(measure.value - found[1]) < step + measure.error
    assert answer.report["residual"] < 1e-8


def test_a_cap_says_where_it_acted_and_lowers_the_peak() -> None:
    mesh = coarse(1, 2)

    def answer(*settings: str):  # type: ignore[no-untyped-def]
        return on_its_mesh("tsb1-pipe", (*mesh, *settings), method="static").as_dict()

    plain = answer("fem.degree=2")
    capped = answer("fem.degree=2", "contact.maximum_stiffness=100")
    assert plain["contact_cap"] is None
    found = capped["contact_cap"]
    assert 0 < found["points"] < found["pressing_points"]
    assert 0.0 < found["force_share"] < 1.0
    peaks = (data["measures"]["p_max_point"]["value"] for data in (capped, plain))
    assert next(peaks) < next(peaks)
