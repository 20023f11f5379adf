"""Points of surfaces and the facets that they face, wherever the surfaces have moved.

Of two blocks that come near, facets of the finer one look for facets of the other. Spatial trees
find the *neighbours* of each facet; they hold until two blocks together have moved by a skin. Cuts
along the neighbours' edges (`fem.contact.cuts`) follow the motion between searches.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from fem.contact.cuts import OPPOSITE, carry_over, closest_on_facets, cut_facets
from fem.contact.surfaces import ContactNormals, PointKinematics
from fem.element.facet import bilinear, facet_areas
from geometry.mesh import FloatArray, IntArray, run_starts

#: Skin of the search over the shortest mean edge of a facet.
_SKIN = 0.1

#: Surfaces lie in each other by at most this many skins: what is deeper is another surface.
_DEEPEST = 3.0

#: Points a facet that there is room for at first.
_ROOM = 16

#: Normals may turn between two searches: neighbours look at each other by less than what cuts ask.
_NEIGHBOURS = 0.5 * OPPOSITE


@dataclass(frozen=True)
class BlockSurface:
    """The facets of one block that can touch others."""

    block: int
    """Number of the block, for messages."""
    group: int
    """Group of the model; -1 for a rigid block."""
    copy: int
    """Copy of that group that moves as it does; 0 for a rigid block."""
    rotation: FloatArray
    """Placement, (3, 3)."""
    nodes: IntArray
    """Mesh nodes on the surface, (n_nodes,)."""
    reference: FloatArray
    """Their positions before any displacement, world axes, (n_nodes, 3) [mm]."""
    quads: IntArray
    """Facets as positions in `nodes`, counter-clockwise from outside, (n_facets, 4)."""
    stands: int = -1
    """In a sector: block that stands for it …"""
    turn: int = 0
    """… and by how many angles of the sector it is turned from that."""

    @property
    def edge(self) -> float:
        """Mean edge of the facets [mm]."""
        corners = self.reference[self.quads]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def facet_area_vectors(corners: FloatArray) -> FloatArray:
    """Vector areas of facets (n, 4, 3): (n, 3) [mm²]."""
    return 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])


class FacingPoints:
    """Points on the surfaces that look for others, and the facet that each faces at present."""

    def __init__(
        self,
        surfaces: tuple[BlockSurface, ...],
        *,
        reach: float,
        symmetry: int = 1,
        slight: float = 0.0,
    ) -> None:
        """Place the surfaces and find what faces what.

        Parameters
        ----------
        surfaces
            Of all blocks; those of one group follow each other.
        reach
            Distance below which contact acts [mm].
        symmetry
            Order of the sector: contact of blocks with `BlockSurface.turn` 0 alone is integrated,
            as those of all others are images of it.
        slight
            Share of a facet's nodal forces by which the points of a sliver may err, so that they
            are one or two.
        """
        sizes = np.cumsum([0, *(len(s.nodes) for s in surfaces)])
        facets = np.cumsum([0, *(len(s.quads) for s in surfaces)])
        self.surfaces, self.symmetry, self._slight = surfaces, symmetry, slight
        self.node_start: IntArray = sizes
        self.position = np.concatenate([s.reference for s in surfaces])
        self.quads = np.concatenate(
            [s.quads + first for s, first in zip(surfaces, sizes[:-1], strict=True)]
        )
        self.facets = [slice(a, b) for a, b in pairwise(facets.tolist())]
        self._edges = np.array([s.edge for s in surfaces])
        self.skin = _SKIN * float(self._edges.min())
        self._bounds = np.array([-_DEEPEST * self.skin, max(reach, 0.0) + self.skin])
        #: Of the undeformed facets, (n_facets,) [mm²].
        self.facet_area = facet_areas(self.position, self.quads)
        self._take(_ROOM * len(self.quads))
        self.search()

    def _take(self, room: int) -> None:
        """Make room for points."""
        self._slave, self._facet = np.zeros(room, np.int64), np.zeros(room, np.int64)
        self._shapes, self._weights = np.zeros((room, 4)), np.zeros(room)
        self._cells, self._xi = np.zeros((room, 2, 2)), np.zeros((room, 2))

    @property
    def slave(self) -> IntArray:
        """Facet of each point, (n,)."""
        return self._slave[: self.count]

    @property
    def shapes(self) -> FloatArray:
        """Shape functions of its corners there, (n, 4)."""
        return self._shapes[: self.count]

    @property
    def weights(self) -> FloatArray:
        """Area that each point stands for, of the undeformed surface, (n,) [mm²]."""
        return self._weights[: self.count]

    @property
    def cells(self) -> FloatArray:
        """Box round that area in natural coordinates, lower then upper corner, (n, 2, 2)."""
        return self._cells[: self.count]

    @property
    def facet(self) -> IntArray:
        """Facet that each point faces, (n,)."""
        return self._facet[: self.count]

    @property
    def xi(self) -> FloatArray:
        """Natural coordinates of the closest point there, (n, 2)."""
        return self._xi[: self.count]

    @property
    def room(self) -> int:
        """Points that there is room for."""
        return len(self._slave)

    @property
    def all_xi(self) -> FloatArray:
        """`xi` with the room for more points, (room, 2)."""
        return self._xi

    @property
    def block(self) -> IntArray:
        """Block that each point lies on, (n,)."""
        return self.facet_block[self.slave]

    @property
    def facet_block(self) -> IntArray:
        """Block of each facet, (n_facets,)."""
        blocks = [s.block for s in self.surfaces]
        return np.repeat(blocks, [f.stop - f.start for f in self.facets])

    @property
    def facet_position(self) -> IntArray:
        """Position of each facet among those of its surface, (n_facets,)."""
        return np.concatenate([np.arange(f.stop - f.start) for f in self.facets])

    def place(self) -> FloatArray:
        """Positions of the points, world axes, (n, 3) [mm]."""
        corners = self.position[self.quads[self.slave]]
        return np.einsum("pa,pai->pi", self.shapes, corners)

    def displace(self, displacements: tuple[FloatArray, ...]) -> None:
        """Place the surfaces at displacements of each group, world axes; none of a sector.

        Parameters
        ----------
        displacements
            (n_copies, n_nodes, 3) [mm] for each group.
        """
        for first, surface in zip(self.node_start, self.surfaces, strict=False):
            where = slice(int(first), int(first) + len(surface.nodes))
            self.position[where] = surface.reference
            if surface.group >= 0:
                self.position[where] += displacements[surface.group][surface.copy, surface.nodes]

    def search(self) -> None:
        """Find the neighbours of every facet at the present positions, and cut."""
        corners = self.position[self.quads]
        self._centre = corners.mean(axis=1)
        self._radius = np.linalg.norm(corners - self._centre[:, None], axis=2).max(axis=1)
        vectors = facet_area_vectors(corners)
        self._normal = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        found = [
            (*self._near_facets(m, s), share) for m, s, share in self._near_blocks(self.farthest)
        ]
        own = np.concatenate([np.empty(0, np.int64), *(f for f, _, _ in found)])
        near = np.concatenate([np.empty(0, np.int64), *(g for _, g, _ in found)])
        share = np.concatenate([np.empty(0), *(np.full(len(f), w) for f, _, w in found)])
        order = np.lexsort((near, own))
        self._start = np.searchsorted(own[order], np.arange(len(self.quads) + 1))
        self._near, self._share = near[order], share[order]
        self.cut()

    def cut(self) -> None:
        """Cut the facets along those that they face now: points follow the motion."""
        while True:
            self.count = int(
                cut_facets(
                    self.position,
                    self.quads,
                    self.facet_area,
                    self._start,
                    self._near,
                    self._share,
                    self._bounds,
                    self._slight,
                    self._slave,
                    self._shapes,
                    self._weights,
                    self._facet,
                    self._xi,
                    self._cells,
                )
            )
            if self.count <= len(self._slave):
                return
            self._take(2 * self.count)

    def carried(self, slave: IntArray, shapes: FloatArray, values: FloatArray) -> FloatArray:
        """Values (m, 3) of points of an earlier cut at those of the present one, (n, 3)."""
        new = np.empty((self.count, 3))
        carry_over(slave, shapes, values, self.slave, self.shapes, new)
        return new

    @property
    def farthest(self) -> float:
        """Largest gap at which a point counts as facing a facet [mm]."""
        return float(self._bounds[1])

    def _near_blocks(self, margin: float) -> list[tuple[int, int, float]]:
        """Master and slave of each two blocks whose boxes overlap, and how much the pair counts.

        The finer one is slave, of two alike the later one. In a sector two images of one block are
        alike; the one that follows the other by less than half a turn is slave.
        """
        low, high = np.empty((len(self.surfaces), 3)), np.empty((len(self.surfaces), 3))
        for k, facets in enumerate(self.facets):
            corners = self.position[self.quads[facets]].reshape(-1, 3)
            low[k], high[k] = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        pairs = []
        for i in range(len(low)):
            overlap = ((low[i] <= high[i + 1 :]) & (low[i + 1 :] <= high[i])).all(axis=1)
            for j in (np.flatnonzero(overlap) + i + 1).tolist():
                if max(self.surfaces[i].group, self.surfaces[j].group) >= 0:
                    pairs += [p for p in self._order(i, j) if not self.surfaces[p[1]].turn]
        return pairs

    def _order(self, i: int, j: int) -> list[tuple[int, int, float]]:
        """(master, slave, share) of two blocks that come near."""
        one, two = self.surfaces[i], self.surfaces[j]
        if self._edges[j] > self._edges[i] * (1.0 + 1e-9):
            return [(j, i, 1.0)]
        if self._edges[i] > self._edges[j] * (1.0 + 1e-9) or self.symmetry == 1:
            return [(i, j, 1.0)]
        if one.stands != two.stands:
            later = (two.group, two.stands) > (one.group, one.stands)
            return [(i, j, 1.0) if later else (j, i, 1.0)]
        ahead = (two.turn - one.turn) % self.symmetry
        if 2 * ahead == self.symmetry:
            return [(i, j, 0.5), (j, i, 0.5)]
        return [(i, j, 1.0) if 2 * ahead < self.symmetry else (j, i, 1.0)]

    def _near_facets(self, m: int, s: int) -> tuple[IntArray, IntArray]:
        """Facets of one block and those of another that each may come to face."""
        masters, slaves = self.facets[m], self.facets[s]
        tree = cKDTree(self._centre[masters])
        reach = self._radius[slaves] + self._radius[masters].max(initial=0.0) + self.farthest
        found = tree.query_ball_point(self._centre[slaves], reach)
        counts = [len(row) for row in found]
        own = np.repeat(np.arange(slaves.start, slaves.stop), counts)
        near = np.concatenate([np.empty(0, np.int64), *(np.array(r, np.int64) for r in found)])
        near = near.astype(np.int64) + masters.start
        away = np.linalg.norm(self._centre[own] - self._centre[near], axis=1)
        keep = away <= self._radius[own] + self._radius[near] + self.farthest
        keep &= np.einsum("fi,fi->f", self._normal[own], self._normal[near]) < -_NEIGHBOURS
        return own[keep], near[keep]


def closest_points(
    corners: FloatArray, points: FloatArray, start: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Closest points of facets to points, by Newton.

    Parameters
    ----------
    corners
        One facet for each point, (n, 4, 3) [mm].
    points
        (n, 3) [mm].
    start
        Natural coordinates to start from, (n, 2); None: the centres.

    Returns
    -------
    tuple[FloatArray, FloatArray, FloatArray]
        Natural coordinates (n, 2), held within twice the facet, gaps (n,) [mm], normals (n, 3).
    """
    n = len(points)
    xi = np.zeros((n, 2)) if start is None else start.copy()
    gap, normal = np.empty(n), np.empty((n, 3))
    # One form for all: a view would be compiled for anew.
    facing, where = np.ascontiguousarray(corners), np.ascontiguousarray(points)
    closest_on_facets(facing, where, xi, gap, normal, start is not None)
    return xi, gap, normal


