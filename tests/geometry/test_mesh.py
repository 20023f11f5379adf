"""Laws of meshes: exact volumes, closed surfaces, orientation, bad meshes refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.block import box_block
from geometry.families.sine_block import SineBlockDivisions, sine_block
from geometry.files.mesh_io import hexahedra_of, read_any_mesh, write_hex_mesh
from geometry.mesh import (
    CORNERS,
    HEX_EDGES,
    HEX_TETRAHEDRA,
    HexMesh,
    MeshError,
    QuadSurface,
    boundary_quads,
    check_mesh,
    corner_jacobians,
    cross,
    gauss_points,
    jacobians,
    lengths,
    read_only,
    shape_values,
    structured_quads,
    volume_and_centroid,
)
from tests.support.blocks import tsb

pytestmark = pytest.mark.quick

EPS = np.finfo(float).eps


def distorted_box(seed: int) -> HexMesh:
    """A 2 × 3 × 2 box whose inner nodes are moved at random."""
    mesh = box_block((2.0, 3.0, 2.0), (2, 3, 2)).mesh
    rng = np.random.default_rng(seed)
    return HexMesh(mesh.nodes + rng.uniform(-0.15, 0.15, mesh.nodes.shape), mesh.elements)


@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_volume_equals_the_flux_of_the_position_through_the_surface(seed: int) -> None:
    # Divergence theorem, ∫ x·n dA = 3 V. On a bilinear patch with corners p1..p4, ∫ x·dA is
    # known in closed form through the two splittings into triangles: their mean is exact.
    mesh = distorted_box(seed)
    p = mesh.nodes[boundary_quads(mesh)]

    def fan(a: int, b: int, c: int) -> float:
        return float(np.einsum("fi,fi->", p[:, a], np.cross(p[:, b], p[:, c])))

    flux = 0.25 * (fan(0, 1, 2) + fan(0, 2, 3) + fan(1, 2, 3) + fan(1, 3, 0))
    volume = volume_and_centroid(mesh)[0]
    # Sums of about 200 terms of order one: a few hundred roundings.
    assert abs(flux - 3 * volume) < 500 * EPS * 3 * volume


@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_vector_areas_of_a_closed_surface_sum_to_zero(seed: int) -> None:
    mesh = distorted_box(seed)
    surface = QuadSurface(mesh.nodes, boundary_quads(mesh))
    assert np.abs(surface.area_vectors.sum(axis=0)).max() < 100 * EPS * surface.areas.sum()


def test_volume_of_the_sine_block_converges_to_the_shell_sector_in_second_order() -> None:
    # The wave shears vertical columns and leaves their height alone: V = h (r_o² - r_i²) π / n.
    exact = 200.0 * (160.0**2 - 120.0**2) * np.pi / 4
    errors = [exact - sine_block(tsb(), SineBlockDivisions(n, 2, 2)).volume for n in (12, 24, 48)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.02)


@pytest.mark.parametrize("shift", [0.0, 0.25, 0.5])
def test_every_corner_jacobian_of_the_sine_block_is_positive(shift: float) -> None:
    assert corner_jacobians(sine_block(tsb(shift), SineBlockDivisions(24, 4, 6)).mesh).min() > 0


def test_inverted_element_is_named() -> None:
    mesh = box_block((1.0, 1.0, 1.0), (2, 1, 1)).mesh
    elements = mesh.elements.copy()
    elements[1] = elements[1][[4, 5, 6, 7, 0, 1, 2, 3]]
    with pytest.raises(MeshError, match=r"1 of 2 hexahedra are inverted.*first element 1"):
        check_mesh(HexMesh(mesh.nodes, elements))


def test_nan_coordinates_are_named() -> None:
    mesh = box_block((1.0, 1.0, 1.0), (1, 1, 1)).mesh
    nodes = mesh.nodes.copy()
    nodes[3, 1] = np.nan
    with pytest.raises(MeshError, match="node 3"):
        check_mesh(HexMesh(nodes, mesh.elements))


@pytest.mark.parametrize("suffix", [".vtu", ".inp"])
def test_mesh_files_give_back_the_mesh(tmp_path, suffix: str) -> None:
    mesh = sine_block(tsb(), SineBlockDivisions(12, 2, 3)).mesh
    path = tmp_path / f"block{suffix}"
    write_hex_mesh(path, mesh)
    back, _ = hexahedra_of(read_any_mesh(path), path)
    np.testing.assert_array_equal(back.elements, mesh.elements)
    # .inp is text with 16 digits; .vtu keeps the bits.
    np.testing.assert_allclose(back.nodes, mesh.nodes, rtol=1e-14, atol=1e-12)
    assert not list(tmp_path.glob(".partial*"))


def test_unreadable_mesh_is_refused_in_one_line(tmp_path) -> None:
    path = tmp_path / "broken.vtu"
    path.write_text("<VTKFile")
    with pytest.raises(MeshError, match="cannot be read as a mesh"):
        read_any_mesh(path)
    other = tmp_path / "other" / "mesh.inp"
    other.parent.mkdir()
    other.write_text("*Node\n1, 0, 0, 0\n")
    for name in ("/dev/zero", str(other)):
        path = tmp_path / "includes.inp"
        path.write_text(f"*Include, input={name}\n")
        with pytest.raises(MeshError, match=r"includes\.inp: \*Include of another file"):
            read_any_mesh(path)


def test_short_ways_to_volume_centroid_and_corners() -> None:
    """Two Gauss points are enough for both, edges for corners: against three and the gradients."""
    block = sine_block(tsb(0.3), SineBlockDivisions(12, 3, 4))
    mesh = HexMesh(block.mesh.nodes + np.array([1e4, -2e4, 0.0]), block.mesh.elements)
    points, weights = gauss_points(3)
    x = np.einsum("pa,eai->epi", shape_values(points), mesh.nodes[mesh.elements])
    dv = jacobians(mesh, points) * weights
    volume, centroid = volume_and_centroid(mesh)
    assert volume == pytest.approx(dv.sum(), rel=1e-12)
    np.testing.assert_allclose(centroid, np.einsum("ep,epi->i", dv, x) / dv.sum(), atol=1e-8)
    np.testing.assert_allclose(corner_jacobians(mesh), jacobians(mesh, CORNERS), rtol=1e-9)


@given(seed=st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_jacobians_of_corners_are_those_of_the_mapping(seed: int) -> None:
    """Each is an eighth of the triple product of the three edges that meet."""
    mesh = distorted_box(seed)
    mapped = jacobians(mesh, CORNERS)
    np.testing.assert_allclose(corner_jacobians(mesh), mapped, rtol=1e-12, atol=1e-14)


def test_six_tetrahedra_fill_a_cube_without_overlap() -> None:
    """Each has a sixth of the volume, none is turned, and a point inside lies in one of them."""
    corners = (0.5 * (CORNERS + 1.0))[HEX_TETRAHEDRA]
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    np.testing.assert_allclose(np.linalg.det(edges) / 6, 1 / 6, rtol=8 * EPS)
    inside = np.random.default_rng(7).uniform(size=(100, 1, 3))
    shares = np.linalg.solve(edges, (inside - corners[:, 0])[..., None])[..., 0]
    within = (shares > 0.0).all(axis=2) & (shares.sum(axis=2) < 1.0)
    assert within.sum(axis=1).tolist() == [1] * 100


def test_twelve_edges_join_corners_that_differ_in_one_coordinate() -> None:
    steps = np.abs(np.diff(CORNERS[HEX_EDGES], axis=1)[:, 0])
    assert np.sort(steps, axis=1).tolist() == [[0.0, 0.0, 2.0]] * 12
    assert len({tuple(sorted(edge)) for edge in HEX_EDGES.tolist()}) == 12


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_grid_of_quadrilaterals_covers_its_square_once(n: int) -> None:
    u, v = (line.ravel() for line in np.indices((n + 1, n + 1)))
    surface = QuadSurface(np.column_stack([u, v, 0 * u]).astype(float), structured_quads(n))
    np.testing.assert_array_equal(surface.areas, np.ones(n * n))
    assert len(np.unique(surface.centroids.round(6), axis=0)) == n * n


def test_arrays_of_answers_cannot_be_changed_but_their_origin_can() -> None:
    """Whether they stand alone, in a tuple or in a dictionary."""
    origin = np.zeros(3)
    for view in (read_only(origin), read_only((origin, 1))[0], read_only({"a": origin})["a"]):
        with pytest.raises(ValueError, match="read-only"):
            view[0] = 1.0
    origin[0] = 2.0
    assert read_only(origin)[0] == 2.0
    assert read_only("text") == "text"


def test_products_and_lengths_of_vectors_are_those_of_numpy() -> None:
    """Broadcast as there; lengths are sums of three squares in another order: four roundings."""
    random = np.random.default_rng(5)
    one, two = random.normal(size=(4, 1, 3)), random.normal(size=(4, 5, 3))
    np.testing.assert_array_equal(cross(one, two), np.cross(one, two))
    np.testing.assert_allclose(lengths(two), np.linalg.norm(two, axis=2), rtol=1e-15)
