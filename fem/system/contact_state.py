"""Contact of a deformed assembly: which facets press on which blocks, where and how hard."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fem.contact.law import ContactLaw
from fem.contact.search import BlockSurface, FacingPoints, SearchedPoints
from fem.contact.surfaces import (
    ContactPoints,
    CurrentFrame,
    MatchedFacets,
    corner_overclosures,
    placed_corners,
)
from fem.element.functions import facet_areas, facet_functions
from fem.system.system import Sector, System
from geometry.assembly import Assembly
from geometry.mesh import (
    BoolArray,
    FloatArray,
    IntArray,
    ReadOnlyArrays,
    cross,
    structured_quads,
)


def block_surfaces(system: Sector, copy_of: IntArray | None = None) -> tuple[BlockSurface, ...]:
    """Collect the facets of all blocks that can touch others, in the order of their bodies.

    Parameters
    ----------
    system
        Blocks where they stand before any displacement, and which of them are computed.
    copy_of
        Copy of its body that moves as each block does, (n_blocks,); None: those of ``system``.
    """
    whole, assembly = system.whole, system.whole.assembly
    copies = whole.copy_of if copy_of is None else copy_of
    computed = system.orbits.representative == assembly.originals
    result = []
    for block in range(assembly.n_blocks):
        if len(assembly.shape(block).contact_quads):
            surface = block_surface(assembly, block, whole.offsets[block])
            result.append(
                replace(
                    surface,
                    body=int(whole.body_number[block]),
                    copy=int(max(copies[block], 0)),
                    computed=bool(computed[block]),
                )
            )
    return tuple(sorted(result, key=lambda surface: surface.body))


def block_surface(assembly: Assembly, block: int, offset: FloatArray) -> BlockSurface:
    """Facets of one block that can touch others, moved by an offset (3,) [mm]; it moves alone."""
    mesh, quads = assembly.shape(block).mesh, assembly.shape(block).contact_quads
    facets = None
    if mesh.degree > 1:
        facets = mesh.facet_nodes(quads)
        quads = facets[:, structured_quads(mesh.degree)].reshape(-1, 4)
    nodes, origin = np.unique(quads), assembly.centroids.mean(axis=0)
    shift = assembly.translations[block] + offset - origin
    return BlockSurface(
        block=block,
        body=0,
        copy=block,
        rotation=assembly.rotations[block],
        nodes=nodes,
        reference=mesh.nodes[nodes] @ assembly.rotations[block].T + shift,
        quads=np.searchsorted(nodes, quads),
        facets=None if facets is None else np.searchsorted(nodes, facets),
        origin=origin,
    )


def facing_points(
    system: Sector,
    displacements: tuple[FloatArray, ...] | None = None,
    *,
    copy_of: IntArray | None = None,
    slight: float = 0.0,
) -> FacingPoints:
    """Find what faces what in an assembly.

    Parameters
    ----------
    system
        Blocks and contact law; points are those of the blocks that are computed.
    displacements
        Of its bodies, world axes, (n_copies, n_nodes, 3) [mm]; None: before any displacement.
    copy_of
        As `block_surfaces`.
    slight
        As `FacingPoints`.
    """
    reach = -system.whole.contact.law.start - system.whole.surfaces.clearance
    surfaces = block_surfaces(system, copy_of)
    points = FacingPoints(surfaces, reach=reach, slight=slight)
    if displacements is not None:
        points.displace(displacements)
        points.search()
    return points


#: Least share of a facet that counts as facing a block.
_SLIVER = 1e-3


@dataclass(frozen=True)
class ContactState(ReadOnlyArrays):
    """Contact of an assembly at given displacements, whether facets match or a search found them.

    Facets have points of integration, any number each.
    """

    block_m: IntArray
    """Block that the facet presses on (the master), (n_facets,)."""
    block_s: IntArray
    """Block whose facet it is in a search, the opposing one of matched facets; (n_facets,)."""
    interface: IntArray | None
    """Position of each facet in the assembly's interfaces; None where a search found them."""
    corners: FloatArray
    """Where the facet, or the part of it that faces the master, is now; (n_facets, 4, 3) [mm]."""
    facet: IntArray
    """Facet of each point, (n_points,)."""
    positions: FloatArray
    """Of the points now, world axes, (n_points, 3) [mm]."""
    normals: FloatArray
    """From m to s, (n_points, 3)."""
    point_areas: FloatArray
    """(n_points,) [mm²]"""
    point_pressures: FloatArray
    """(n_points,) [MPa]"""
    point_overclosures: FloatArray
    """(n_points,) [mm]"""
    point_slips: FloatArray
    """Displacement of block s along the facet, relative to block m, world axes, (n_points, 3) [mm]:
    of points that coincided as built, or in a search of the points that face each other now."""
    surfaces: ContactPoints
    """All points, those of facets that are left out too."""
    frictions: FloatArray | None
    """Friction on block s at these, world axes, (n, n_points, 3) [MPa]; None without friction."""
    point_moments: FloatArray
    """Moment of the nodal forces on blocks m and s about `positions`, (n_points, 2, 3) [N mm]: they
    act on both sides of a gap, and turn normals."""
    point_frictions: FloatArray | None = None
    """Friction on block s, world axes, (n_points, 3) [MPa]; None without friction."""
    corner_overclosures: FloatArray | None = None
    """Where matched facets are looked at for peaks, at corners of bilinear ones, (n_facets, n)
    [mm]; None where a search found them."""
    position_s: IntArray | None = None
    """Where a search found them: position of each in the contact facets of block s, (n_facets,)."""

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return len(self.block_m)

    @cached_property
    def areas(self) -> FloatArray:
        """Of the facets, as far as they face the master, (n_facets,) [mm²]."""
        areas = np.bincount(self.facet, self.point_areas, minlength=self.n_facets)
        return areas.astype(np.float64)

    @cached_property
    def pressures(self) -> FloatArray:
        """Force over area of each facet, (n_facets,) [MPa]."""
        force = self.point_areas * self.point_pressures
        return np.bincount(self.facet, force, minlength=self.n_facets) / self.areas

    @cached_property
    def point_forces(self) -> FloatArray:
        """Force of each point on block s, friction included, (n_points, 3) [N]."""
        traction = self.point_pressures[:, None] * self.normals
        if self.point_frictions is not None:
            traction += self.point_frictions
        return self.point_areas[:, None] * traction

    @cached_property
    def forces(self) -> FloatArray:
        """Force of each facet on block s, friction included, (n_facets, 3) [N]."""
        return self._of_facets(self.point_forces)

    @cached_property
    def mean_normals(self) -> FloatArray:
        """Normals from m to s, weighted by area, unit length, (n_facets, 3)."""
        mean = self._of_facets(self.point_areas[:, None] * self.normals)
        return mean / np.linalg.norm(mean, axis=1, keepdims=True)

    @cached_property
    def slips(self) -> FloatArray:
        """Slips of the points, weighted by area, (n_facets, 3) [mm]."""
        return self._of_facets(self.point_areas[:, None] * self.point_slips) / self.areas[:, None]

    def _of_facets(self, values: FloatArray) -> FloatArray:
        """Sum of the values of the points of each facet, (n_facets, 3)."""
        columns = [np.bincount(self.facet, column, minlength=self.n_facets) for column in values.T]
        return np.stack(columns, axis=1)

    @cached_property
    def deepest(self) -> FloatArray:
        """Largest overclosure of each facet, (n_facets,) [mm]."""
        deepest = np.full(self.n_facets, -np.inf)
        np.maximum.at(deepest, self.facet, self.point_overclosures)
        return deepest

    @cached_property
    def centroids(self) -> FloatArray:
        """Means of the corners, (n_facets, 3) [mm]."""
        return self.corners.mean(axis=1)

    def joint(self, m: int, s: int) -> IntArray:
        """Points between two blocks, either of which may be the master."""
        pair = (self.block_m == m) & (self.block_s == s)
        pair |= (self.block_m == s) & (self.block_s == m)
        return np.flatnonzero(pair[self.facet])