@dataclass(frozen=True)
class SearchedSurfaces:
    """Points that face a facet, sorted by block pair: to the static solver facets with one point.

    The same quantities as `fem.contact.surfaces`, for points x_s = Σ N_a x_a of a slave facet that
    face a master facet, whatever the meshes: gap = n · (x_s - x_m(ξ)), n normal to the master
    facet. With *current* normals ξ is the closest point of the displaced facet, whose way does not
    change the gap (d stands on the facet); with *reference* normals n and ξ stay as the search
    found them.
    """

    block_m: IntArray
    """Master block, (n,)."""
    block_s: IntArray
    """Block that the point lies on, (n,)."""
    quads_m: IntArray
    """Corner nodes of the faced facet in block m's mesh, (n, 4)."""
    quads_s: IntArray
    """Corner nodes of the point's facet in block s's mesh, (n, 4)."""
    corners: FloatArray
    """Of both facets before any displacement, m's first, world axes, (n, 8, 3) [mm]."""
    shapes: FloatArray
    """Shape functions of the point's facet there, (n, 4)."""
    xi: FloatArray
    """Natural coordinates of the closest point as the search found it, (n, 2)."""
    normals: FloatArray
    """From m to s as the search found them, (n, 1 point, 3)."""
    weights: FloatArray
    """Area that the point stands for, (n, 1 point) [mm²]."""
    order: IntArray
    """Position of each point in the search, (n,)."""
    clearance: float
    """Added to every gap [mm]."""

    @property
    def n_facets(self) -> int:
        """Number of points."""
        return len(self.block_m)

    @property
    def areas(self) -> FloatArray:
        """Area of each point, (n,) [mm²]."""
        return self.weights[:, 0]

    @cached_property
    def pair_start(self) -> IntArray:
        """First point of each block pair, and the total; (n_pairs + 1,)."""
        return run_starts(self.block_m, self.block_s)

    @cached_property
    def difference(self) -> FloatArray:
        """Corner weights of d = x_s - x_m, (n, 1 point, 8)."""
        return np.concatenate([-bilinear(self.xi)[0], self.shapes], axis=1)[:, None]

    @cached_property
    def tangents(self) -> FloatArray:
        """Orthonormal tangents of the normals, (n, 1 point, 2, 3)."""
        slopes = bilinear(self.xi)[1]
        first: FloatArray = np.einsum("na,nai->ni", slopes[:, :, 0], self.corners[:, :4])
        normal = self.normals[:, 0]
        first -= np.einsum("ni,ni->n", first, normal)[:, None] * normal
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return np.stack([first, np.cross(normal, first)], axis=1)[:, None]

    def kinematics(
        self, corner_displacements: FloatArray, normals: ContactNormals
    ) -> PointKinematics:
        """Overclosures and their gradients at displaced corners (n, 8, 3) [mm], world axes."""
        corners: FloatArray = self.corners + corner_displacements
        if normals is ContactNormals.REFERENCE:
            d = np.einsum("npa,nai->npi", self.difference, corners)
            gap = np.einsum("npi,npi->np", self.normals, d)
            gradient = -np.einsum("npa,npi->npai", self.difference, self.normals)
            return PointKinematics(-gap - self.clearance, gradient)
        points = np.einsum("na,nai->ni", self.shapes, corners[:, 4:])
        xi, found, normal = closest_points(corners[:, :4], points, self.xi)
        difference = np.concatenate([-bilinear(xi)[0], self.shapes], axis=1)
        by_corner = -np.einsum("na,ni->nai", difference, normal)
        return PointKinematics((-found - self.clearance)[:, None], by_corner[:, None])

    def subset(self, points: IntArray) -> SearchedSurfaces:
        """Keep some points, in the order given."""
        each = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "clearance"}
        return replace(self, **{name: values[points] for name, values in each.items()})


def searched_surfaces(points: FacingPoints, clearance: float) -> SearchedSurfaces:
    """Points of a search at its present positions, as the static solver takes them."""
    master, slave = points.facet, points.slave
    sizes = [len(s.quads) for s in points.surfaces]
    nodes = np.concatenate([s.nodes for s in points.surfaces])
    reference = np.concatenate([s.reference for s in points.surfaces])
    blocks = np.repeat([s.block for s in points.surfaces], sizes)
    order = np.lexsort((blocks[slave], blocks[master]))
    master, slave = master[order], slave[order]
    quads_m, quads_s = points.quads[master], points.quads[slave]
    position = np.einsum("na,nai->ni", points.shapes[order], points.position[quads_s])
    xi, _, normal = closest_points(points.position[quads_m], position, points.xi[order])
    return SearchedSurfaces(
        block_m=blocks[master],
        block_s=blocks[slave],
        quads_m=nodes[quads_m],
        quads_s=nodes[quads_s],
        corners=np.concatenate([reference[quads_m], reference[quads_s]], axis=1),
        shapes=points.shapes[order],
        xi=xi,
        normals=normal[:, None],
        weights=points.weights[order][:, None],
        order=order,
        clearance=clearance,
    )
