"""How deep blocks are in each other; assemblies that cannot be meant are rejected for it.

The points of a block that are looked at are its vertices, moved inward by the tolerance, the
middles of its triangles, and the middles of what lies inside where its edges pierce the other
block; and a coarse lattice in the box that both share, for blocks that coincide. The distance to a
block's surface is VTK's signed distance, which is fast on fine surfaces.

The depth of two blocks that overlap is the least translation that separates them. Of blocks that no
short one separates, one inside the other or held all round, it is that of the deepest point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geometry.files.vtu import as_array, as_surface
from geometry.interface import ROUGHLY_SAME, placements
from geometry.mesh import FloatArray, IntArray
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.near.triangle_search import (
    Surface,
    enclosed,
    overlapping_boxes,
    segment_piercings,
)
from geometry.polyhedra.polyhedron import Polyhedron
from geometry.polyhedra.separation import separations

#: Points along each edge of the lattice in the shared box.
_EDGE = 7
#: The lattice in a box from 0 to 1, (343, 3).
_LATTICE = (np.indices((_EDGE,) * 3).reshape(3, -1).T + 0.5) / _EDGE
#: Surfaces with more triangles than this are fine enough to be judged by their vertices.
_FINE = 2000
#: What two blocks may be, by whether b is inside a and a inside b.
_INSIDE = {
    (False, False): "",
    (True, True): "one block that is there twice",
    (True, False): "the second inside the first: a hollow block is one object of both surfaces",
    (False, True): "the first inside the second: a hollow block is one object of both surfaces",
}
#: Translations that are tried, shortest first, and overlap of moved blocks that is round-off, over
#: their size.
_TRIED, _ROUND_OFF = 12, 1e-9
#: Blocks that must be moved farther than this many depths of the deepest point are held all round:
#: a dovetail 0.2 mm too wide is not as deep as it is long.
_HELD = 10.0
#: Part of the tolerance within which a point that is deeper can be moved and stays inside.
_SURELY = 0.9


@dataclass(frozen=True)
class Overlap:
    """Two blocks that share space."""

    block_a: int
    block_b: int
    depth: float
    """Least translation that separates them; of blocks that no short one separates, depth of the
    deepest point of one inside the other [mm]."""
    point: FloatArray
    """A point in the overlap where it is deepest, (3,) [mm]."""
    words: str = ""
    """What both blocks may be, where one is inside the other or both are one; empty else."""


class SignedDistance:
    """Distance to one closed surface, negative inside; made ready when it is first asked."""

    def __init__(self, shape: Polyhedron) -> None:
        self._shape = shape

    @cached_property
    def _function(self) -> Any:
        """Kept: its search tree takes as long as the distances of some hundred points."""
        from vtkmodules.vtkFiltersCore import vtkImplicitPolyDataDistance

        function = vtkImplicitPolyDataDistance()
        function.SetInput(as_surface(self._shape.points, self._shape.triangles))
        return function

    def __call__(self, points: FloatArray) -> FloatArray:
        """Signed distances of points (n, 3): (n,) [mm]."""
        if not len(points):
            return np.zeros(0)
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkDoubleArray

        result = vtkDoubleArray()
        self._function.FunctionValue(as_array(points), result)
        return np.array(vtk_to_numpy(result), dtype=np.float64)


def _inner_middles(points: FloatArray, edges: IntArray, surface: Surface) -> FloatArray:
    """Middles of the pieces of edges between two piercings of a surface, (n, 3).

    Parameters
    ----------
    points, edges
        (n_points, 3) [mm], in the frame of the surface, and (n_edges, 2).
    surface
        Of the other block.
    """
    start, end = points[edges].swapaxes(0, 1)
    pairs, position = segment_piercings(start, end, surface)
    order = np.lexsort((position, pairs[:, 0]))
    edge, position = pairs[order, 0], position[order]
    same = edge[1:] == edge[:-1]
    middle = 0.5 * (position[1:] + position[:-1])[same]
    edge = edge[1:][same]
    return start[edge] + middle[:, None] * (end - start)[edge]


def penetration(
    a: Polyhedron,
    b: Polyhedron,
    motion: tuple[FloatArray, FloatArray],
    tolerance: float,
    distances: tuple[SignedDistance, SignedDistance],
) -> tuple[float, FloatArray]:
    """Return how deep two shapes overlap, b placed by a rigid motion in a's frame.

    Parameters
    ----------
    a, b
        Shapes.
    motion
        Rotation and translation of b relative to a: x_a = rotation @ x_b + translation.
    tolerance
        Depth that is still a touch [mm].
    distances
        Signed distances to a and to b, each in its own frame.

    Returns
    -------
    float
        Depth of the deepest point looked at [mm]; the tolerance or less where blocks only touch.
    FloatArray
        That point in a's frame, (3,).
    """
    (rotation, translation), (to_a, to_b) = motion, distances
    b_points = b.points @ rotation.T + translation
    low = np.maximum(a.points.min(axis=0), b_points.min(axis=0))
    high = np.minimum(a.points.max(axis=0), b_points.max(axis=0))
    if (low >= high).any():
        return 0.0, np.zeros(3)
    margin = _SURELY * tolerance

    def local(points: FloatArray) -> FloatArray:
        return (points - translation) @ rotation

    def deep_in_a(points: FloatArray) -> FloatArray:
        return points[enclosed(points, a.surface, margin)]

    def deep_in_b(points: FloatArray) -> FloatArray:
        return points[enclosed(local(points), b.surface, margin)]

    middles_b = _inner_middles(b_points, b.edges, a.surface)
    middles_a = _inner_middles(local(a.points), a.edges, b.surface) @ rotation.T + translation
    of_b = [(b.points + tolerance * b.inward) @ rotation.T + translation, middles_b]
    of_a = [a.points + tolerance * a.inward, middles_a]
    if len(b.triangles) <= _FINE:
        of_b.append(b.middles @ rotation.T + translation)
    if len(a.triangles) <= _FINE:
        of_a.append(a.middles)
    lattice = low + (high - low) * _LATTICE
    lattice = lattice[enclosed(lattice, a.surface, margin, 1)]
    depth, where = 0.0, np.zeros(3)
    # Distances take long: they are asked for where something is deep inside.
    for points, depths in (
        (deep_in_a(deep_in_b(lattice)), lambda p: np.minimum(-to_a(p), -to_b(local(p)))),
        (deep_in_a(np.concatenate(of_b)), lambda p: -to_a(p)),
        (deep_in_b(np.concatenate(of_a)), lambda p: -to_b(local(p))),
    ):
        result = depths(points)
        if result.max(initial=0.0) > depth:
            depth, where = float(result.max()), points[int(np.argmax(result))]
    return depth, where


def overlap_depth(
    a: Polyhedron,
    b: Polyhedron,
    motion: tuple[FloatArray, FloatArray],
    tolerance: float,
    distances: tuple[SignedDistance, SignedDistance] | None = None,
) -> tuple[float, FloatArray]:
    """Return the depth of an overlap of two shapes, as of `Overlap`, and where it is deepest.

    Arguments as of `penetration`. The depth is the tolerance or less where blocks only touch.
    """
    distances = distances or (SignedDistance(a), SignedDistance(b))
    depth, where = penetration(a, b, motion, tolerance, distances)
    if depth <= tolerance:
        return depth, where
    if a.exact is not None or b.exact is not None:
        return exact_penetration((a, b), motion, distances)
    rotation, translation = motion
    touch = max(tolerance, _ROUND_OFF * float(np.ptp(a.points, axis=0).max()))
    for way in separations(a, b, motion, least=tolerance, most=_HELD * depth)[:_TRIED]:
        there = rotation, translation + way.distance * way.direction
        if penetration(a, b, there, touch, distances)[0] <= touch:
            return way.distance, way.point
    return depth, where


def exact_penetration(
    shapes: tuple[Polyhedron, Polyhedron],
    motion: tuple[FloatArray, FloatArray],
    distances: tuple[SignedDistance, SignedDistance],
) -> tuple[float, FloatArray]:
    """As `penetration`, of shapes whose curved faces are those of CAD models, not their facets.

    Points of one that lie off its exact faces are moved onto them, and depths are measured from
    the exact faces of the other.
    """
    rotation, translation = motion

    def into_a(points: FloatArray) -> FloatArray:
        return points @ rotation.T + translation

    def into_b(points: FloatArray) -> FloatArray:
        return (points - translation) @ rotation

    a, b = shapes
    crossings = (
        _inner_middles(into_b(a.points), a.edges, b.surface),
        _inner_middles(into_a(b.points), b.edges, a.surface),
    )
    depth, where = 0.0, np.zeros(3)
    for one, other, to_other, met, way, placed in (
        (a, b, distances[1], into_a(crossings[0]), into_b, lambda points: points),
        (b, a, distances[0], into_b(crossings[1]), into_a, into_a),
    ):
        points = np.concatenate([one.points, one.middles, met])
        near, height = on_exact_faces(one, points)
        points = np.where((height > 0.0)[:, None], near, points)
        there = way(points)
        _, outside = on_exact_faces(other, there)
        depths = np.minimum(-to_other(there), np.where(np.isnan(outside), np.inf, -outside))
        if depths.max() > depth:
            depth, where = float(depths.max()), placed(points)[int(depths.argmax())]
    return depth, where


def on_exact_faces(shape: Polyhedron, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nearest points on exact curved faces, and heights of points (n, 3) above them, (n,) [mm].

    Points that are farther from them than any facet lies off its face have none: NaN.
    """
    near, height = points.copy(), np.full(len(points), np.nan)
    off = shape.facet_errors[0]
    curved = np.flatnonzero(off > 0.0)
    if not curved.size:
        return near, height
    import pyvista as pv

    facets = pv.wrap(as_surface(shape.points, shape.triangles[curved]))
    cells, on_facet = facets.find_closest_cell(points, return_closest_point=True)
    rows = np.flatnonzero(np.linalg.norm(on_facet - points, axis=1) <= 2.0 * off.max())
    assert shape.exact is not None
    foot, normals = shape.exact.on(points[rows], curved[np.asarray(cells)[rows]])
    near[rows] = foot
    height[rows] = np.einsum("ni,ni->n", points[rows] - foot, normals)
    return near, height


