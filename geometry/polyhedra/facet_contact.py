"""Contacts between blocks whose meshes do not match: opposing triangles, clipped to polygons.

Facets of different blocks that face each other and lie within a tolerance of one another are
found by a sweep over their boxes; what they share is clipped to convex polygons. Polygons of one
pair of planes make a patch.

Where the contact points of a patch lie decides what the assembly can do. A flat patch with one
point would let its blocks rock. A gap that opens or closes is an affine function on a plane, so it
is non-negative on the whole patch if and only if it is so at the corners of its convex hull, and
every pressure on the patch has the same resultant as some forces at those corners: points at the
*vertices* of the hull are exact for flat faces, at the smallest number. On finely meshed curved
faces one point at the *centroid* of each polygon converges faster and is what the paper does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from geometry.mesh import BoolArray, FloatArray, IntArray, run_starts
from geometry.polyhedra.exact_contact import touched
from geometry.polyhedra.near.triangle_kernels import MOST_CORNERS, clip_pairs, hulls
from geometry.polyhedra.near.triangle_search import ASKEW, distinct_rows, segment_piercings
from geometry.polyhedra.options import CROSSING_EDGES, STANDING_CORNER, ContactPlacement
from geometry.polyhedra.placed_shapes import PlacedShapes
from geometry.polyhedra.point_contact import PointContacts, crossing_edges, standing_corners
from geometry.polyhedra.polyhedron import widths

#: Area that a contact without area stands for, as a part of the mean area of the others.
_POINT_AREA = 1e-2
#: Patches smaller than this part of the mean patch of their joint are what clipping left.
_SLIVER_PATCH = 0.05
#: Patches smaller than this fraction of the smaller of two planes are edges that touch …
_SLIVER = 1e-7
#: … and polygons smaller than this fraction of the smaller of two triangles are corners.
_SPECK = 1e-12
#: Points of triangles that lines of sight go through, by their corners, (9, 3) …
_SAMPLES = np.array([[i, j, 8 - i - j] for i in (1, 3, 5) for j in (1, 3, 5) if i + j < 8]) / 8.0
#: … and the part of a line at each of its ends where its own blocks hide nothing.
_INSET = 1e-3
#: Points of a patch this near to each other are one, in sizes of the assembly.
_ONE_POINT = 1e-6
#: Largest angle between facing facets of flat faces unless stated [°].
_ANGLE = 5.0


@dataclass(frozen=True)
class ContactPolygons:
    """The clipped overlaps, for pictures, areas and checks."""

    corners: FloatArray
    """Corners of all polygons, one polygon after the other, (n_corners, 3) [mm]."""
    start: IntArray
    """First corner of each polygon, and the total; (n_polygons + 1,)."""
    areas: FloatArray
    """(n_polygons,) [mm²]."""
    patch: IntArray
    """Patch of each polygon, (n_polygons,)."""

    @cached_property
    def triangles(self) -> tuple[IntArray, IntArray]:
        """Polygons as fans: places of their corners (n, 3), and the polygon of each (n,)."""
        count = np.diff(self.start)
        fans, owner = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for k in range(1, int(count.max(initial=2)) - 1):
            has = np.flatnonzero(count > k + 1)
            first = self.start[:-1][has]
            fans.append(np.column_stack([first, first + k, first + k + 1]))
            owner.append(has)
        return np.concatenate(fans), np.concatenate(owner)

    @cached_property
    def triangle_areas(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Centroid (n, 3) [mm], area (n,) [mm²] and patch (n,) of each of those triangles."""
        triangles, owner = self.triangles
        p = self.corners[triangles]
        areas = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        return p.mean(axis=1), areas, self.patch[owner]

    @property
    def patch_centroids(self) -> FloatArray:
        """Centroid of each patch, (n_patches, 3) [mm]."""
        middles, areas, patch = self.triangle_areas
        return _centroids(middles, areas, patch, int(self.patch.max(initial=-1)) + 1)

    @property
    def centroids(self) -> FloatArray:
        """Centroid of each polygon, (n_polygons, 3) [mm]."""
        middles, areas, _ = self.triangle_areas
        return _centroids(middles, areas, self.triangles[1], len(self.areas))


