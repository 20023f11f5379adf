"""Curved elements of degree two and three: exact where they must be, and of their order."""

from __future__ import annotations

import numpy as np
import pytest

from fem.element.hexahedron import ElementType, element_stiffness
from fem.element.lagrange import (
    LagrangeElement,
    gauss_line,
    line_basis,
    lobatto_points,
    tensor_points,
)
from fem.element.material import Material
from fem.static.lagrange_block import (
    FACES,
    Lattice,
    body_force,
    columns_of,
    contact_points,
    face_pressure,
    free_block,
    lattice_motions,
)
from fem.static.lagrange_tube import CONTACT_FACES
from fem.static.linear_step.columns import alike_lengths
from geometry.families.sine_block import TSB1
from geometry.mesh import FloatArray, MeshError
from tests.test_validation_own_fem import deformable
from validation.build.deformable import build_deformable
from validation.errors import InputError
from validation.run.curved.accuracy import run_curved
from validation.run.curved.solve import CurvedRun, sine_lattice
from validation.run.solve import run_static

CONCRETE = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)


def lattice(degree: int, counts: tuple[int, int, int] = (1, 6, 2)) -> Lattice:
    lines = tuple(np.linspace(0.0, 1.0, n + 1) for n in counts)
    return sine_lattice(TSB1, lines, LagrangeElement(degree, CONCRETE))  # type: ignore[arg-type]


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


def test_degree_one_is_the_trilinear_element() -> None:
    """The same functions, Gauss points and order of nodes but for the numbering."""
    nodes = lattice(1).positions[lattice(1).elements]
    vtk = [0, 4, 6, 2, 1, 5, 7, 3]
    mine = LagrangeElement(1, CONCRETE).stiffness(nodes)
    dofs = (3 * np.array(vtk)[:, None] + np.arange(3)).ravel()
    ours = element_stiffness(nodes[:, vtk], CONCRETE, ElementType.FULL)
    np.testing.assert_allclose(mine[:, dofs][:, :, dofs], ours, rtol=0, atol=1e-9 * ours.max())


@pytest.mark.parametrize("degree", [2, 3])
def test_affine_states_are_exact(degree: int) -> None:
    """Patch test: a constant strain on curved elements, its stress everywhere, no force inside."""
    block = lattice(degree)
    gradient = 1e-4 * np.array([[1.0, 0.3, -0.2], [0.1, -0.5, 0.4], [0.0, 0.2, 0.7]])
    u = block.positions @ gradient.T
    strain = 0.5 * (gradient + gradient.T)
    voigt = np.array([*np.diag(strain), *(2 * strain[[0, 1, 0], [1, 2, 2]])])
    expected = CONCRETE.elasticity_matrix() @ voigt
    at = tensor_points(degree, *gauss_line(degree))
    force = np.zeros_like(block.positions)
    for members in block.elements:
        corners = block.positions[members]
        stress = block.element.stress(corners, u[members], at)
        # Differences of coordinates of 200 mm: 1e-14 of them over an element of 20 mm.
        np.testing.assert_allclose(
            stress, np.tile(expected, (len(stress), 1)), atol=1e-11 * 33e3 * 1e-4 * 100
        )
        stiffness = block.element.stiffness(corners[None])[0]
        force[members] += (stiffness @ u[members].ravel()).reshape(-1, 3)
    boundary = np.unique(np.concatenate([block.face(name).ravel() for name in FACES]))
    inside = np.setdiff1d(np.arange(len(force)), boundary)
    assert len(inside) > 0
    assert np.abs(force[inside]).max() < 1e-9 * np.abs(force).max()