def corner_displacements(
    system: System,
    displacements: tuple[FloatArray, ...],
    surfaces: ContactPoints | None = None,
) -> FloatArray:
    """World displacements of the nodes of every facet pair, m's first.

    Parameters
    ----------
    system
        Blocks and surfaces; rigid blocks do not move.
    displacements
        Of each body, (n_copies, n_nodes, 3) [mm], world axes.
    surfaces
        Facets; None: the matched ones.

    Returns
    -------
    FloatArray
        (n_facets, nodes of both, 3) [mm].
    """
    surfaces = system.surfaces if surfaces is None else surfaces
    per_side = surfaces.quads_m.shape[1]
    moved = np.zeros((surfaces.n_facets, 2 * per_side, 3))
    for half, (block, quads) in enumerate(
        ((surfaces.block_m, surfaces.quads_m), (surfaces.block_s, surfaces.quads_s))
    ):
        corners = slice(per_side * half, per_side * (half + 1))
        for body, u in enumerate(displacements):
            rows: IntArray = np.flatnonzero(system.body_number[block] == body)
            copies = system.copy_of[block[rows]]
            moved[rows, corners] = u[copies[:, None], quads[rows]]
    return moved


def contact_state(
    system: System,
    displacements: tuple[FloatArray, ...],
    points: ContactPoints | None = None,
    frictions: FloatArray | None = None,
    overclosures: FloatArray | None = None,
) -> ContactState:
    """Contact of an assembly at some points.

    Parameters
    ----------
    system
        Blocks and law.
    displacements
        Of each body, world axes, (n_copies, n_nodes, 3) [mm].
    points
        None: those of its matched facets.
    frictions
        Friction on block s there, world axes, (n_facets, n_points, 3) [MPa]; None: without.
    overclosures
        As a solver has them there, (n_facets, n_points) [mm]; None: those of the displacements,
        which differ by their rounding.
    """
    points = system.surfaces if points is None else points
    moved = corner_displacements(system, displacements, points)
    law = system.contact.law.on(points.block_m, points.block_s)
    if isinstance(points, SearchedPoints):
        return searched_state(points, moved, law, frictions, overclosures)
    assert isinstance(points, MatchedFacets)
    sides = ((points.block_m, points.quads_m), (points.block_s, points.quads_s))
    nodes = moved + np.concatenate(
        [
            placed_corners(system.assembly, block, quads) + system.offsets[block][:, None]
            for block, quads in sides
        ],
        axis=1,
    )
    frame = points.frame(moved)
    return ContactState(
        block_m=points.block_m,
        block_s=points.block_s,
        interface=points.facet,
        corners=nodes[:, points.basis.corners],
        facet=np.repeat(np.arange(points.n_facets), points.basis.n_points),
        point_slips=_along(points.functions @ moved, frame.normal).reshape(-1, 3),
        corner_overclosures=corner_overclosures(points, moved),
        surfaces=points,
        frictions=frictions,
        **_at_points(points, frame, nodes, law, (frictions, overclosures)),
    )


