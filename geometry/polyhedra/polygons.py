"""Triangles of polygons, concave and warped ones too, whichever corner comes first.

A flat polygon may be cut along any diagonal. A warped one has another surface for each, and two
blocks that share it may start it at different corners: it is cut round its middle, the mean of its
corners, as `polyhedron_from_block` does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.mesh import BoolArray, FloatArray, IntArray, MeshError

#: Smallest area of a triangle that counts, and smallest share of it that faces the right way.
_TINY = 1e-9
#: Corners this close to the plane of a polygon, in polygon sizes, lie in it to round-off.
_FLAT = 1e-9


def surface_of_polygons(
    name: str, points: FloatArray, groups: Sequence[IntArray]
) -> tuple[FloatArray, IntArray]:
    """Triangulated surface of polygons; one surface whichever corner of a polygon comes first.

    Parameters
    ----------
    name
        What messages call the surface.
    points
        (n_points, 3).
    groups
        Polygons with the same number of corners together, (n_polygons, n_corners) each.

    Returns
    -------
    FloatArray
        The points, followed by the middles of warped polygons; (n, 3).
    IntArray
        Corners of the triangles, (n_triangles, 3), turned as the polygons are.

    Raises
    ------
    MeshError
        For a polygon that crosses itself or has no area.
    """
    nodes, triangles = [points], []
    count = len(points)
    for group in groups:
        round_middle = _seen_from_middle(points, group)
        middles, cut = _cut_round_middles(points, group[round_middle], count)
        count += len(middles)
        nodes.append(middles)
        triangles += [cut, _triangles_of_polygons(name, points, group[~round_middle])]
    return np.concatenate(nodes), np.concatenate(triangles)


def _seen_from_middle(points: FloatArray, polygons: IntArray) -> BoolArray:
    """Which polygons are warped and show all of themselves to their middle, (n_polygons,)."""
    p = points[polygons]
    arms = p - p.mean(axis=1, keepdims=True)
    vectors = np.cross(arms, np.roll(arms, -1, axis=1))
    total = vectors.sum(axis=1)
    area = np.maximum(np.linalg.norm(total, axis=1), np.finfo(np.float64).tiny)
    size = np.linalg.norm(arms, axis=2).max(axis=1)
    height = np.abs(np.einsum("pci,pi->pc", arms, total / area[:, None])).max(axis=1)
    return (height > _FLAT * size) & _same_way(vectors)


def _cut_round_middles(
    points: FloatArray, polygons: IntArray, first: int
) -> tuple[FloatArray, IntArray]:
    """Middles of polygons, numbered from ``first``, and the triangles between them and the edges.

    The middle is a sum in the order of size, coordinate by coordinate: the same number for the
    blocks on both sides, whatever their corners' order.
    """
    middles = np.sort(points[polygons], axis=1).mean(axis=1)
    number = np.repeat(first + np.arange(len(polygons)), polygons.shape[1])
    start, end = polygons.ravel(), np.roll(polygons, -1, axis=1).ravel()
    return middles, np.column_stack([start, end, number])


def _triangles_of_polygons(name: str, points: FloatArray, polygons: IntArray) -> IntArray:
    """Cut polygons with the same number of corners into triangles that stay inside them.

    Where all triangles from one corner face as the polygon does (it is convex, or sees all of
    itself from there) they are the answer; else its ears are cut one by one.

    Parameters
    ----------
    name
        What messages call the surface.
    points
        (n_points, 3).
    polygons
        Corners in order round each polygon, (n_polygons, n_corners).

    Returns
    -------
    IntArray
        (n_polygons (n_corners - 2), 3), turned as the polygons are.
    """
    n = polygons.shape[1]
    if n == 3:
        return polygons
    rest = np.arange(len(polygons))
    parts = []
    for first in (0, 1):
        fan = np.roll(polygons[rest], -first, axis=1)
        fan = np.stack([fan[:, [0, k, k + 1]] for k in range(1, n - 1)], axis=1)
        good = _covers(points, fan)
        parts.append(fan[good].reshape(-1, 3))
        rest = rest[~good]
    parts += [_without_ears(name, points, polygons[k]) for k in rest]
    return np.concatenate(parts)


def _covers(points: FloatArray, triangles: IntArray) -> BoolArray:
    """Whether the triangles of each polygon all face as their sum does; (n_polygons,).

    Triangles (n_polygons, n, 3) that share the edges inside a polygon then lie side by side.
    """
    p = points[triangles]
    return _same_way(np.cross(p[:, :, 1] - p[:, :, 0], p[:, :, 2] - p[:, :, 0]))


def _same_way(vectors: FloatArray) -> BoolArray:
    """Whether the area vectors of each row, (n_rows, n, 3), all face as their sum does."""
    total = vectors.sum(axis=1)
    along = np.einsum("pti,pi->pt", vectors, total)
    square = np.einsum("pi,pi->p", total, total)
    return (along > _TINY * square[:, None]).all(axis=1) & (square > 0.0)


def _without_ears(name: str, points: FloatArray, polygon: IntArray) -> IntArray:
    """Triangles of one polygon by cutting ears (VTK)."""
    from vtkmodules.vtkCommonCore import vtkIdList
    from vtkmodules.vtkCommonDataModel import vtkPolygon

    shape = vtkPolygon()
    middle = points[polygon].mean(axis=0)  # far from the origin digits would be lost
    shape.GetPoints().SetNumberOfPoints(len(polygon))
    shape.GetPointIds().SetNumberOfIds(len(polygon))
    for k, corner in enumerate(polygon.tolist()):
        shape.GetPoints().SetPoint(k, *(points[corner] - middle))
        shape.GetPointIds().SetId(k, k)
    result = vtkIdList()
    done = shape.TriangulateLocalIds(0, result)
    ears = np.array([result.GetId(k) for k in range(result.GetNumberOfIds())], dtype=np.int64)
    triangles = polygon[ears.reshape(-1, 3)]
    if not done or len(triangles) != len(polygon) - 2 or not _covers(points, triangles[None])[0]:
        raise MeshError(
            f"{name}: a face of {len(polygon)} corners near {np.round(middle, 3).tolist()} (in the "
            "file's unit) cannot be cut into triangles: it crosses or touches itself, or a corner "
            "lies on an edge; triangulate it in the program that made it"
        )
    return triangles