def test_faces_are_closed_and_look_outwards() -> None:
    """∮ x · ν dA = 3 V and ∮ ν dA = 0, the volume that of the stiffness' own quadrature."""
    block = lattice(3)
    at = tensor_points(3, *gauss_line(5), dimension=2)
    total, flux = np.zeros(3), 0.0
    for name in FACES:
        found = block.face_points(name, at)
        total += np.einsum("qp,qpi->i", found.weights, found.normals)
        flux += float(np.einsum("qp,qpi,qpi->", found.weights, found.normals, found.positions))
    fine = tensor_points(3, *gauss_line(5))
    volume = sum(
        float(block.element.gradients(block.positions[e], fine)[1].sum()) for e in block.elements
    )
    # Polynomials of degree 3 × 3 - 1 in each direction: five points integrate them exactly.
    assert flux == pytest.approx(3.0 * volume, rel=1e-12)
    assert np.abs(total).max() < 1e-9 * volume ** (2 / 3)
    assert volume == pytest.approx(np.pi / 4 * (160.0**2 - 120.0**2) * 200.0, rel=1e-4)


def test_pressure_has_its_resultant() -> None:
    """P times the projected area of the exact inner face, a quarter of a circle of 120 mm."""
    force = face_pressure(lattice(3), "inner", 0.01).sum(axis=0)
    expected = 0.01 * 2 * 120.0 * np.sin(np.pi / 4) * 200.0
    assert force[0] == pytest.approx(expected, rel=1e-6)
    assert np.abs(force[1:]).max() < 1e-9 * expected


def test_weight_has_its_resultant() -> None:
    """Density times exact volume times acceleration: cubic elements miss the sine by 1e-5."""
    force = body_force(lattice(3, (1, 12, 2)), np.array([0.0, 0.0, -9810.0]))
    volume = 0.5 * np.pi / 2.0 * (160.0**2 - 120.0**2) * 200.0
    weight = CONCRETE.density * volume * 9810.0
    np.testing.assert_allclose(force.sum(axis=0), [0.0, 0.0, -weight], atol=1e-4 * weight)


@pytest.mark.parametrize("counts", [(1, 1, 1), (2, 5, 1), (1, 12, 2)])
def test_columns_answer_as_the_whole_block(counts: tuple[int, int, int]) -> None:
    """Forces in balance on points and nodes, against the assembled stiffness without substructures.

    One column, columns that are not alike, and half waves within waves within the block.
    """
    block = lattice(2, counts)
    points = contact_points(block, CONTACT_FACES)
    rigid = lattice_motions(block.positions)
    # Conditions of the held stiffness of some 1e5.
    precision, n = 1e-9, rigid.shape[0]
    whole = np.zeros((n, n))
    for nodes in block.elements:
        unknowns = (3 * nodes[:, None] + np.arange(3)).ravel()
        stiffness = block.element.stiffness(block.positions[nodes][None])[0]
        whole[np.ix_(unknowns, unknowns)] += stiffness
    inverse = np.linalg.inv(whole + whole.diagonal().mean() * rigid @ rigid.T)

    def balanced(found: FloatArray, motions: FloatArray) -> FloatArray:
        return np.asarray(found - motions @ np.linalg.lstsq(motions, found)[0])

    rng = np.random.default_rng(1)
    for asked in (
        np.ones(points.outward.shape[0], bool),
        rng.random(points.outward.shape[0]) < 0.2,
    ):
        free = free_block(points, asked)
        chosen = free.flexible.points
        assert sorted(chosen) == np.flatnonzero(asked).tolist()
        outward, motions = points.outward[chosen], free.motions[chosen]
        expected = outward @ (outward @ inverse).T
        found = free.flexible.flexibility
        sides = (balanced(balanced(f, motions).T, motions) for f in (found, expected))
        np.testing.assert_allclose(*sides, rtol=0, atol=precision * np.abs(expected).max())
    forces = balanced(rng.standard_normal((n, 2)), rigid)
    moved = free.flexible.displacements(forces.T.reshape(2, -1, 3)).reshape(2, -1).T
    sides = (balanced(u, rigid) for u in (moved, inverse @ forces))
    np.testing.assert_allclose(*sides, rtol=0, atol=precision * np.abs(inverse @ forces).max())


def test_alike_columns_are_found() -> None:
    """Quarter waves of two elements, three of them, half a block; nothing in five elements."""

    def lengths(around: int) -> list[int]:
        return alike_lengths(columns_of(contact_points(lattice(1, (1, around, 1)), CONTACT_FACES)))

    assert lengths(24) == [2, 6, 12, 24]
    assert lengths(5) == [5]


