"""Blocks given by a closed triangulated surface: what STL, OBJ and CAD files describe.

Such a block has mass, faces and contacts, but no volume mesh: it is for rigid-block analysis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from geometry.block import Block
from geometry.mesh import BoolArray, FloatArray, IntArray, MeshError, connected_parts
from geometry.polyhedra.near.triangle_search import (
    BoxTree,
    Surface,
    boxes_of_triangles,
    coplanar_groups,
    directed_edges,
    distinct_rows,
    grouped_edges,
    joined,
    piercings,
    ridges,
    smooth_groups,
    undirected_edges,
)
from geometry.polyhedra.polygons import surface_of_polygons
from geometry.polyhedra.solids import across_matter

#: Edges flatter than this are the facets of a curved face, not edges [°].
_SHARP = 25.0
#: Points of a triangle where it is compared with its exact face, by its corners.
_ON_FACETS = np.array([*np.eye(3), *(0.5 * (1.0 - np.eye(3))), np.full(3, 1.0 / 3.0)])
#: 1 + cos of the angle between neighbours that lie on each other: half a thousandth of a radian.
_FLAT = 1e-7


class CurvedFaces(Protocol):
    """The exact shape of a block that its triangles stand for."""

    @property
    def extent(self) -> tuple[float, FloatArray]:
        """Volume [mm³] and centroid (3,) [mm] of the exact shape."""

    def on(self, points: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points on the faces of some triangles, and outward normals there, (n, 3) each.

        ``points`` (n, 3) [mm] and ``triangles`` (n,) are those of the block.
        """

    def together(self, triangles: IntArray) -> BoolArray:
        """Whether the two triangles of each row (n, 2) are of one curved face, (n,)."""

    def curved(self, triangles: IntArray) -> BoolArray:
        """Whether triangles (n,) are of curved faces, (n,)."""