def _centroids(points: FloatArray, areas: FloatArray, group: IntArray, n: int) -> FloatArray:
    """Means of points (m, 3), weighted by areas (m,), of n groups (m,); (n, 3)."""
    total = np.zeros((n, 3))
    np.add.at(total, group, areas[:, None] * points)
    return total / np.bincount(group, weights=areas, minlength=n)[:, None]


@dataclass(frozen=True)
class ContactPatches:
    """Flat pieces of interface: all contact between one plane of m and one plane of s."""

    block_m: IntArray
    """Master block, (n_patches,)."""
    block_s: IntArray
    """Opposing block, (n_patches,)."""
    normals: FloatArray
    """Unit normal from m to s, (n_patches, 3)."""
    areas: FloatArray
    """(n_patches,) [mm²]."""
    wide: BoolArray
    """Whether the faces share an area there, not a strip that a chamfer takes away, (n_patches,).
    """
    widths: FloatArray
    """Width of what both faces share, (n_patches,) [mm]."""
    curved: BoolArray
    """Whether one of both faces is curved, (n_patches,)."""
    gaps: FloatArray
    """Least gap of exact faces of CAD models, negative where they overlap, else 0; (n_patches,)
    [mm]."""


@dataclass(frozen=True)
class PatchContacts:
    """Contacts of blocks without matching facets, sorted by block pair (m, s), m < s."""

    block_m: IntArray
    """Master block, (n_contacts,)."""
    block_s: IntArray
    """Opposing block, (n_contacts,)."""
    centroids: FloatArray
    """Contact points in world coordinates, (n_contacts, 3) [mm]."""
    normals: FloatArray
    """Unit normal from block m to block s, (n_contacts, 3)."""
    areas: FloatArray
    """Area that each point stands for, nominal where it has no patch; (n_contacts,) [mm²]."""
    pair_start: IntArray
    """First contact of each block pair, and the total; (n_pairs + 1,)."""
    patch: IntArray
    """Patch of each contact; `CROSSING_EDGES` or `STANDING_CORNER` where there is none, both
    negative; (n_contacts,)."""
    bears: BoolArray
    """Whether friction counts there, (n_contacts,): on an area, and where a corner or an edge lies
    in the interior of a face; not where edges and corners meet edges and corners."""
    patches: ContactPatches
    polygons: ContactPolygons

    @property
    def n_contacts(self) -> int:
        """Number of contact points."""
        return len(self.block_m)

    @property
    def n_pairs(self) -> int:
        """Number of block pairs that touch."""
        return len(self.pair_start) - 1

    def of_patches(self, index: IntArray, values: FloatArray) -> FloatArray:
        """Sum by patch of values (n, …) of the contacts at places ``index`` (n,)."""
        total = np.zeros((len(self.patches.areas), *values.shape[1:]))
        patch = self.patch[index]
        np.add.at(total, patch[patch >= 0], values[patch >= 0])
        return total

    def patch_pressures(self, index: IntArray, normal_forces: FloatArray) -> FloatArray:
        """Mean pressure of each patch, (n_patches,) [MPa].

        A patch below `_SLIVER_PATCH` of the mean area of its joint's patches shares the pressure of
        the nearest one that is not: what clipping leaves has no pressure of its own.

        Parameters
        ----------
        index, normal_forces
            Places of some contacts and their forces, (n,) and (n,) [N].
        """
        host, areas = self._hosts, self.patches.areas
        force = np.bincount(
            host, weights=self.of_patches(index, normal_forces), minlength=len(areas)
        )
        area = np.bincount(host, weights=areas, minlength=len(areas))
        return (force / np.where(area > 0.0, area, 1.0))[host]

    @cached_property
    def _hosts(self) -> IntArray:
        """Patch that each patch shares its pressure with, itself for most; (n_patches,)."""
        patches = self.patches
        host = np.arange(len(patches.areas))
        pairs = np.column_stack([patches.block_m, patches.block_s])
        _, joint = np.unique(pairs, axis=0, return_inverse=True)
        joint = joint.ravel()
        mean = np.bincount(joint, weights=patches.areas) / np.maximum(np.bincount(joint), 1)
        small = patches.areas < _SLIVER_PATCH * mean[joint]
        if not small.any():
            return host
        middles = self.polygons.patch_centroids
        for k in np.flatnonzero(small).tolist():
            others = np.flatnonzero((joint == joint[k]) & ~small)
            away = np.linalg.norm(middles[others] - middles[k], axis=1)
            host[k] = others[int(np.argmin(away))]
        return host

    @property
    def on_areas(self) -> BoolArray:
        """Which contacts are on an area, (n_contacts,)."""
        result = self.patch >= 0
        result[result] = self.patches.wide[self.patch[result]]
        return result

    def some(self, kept: BoolArray) -> PatchContacts:
        """Some of the contacts, (n_contacts,), alone."""
        block_m, block_s = self.block_m[kept], self.block_s[kept]
        return replace(
            self,
            block_m=block_m,
            block_s=block_s,
            centroids=self.centroids[kept],
            normals=self.normals[kept],
            areas=self.areas[kept],
            pair_start=run_starts(block_m, block_s),
            patch=self.patch[kept],
            bears=self.bears[kept],
        )