def _at_points(
    points: ContactPoints,
    frame: CurrentFrame,
    nodes: FloatArray,
    law: ContactLaw | None,
    solved: tuple[FloatArray | None, FloatArray | None],
) -> dict[str, Any]:
    """What `ContactState` has of each point, from where both facets are now (n, 2 m, 3) [mm].

    ``solved`` are the frictions and overclosures of `contact_state`. Nodal forces are
    f_a = w (φ_a (p n + friction) - p Σ s_a,k b_k) with φ the functions of d, s the slopes and b
    what turns the normal (`ContactPoints.kinematics`).
    """
    frictions, overclosures = solved
    if overclosures is None:
        overclosures = -frame.gap - points.clearance
    pressures = np.zeros_like(overclosures) if law is None else law.pressure(overclosures)
    n_nodes = nodes.shape[1] // 2
    of_s = points.functions[..., n_nodes:] @ nodes[:, n_nodes:]
    positions = of_s - 0.5 * frame.d
    acting = pressures[..., None] * frame.normal
    if frictions is not None:
        acting += frictions
    turning = frame.by_tangents
    moments = []
    for side in (slice(None, n_nodes), slice(n_nodes, None)):
        slopes = points.slopes[..., side]
        n, n_points = slopes.shape[:2]
        tangents = slopes.reshape(n, 2 * n_points, n_nodes) @ nodes[:, side]
        turned = cross(tangents.reshape(turning.shape), turning).sum(axis=2)
        moments.append(0.5 * cross(frame.d, acting) - pressures[..., None] * turned)
    weighted = points.weights[..., None, None] * np.stack(moments, axis=2)
    return {
        "positions": positions.reshape(-1, 3),
        "normals": frame.normal.reshape(-1, 3),
        "point_areas": points.weights.ravel(),
        "point_pressures": pressures.ravel(),
        "point_overclosures": overclosures.ravel(),
        "point_frictions": None if frictions is None else frictions.reshape(-1, 3),
        "point_moments": weighted.reshape(-1, 2, 3),
    }


