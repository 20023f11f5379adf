"""Facets cut along the edges of others, and the points on their pieces."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from fem.contact.cuts import carry_over
from fem.contact.pieces import clip, fine_points, moment_points
from fem.contact.search import BlockSurface, FacingPoints, closest_points
from fem.element.functions import lagrange_basis
from geometry.block import box_block
from geometry.mesh import boundary_quads

pytestmark = pytest.mark.quick

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def area(polygon):
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def cut(facet, quad):
    polygon = np.zeros((12, 2))
    polygon[:4] = facet
    n = clip(polygon, 4, quad, 2.0, np.empty((12, 2)))
    return polygon[:n]


def grid(turn, size, cells):
    """Squares that tile the plane round the origin, turned by an angle; (n, 4, 2)."""
    shifts = np.stack(np.meshgrid(*2 * [np.arange(-cells, cells) * size]), axis=-1)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return (SQUARE / 2.0 * size + shifts.reshape(-1, 1, 2)) @ rotation.T


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4])
def test_pieces_fill_the_facet(turn):
    """Areas add up to rounding, and so do the moments of order one and two of their points: those
    of the square [0, 2]² are 4, 4, 4, 16/3, 4, 16/3. All points lie in their piece."""
    total, fourth = np.zeros(6), np.zeros(5)
    for quad in grid(turn, 1.3, 4):
        piece = cut(SQUARE, quad)
        if len(piece) < 3 or area(piece) < 1e-12:
            continue
        points = np.empty((4, 2))
        size = moment_points(piece, len(piece), points)
        assert size == pytest.approx(area(piece), rel=1e-12)
        x, y = points[:3].T
        many, weights = np.empty((70, 2)), np.empty(70)
        n = fine_points(piece, len(piece), many, weights)
        u, v = many[:n].T
        fourth += [weights[:n] @ (u**k * v ** (4 - k)) for k in range(5)]
        total += size / 3.0 * np.array([np.ones(3), x, y, x * x, x * y, y * y]).sum(axis=1)
        edge = np.roll(piece, -1, axis=0) - piece
        for point in points[:3]:
            away = point - piece
            assert (edge[:, 0] * away[:, 1] - edge[:, 1] * away[:, 0]).min() > -1e-9
    assert total == pytest.approx([4.0, 4.0, 4.0, 16.0 / 3.0, 4.0, 16.0 / 3.0], rel=1e-12)
    # Those of order four, by the points of curved facets: 2^(k+1) / (k+1) times the other's.
    assert fourth == pytest.approx([12.8, 8.0, 64.0 / 9.0, 8.0, 12.8], rel=1e-12)


def test_random_triangles_keep_their_moments():
    """∫ x² over a triangle is area/12 (Σ x_i² + (Σ x_i)²)."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        triangle = rng.standard_normal((3, 2))
        if area(triangle) < 0.0:
            triangle = triangle[::-1]
        points = np.empty((4, 2))
        size = moment_points(np.ascontiguousarray(triangle), 3, points)
        x = triangle[:, 0]
        exact = size / 12.0 * ((x**2).sum() + x.sum() ** 2)
        assert size / 3.0 * (points[:3, 0] ** 2).sum() == pytest.approx(exact, rel=1e-9)


def plate(number, cells, shift=(0.0, 0.0), turn=0.0, *, up, height=0.0):
    """A square of 4 × 4 mm² with cells × cells facets that look up or down."""
    line = np.linspace(-2.0, 2.0, cells + 1)
    x, y = (g.ravel() for g in np.meshgrid(line, line, indexing="ij"))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    nodes = np.column_stack([np.stack([x, y], 1) @ rotation.T + shift, np.full(len(x), height)])
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = np.stack([first, first + cells + 1, first + cells + 2, first + 1], axis=1)
    return BlockSurface(
        block=number,
        body=0,
        copy=number,
        rotation=np.eye(3),
        nodes=np.arange(len(nodes)),
        reference=nodes,
        quads=quads if up else quads[:, ::-1].copy(),
    )