def _opposing(world: PlacedShapes, angle: float | None) -> IntArray:
    """Pairs of triangles of different blocks that face each other, block m < block s; (n, 2).

    ``angle`` as in `geometry.polyhedra.options.DetectionOptions`.
    """
    pairs = world.tree.pairs(*world.boxes, world.block)
    pairs = pairs[world.block[pairs[:, 0]] < world.block[pairs[:, 1]]]
    dot = np.einsum("pi,pi->p", world.normals[pairs[:, 0]], world.normals[pairs[:, 1]])
    if angle is not None:
        return pairs[dot <= -np.cos(np.radians(angle))]
    most = np.radians(_ANGLE) + np.maximum(world.turns[pairs[:, 0]], world.turns[pairs[:, 1]])
    return pairs[dot <= -np.cos(most)]


def facing_areas(world: PlacedShapes, angle: float, touching: float) -> tuple[IntArray, FloatArray]:
    """Pairs of blocks that see each other within the tolerance, sorted, (n, 2); areas [mm²].

    Curved faces of CAD models do not count: where they touch is in their shape.

    Parameters
    ----------
    world
        The blocks.
    angle
        Largest one between facets [°].
    touching
        Nothing lies between facets this near to each other [mm].
    """
    pairs = _opposing(world, angle)
    pairs = pairs[(world.offsets[pairs] == 0.0).all(axis=1)]
    corners, count, area = _clipped(world, pairs)
    kept = np.flatnonzero((count >= 3) & (area > 0.0))
    used = np.arange(MOST_CORNERS) < count[kept][:, None]
    polygons = ContactPolygons(
        corners=corners[kept][used],
        start=np.concatenate([[0], np.cumsum(count[kept])]),
        areas=area[kept],
        patch=np.arange(len(kept)),
    )
    area = _seen_areas(world, pairs[kept], polygons, touching)
    blocks = world.block[pairs[kept[area > 0.0]]]
    first, row, _ = distinct_rows(blocks)
    return blocks[first], np.bincount(row, weights=area[area > 0.0], minlength=len(first))


def _seen_areas(
    world: PlacedShapes, pairs: IntArray, polygons: ContactPolygons, touching: float
) -> FloatArray:
    """Area of polygons between pairs of triangles that no facet hides, (n,) [mm²].

    It is sampled by lines from one triangle to the other.
    """
    fans, owner = polygons.triangles
    points = _SAMPLES @ polygons.corners[fans]
    m, s = pairs[owner].T
    direction = world.normals[m] - world.normals[s]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)

    def height(facets: IntArray) -> FloatArray:
        """From the points to the planes of facets, along the direction."""
        arm, n = world.corners[facets][:, :1] - points, world.normals[facets]
        return np.einsum("nqi,ni->nq", arm, n) / np.einsum("ni,ni->n", direction, n)[:, None]

    low, high = height(m), height(s)
    row, sample = np.nonzero(high - low > touching)
    at, along, length = points[row, sample], direction[row], (high - low)[row, sample]
    # What touches both sides is met just outside the line, and by no facet of either block.
    start = at + (low[row, sample] - touching)[:, None] * along
    end = at + (high[row, sample] + touching)[:, None] * along
    met, part = segment_piercings(start, end, world.surface)
    line, facet = met.T
    away = part * (length[line] + 2.0 * touching) - touching
    own = (world.block[facet] == world.block[m[row[line]]]) | (
        world.block[facet] == world.block[s[row[line]]]
    )
    inside = (away > _INSET * length[line]) & (away < (1.0 - _INSET) * length[line])
    barred = line[~own | inside]
    seen = np.ones(low.shape)
    seen[row[barred], sample[barred]] = 0.0
    areas = polygons.triangle_areas[1] * seen.mean(axis=1)
    return np.bincount(owner, weights=areas, minlength=len(pairs))


