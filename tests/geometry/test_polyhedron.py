"""Laws of triangulated blocks: exact mass, refused surfaces, overlaps, files."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from geometry import HexagonBlock
from geometry.families.hexagon_block import HexagonBlockDivisions, hexagon_block
from geometry.families.masonry import box
from geometry.families.platonic_layers import cube, octahedron, tetrahedron
from geometry.files.block_files import read_blocks, step_hexahedra
from geometry.files.mesh_io import hexahedra_of, read_any_mesh, write_hex_mesh
from geometry.mesh import FloatArray, IntArray, MeshError, boundary_quads
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.facet_contact import ContactPolygons
from geometry.polyhedra.near.triangle_search import enclosed, overlapping_boxes, segment_piercings
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.overlap import check_assembly, find_overlaps
from geometry.polyhedra.polyhedron import (
    Polyhedron,
    convex_polyhedron,
    polyhedron,
    polyhedron_from_block,
    turned_outward,
)
from tests.support.blocks import random_rotation

pytestmark = pytest.mark.quick

I = np.eye(3)  # noqa: E741


def test_volumes_and_centroids_of_known_solids() -> None:
    # Closed forms with the edge a: tetrahedron a³/(6√2), octahedron √2/3 a³. A dozen terms: 1e-14.
    for shape, volume in (
        (tetrahedron(3.0), 27 / (6 * np.sqrt(2))),
        (octahedron(3.0), np.sqrt(2) / 3 * 27),
        (cube(3.0), 27.0),
    ):
        assert shape.volume == pytest.approx(volume, rel=1e-13)
        np.testing.assert_allclose(shape.centroid, 0.0, atol=1e-14)


def test_the_centroid_of_a_moved_body_moves_with_it() -> None:
    shape = box((2.0, 3.0, 5.0))
    turn, shift = random_rotation(4), np.array([1e3, -2e3, 5e2])
    moved = Polyhedron("moved", shape.points @ turn.T + shift, shape.triangles)
    # Coordinates of 2e3 carry 2e3 · 1e-16 of absolute error into lengths of 5.
    np.testing.assert_allclose(moved.centroid, turn @ shape.centroid + shift, atol=1e-9)


def test_hexahedral_block_and_its_boundary_have_nearly_the_same_volume() -> None:
    parameters = HexagonBlock(4, 120.0, 40.0)
    block = hexagon_block(parameters, HexagonBlockDivisions(12, 6))
    surface = polyhedron_from_block(block)
    # Warped quadrilaterals are bilinear patches there, two triangles here: the prism between
    # them is a twelfth of the warp per facet, with both signs.
    assert surface.volume == pytest.approx(block.volume, rel=1e-3)


def test_coplanar_triangles_share_a_plane_and_curved_ones_do_not() -> None:
    assert len(np.unique(box((1.0, 2.0, 3.0)).plane_of)) == 6
    parameters = HexagonBlock(4, 120.0, 40.0)
    surface = polyhedron_from_block(hexagon_block(parameters, HexagonBlockDivisions(4, 2)))
    # Nothing on this block is flat but, at most, the two halves of a quadrilateral.
    assert np.bincount(surface.plane_of).max() <= 2


def test_overlapping_boxes_are_those_that_overlap() -> None:
    rng = np.random.default_rng(0)
    low_a, low_b = rng.random((60, 3)), rng.random((40, 3))
    high_a, high_b = low_a + 0.3 * rng.random((60, 3)), low_b + 0.3 * rng.random((40, 3))
    expected = np.argwhere(((low_a[:, None] <= high_b) & (low_b <= high_a[:, None])).all(axis=2))
    np.testing.assert_array_equal(overlapping_boxes(low_a, high_a, low_b, high_b), expected)
    of_a, of_b = rng.integers(-1, 3, 60), rng.integers(-1, 3, 40)
    i, j = expected.T
    others = expected[(of_a[i] != of_b[j]) | (of_a[i] < 0)]
    found = overlapping_boxes(low_a, high_a, low_b, high_b, (of_a, of_b))
    np.testing.assert_array_equal(found, others)


def test_boxes_of_very_different_size_and_equal_boxes_are_all_found() -> None:
    rng = np.random.default_rng(1)
    low = np.concatenate([rng.random((30, 3)), np.zeros((1, 3)), np.full((20, 3), 0.5)])
    high = low + np.concatenate([np.full(30, 1e-9), [1e6], np.zeros(20)])[:, None]
    expected = np.argwhere(((low[:, None] <= high) & (low <= high[:, None])).all(axis=2))
    np.testing.assert_array_equal(overlapping_boxes(low, high, low, high), expected)


def test_points_deep_inside_are_kept_and_those_outside_or_on_a_face_are_not() -> None:
    solid, margin = box((2.0, 1.0, 1.0)), 0.02
    points = 3.0 * np.random.default_rng(2).random((4000, 3)) - 0.5
    depth = np.minimum(points, [2.0, 1.0, 1.0] - points).min(axis=1)
    turn = random_rotation(2)
    turned = polyhedron("turned", solid.points @ turn.T, solid.triangles)
    found = enclosed(points @ turn.T, turned.surface, margin)
    assert found[depth > margin].all()
    assert not found[depth < 0.0].any()
    floor = points[depth > 0.0] * [1.0, 1.0, 0.0]
    assert not enclosed(floor, solid.surface, margin).any()


def test_segments_pierce_the_triangles_that_plain_algebra_says() -> None:
    rng = np.random.default_rng(3)
    solid = convex_polyhedron("hull", rng.standard_normal((40, 3)))
    start, end = 2.0 * rng.standard_normal((2, 200, 3))
    expected = []
    for i, j in np.ndindex(len(start), len(solid.corners)):
        a, b, c = solid.corners[j]
        # a + u (b - a) + v (c - a) = start + t (end - start)
        columns = np.column_stack([b - a, c - a, start[i] - end[i]])
        u, v, t = np.linalg.solve(columns, start[i] - a)
        if min(u, v, 1.0 - u - v) > 1e-6 and 0.0 < t < 1.0:
            expected.append((i, j, t))
    pairs, position = segment_piercings(start, end, solid.surface)
    np.testing.assert_array_equal(pairs, [row[:2] for row in expected])
    # Elimination of 3 x 3 of condition below 1e5: far below.
    np.testing.assert_allclose(position, [row[2] for row in expected], atol=1e-9)
    assert not len(segment_piercings(start, end, solid.surface, margin=100.0)[0])


def _soup(*solids: Polyhedron) -> tuple[FloatArray, IntArray]:
    points, triangles, offset = [], [], 0
    for solid in solids:
        points.append(solid.points)
        triangles.append(solid.triangles + offset)
        offset += len(solid.points)
    return np.concatenate(points), np.concatenate(triangles)


def test_surfaces_that_bound_no_solid_are_refused() -> None:
    good = box((10.0, 20.0, 30.0))
    crossing = Polyhedron("b", good.points + np.array([5.0, 7.0, 11.0]), good.triangles)
    with pytest.raises(MeshError, match="cuts through itself"):
        polyhedron("crossing", *_soup(good, crossing))
    with pytest.raises(MeshError, match="at least 4"):
        polyhedron("none", good.points, good.triangles[:2])


def test_an_inside_out_surface_is_the_same_solid() -> None:
    good = box((1.0, 2.0, 3.0))
    turned = polyhedron("turned", good.points, good.triangles[:, ::-1])
    assert turned.volume == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("shift", "depth"),
    [
        ([0.0, 0.0, 1.5], 0.5),  # a shallow cross
        ([0.0, 0.0, 2.0], 0.0),  # touching
        ([0.0, 0.0, 2.1], 0.0),  # apart
        ([0.0, 0.0, 0.0], 2.0),  # a cross in one plane: no vertex of one lies inside the other
    ],
)
def test_depth_of_crossed_bars(shift: list[float], depth: float) -> None:
    long, wide = box((20.0, 2.0, 2.0)), box((2.0, 20.0, 2.0))
    places = np.array([[-10.0, -1.0, -1.0], [-1.0, -10.0, -1.0]]) + np.array([[0.0] * 3, shift])
    placed = [(long, I, places[0]), (wide, I, places[1])]
    found = find_overlaps(polyhedral_assembly("bars", placed, np.arange(2) == 0), 1e-6)
    assert [o.depth for o in found] == ([] if depth == 0.0 else [pytest.approx(depth, rel=1e-9)])


def test_coincident_blocks_overlap() -> None:
    shape = box((2.0, 2.0, 2.0))
    twice = polyhedral_assembly("twice", [(shape, I, np.zeros(3))] * 2, np.arange(2) == 0)
    found = find_overlaps(twice, 1e-6)
    assert len(found) == 1
    assert found[0].depth > 0.5


def _stack(gap: float, size: float = 100.0, **options: float) -> None:
    shape = box((size, size, size))
    check_assembly(
        polyhedral_assembly(
            "stack",
            [(shape, I, np.zeros(3)), (shape, I, np.array([0.0, 0.0, size + gap]))],
            np.array([True, False]),
            DetectionOptions(**options),  # type: ignore[arg-type]
        )
    )


def test_every_overlap_beyond_the_tolerance_is_named() -> None:
    """A joint deeper than the tolerance is no contact: the verdict is that without it."""
    shape, tolerance = box((300.0, 300.0, 300.0)), 0.03

    def cubes(sunk: float) -> PolyhedralAssembly:
        places = [[0.0, 0.0, 0.0], [0.0, 0.0, 300.0 - sunk], [300.0 - sunk, 0.0, 300.0]]
        return polyhedral_assembly(
            "cubes",
            [(shape, I, np.array(place)) for place in places],
            np.array([True, False, False]),
            DetectionOptions(tolerance=tolerance),
        )

    within = cubes(0.9 * tolerance)
    check_assembly(within)
    found = within.interfaces
    assert {(0, 1), (1, 2)} <= set(zip(found.block_m.tolist(), found.block_s.tolist(), strict=True))
    for sunk in (1.1 * tolerance, 1.9 * tolerance, 3.0 * tolerance):
        with pytest.raises(AssemblyError) as error:
            check_assembly(cubes(sunk))
        for pair in ("blocks 0 and 1", "blocks 1 and 2"):
            assert f"{pair} overlap by {sunk:.3g} mm" in str(error.value)


@pytest.mark.parametrize("what", ["rotations", "translations"])
def test_placements_without_numbers_are_refused(what: str) -> None:
    """Compiled loops read beyond their arrays where every comparison of a box was false."""
    shape = box((1.0, 1.0, 1.0))
    turns, shifts = np.array([I, I]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    (turns if what == "rotations" else shifts)[1] = np.nan
    blocks = [(shape, turn, shift) for turn, shift in zip(turns, shifts, strict=True)]
    with pytest.raises(AssemblyError, match=f"{what} of block 1: got .*nan.* expected finite"):
        polyhedral_assembly("stack", blocks, np.array([True, False]))


@pytest.mark.parametrize("n", [1, 3, 5, 100])
def test_boxes_without_numbers_overlap_nothing(n: int) -> None:
    """Leaves that hold no box are never read, whatever is asked."""
    low = np.arange(3.0 * n).reshape(n, 3)
    asked = np.vstack([low, np.full((2, 3), np.nan)])
    found = overlapping_boxes(asked, asked + 0.5, low, low + 0.5)
    np.testing.assert_array_equal(found, np.column_stack([np.arange(n), np.arange(n)]))


def test_assemblies_that_cannot_be_meant_are_refused() -> None:
    _stack(0.0)
    _stack(0.5, tolerance=0.6)
    with pytest.raises(AssemblyError, match="move it"):
        _stack(50.0)
    with pytest.raises(AssemblyError, match="small fraction of a block"):
        _stack(0.0, tolerance=50.0)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "vtu"])
def test_shapes_survive_files(tmp_path: Path, suffix: str) -> None:
    shape = octahedron(80.0)
    path = tmp_path / f"octahedron.{suffix}"
    meshio.write(path, meshio.Mesh(shape.points, [("triangle", shape.triangles)]))
    (read,) = read_blocks(path)
    assert len(read.points) == 6
    assert read.volume == pytest.approx(
        shape.volume,
        rel=1e-6,  # binary STL holds single precision
    )
    (metres,) = read_blocks(path, units="m")
    assert metres.volume == pytest.approx(1e9 * read.volume)


def test_each_closed_surface_of_a_file_is_a_block(tmp_path: Path) -> None:
    far = Polyhedron("far", tetrahedron(5.0).points + 100.0, tetrahedron(5.0).triangles)
    points, triangles = _soup(box((10.0, 10.0, 10.0)), far)
    meshio.write(tmp_path / "two.stl", meshio.Mesh(points, [("triangle", triangles)]))
    volumes = sorted(b.volume for b in read_blocks(tmp_path / "two.stl"))
    np.testing.assert_allclose(volumes, [125 / (6 * np.sqrt(2)), 1000.0], rtol=1e-5)


def test_hexahedra_and_tetrahedra_give_their_boundary(tmp_path: Path) -> None:
    parameters = HexagonBlock(4, 120.0, 40.0)
    mesh = hexagon_block(parameters, HexagonBlockDivisions(4, 2)).mesh
    write_hex_mesh(tmp_path / "block.vtu", mesh)
    (block,) = read_blocks(tmp_path / "block.vtu")
    # Its facets are warped: four triangles round the middle of each, whose volume is that of
    # bilinear facets; 4e5 mm³ are a sum of 400 terms.
    assert len(block.triangles) == 4 * len(boundary_quads(mesh))
    assert block.volume == pytest.approx(
        hexagon_block(parameters, HexagonBlockDivisions(4, 2)).volume
    )
    path = tmp_path / "block.vtu"
    assert hexahedra_of(read_any_mesh(path), path)[0].n_elements == mesh.n_elements
    tetra = meshio.Mesh(tetrahedron(10.0).points, [("tetra", np.array([[0, 1, 2, 3]]))])
    meshio.write(tmp_path / "tetra.vtu", tetra)
    (solid,) = read_blocks(tmp_path / "tetra.vtu")
    assert len(solid.triangles) == 4


def test_files_that_hold_no_block_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="no such file"):
        read_blocks(tmp_path / "missing.stl")
    (tmp_path / "words.stl").write_text("not a mesh")
    with pytest.raises(MeshError, match=r"words\.stl"):
        read_blocks(tmp_path / "words.stl")
    lines = meshio.Mesh(np.zeros((2, 3)), [("line", np.array([[0, 1]]))])
    meshio.write(tmp_path / "lines.vtu", lines)
    with pytest.raises(MeshError, match="got line"):
        read_blocks(tmp_path / "lines.vtu")


def test_step_solids_through_gmsh(tmp_path: Path) -> None:
    gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 10, 20, 30)
    gmsh.model.occ.addCylinder(100, 0, 0, 0, 0, 10, 5)
    gmsh.model.occ.synchronize()
    gmsh.write(str(tmp_path / "two.step"))
    gmsh.finalize()
    blocks = read_blocks(tmp_path / "two.step", element_size=1.0)
    volumes = sorted(b.volume for b in blocks)
    # Chords of 1 mm on a circle of 5 mm lose (1/5)²/6 of its area.
    assert volumes[0] == pytest.approx(np.pi * 250, rel=0.01)
    assert volumes[1] == pytest.approx(6000.0, rel=1e-9)
    # A cylinder has no grid: gmsh fills its surface with tetrahedra.
    assert step_hexahedra(tmp_path / "two.step") == []


@pytest.mark.parametrize("solid", ["ball", "torus"])
def test_a_step_solid_with_a_seam_has_no_grid(solid: str, tmp_path: Path) -> None:
    """A seam bounds a face twice: gmsh crashed with the whole run when it sought a grid there."""
    gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    if solid == "ball":
        gmsh.model.occ.addSphere(0, 0, 0, 10)
    else:
        gmsh.model.occ.addTorus(0, 0, 0, 10, 2)
    gmsh.model.occ.synchronize()
    gmsh.write(str(tmp_path / "round.step"))
    gmsh.finalize()
    assert step_hexahedra(tmp_path / "round.step") == []


def test_a_step_box_becomes_hexahedra(tmp_path: Path) -> None:
    gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 10, 20, 30)
    gmsh.model.occ.synchronize()
    gmsh.write(str(tmp_path / "box.step"))
    gmsh.finalize()
    (mesh,) = step_hexahedra(tmp_path / "box.step", divisions=3)
    assert mesh.n_elements == 27


def test_surface_that_encloses_nothing_warns_of_nothing() -> None:
    """Half of a cube's triangles turned: signed volumes cancel, and checks name the edges."""
    points = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    triangles = convex_polyhedron("cube", points).triangles.copy()
    triangles[::2] = triangles[::2, ::-1]  # each spans the same volume with the middle
    mixed = turned_outward("mixed", points, triangles)
    assert mixed.volume == 0.0
    assert np.isfinite(mixed.centroid).all()


def test_centroid_of_a_patch_is_that_of_its_polygons_by_area() -> None:
    """An L of two rectangles, 2 × 1 and 1 × 3, beside a patch of one triangle."""
    rectangles = [[0, 0], [2, 0], [2, 1], [0, 1], [0, 1], [1, 1], [1, 4], [0, 4]]
    flat = np.array([*rectangles, [10, 0], [13, 0], [10, 3]], dtype=np.float64)
    polygons = ContactPolygons(
        corners=np.column_stack([flat, np.full(len(flat), 5.0)]),
        start=np.array([0, 4, 8, 11]),
        areas=np.array([2.0, 3.0, 4.5]),
        patch=np.array([0, 0, 1]),
    )
    expected = [[(2 * 1.0 + 3 * 0.5) / 5, (2 * 0.5 + 3 * 2.5) / 5, 5.0], [11.0, 1.0, 5.0]]
    np.testing.assert_allclose(polygons.patch_centroids, expected, rtol=1e-14)