def find_overlaps(
    blocks: PolyhedralAssembly, tolerance: float, *, by_points: bool = False
) -> list[Overlap]:
    """Pairs of blocks that are deeper in each other than a tolerance [mm], deepest first.

    Pairs of equal shapes in equal relative positions are looked at once. ``by_points``: the depth
    of all is that of the deepest point, which is less work.
    """
    depth_of = penetration if by_points else overlap_depth
    points = [blocks.points(block) for block in range(blocks.n_blocks)]
    least, most = (np.array([end(p, axis=0) for p in points]) for end in (np.min, np.max))
    low, high = least + 0.5 * tolerance, most - 0.5 * tolerance
    pairs = overlapping_boxes(low, high, low, high)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    distances = {int(k): SignedDistance(blocks.shapes[k]) for k in np.unique(blocks.shape_of)}
    size = float((most.max(axis=0) - least.min(axis=0)).max())
    overlaps = []
    for one in placements(pairs, blocks, size=size, same=ROUGHLY_SAME):
        a, b = blocks.shapes[one.shape_m], blocks.shapes[one.shape_s]
        of_a, of_b = distances[one.shape_m], distances[one.shape_s]
        depth, where = depth_of(a, b, (one.rotation, one.translation), tolerance, (of_a, of_b))
        if depth <= tolerance:
            continue
        b_in_a = of_a(b.points @ one.rotation.T + one.translation).max() <= tolerance
        a_in_b = of_b((a.points - one.translation) @ one.rotation).max() <= tolerance
        words = _INSIDE[bool(b_in_a), bool(a_in_b)]
        for i, j in pairs[one.pairs].tolist():
            overlaps.append(Overlap(i, j, depth, blocks.place(i, where), words))
    return sorted(overlaps, key=lambda overlap: (-overlap.depth, overlap.block_a, overlap.block_b))