def _clipped(
    world: PlacedShapes, pairs: IntArray, reach: FloatArray | float = 0.0
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Corners (n, most, 3), their number (n,) and area (n,) of what pairs of triangles share.

    ``reach``: by how much more than the tolerance they may be apart [mm].
    """
    corners = np.zeros((len(pairs), MOST_CORNERS, 3))
    count, area = np.zeros(len(pairs), dtype=np.int64), np.zeros(len(pairs))
    tolerances = np.broadcast_to(world.tolerance + np.asarray(reach), len(pairs)).copy()
    clip_pairs(world.corners, world.normals, pairs, tolerances, corners, count, area)
    return corners, count, area


def _shared(
    world: PlacedShapes, angle: float | None
) -> tuple[IntArray, FloatArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Pairs of triangles that touch, their polygons, where these touch, counts, areas and gaps.

    Gaps are those of exact curved faces, zero of others.
    """
    off = world.offsets
    wide = world if not off.any() else world.wider(2.0 * float(off.max()))
    pairs = _opposing(wide, angle)
    reach = off[pairs].sum(axis=1)
    corners, count, area = _clipped(world, pairs, reach)
    touch, gaps = corners.copy(), np.zeros(len(pairs))
    curved = np.flatnonzero((reach > 0.0) & (count >= 3))
    if curved.size:
        exact = touched(world, pairs[curved], corners[curved], count[curved])
        corners[curved], touch[curved] = exact.corners, exact.touch
        count[curved], gaps[curved] = exact.count, exact.gaps
        used = np.arange(MOST_CORNERS - 2) < exact.count[:, None] - 2
        fans = exact.corners[:, 1:] - exact.corners[:, :1]
        twice = np.linalg.norm(np.cross(fans[:, :-1], fans[:, 1:]), axis=2)
        area[curved] = 0.5 * np.where(used, twice, 0.0).sum(axis=1)
    return pairs, corners, touch, count, area, gaps


def _in_patches(world: PlacedShapes, pairs: IntArray, areas: FloatArray) -> BoolArray:
    """Whether the planes of pairs of triangles (n, 2) share an area, not an edge; (n,)."""
    plane = world.block * (world.planes.max() + 1) + world.planes
    _, patch, _ = distinct_rows(plane[pairs])
    least = _SLIVER * np.minimum(world.plane_areas[pairs[:, 0]], world.plane_areas[pairs[:, 1]])
    return np.bincount(patch, weights=areas)[patch] > least


def find_contacts(
    world: PlacedShapes, *, angle: float | None, placement: ContactPlacement
) -> PatchContacts:
    """Find where blocks touch: their tolerance is the largest gap or overlap of touching facets.

    Angle and placement are those of `geometry.polyhedra.options.DetectionOptions`.
    """
    pairs, corners, touch, count, area, gaps = _shared(world, angle)
    least = np.minimum(world.areas[pairs[:, 0]], world.areas[pairs[:, 1]])
    least *= _SPECK if placement is ContactPlacement.VERTICES else _SLIVER
    kept = np.flatnonzero((count >= 3) & (area > least))
    kept = kept[_in_patches(world, pairs[kept], area[kept])]
    m, s = pairs[kept, 0], pairs[kept, 1]
    keys = (world.planes[s], world.planes[m], world.block[s], world.block[m])
    order = np.lexsort((s, m, *keys))
    kept, m, s = kept[order], m[order], s[order]
    patch_start = run_starts(*(key[order] for key in keys))
    patch = np.repeat(np.arange(len(patch_start) - 1), np.diff(patch_start))
    direction = world.normals[m] - world.normals[s]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    count, area = count[kept], area[kept]
    flat = np.arange(MOST_CORNERS) < count[:, None]
    polygons = ContactPolygons(
        corners=corners[kept][flat],
        start=np.concatenate([[0], np.cumsum(count)]),
        areas=area,
        patch=patch,
    )
    n_patches = len(patch_start) - 1
    least_gap = np.zeros(n_patches)
    np.minimum.at(least_gap, patch, gaps[kept])
    normal, patch_area = np.zeros((n_patches, 3)), np.zeros(n_patches)
    np.add.at(patch_area, patch, area)
    np.add.at(normal, patch, direction * area[:, None])
    first = patch_start[:-1]
    faces = np.column_stack([world.faces[m][first], world.faces[s][first]])
    width = _widths(polygons, faces)
    patches = ContactPatches(
        block_m=world.block[m][first],
        block_s=world.block[s][first],
        normals=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        areas=patch_area,
        wide=width > world.least_widths[faces].min(axis=1),
        widths=width,
        curved=(world.turns[m] + world.turns[s])[first] > 0.0,
        gaps=least_gap,
    )
    if placement is ContactPlacement.CENTROIDS:
        contacts = _on_patches(
            patches,
            polygons,
            patch,
            points=polygons.centroids,
            normals=direction,
            areas=area,
        )
        return _on_exact_faces(world, contacts, m[first], s[first])
    places = touch[kept][flat] if world.offsets.any() else None
    at_vertices = _at_vertices(patches, polygons, places)
    flat_contacts = _on_exact_faces(world, at_vertices, m[first], s[first])
    narrow = np.flatnonzero(~flat_contacts.bears)
    for triangle in (m, s):
        faces = world.faces[triangle][first][flat_contacts.patch[narrow]]
        flat_contacts.bears[narrow] |= world.within(flat_contacts.centroids[narrow], faces)
    for kind, result in ((CROSSING_EDGES, crossing_edges), (STANDING_CORNER, standing_corners)):
        flat_contacts = _with_points(flat_contacts, result(world), kind, world.tolerance)
    return flat_contacts


def _widths(polygons: ContactPolygons, faces: IntArray) -> FloatArray:
    """Width of what the two faces of each patch (n_patches, 2) share, (n_patches,) [mm].

    All that two faces share counts together: the facets of curved faces are narrow.
    """
    group = np.unique(faces, axis=0, return_inverse=True)[1].ravel()
    triangles, owner = polygons.triangles
    return widths(polygons.corners[triangles], group[polygons.patch[owner]])[group]


def _on_exact_faces(
    world: PlacedShapes, contacts: PatchContacts, m: IntArray, s: IntArray
) -> PatchContacts:
    """Contacts where curved faces of CAD models are, with the normals of these.

    ``m`` and ``s`` are triangles of the two planes of each patch, (n_patches,). The facets of a
    cylinder are teeth to what slides along it; its surface is not.
    """
    points, of_s = world.on_exact_faces(contacts.centroids, s[contacts.patch])
    points, of_m = world.on_exact_faces(points, m[contacts.patch])
    direction = of_m - of_s
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    m, s = m[contacts.patch], s[contacts.patch]
    curved = ((of_m != world.normals[m]) | (of_s != world.normals[s])).any(axis=1)
    normals = np.where(curved[:, None], direction, contacts.normals)
    return replace(contacts, centroids=points, normals=normals)


def _with_points(
    contacts: PatchContacts, extra: PointContacts, kind: int, tolerance: float
) -> PatchContacts:
    """Add contacts without area of one kind, but for those that say what is said already."""
    n_known = contacts.n_contacts
    block_m = np.concatenate([contacts.block_m, extra.block_m])
    block_s = np.concatenate([contacts.block_s, extra.block_s])
    points = np.concatenate([contacts.centroids, extra.points])
    normals = np.concatenate([contacts.normals, extra.normals])
    kept = np.ones(len(points), dtype=bool)
    tree = cKDTree(points) if len(extra.points) else None
    for k in range(n_known, len(points)):
        assert tree is not None
        # A corner on the diagonal of a face stands on both of its triangles.
        kept[k] = not any(
            c < k
            and kept[c]
            and block_m[c] == block_m[k]
            and block_s[c] == block_s[k]
            and normals[c] @ normals[k] > 1 - 1e-6
            for c in tree.query_ball_point(points[k], 4 * tolerance)
        )
    fresh = kept[n_known:]
    n = int(fresh.sum())
    nominal = _POINT_AREA * (contacts.areas.mean() if contacts.n_contacts else 1.0)
    block_m, block_s = block_m[kept], block_s[kept]
    order = np.lexsort((block_s, block_m))
    return PatchContacts(
        block_m=block_m[order],
        block_s=block_s[order],
        centroids=points[kept][order],
        normals=normals[kept][order],
        areas=np.concatenate([contacts.areas, np.full(n, nominal)])[order],
        pair_start=run_starts(block_m[order], block_s[order]),
        patch=np.concatenate([contacts.patch, np.full(n, kind)])[order],
        bears=np.concatenate([contacts.bears, extra.within[fresh]])[order],
        patches=contacts.patches,
        polygons=contacts.polygons,
    )


def _on_patches(
    patches: ContactPatches,
    polygons: ContactPolygons,
    patch: IntArray,
    *,
    points: FloatArray,
    normals: FloatArray,
    areas: FloatArray,
) -> PatchContacts:
    """Contacts on areas, from the patch (n,) and place (n, 3) of each."""
    block_m, block_s = patches.block_m[patch], patches.block_s[patch]
    return PatchContacts(
        block_m=block_m,
        block_s=block_s,
        centroids=points,
        normals=normals,
        areas=areas,
        pair_start=run_starts(block_m, block_s),
        patch=patch,
        bears=patches.wide[patch],
        patches=patches,
        polygons=polygons,
    )


def _at_vertices(
    patches: ContactPatches, polygons: ContactPolygons, places: FloatArray | None = None
) -> PatchContacts:
    """Points at the corners of each patch's convex hull.

    ``places`` are where exact faces touch for each corner of the polygons, (n_corners, 3): several
    corners of a strip have one.
    """
    owner = np.repeat(polygons.patch, np.diff(polygons.start))
    n_patches = len(patches.areas)
    # Along no edge that anyone draws: round-off does not change the order of corners.
    steep = np.abs(patches.normals @ ASKEW[0]) > 0.9
    u = np.cross(patches.normals, ASKEW[steep.astype(np.int64)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(patches.normals, u)
    flat = np.column_stack(
        [
            np.einsum("ci,ci->c", polygons.corners, u[owner]),
            np.einsum("ci,ci->c", polygons.corners, v[owner]),
        ]
    )
    start = np.searchsorted(owner, np.arange(n_patches + 1))
    # Equal to round-off is equal, so that repeated corners sort beside each other.
    size = float(np.abs(flat).max(initial=0.0))
    rounded = np.round(flat[:, 0] / (1e-9 * size)) if size > 0 else flat[:, 0]
    order = np.lexsort((flat[:, 1], rounded, owner))
    chosen = np.empty(2 * len(flat) + 2, dtype=np.int64)
    chosen_start = np.zeros(n_patches + 1, dtype=np.int64)
    total = hulls(flat, start, order, 1e-7 * size, chosen, chosen_start)
    corner, count = chosen[:total], np.diff(chosen_start)
    patch = np.repeat(np.arange(n_patches), count)
    if places is not None:
        once = _distinct(places[corner], patch, size)
        corner, patch = corner[once], patch[once]
        count = np.bincount(patch, minlength=n_patches)
    return _on_patches(
        patches,
        polygons,
        patch,
        points=(polygons.corners if places is None else places)[corner],
        normals=patches.normals[patch],
        areas=(patches.areas / np.maximum(count, 1))[patch],
    )


def _distinct(points: FloatArray, patch: IntArray, size: float) -> IntArray:
    """Places of points (n, 3) that no earlier one of their patch (n,) equals, ascending."""
    near = cKDTree(points).query_pairs(_ONE_POINT * size, output_type="ndarray")
    same = near[patch[near[:, 0]] == patch[near[:, 1]]]
    kept = np.ones(len(points), dtype=np.bool_)
    kept[same.max(axis=1)] = False
    return np.flatnonzero(kept)