@pytest.mark.parametrize(("cells", "shift", "turn"), [(4, 0.0, 0.0), (6, 0.37, 0.0), (5, 0.1, 0.4)])
def test_a_uniform_pressure_gives_the_forces_of_either_surface(cells, shift, turn):
    """∫ N_a on a plate inside the other, from the points: each node of the inner one has the area
    round it, to rounding where facets are squares."""
    outer = plate(0, 7, up=True)
    outer = BlockSurface(**(vars(outer) | {"reference": 3.0 * outer.reference}))
    points = FacingPoints((outer, plate(1, cells, (shift, shift), turn, up=False)), reach=0.1)
    assert (points.now.facet < 49).all()
    on_nodes = np.zeros(len(points.position))
    np.add.at(
        on_nodes, points.quads[points.now.slave], points.now.weights[:, None] * points.now.shapes
    )
    cell = (4.0 / cells) ** 2
    line = np.full(cells + 1, 1.0)
    line[[0, -1]] = 0.5
    assert on_nodes[64:] == pytest.approx(cell * np.outer(line, line).ravel(), rel=1e-10)


def test_what_hangs_over_faces_nothing():
    """A plate moved aside by 1.1 mm of its 4 mm along both axes: 2.9² mm² remain."""
    points = FacingPoints((plate(0, 4, up=True), plate(1, 4, (1.1, 1.1), up=False)), reach=0.1)
    assert points.now.weights.sum() == pytest.approx(2.9**2, rel=1e-12)
    assert (points.now.cells >= -1.0).all()
    assert (points.now.cells <= 1.0).all()


def test_facets_that_match_to_rounding_keep_their_gauss_points():
    """Four points on each facet at ±1/√3, also after a slide of a thousandth."""
    for shift in (0.0, 1e-12, 1e-3):
        points = FacingPoints((plate(0, 4, up=True), plate(1, 4, (shift, 0), up=False)), reach=0.1)
        assert np.bincount(points.now.slave)[16:].min() == 4
        corner = points.now.shapes.max(axis=1)
        assert corner == pytest.approx((1.0 + 1.0 / np.sqrt(3.0)) ** 2 / 4.0, abs=2e-3)


@pytest.mark.parametrize("cells", [2, 3, 7])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_points_reach_every_corner_of_what_two_plates_share(cells, turn):
    """Whichever is finer, and where lines nearly coincide: pressure can act at the very edge."""
    for shift in (0.3, 1e-4):
        plates = (plate(0, 4, up=True), plate(1, cells, (shift, 0.2), turn, up=False))
        points = FacingPoints(plates, reach=0.1)
        found = points.now
        position = np.einsum("pa,pai->pi", found.shapes, points.position[points.quads[found.slave]])
        # Pieces below 1e-8 of a facet are left out: triangles of a side of at most 2e-4 of it.
        assert ConvexHull(position[:, :2]).volume == pytest.approx(found.weights.sum(), rel=1e-7)
        assert (found.weights > 0.0).all()


@pytest.mark.parametrize("shift", [0.0, 0.37])
def test_boxes_round_pieces_are_the_pieces_where_edges_are_parallel(shift):
    """Their area in natural coordinates, four for the whole facet, is that of their points."""
    plates = (plate(0, 4, up=True), plate(1, 5, (shift, 0.2), up=False))
    points = FacingPoints(plates, reach=0.1)
    found = points.now
    pieces, which = np.unique(
        np.column_stack([found.slave, found.facet]), axis=0, return_inverse=True
    )
    area = np.bincount(which.ravel(), found.weights) / points.facet_area[pieces[:, 0]]
    box = np.prod(found.cells[:, 1] - found.cells[:, 0], axis=1) / 4.0
    assert box == pytest.approx(area[which.ravel()], abs=1e-9)
    assert (np.abs(found.cells) <= 1.0).all()