@dataclass(frozen=True)
class Polyhedron:
    """One closed block shape in its own reference position."""

    name: str
    """Name in reports."""
    points: FloatArray
    """Vertices, (n_points, 3) [mm]."""
    triangles: IntArray
    """Corners counter-clockwise seen from outside, (n_triangles, 3)."""
    straightened: bool = False
    """Whether its file has nodes between corners, which a polyhedron has no use for."""
    given_name: str = ""
    """Name that its file gives it; empty without."""
    held: bool = False
    """Whether its file says that it is a support."""
    repairs: tuple[str, ...] = ()
    """What was changed in its surface on request."""
    source: tuple[Path, str] | None = None
    """File that it was read from, and the unit of it: the file may have its hexahedra."""
    exact: CurvedFaces | None = None
    """Faces of the CAD model that the triangles are on; None: the triangles are the shape."""

    @cached_property
    def corners(self) -> FloatArray:
        """Corner coordinates, (n_triangles, 3, 3) [mm]."""
        return self.points[self.triangles]

    @cached_property
    def area_vectors(self) -> FloatArray:
        """Outward vector areas, (n_triangles, 3) [mm²]."""
        p = self.corners
        return 0.5 * np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])

    @cached_property
    def areas(self) -> FloatArray:
        """Triangle areas, (n_triangles,) [mm²]."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @cached_property
    def normals(self) -> FloatArray:
        """Unit outward normals, (n_triangles, 3)."""
        return self.area_vectors / self.areas[:, None]

    @cached_property
    def middles(self) -> FloatArray:
        """Centroids of triangles, (n_triangles, 3) [mm]."""
        return self.corners.mean(axis=1)

    @cached_property
    def facet_errors(self) -> tuple[FloatArray, FloatArray]:
        """How far [mm] and by which angle [rad] facets leave exact faces, (n_triangles,) each."""
        away, turn = np.zeros((2, len(self.triangles)))
        if self.exact is None:
            return away, turn
        curved = np.flatnonzero(self.exact.curved(np.arange(len(self.triangles))))
        points = _ON_FACETS @ self.corners[curved]
        every = np.repeat(curved, len(_ON_FACETS))
        near, normals = self.exact.on(points.reshape(-1, 3), every)
        distance = np.linalg.norm(near - points.reshape(-1, 3), axis=1)
        cosine = np.einsum("ni,ni->n", normals, self.normals[every])
        away[curved] = distance.reshape(len(curved), -1).max(axis=1)
        turn[curved] = np.arccos(np.clip(cosine, -1.0, 1.0)).reshape(len(curved), -1).max(axis=1)
        return away, turn

    @cached_property
    def edges(self) -> IntArray:
        """Undirected edges, (n_edges, 2)."""
        return undirected_edges(self.triangles)[0]

    @cached_property
    def plane_of(self) -> IntArray:
        """Group of connected coplanar triangles that each triangle belongs to, (n_triangles,)."""
        return coplanar_groups(self.points, self.triangles, self.normals, self.areas)

    @cached_property
    def face_of(self) -> IntArray:
        """Flat or curved face, between sharp edges, that each triangle is of, (n_triangles,)."""
        return smooth_groups(self.triangles, self.normals, np.radians(_SHARP))

    @cached_property
    def face_widths(self) -> FloatArray:
        """Width of each face, (n_faces,) [mm]."""
        return widths(self.corners, self.face_of)

    @cached_property
    def face_borders(self) -> tuple[IntArray, IntArray]:
        """Edges round each face, one face after the other, (n, 2), and the first of each face."""
        edges, edge_of, own = grouped_edges(self.triangles, self.face_of)
        face, border = np.repeat(self.face_of, 3), np.flatnonzero(own[edge_of] < 0)
        border = border[np.argsort(face[border], kind="stable")]
        faces = np.arange(int(face.max(initial=-1)) + 2)
        return edges[edge_of[border]], np.searchsorted(face[border], faces)

    def outline(self, plane: int) -> list[int]:
        """Points of one flat side in order round it; empty where more than one loop bounds it."""
        directed = directed_edges(self.triangles[self.plane_of == plane]).tolist()
        known = set(map(tuple, directed))
        following = {start: end for start, end in known if (end, start) not in known}
        n_edges = sum((end, start) not in known for start, end in known)
        loop = list(following)[:1]
        while (after := following[loop[-1]]) != loop[0] and len(loop) <= n_edges:
            loop.append(after)
        return loop if len(loop) == n_edges == len(following) else []

    @cached_property
    def surface(self) -> Surface:
        """The triangles, ready to be searched."""
        tree = BoxTree.of(*boxes_of_triangles(self.corners), self.plane_of)
        return Surface(self.triangles, self.corners, self.area_vectors, tree)

    @cached_property
    def extent(self) -> tuple[float, FloatArray]:
        """Volume [mm³] and centroid (3,) [mm], by the divergence theorem.

        Each triangle spans a tetrahedron with a reference point; their signed moments add up
        exactly (no quadrature). Curved faces of a CAD model count as they are.
        """
        if self.exact is not None:
            return self.exact.extent
        reference = self.points.mean(axis=0)
        p = self.corners - reference
        volume6 = np.einsum("ti,ti->t", p[:, 0], np.cross(p[:, 1], p[:, 2]))
        volume = float(volume6.sum()) / 6.0
        first = np.einsum("t,ti->i", volume6, p.sum(axis=1)) / 24.0
        # Surfaces with triangles turned at random may enclose nothing: checks name what is wrong.
        return volume, reference + (first / volume if volume else np.zeros(3))

    @cached_property
    def plane_areas(self) -> FloatArray:
        """Area of each plane of `plane_of`, (n_planes,) [mm²]."""
        return np.bincount(self.plane_of, weights=self.areas)

    @cached_property
    def plane_normals(self) -> FloatArray:
        """Outward normal of each plane, (n_planes, 3)."""
        total = np.zeros((len(self.plane_areas), 3))
        np.add.at(total, self.plane_of, self.area_vectors)
        return total / np.linalg.norm(total, axis=1, keepdims=True)

    @cached_property
    def inward(self) -> FloatArray:
        """Sum of the inward normals of the planes round each vertex, (n_points, 3)."""
        rows = np.column_stack([self.triangles.ravel(), np.repeat(self.plane_of, 3)])
        corner, plane = rows[distinct_rows(rows)[0]].T
        normals = self.plane_normals[plane]
        n = len(self.points)
        sums = [np.bincount(corner, weights=-normals[:, axis], minlength=n) for axis in range(3)]
        return np.column_stack(sums)

    @cached_property
    def _ridges(self) -> tuple[IntArray, IntArray]:
        """Edges between two planes, (n, 2), and the triangles to their left and right, (n, 2)."""
        return ridges(self.triangles, self.plane_of)

    @property
    def ridges(self) -> tuple[IntArray, IntArray]:
        """Edges between two planes, (n, 2), and the planes to their left and right, (n, 2)."""
        ends, sides = self._ridges
        return ends, self.plane_of[sides]

    @cached_property
    def plane_turns(self) -> FloatArray:
        """Largest angle to a neighbour in the same curved face, (n_planes,) [rad]; 0 in flat ones.

        The facets of curved faces are turned by it from the faces that they stand for.
        """
        planes = self.ridges[1]
        turns = np.zeros(len(self.plane_areas))
        cosine = np.einsum("ni,ni->n", *self.plane_normals[planes].swapaxes(0, 1))
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        smooth = angle < np.radians(_SHARP)
        for side in planes[smooth].T:
            np.maximum.at(turns, side, angle[smooth])
        return turns

    @cached_property
    def sharp_edges(self) -> tuple[IntArray, FloatArray, IntArray]:
        """Convex edges with a real dihedral angle.

        Their corners (n, 2), and normals (n, 2, 3) and numbers (n, 2) of their two faces. The
        pieces of a straight edge between two planes are one edge.
        """
        ends, sides = self._ridges
        if self.exact is not None:  # edges of triangles inside a curved face are none of the block
            between = ~self.exact.together(sides)
            ends, sides = ends[between], sides[between]
        planes = self.plane_of[sides]
        normals = self.plane_normals[planes]
        along = self.points[ends[:, 1]] - self.points[ends[:, 0]]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        # Walking along the first triangle's edge, a convex edge turns the normal towards +along.
        sine = np.einsum("ei,ei->e", np.cross(normals[:, 0], normals[:, 1]), along)
        cosine = np.einsum("ei,ei->e", normals[:, 0], normals[:, 1])
        sharp = (sine > 0) & (cosine < np.cos(np.radians(_SHARP)))
        # Where two pieces between the same planes meet there is no corner.
        pairs = np.sort(planes[sharp], axis=1)
        rows = np.column_stack([np.repeat(pairs, 2, axis=0), ends[sharp].ravel()])
        first, _, count = distinct_rows(rows)
        plane_a, plane_b, corner = rows[first[count % 2 == 1]].T
        axis = np.cross(self.plane_normals[plane_a], self.plane_normals[plane_b])
        place = np.einsum("ni,ni->n", self.points[corner], axis)
        order = np.lexsort((place, plane_b, plane_a))
        edges = corner[order].reshape(-1, 2)
        sides = np.column_stack([plane_a, plane_b])[order[::2]]
        face = np.empty(len(self.plane_areas), dtype=np.int64)
        face[self.plane_of] = self.face_of
        return edges, self.plane_normals[sides], face[sides]

    @property
    def volume(self) -> float:
        """Volume inside the surface [mm³]."""
        return self.extent[0]

    @property
    def centroid(self) -> FloatArray:
        """Mass centroid of the solid, (3,) [mm]."""
        return self.extent[1]


def widths(corners: FloatArray, group: IntArray) -> FloatArray:
    """Area over length of groups of triangles (n, 3, 3), numbered by ``group`` (n,) [mm].

    The length is that of a rectangle with the same second moments of area: whatever the triangles
    and their order, a rectangle is as wide as it is, and strips far apart as their mean.
    """
    n = int(group.max(initial=-1)) + 1
    twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(twice, axis=1)
    total = np.maximum(np.bincount(group, weights=area, minlength=n), np.finfo(np.float64).tiny)
    middle = np.zeros((n, 3))
    np.add.at(middle, group, area[:, None] * corners.mean(axis=1))
    arms = corners - (middle / total[:, None])[group][:, None]
    arms_sum = arms.sum(axis=1)
    square = np.einsum("tci,tcj->tij", arms, arms)
    square += np.einsum("ti,tj->tij", arms_sum, arms_sum)
    second = np.zeros((n, 3, 3))
    np.add.at(second, group, area[:, None, None] / 12.0 * square)
    largest = np.linalg.eigvalsh(second / total[:, None, None])[:, -1]
    return total / np.sqrt(np.maximum(12.0 * largest, np.finfo(np.float64).tiny))


def _edge_uses(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Undirected edges (n, 2), and +1/-1 uses summed and counted: (n, 2) [balance, count]."""
    directed = directed_edges(triangles)
    sign = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    edges, inverse, count = undirected_edges(triangles)
    balance = np.bincount(inverse, weights=sign, minlength=len(edges)).astype(np.int64)
    return edges, np.column_stack([balance, count])