def _of_exact_faces(assembly: PolyhedralAssembly) -> list[Overlap]:
    """Overlaps of curved faces of CAD models between the vertices of their facets."""
    if all(shape.exact is None for shape in assembly.shapes):
        return []
    patches = assembly.interfaces.patches
    deep = np.flatnonzero(patches.gaps < -assembly.tolerance)
    middles = assembly.interfaces.polygons.patch_centroids
    found: dict[tuple[int, int], Overlap] = {}
    for k in deep[np.argsort(patches.gaps[deep])].tolist():
        pair = int(patches.block_m[k]), int(patches.block_s[k])
        found.setdefault(pair, Overlap(*pair, float(-patches.gaps[k]), middles[k]))
    return list(found.values())


#: Largest tolerance, in block lengths ∛V.
_LARGEST = 0.1
#: Overlapping pairs that one message names.
_MOST_NAMED = 20

#: Coordinates may be rounded to this part of the contact tolerance.
_ROUNDING = 0.01


def largest_tolerance(assembly: PolyhedralAssembly) -> float:
    """Contact tolerance from which on blocks are no solids with gaps [mm]."""
    return _LARGEST * assembly.characteristic_length


def check_contacts(assembly: PolyhedralAssembly, supported: IntArray | None = None) -> None:
    """Reject free blocks that touch nothing, but for those whose numbers are ``supported``.

    Raises
    ------
    AssemblyError
        Naming the block and, if there is one, the gap that keeps it apart.
    """
    interfaces = assembly.interfaces
    touching = np.zeros(assembly.n_blocks, dtype=bool)
    touching[interfaces.block_m] = touching[interfaces.block_s] = True
    if supported is not None:
        touching[supported] = True
    lonely = np.flatnonzero(~touching & ~assembly.fixed)
    if not lonely.size:
        return
    block = int(lonely[0])
    remedy = "move it, or fix or remove it"
    for factor in (10.0, 100.0, 1000.0):
        tolerance = float(f"{factor * assembly.tolerance:.3g}")
        if tolerance > largest_tolerance(assembly):
            break
        wider = assembly.contacts_within(tolerance)
        if block in wider.block_m or block in wider.block_s:
            remedy = (
                f"a facing surface lies within {tolerance:.3g} mm: set `tolerance` = "
                f"{tolerance:.3g} if that is meant to touch"
            )
            break
    more = f" (and {lonely.size - 1} more)" if lonely.size > 1 else ""
    raise AssemblyError(
        f"{assembly.name}: block {assembly.named(block)}{more} touches no other block within "
        f"{assembly.tolerance:.3g} mm; {remedy}"
    )


