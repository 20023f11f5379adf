"""How deep blocks are in each other; assemblies that cannot be meant are refused for it.

The points of a block that are looked at are its vertices, the middles of its triangles, and the
middles of what lies inside where its edges pierce the other block; and a coarse lattice in the box
that both share, for blocks that coincide. The distance to a block's surface is VTK's signed
distance, which is fast on fine surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.assembly import AssemblyError
from geometry.files.vtu import as_array, as_cells
from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.polyhedron import Polyhedron
from geometry.polyhedra.triangle_search import (
    boxes_of_triangles,
    overlapping_boxes,
    segment_piercings,
)

#: Points along each edge of the lattice in the shared box.
_LATTICE = 7
#: Surfaces with more triangles than this are fine enough to be judged by their vertices.
_FINE = 2000


@dataclass(frozen=True)
class Overlap:
    """Two blocks that share space."""

    block_a: int
    block_b: int
    depth: float
    """How deep the deepest point of one lies inside the other [mm]."""
    point: FloatArray
    """That point, (3,) [mm]."""


class SignedDistance:
    """Distance to one closed surface, negative inside."""

    def __init__(self, shape: Polyhedron) -> None:
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkPolyData
        from vtkmodules.vtkFiltersCore import vtkImplicitPolyDataDistance

        surface, points = vtkPolyData(), vtkPoints()
        points.SetData(as_array(shape.points))
        surface.SetPoints(points)
        surface.SetPolys(as_cells(shape.triangles))
        # Kept: its search tree takes as long as the distances of some hundred points.
        self._function: Any = vtkImplicitPolyDataDistance()
        self._function.SetInput(surface)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Signed distances of points (n, 3): (n,) [mm]."""
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkDoubleArray

        if not len(points):
            return np.zeros(0)
        found = vtkDoubleArray()
        self._function.FunctionValue(as_array(points), found)
        return np.array(vtk_to_numpy(found), dtype=np.float64)


def _inner_middles(a: FloatArray, a_edges: IntArray, corners_b: FloatArray) -> FloatArray:
    """Middles of the pieces of a's edges between two piercings of b, (n, 3)."""
    start, end = a[a_edges[:, 0]], a[a_edges[:, 1]]
    low, high = corners_b.min(axis=(0, 1)), corners_b.max(axis=(0, 1))
    near = _meeting(np.minimum(start, end), np.maximum(start, end), low, high)
    start, end = start[near], end[near]
    if not len(start):
        return np.zeros((0, 3))
    low, high = np.minimum(start, end).min(axis=0), np.maximum(start, end).max(axis=0)
    corners_b = corners_b[_meeting(*boxes_of_triangles(corners_b), low, high)]
    pairs, position = segment_piercings(start, end, corners_b, 0.0)
    if len(pairs) < 2:
        return np.zeros((0, 3))
    order = np.lexsort((position, pairs[:, 0]))
    edge, position = pairs[order, 0], position[order]
    same = edge[1:] == edge[:-1]
    middle = 0.5 * (position[1:] + position[:-1])[same]
    edge = edge[1:][same]
    return start[edge] + middle[:, None] * (end - start)[edge]


def _meeting(
    low: FloatArray, high: FloatArray, box_low: FloatArray, box_high: FloatArray
) -> IntArray:
    """Which boxes (n, 3) meet one, (n_meeting,)."""
    return np.flatnonzero(((low <= box_high) & (high >= box_low)).all(axis=1))


def penetration(
    a: Polyhedron,
    b: Polyhedron,
    rotation: FloatArray,
    translation: FloatArray,
    distances: tuple[SignedDistance, SignedDistance],
) -> tuple[float, FloatArray]:
    """Return how deep two shapes overlap, b placed by a rigid motion in a's frame.

    Parameters
    ----------
    a, b
        Shapes.
    rotation, translation
        Position of b relative to a: x_a = rotation @ x_b + translation.
    distances
        Signed distances to a and to b, each in its own frame.

    Returns
    -------
    float
        Depth of the deepest point looked at [mm]; 0 where the shapes are apart or touch.
    FloatArray
        That point in a's frame, (3,).
    """
    b_points = b.points @ rotation.T + translation
    b_corners = b_points[b.triangles]
    low = np.maximum(a.points.min(axis=0), b_points.min(axis=0))
    high = np.minimum(a.points.max(axis=0), b_points.max(axis=0))
    if (low >= high).any():
        return 0.0, np.zeros(3)

    def within(points: FloatArray) -> FloatArray:
        return points[((points >= low) & (points <= high)).all(axis=1)]

    of_b = [b_points, _inner_middles(b_points, b.edges, a.corners)]
    of_a = [a.points, _inner_middles(a.points, a.edges, b_corners)]
    if len(b.triangles) <= _FINE:
        of_b.append(b_corners.mean(axis=1))
    if len(a.triangles) <= _FINE:
        of_a.append(a.corners.mean(axis=1))
    lattice = low + (high - low) * (np.indices((_LATTICE,) * 3).reshape(3, -1).T + 0.5) / _LATTICE
    inside = distances[0](lattice)
    lattice, inside = lattice[inside < 0.0], inside[inside < 0.0]
    shared = np.minimum(-inside, -distances[1]((lattice - translation) @ rotation))
    depth, where = 0.0, np.zeros(3)
    if len(shared) and float(shared.max()) > 0.0:
        depth, where = float(shared.max()), lattice[int(np.argmax(shared))]
    candidates = within(np.concatenate(of_b))
    in_b_frame = within(np.concatenate(of_a))
    for points, distance in (
        (candidates, distances[0](candidates)),
        (in_b_frame, distances[1]((in_b_frame - translation) @ rotation)),
    ):
        if len(points) and -float(distance.min()) > depth:
            deepest = int(np.argmin(distance))
            depth, where = -float(distance[deepest]), points[deepest]
    return depth, where