def test_an_element_that_folds_is_refused() -> None:
    nodes: FloatArray = lattice(2).positions[lattice(2).elements[:1]].copy()
    nodes[0, 13] += [0.0, 300.0, 0.0]
    with pytest.raises(MeshError, match=r"it folds; expected"):
        LagrangeElement(2, CONCRETE).stiffness(nodes)


# ---------------------------------------------------------------------------------------------
# Tubes


def curved(degree: int, layers: int = 1, *settings: str, case: str = "pipe") -> CurvedRun:
    mesh = ("mesh.around=12", "mesh.radial=2", "mesh.axial=4", f"assembly.layers={layers}")
    return run_curved("tube", deformable(f"tsb1-{case}", *mesh, f"fem.degree={degree}", *settings))


GRAVITY = "effects.gravity=[0.0, 0.0, -9.81e5]"  # a hundredfold, so that weight is felt


@pytest.mark.parametrize(("case", "more"), [("pipe", ()), ("tunnel", ()), ("pipe", (GRAVITY,))])
def test_two_independent_discretisations_agree(case: str, more: tuple[str, ...]) -> None:
    """Degree two beside trilinear blocks with incompatible modes on meshes of 4 and 6 a wave.

    Both converge to the same state; the trilinear one, extrapolated from its two meshes with an
    error in proportion to the size of an element, is known to the size of that extrapolation.
    """
    run = curved(2, 2, *more, case=case)
    found = []
    for around, radial, axial in ((24, 4, 8), (36, 6, 12)):
        mesh = (f"mesh.around={around}", f"mesh.radial={radial}", f"mesh.axial={axial}")
        scene = deformable(f"tsb1-{case}", "assembly.layers=2", *mesh, *more)
        found.append(run_static("trilinear", scene).largest_displacement)
    step = 2.0 * abs(found[1] - found[0])
    measure = run.measures["max_displacement"]
    assert measure.error is not None
    assert abs(measure.value - found[1]) < step + measure.error
    assert run.state.residual < 1e-9


def test_the_change_of_degree_covers_the_error() -> None:
    """Degree two judged by degree three on the same elements."""
    run, reference = curved(2), curved(3)
    for name, measure in run.measures.items():
        assert measure.error is not None
        assert abs(measure.value - reference.measures[name].value) < measure.error, name


def test_a_cap_says_where_it_acted_and_lowers_the_peak() -> None:
    plain, capped = curved(2), curved(2, 1, "contact.maximum_stiffness=100")
    assert plain.as_json()["contact_cap"] is None
    found = capped.as_json()["contact_cap"]
    assert 0 < found["points"] < found["pressing_points"]
    assert 0.0 < found["force_share"] < 1.0
    assert capped.measures["p_max_point"].value < plain.measures["p_max_point"].value


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        (("mesh.around=13",), "a multiple of 3"),
        (("mesh.around=84", "mesh.radial=8"), "expected at most 12000"),
        (("fem.method='explicit'",), r"fem\.method"),
        (("effects.friction.coefficient=0.1",), r"effects\.friction"),
        (("contact.spacing=0.01",), r"contact\.spacing"),
        (("effects.gravity=[9810.0, 0.0, 0.0]",), "across the axis"),
        (("load.case='shaft'",), "load case shaft"),
        (("fem.symmetry='none'",), r"fem\.symmetry"),
    ],
)
def test_what_curved_elements_do_not_do_is_named(settings: tuple[str, ...], text: str) -> None:
    with pytest.raises(InputError, match=text):
        curved(2, 2, *settings)


def test_explicit_runs_refuse_a_degree() -> None:
    explicit = deformable("tsb1-pipe", "fem.degree=2", "fem.method='explicit'")
    with pytest.raises(InputError, match=r"fem\.degree: got 2 with fem\.method"):
        build_deformable(explicit, "tube")
    with pytest.raises(InputError, match="tube of Sine Blocks"):
        run_curved("wall", deformable("thb0-tunnel", "fem.degree=2"))