def is_closed(triangles: IntArray) -> bool:
    """Whether no edge belongs to one triangle only."""
    if joined(triangles) is not None:
        return True
    return len(triangles) > 0 and bool((_edge_uses(triangles)[1][:, 1] > 1).all())


def check_polyhedron(block: Polyhedron) -> None:
    """Reject surfaces that bound no solid.

    Raises
    ------
    MeshError
        The first of its `faults`.
    """
    fault = next(faults(block), None)
    if fault is not None:
        raise MeshError(f"{block.name}: {fault}")


def faults(block: Polyhedron) -> Iterator[str]:
    """Why a surface bounds no solid, what must be mended first comes first.

    Non-finite points, triangles without area, an open surface, triangles turned against their
    neighbours or folded on them, a surface that cuts through itself, no volume.
    """
    if len(block.triangles) < 4:
        yield f"got {len(block.triangles)} triangles; expected a closed surface of at least 4"
        return
    if not np.isfinite(block.points).all():
        yield "a vertex is not finite; expected finite coordinates in mm"
        return
    size = float(np.linalg.norm(np.ptp(block.points, axis=0)))
    if size == 0.0:
        yield "all points coincide; expected a solid"
        return
    flat = np.flatnonzero(block.areas <= 1e-14 * size**2)
    if flat.size:
        yield f"triangle {flat[0]} has no area; remove degenerate triangles"
    pairs = joined(block.triangles)
    misfits = [*_misfits(block)] if pairs is None else []
    yield from misfits
    if flat.size or misfits:
        return
    if pairs is None:
        pairs = across_matter(block.name, block.points, block.triangles)
    if block.volume <= 1e-12 * size**3:
        yield f"volume {block.volume:.3g} mm³; expected a positive volume"
    yield from _folds(block, pairs)
    crossing = piercings(block.points, block.surface, block.plane_of, 1e-7 * size)
    if len(crossing):
        yield (
            f"the surface cuts through itself near {np.round(crossing[0], 3).tolist()} mm "
            f"({len(crossing)} places); expected a surface without self-intersections: unite or "
            "separate the parts"
        )