def find_overlaps(
    shapes: tuple[Polyhedron, ...],
    shape_of: IntArray,
    rotations: FloatArray,
    translations: FloatArray,
    tolerance: float,
) -> list[Overlap]:
    """Pairs of blocks that are deeper than a tolerance in each other, deepest first.

    Pairs of equal shapes in equal relative positions are looked at once.

    Parameters
    ----------
    shapes, shape_of, rotations, translations
        As in `geometry.polyhedra.assembly.PolyhedralAssembly`.
    tolerance
        Depth that is still a touch [mm].
    """
    n = len(shape_of)
    boxes = np.empty((n, 2, 3))
    for block in range(n):
        points = shapes[shape_of[block]].points @ rotations[block].T + translations[block]
        boxes[block] = points.min(axis=0), points.max(axis=0)
    low, high = boxes[:, 0] + 0.5 * tolerance, boxes[:, 1] - 0.5 * tolerance
    pairs = overlapping_boxes(low, high, low, high)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    distances = {int(k): SignedDistance(shapes[k]) for k in np.unique(shape_of)}
    size = float(np.ptp(boxes.reshape(-1, 3), axis=0).max(initial=0.0))
    known: dict[tuple[int, ...], tuple[float, FloatArray]] = {}
    found = []
    for i, j in pairs.tolist():
        rotation = rotations[i].T @ rotations[j]
        translation = rotations[i].T @ (translations[j] - translations[i])
        kinds = int(shape_of[i]), int(shape_of[j])
        rounded = np.concatenate([rotation.ravel() * 1e7, translation * (1e7 / max(size, 1e-300))])
        key = (*kinds, *np.round(rounded).astype(np.int64).tolist())
        if key not in known:
            known[key] = penetration(
                shapes[kinds[0]],
                shapes[kinds[1]],
                rotation,
                translation,
                (distances[kinds[0]], distances[kinds[1]]),
            )
        depth, where = known[key]
        if depth > tolerance:
            found.append(Overlap(i, j, depth, rotations[i] @ where + translations[i]))
    return sorted(found, key=lambda overlap: -overlap.depth)


#: Coordinates may be rounded to this part of the contact tolerance.
_ROUNDING = 0.01


def check_contacts(assembly: PolyhedralAssembly) -> None:
    """Refuse free blocks that touch nothing.

    Raises
    ------
    AssemblyError
        Naming the block and, if there is one, the gap that keeps it apart.
    """
    found = assembly.interfaces
    touching = np.zeros(assembly.n_blocks, dtype=bool)
    touching[found.block_m] = touching[found.block_s] = True
    lonely = np.flatnonzero(~touching & ~assembly.fixed)
    if not lonely.size:
        return
    block = int(lonely[0])
    remedy = "move it, or fix or remove it"
    tolerance = assembly.tolerance
    for _ in range(3):
        tolerance *= 10.0
        wider = assembly.contacts_within(tolerance)
        if block in wider.block_m or block in wider.block_s:
            remedy = (
                f"a facing surface lies within {tolerance:.3g} mm: set detection.tolerance = "
                f"{tolerance:.3g} if that is meant to touch"
            )
            break
    more = f" (and {lonely.size - 1} more)" if lonely.size > 1 else ""
    raise AssemblyError(
        f"{assembly.name}: block {block}{more} touches no other block within "
        f"{assembly.tolerance:.3g} mm; {remedy}"
    )


def check_overlaps(assembly: PolyhedralAssembly) -> None:
    """Refuse blocks that are deeper in each other than twice the contact tolerance.

    Raises
    ------
    AssemblyError
        Naming the deepest pair, how deep and where.
    """
    found = find_overlaps(
        assembly.shapes,
        assembly.shape_of,
        assembly.rotations,
        assembly.translations,
        2 * assembly.tolerance,
    )
    if found:
        worst = found[0]
        raise AssemblyError(
            f"{assembly.name}: blocks {worst.block_a} and {worst.block_b} overlap by "
            f"{worst.depth:.3g} mm near {np.round(worst.point, 2).tolist()} mm "
            f"({len(found)} overlapping pairs); expected blocks that touch within "
            f"{assembly.tolerance:.3g} mm: move them apart or set detection.tolerance"
        )


def check_assembly(assembly: PolyhedralAssembly) -> None:
    """Refuse overlapping blocks and blocks without contact.

    Raises
    ------
    AssemblyError
        One clear message for the first of these found.
    """
    if not (np.isfinite(assembly.tolerance) and assembly.tolerance > 0):
        raise AssemblyError(
            f"detection.tolerance: got {assembly.tolerance}, expected a positive length in mm"
        )
    if assembly.tolerance > 0.1 * assembly.characteristic_length:
        raise AssemblyError(
            f"detection.tolerance: got {assembly.tolerance:g} mm for blocks of "
            f"{assembly.characteristic_length:.3g} mm; expected a small fraction of a block"
        )
    _check_distance(assembly)
    check_overlaps(assembly)
    check_contacts(assembly)


def _check_distance(assembly: PolyhedralAssembly) -> None:
    """Refuse blocks so far from the origin that coordinates are rounded to what counts as a gap."""
    reach = float(np.abs(assembly.translations).max())
    rounding = float(np.spacing(reach))
    if not rounding <= _ROUNDING * assembly.tolerance:
        raise AssemblyError(
            f"{assembly.name}: a block lies {reach:.3g} mm from the origin, where coordinates "
            f"are rounded to {rounding:.1g} mm, and gaps of {assembly.tolerance:.3g} mm are told "
            "apart; move the assembly to the origin"
        )
