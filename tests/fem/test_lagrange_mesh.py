"""Elements of degree two to four on blocks of any family, by the general static solver."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from fem import (
    LinearPenalty,
    Material,
    Problem,
    Static,
    solve_static,
)
from fem.answer.pressures import contact_measures, largest_pressure
from fem.contact.normals import ContactNormals
from fem.element.kinds import block_lumped_mass
from fem.element.lagrange import LagrangeMesh, in_pieces, with_degree
from fem.static.solve import StaticMethod, StaticOptions
from fem.system.body import placed_body
from fem.system.rows import pressure_forces
from geometry.block import Block
from geometry.families.boxes import ColumnBox, box_column
from geometry.families.hexagon_block import (
    HexagonBlockDivisions,
    hexagon_block,
)
from geometry.loads import face_pressure
from geometry.mesh import QuadSurface, boundary_quads, check_mesh
from tests.support.answers import PLAIN, by_options, on_its_mesh
from tests.support.blocks import tsb
from tests.support.fem_problems import (
    CONCRETE,
    degrees_of_freedom,
    distorted_box,
    static_displacement,
)
from tests.support.lagrange_meshes import CURVED, HEXAGON, sine
from validation import load_case


def distorted() -> Block:
    mesh = distorted_box()
    return Block("box", mesh, {"all": boundary_quads(mesh)}, ("all",))


def hydrostatic_error(block: Block, degree: int) -> float:
    """K u of a uniform contraction against the forces of the pressure that makes it, relative."""
    mesh = with_degree(block, degree).mesh
    bulk = CONCRETE.young_modulus / (3.0 * (1.0 - 2.0 * CONCRETE.poisson_ratio))
    found = placed_body(mesh, CONCRETE).stiffness @ (mesh.nodes / (-3.0 * bulk)).ravel()
    quads = mesh.facet_nodes(boundary_quads(mesh))
    pressed = pressure_forces(mesh.nodes, quads, 1.0)
    return float(np.abs(found.reshape(-1, 3) - pressed).max() / np.abs(pressed).max())


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_straight_elements_pass_the_patch_test(degree: int) -> None:
    """A uniform pressure on the whole surface needs its own forces alone, none inside.

    Of trilinear geometry the products have degree k + 2 at most, below 2 k + 2: Gauss points are
    exact, and rounding is left: 1e-16 of terms K u that are some hundred times larger.
    """
    assert hydrostatic_error(distorted(), degree) < 1e-11


@pytest.mark.parametrize("name", CURVED)
def test_quadratic_curved_elements_pass_the_patch_test(name: str) -> None:
    """Of a geometry of degree 2 products have degree 5: three Gauss points are exact."""
    assert hydrostatic_error(CURVED[name], 2) < 1e-10


def test_volumes_are_those_of_the_exact_shape() -> None:
    """A Sine Block has that of the sector of a ring; a geometry of degree k errs by h^(k + 1)."""
    block = tsb()
    outer = block.inner_radius + block.thickness
    exact = 0.5 * block.block_angle * (outer**2 - block.inner_radius**2) * block.height
    errors = [
        abs(block_lumped_mass(with_degree(sine(), degree).mesh, 1.0).sum() / exact - 1.0)
        for degree in (1, 2, 3, 4)
    ]
    # A chord of an angle α loses α² / 6 of its sector; each degree gains a factor of that order.
    angle = block.block_angle / 12.0
    assert errors[0] == pytest.approx(angle**2 / 6.0, rel=0.05)
    assert all(b < angle**2 * a for a, b in itertools.pairwise(errors))
    hexagons = [
        block_lumped_mass(
            with_degree(hexagon_block(HEXAGON, HexagonBlockDivisions(m, 1)), 4).mesh, 1.0
        )
        for m in (2, 6)
    ]
    assert hexagons[0].sum() == pytest.approx(hexagons[1].sum(), rel=1e-6)


def test_a_quadratic_element_is_that_of_another_library() -> None:
    """Eigenvalues of a stiffness do not depend on the basis: scikit-fem on the same hexahedron."""
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    mesh = distorted_box((1, 1, 1))
    theirs = skfem.MeshHex.init_tensor(*[np.array([0.0, 1.0])] * 3)
    order = [int(np.abs(mesh.nodes - p).sum(axis=1).argmin()) for p in np.round(theirs.p.T)]
    theirs = skfem.MeshHex(mesh.nodes[order].T, theirs.t)
    # As many Gauss points as ours, three in each direction.
    basis = skfem.Basis(theirs, skfem.ElementVector(skfem.ElementHex2()), intorder=5)
    lame = lame_parameters(CONCRETE.young_modulus, CONCRETE.poisson_ratio)
    expected = np.linalg.eigvalsh(linear_elasticity(*lame).assemble(basis).toarray())
    block = Block("box", mesh, {})
    ours = placed_body(with_degree(block, 2).mesh, CONCRETE).stiffness.toarray()
    np.testing.assert_allclose(np.linalg.eigvalsh(ours), expected, atol=1e-11 * expected[-1])


@pytest.mark.parametrize("degree", [2, 3])
def test_displacements_converge_with_one_order_more_than_the_degree(degree: int) -> None:
    """u = ∇φ with φ harmonic needs no force inside: given on the surface, it is found inside.

    Halving of the elements of a Sine Block; a quarter of an order for meshes not yet in the limit.
    """
    errors = []
    for divisions in ((12, 1, 2), (24, 2, 4)):
        mesh = with_degree(sine(divisions), degree).mesh
        x, y, _ = mesh.nodes.T / 60.0
        exact = 1e-3 * np.column_stack(
            [np.exp(x) * np.cos(y), -np.exp(x) * np.sin(y), np.zeros(len(x))]
        )
        held = degrees_of_freedom(np.unique(mesh.facet_nodes(boundary_quads(mesh))))
        stiffness = placed_body(mesh, CONCRETE).stiffness
        u = static_displacement(stiffness, np.zeros(exact.size), held, exact.ravel()[held])
        mass = block_lumped_mass(mesh, 1.0)
        error = ((u.reshape(-1, 3) - exact) ** 2).sum(axis=1)
        errors.append(float(np.sqrt(mass @ error)))
    assert np.log2(errors[0] / errors[1]) > degree + 0.75


# ---------------------------------------------------------------------------------------------
# Contact


BAR = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.2)
STIFFNESS = 500.0


def column(degree: int, **more: object) -> Problem:
    """Three equal boxes under a pressure of 2 MPa, their law linear."""
    boxes = box_column([ColumnBox((100.0, 80.0, 50.0), (2, 2, 1))] * 3)
    load = face_pressure(boxes, np.array([2]), "z+", 2.0)
    law = LinearPenalty(STIFFNESS)
    # Current normals would turn with what widens.
    more |= {"normals": ContactNormals.REFERENCE}
    return Problem(boxes, load, BAR, degree=degree, law=law, **more)  # type: ignore[arg-type]


def stated(name: str, *settings: str) -> Problem:
    return load_case(name, ("fem.method='static'", *settings)).problem


def test_solvers_agree_on_a_pressure_that_is_not_resolved() -> None:
    """With open gaps the law beyond the integration points belongs to no solved state."""
    settings = ("contact.clearance=0.2", "mesh.around=12", "mesh.radial=1", "mesh.axial=2")
    settings += ("assembly.layers=1",)
    problem = replace(stated("tsb1-pipe", *settings), degree=2, normals=ContactNormals.REFERENCE)
    found = solve_static(problem, Static(error_estimate=False)).details
    sparse = StaticOptions(method=StaticMethod.SPARSE)
    other = by_options(problem, sparse).details
    peak, same = (largest_pressure(f) for f in (found, other))
    assert peak is not None
    assert same is not None
    assert peak.value == pytest.approx(same.value, rel=1e-5)
    assert not peak.resolved
    assert not same.resolved
    assert peak.value == contact_measures(found).p_max_point


FAMILIES = {
    "thb0-tunnel": (("mesh.edge=2", "mesh.radial=1"), ("mesh.edge=4", "mesh.radial=2")),
    "planar-sine": (("mesh.divisions=[12,1,2]",), ("mesh.divisions=[24,2,4]",)),
    "osteomorphic": (("mesh.divisions=[4,2,2]",), ("mesh.divisions=[8,4,4]",)),
}
"""A coarse mesh and one twice as fine."""


@pytest.mark.parametrize("name", FAMILIES)
def test_few_quadratic_elements_beat_eight_times_as_many_trilinear_ones(name: str) -> None:
    """The coarse quadratic mesh has as many nodes as the fine trilinear one; against degree 4."""
    less = ("assembly.layers=1", *(("assembly.columns=2",) if "thb" not in name else ()))
    coarse, fine = FAMILIES[name]

    def moved(degree: int, *settings: str) -> float:
        problem = replace(stated(name, *settings, *less), degree=degree)
        return solve_static(problem, PLAIN)["u"].value

    reference = moved(4, *coarse)
    assert abs(moved(2, *coarse) - reference) < abs(moved(1, *fine) - reference)


def test_error_bars_hold_the_next_degree() -> None:
    """Bars of degree 2 hold the answers of degree 3, but for one peak on so few elements.

    A value that is printed as not resolved promises nothing.
    """
    settings = ("mesh.edge=2", "mesh.radial=2", "assembly.layers=1", "fem.method='static'")
    run = on_its_mesh("thb0-tunnel", (*settings, "fem.degree=2"), error_estimate=True)
    finer = on_its_mesh("thb0-tunnel", (*settings, "fem.degree=3"))
    errors = {name: measure.error for name, measure in run.measures.items()}
    assert None not in errors.values()
    missed = [
        name
        for name, measure in run.measures.items()
        if measure.resolved and abs(measure.value - finer[name].value) > errors[name]
    ]
    assert len(missed) <= 1, missed


def test_a_block_keeps_its_corners() -> None:
    block = sine()
    mesh = with_degree(block, 3).mesh
    assert isinstance(mesh, LagrangeMesh)
    np.testing.assert_array_equal(mesh.nodes[: block.mesh.n_nodes], block.mesh.nodes)
    np.testing.assert_array_equal(np.unique(mesh.members), np.arange(mesh.n_nodes))
    assert with_degree(with_degree(block, 3), 3).mesh is not None


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("name", CURVED)
def test_pieces_fill_the_block_and_its_faces_close_it(name: str, degree: int) -> None:
    """What pictures show: degree³ hexahedra an element, faces outward, as straight as chords are.

    Vector areas of a closed surface sum to zero; a chord of an angle α loses α² / 6 of a sector.
    """
    block = with_degree(CURVED[name], degree)
    pieces = in_pieces(block)
    check_mesh(pieces.mesh)
    assert pieces.mesh.n_elements == degree**3 * block.mesh.n_elements
    shown = np.concatenate(list(pieces.faces.values()))
    assert {frozenset(q) for q in shown.tolist()} == {
        frozenset(q) for q in boundary_quads(pieces.mesh).tolist()
    }
    surface = QuadSurface(pieces.mesh.nodes, shown)
    largest = surface.areas.max()
    np.testing.assert_allclose(surface.area_vectors.sum(axis=0), 0.0, atol=1e-10 * largest)
    outward = np.einsum("fi,fi->", surface.centroids - pieces.centroid, surface.area_vectors) / 3.0
    assert outward == pytest.approx(pieces.volume, rel=0.01)
    angle = np.pi / 2 / degree  # of an element at most, of these
    assert pieces.volume == pytest.approx(block.volume, rel=angle**2 / 6.0)