def searched_state(
    points: SearchedPoints,
    moved: FloatArray,
    law: ContactLaw | None,
    frictions: FloatArray | None = None,
    overclosures: FloatArray | None = None,
) -> ContactState:
    """Contact of the points of a search.

    Facets are those of the finer of two surfaces, one entry for each block that a facet faces,
    with the part of its area that faces it. Where no point of it presses, an entry far away and one
    of less than a thousandth of its facet is left out: facets are counted. Such a sliver that
    presses belongs to the nearest facet of its joint.

    Parameters
    ----------
    points
        As the search found them.
    moved
        Displacements of the nodes of both facets, (n_points, nodes of both, 3) [mm], world axes.
    law
        Of the points; None: nothing presses.
    frictions, overclosures
        As in `contact_state`, (n_points, 1, 3) [MPa] and (n_points, 1) [mm].
    """
    frame, weights = points.frame(moved), points.weights[:, 0]
    nodes = points.corners + moved + points.origin
    at_points = _at_points(points, frame, nodes, law, (frictions, overclosures))
    overclosure, pressure = at_points["point_overclosures"], at_points["point_pressures"]
    key = np.column_stack([points.block_m, points.block_s, points.position_s])
    _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    which = which.ravel()
    area = np.bincount(which, weights)
    mean = -np.bincount(which, weights * overclosure) / area - points.clearance
    presses = np.bincount(which, pressure > 0.0) > 0.0
    whole = area > _SLIVER * points.facet_areas[first]
    near = (((mean <= points.farthest) & whole) | presses)[which]
    at_points = {name: None if v is None else v[near] for name, v in at_points.items()}
    key, part = _with_slivers(key[near], at_points["positions"], whole[which][near])
    entries, which = np.unique(key, axis=0, return_inverse=True)
    own = np.flatnonzero(part)
    first = own[np.unique(which.ravel()[own], return_index=True)[1]]
    slave = nodes[near, points.quads_m.shape[1] :]
    return ContactState(
        block_m=entries[:, 0],
        block_s=entries[:, 1],
        interface=None,
        corners=_faced_parts(slave[first], which.ravel()[own], points.cells[near][own]),
        facet=which.ravel(),
        point_slips=_searched_slips(points)[near],
        position_s=entries[:, 2],
        surfaces=points,
        frictions=frictions,
        **at_points,
    )


def _with_slivers(
    key: IntArray, positions: FloatArray, whole: BoolArray
) -> tuple[IntArray, BoolArray]:
    """Give each point of a sliver to the nearest facet of its joint, if that has another one.

    From blocks m and s and the facet of each point (n, 3), where it is (n, 3) [mm] and whether its
    part of the facet is none (n,): the same key, and whether a point is on the facet of its key.
    """
    key, own = key.copy(), np.ones(len(key), dtype=np.bool_)
    for point in np.flatnonzero(~whole).tolist():
        others = np.flatnonzero(whole & (key[:, :2] == key[point, :2]).all(axis=1))
        if len(others):
            away = np.linalg.norm(positions[others] - positions[point], axis=1)
            key[point], own[point] = key[others[away.argmin()]], False
    return key, own


def _along(vectors: FloatArray, normals: FloatArray) -> FloatArray:
    """Parts of vectors in the planes of unit normals, (..., 3) each."""
    return vectors - np.einsum("...i,...i->...", vectors, normals)[..., None] * normals


def _searched_slips(points: SearchedPoints) -> FloatArray:
    """How far the points that face each other now were apart along the facet, (n_points, 3) [mm].

    Positions before any displacement: a motion that two blocks share is no slip, however large.
    """
    normal = cross(points.tangents[:, 0, 0], points.tangents[:, 0, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return _along(-points.offsets[:, 0], normal)


def _faced_parts(nodes: FloatArray, which: IntArray, cells: FloatArray) -> FloatArray:
    """Corners of the part of each facet on which its points lie, (n_facets, 4, 3) [mm].

    ``nodes`` are those of the facets, (n_facets, n_nodes, 3) [mm].
    """
    low, high = np.full((len(nodes), 2), 1.0), np.full((len(nodes), 2), -1.0)
    np.minimum.at(low, which, cells[:, 0])
    np.maximum.at(high, which, cells[:, 1])
    xi = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high], axis=1)
    xi = np.concatenate([xi, np.stack([low[:, 0], high[:, 1]], 1)[:, None]], axis=1)
    values = facet_functions(xi.reshape(-1, 2), nodes.shape[1])[0]
    values = values.reshape(len(nodes), 4, nodes.shape[1])
    return np.einsum("fpa,fai->fpi", values, nodes)


def facets_that_fit(assembly: Assembly, state: ContactState) -> FloatArray:
    """How many facets that a search found cover the contact faces of each block, (n_blocks,)."""
    areas = [facet_areas(s.mesh.nodes, s.contact_quads) for s in assembly.shapes]
    whole, own = (
        np.array([of(area) for area in areas], dtype=np.float64)[assembly.shape_of]
        for of in (np.sum, len)
    )
    ends = np.concatenate([state.block_m, state.block_s])
    met = np.bincount(ends, minlength=assembly.n_blocks)
    covered = np.bincount(ends, np.tile(state.areas, 2), minlength=assembly.n_blocks)
    return np.where(met > 0, met * whole / np.maximum(covered, 1e-300), own)