def check_overlaps(assembly: PolyhedralAssembly, meshed: PolyhedralAssembly | None = None) -> None:
    """Reject blocks that are deeper in each other than the contact tolerance.

    Facets deeper in each other than that are no contact: the joint would be lost. ``meshed`` are
    the solids that the blocks are meshes of.

    Raises
    ------
    AssemblyError
        Naming the pairs, deepest first, how deep and where.
    """
    curved = meshed is not None and any(shape.exact is not None for shape in meshed.shapes)
    overlaps = find_overlaps(assembly, assembly.tolerance, by_points=curved)
    overlaps = overlaps or _of_exact_faces(assembly)
    if not overlaps:
        return
    remedy = f"move them apart{_wider(assembly, overlaps[0].depth)}"
    if meshed is not None and curved:
        check_overlaps(meshed)
        off = max(float(shape.facet_errors[0].max()) for shape in meshed.shapes)
        remedy = (
            f"the solids do, but facets of their curved faces lie up to {off:.3g} mm off them and "
            "do not match; draw both solids in place in one STEP file, where such faces get one "
            "mesh"
        )
    pairs = "; ".join(
        f"blocks {assembly.named(o.block_a)} and {assembly.named(o.block_b)} overlap by "
        f"{o.depth:.3g} mm near "
        f"{np.round(o.point, 2).tolist()} mm{f' ({o.words})' if o.words else ''}"
        for o in overlaps[:_MOST_NAMED]
    )
    more = f"; and {len(overlaps) - _MOST_NAMED} more" if len(overlaps) > _MOST_NAMED else ""
    count = f" ({len(overlaps)} overlapping pairs)" if len(overlaps) > 1 else ""
    raise AssemblyError(
        f"{assembly.name}: {pairs}{more}{count}; expected blocks that touch within "
        f"{assembly.tolerance:.3g} mm: {remedy}"
    )


def _wider(assembly: PolyhedralAssembly, depth: float) -> str:
    """Words for a tolerance that takes overlaps as joints; empty where none may be so large."""
    tolerance = float(f"{1.05 * depth:.2g}")
    if tolerance > largest_tolerance(assembly):
        return ""
    return f", or set `tolerance` = {tolerance:g} if they are meant to touch"


def check_assembly(
    assembly: PolyhedralAssembly,
    supported: IntArray | None = None,
    meshed: PolyhedralAssembly | None = None,
) -> None:
    """Reject overlapping blocks and blocks that neither touch another nor are supported.

    ``meshed`` as in `check_overlaps`.

    Raises
    ------
    AssemblyError
        One clear message for the first of these found.
    """
    if not (np.isfinite(assembly.tolerance) and assembly.tolerance > 0):
        raise AssemblyError(
            f"tolerance: got {assembly.tolerance}, expected a positive length in mm"
        )
    if assembly.tolerance > largest_tolerance(assembly):
        raise AssemblyError(
            f"tolerance: got {assembly.tolerance:g} mm for blocks of "
            f"{assembly.characteristic_length:.3g} mm; expected a small fraction of a block"
        )
    _check_distance(assembly)
    check_overlaps(assembly, meshed)
    check_contacts(assembly, supported)


def _check_distance(assembly: PolyhedralAssembly) -> None:
    """Reject coordinates that are rounded to what counts as a gap."""
    points = [assembly.points(block) for block in range(assembly.n_blocks)]
    reach = max(float(np.abs(block).max()) for block in points)
    size = max(float(np.ptp(block, axis=0).max()) for block in points)
    rounding = float(np.spacing(reach))
    if rounding <= _ROUNDING * assembly.tolerance:
        return
    if np.spacing(size) > _ROUNDING * assembly.tolerance:
        least = float(np.spacing(size)) / _ROUNDING
        raise AssemblyError(
            f"tolerance: got {assembly.tolerance:.3g} mm, but coordinates of these blocks are "
            f"rounded to {np.spacing(size):.1g} mm; expected {least:.1g} mm or more"
        )
    raise AssemblyError(
        f"{assembly.name}: a block lies {reach:.3g} mm from the origin, where coordinates "
        f"are rounded to {rounding:.1g} mm, too coarse for gaps of {assembly.tolerance:.3g} "
        "mm; move the assembly to the origin"
    )