def _misfits(block: Polyhedron) -> Iterator[str]:
    """Edges that do not join two triangles, turned alike."""
    edges, uses = _edge_uses(block.triangles)
    open_edges = np.flatnonzero(uses[:, 1] == 1)
    if open_edges.size:
        middle = block.points[edges[open_edges[0]]].mean(axis=0)
        yield (
            f"the surface is open: {open_edges.size} edges belong to one triangle only, "
            f"the first near {np.round(middle, 3).tolist()} mm; expected a closed surface: "
            "close the holes in the program that made it"
        )
    turned = np.flatnonzero((uses[:, 0] != 0) & (uses[:, 1] != 1))
    if turned.size:
        middle = block.points[edges[turned[0]]].mean(axis=0)
        yield (
            f"neighbouring triangles face opposite ways at {turned.size} edges, the first "
            f"near {np.round(middle, 3).tolist()} mm; expected normals that all point outward: "
            "turn them in the program that made it"
        )


def _folds(block: Polyhedron, neighbours: IntArray) -> Iterator[str]:
    """Triangles that lie on their neighbours, as where a concave face was cut wrongly."""
    a, b = neighbours.T
    opposite = np.einsum("ni,ni->n", block.normals[a], block.normals[b]) < -1.0 + _FLAT
    folded = np.flatnonzero(opposite)
    if folded.size:
        place = block.corners[a[folded[0]]].mean(axis=0)
        yield (
            f"the surface is folded back on itself near {np.round(place, 3).tolist()} mm "
            f"({folded.size} places): two triangles lie on each other; expected faces cut into "
            "triangles that stay inside them: write the file with polygons, or triangulate in the "
            "program that made it"
        )