def test_no_facet_that_matches_has_no_tangents():
    """Blocks whose meshes do not match anywhere are a case of their own for arrays of no length."""
    basis = lagrange_basis(1)
    assert basis.tangents(np.empty((0, 4, 3))).shape == (0, basis.n_points, 2, 3)


def test_values_go_to_the_nearest_point_of_the_same_facet():
    old_slave, slave = np.array([0, 0, 2]), np.array([0, 1, 2])
    corners = np.eye(4)
    old = np.arange(9.0).reshape(3, 3)
    new = np.empty((3, 3))
    carry_over(old_slave, corners[[0, 1, 2]], old, slave, corners[[1, 1, 3]], new)
    assert (new == [[3.0, 4.0, 5.0], [0.0, 0.0, 0.0], [6.0, 7.0, 8.0]]).all()


@pytest.mark.parametrize("shift", [1e-4, 5e-3, 2e-2])
def test_slivers_have_fewer_points_and_err_by_their_share(shift):
    """Facets of 1 mm that are moved aside a little, and turned by as much: nodal areas as exact
    points give them, to the share of each piece; a node has four facets of at most nine pieces."""
    slight = 1e-7
    plates = plate(0, 8, up=True), plate(1, 4, (shift, 0.5 * shift), shift, up=False)
    found = []
    for share in (0.0, slight):
        points = FacingPoints(plates, reach=0.1, slight=share)
        on_nodes = np.zeros(len(points.position))
        np.add.at(
            on_nodes,
            points.quads[points.now.slave],
            points.now.weights[:, None] * points.now.shapes,
        )
        found.append((points.count, on_nodes, points.now.weights.sum()))
    (many, exact, area), (fewer, close, same) = found
    assert fewer < many
    assert same == pytest.approx(area, rel=1e-12)
    assert np.abs(close - exact).max() < 4 * 9 * slight


def leaning_box(z, lean, cells=2):
    """Surface of a box of 100 × 100 × 50 mm above a height or below it, its far side wider."""
    mesh = box_block((1.0, 1.0, 1.0), (cells,) * 3).mesh
    unit = (mesh.nodes - mesh.nodes.min(axis=0)) / np.ptp(mesh.nodes, axis=0)
    grow = lean * np.abs(unit[:, 2:] - (0.0 if z > 0.0 else 1.0))
    points = np.column_stack([100.0 * unit[:, :2] + grow * (2.0 * unit[:, :2] - 1.0), unit[:, 2]])
    points[:, 2] = 50.0 * points[:, 2] - (0.0 if z > 0.0 else 50.0)
    quads = boundary_quads(mesh)
    nodes = np.unique(quads)
    return nodes, points[nodes], np.searchsorted(nodes, quads)


@pytest.mark.parametrize("lean", [-40.0, -25.0, 0.0, 25.0, 40.0])
@pytest.mark.parametrize("moved", [(0.0, 0.0, -1e-3), (1e-3, 5e-4, -1e-3)])
def test_nothing_lies_deeper_than_blocks_have_moved(lean, moved):
    """Aligned faces whose other sides lean, moved by 1e-3 mm: a side of one block lay 19 mm behind
    the side of the other round the corner, and edges that cross at any depth."""
    blocks = [leaning_box(-1.0, lean), leaning_box(1.0, lean)]
    surfaces = tuple(
        BlockSurface(k, k, 0, np.eye(3), nodes, points + k * np.array(moved), quads)
        for k, (nodes, points, quads) in enumerate(blocks)
    )
    facing = FacingPoints(surfaces, reach=1e-3)
    corners, found = facing.position[facing.quads], facing.now
    points = np.einsum("na,nai->ni", found.shapes, corners[found.slave])
    _, gap, _ = closest_points(corners[found.facet], points, found.xi)
    assert gap.min() > -2e-3