def merge_points(points: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Unite points that coincide to single precision, as STL files repeat every corner.

    Triangles that lose a corner this way are dropped: they have no area.

    Returns
    -------
    FloatArray, IntArray
        Points (n, 3) and triangles (m, 3).
    """
    size = float(np.ptp(points, axis=0).max(initial=0.0))
    step = 2e-6 * size if size > 0 else 1.0
    pairs = cKDTree(points).query_pairs(step, output_type="ndarray")
    if not len(pairs):
        return points, _of_three_points(triangles)
    label = connected_parts(len(points), *pairs.T)
    _, first = np.unique(label, return_index=True)
    return points[first], _of_three_points(label[triangles])


def _of_three_points(triangles: IntArray) -> IntArray:
    """Those triangles whose corners are three points, (n, 3)."""
    return triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]


def polyhedron(name: str, points: FloatArray, triangles: IntArray) -> Polyhedron:
    """Merge repeated points, turn an inside-out surface, check, and return the block.

    A closed surface whose normals all point inward is one and the same solid: it is turned.

    Raises
    ------
    MeshError
        As in `check_polyhedron`.
    """
    if not np.isfinite(points).all():
        raise MeshError(f"{name}: a vertex is not finite; expected finite coordinates in mm")
    return merged_polyhedron(name, *merge_points(np.asarray(points, dtype=np.float64), triangles))


def merged_polyhedron(name: str, points: FloatArray, triangles: IntArray) -> Polyhedron:
    """As `polyhedron`, of points that are merged already."""
    block = turned_outward(name, points, triangles)
    check_polyhedron(block)
    return block


def turned_outward(name: str, points: FloatArray, triangles: IntArray, **stated: Any) -> Polyhedron:
    """Block of the points that are used, not checked; turned as a whole where it faces inward.

    ``stated`` are its other fields.
    """
    used, inverse = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], inverse.reshape(triangles.shape).astype(np.int64)
    block = Polyhedron(name, points, triangles, **stated)
    if len(triangles) >= 4 and block.volume < 0:
        block = Polyhedron(name, points, np.ascontiguousarray(triangles[:, ::-1]), **stated)
    return block


def convex_polyhedron(name: str, points: FloatArray | Sequence[Sequence[float]]) -> Polyhedron:
    """Convex hull of points as a block.

    Parameters
    ----------
    name
        Name of the shape.
    points
        Vertices, (n, 3) [mm].
    """
    p = np.asarray(points, dtype=np.float64)
    hull = ConvexHull(p)
    outward = np.cross(
        p[hull.simplices[:, 1]] - p[hull.simplices[:, 0]],
        p[hull.simplices[:, 2]] - p[hull.simplices[:, 0]],
    )
    flip = np.einsum("ti,ti->t", outward, hull.equations[:, :3]) < 0
    triangles = hull.simplices.astype(np.int64)
    triangles[flip] = triangles[flip][:, ::-1]
    return polyhedron(name, p, triangles)


def polyhedron_from_quads(name: str, points: FloatArray, quads: IntArray) -> Polyhedron:
    """Block bounded by quadrilaterals, cut as `surface_of_polygons` does.

    Parameters
    ----------
    name
        Name of the shape.
    points
        Vertices, (n, 3) [mm].
    quads
        Closed boundary, counter-clockwise seen from outside, (n_quads, 4).
    """
    return polyhedron(name, *surface_of_polygons(name, points, [quads]))


def polyhedron_from_block(block: Block) -> Polyhedron:
    """Return the boundary of a hexahedral block as a rigid, triangulated one.

    Each quadrilateral becomes four triangles round its middle, so that blocks whose warped facets
    coincide still coincide.
    """
    quads = np.concatenate(list(block.faces.values()))
    # Faces may overlap: sets of a file are parts of its surface.
    _, first = np.unique(np.sort(quads, axis=1), axis=0, return_index=True)
    quads = quads[np.sort(first)]
    middles = block.mesh.nodes[quads].mean(axis=1)
    middle = len(block.mesh.nodes) + np.arange(len(quads))
    triangles = np.concatenate(
        [np.column_stack([quads[:, k], quads[:, (k + 1) % 4], middle]) for k in range(4)]
    )
    return polyhedron(block.name, np.concatenate([block.mesh.nodes, middles]), triangles)
