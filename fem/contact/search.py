"""Points of surfaces and the facets that they face, wherever the surfaces have moved.

Of two blocks that come near, facets of the finer one look for facets of the other. Spatial trees
find the *neighbours* of each facet; they hold until two blocks together have moved by a skin. Cuts
along the neighbours' edges (`fem.contact.cuts`) follow the motion between searches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fem.contact.cuts import (
    OPPOSITE,
    CutFacets,
    Neighbours,
    PointsOnFacets,
    carry_over,
    cut_facets,
)
from fem.contact.edge_points import ending_edges, matching_facets
from fem.contact.normals import ContactNormals
from fem.contact.surfaces import ContactPoints, of_no_system
from fem.element.functions import (
    FACET_CORNERS,
    bilinear,
    facet_areas,
    facet_functions,
    lobatto_points,
)
from geometry.machine.work import Operation, count
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Skin of the search over the shortest mean edge of a facet.
_SKIN = 0.1

#: Surfaces lie in each other by at most this many skins: what is deeper is another surface.
_DEEPEST = 3.0

#: Points a facet that there is room for at first.
_ROOM = 16

#: Iterations on the closest point of a facet, and the step that ends them.
_STEPS, _CLOSE = 30, 1e-12
#: Squared sine of the angle between its tangents, below which a facet is folded to a line.
_FOLDED = 1e-20

#: Relative difference of edges, and of places, that is none.
_ALIKE = 1e-9

#: Normals may turn between two searches: neighbours look at each other by less than what cuts ask.
_NEIGHBOURS = 0.5 * OPPOSITE


@dataclass(frozen=True)
class BlockSurface:
    """The facets of one block that can touch others."""

    block: int
    """Number of the block, for messages."""
    body: int
    """Number of its body; -1 for a rigid block."""
    copy: int
    """Copy of that body that moves as it does; 0 for a rigid block."""
    rotation: FloatArray
    """Placement, (3, 3)."""
    nodes: IntArray
    """Mesh nodes on the surface, (n_nodes,)."""
    reference: FloatArray
    """Their positions before any displacement, relative to `origin`, (n_nodes, 3) [mm]."""
    quads: IntArray
    """Facets as positions in `nodes`, counter-clockwise from outside, (n_facets, 4)."""
    facets: IntArray | None = None
    """Curved facets of a higher degree, of which equally many `quads` each are the pieces, all
    their nodes as positions in `nodes`, (n, (degree + 1)²); None: the quads are the facets."""
    computed: bool = True
    """Whether contact of its own facets is integrated: in a sector others are images of that."""
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Place near the blocks, the same for all, world axes, (3,) [mm]: far from the world's origin
    differences of places have fewer digits."""

    @property
    def edge(self) -> float:
        """Mean edge of the facets [mm]."""
        corners = self.reference[self.quads]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def _stretch(nodes: FloatArray, slopes: FloatArray) -> FloatArray:
    """Area over that in natural coordinates, (n,) [mm²]."""
    first, second = np.moveaxis(np.einsum("nak,nai->nki", slopes, nodes), 1, 0)
    return np.linalg.norm(np.cross(first, second), axis=1)


def corner_area_vectors(corners: FloatArray) -> FloatArray:
    """Vector areas of facets (n, 4, 3): (n, 3) [mm²]."""
    return 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])


class FacingPoints:
    """Points on the surfaces that look for others, and the facet that each faces at present."""

    def __init__(
        self,
        surfaces: tuple[BlockSurface, ...],
        *,
        reach: float,
        slight: float = 0.0,
    ) -> None:
        """Place the surfaces and find what faces what.

        Parameters
        ----------
        surfaces
            Of all blocks; those of one body follow each other.
        reach
            Distance below which contact acts [mm].
        slight
            Share of a facet's nodal forces by which the points of a sliver may err, so that they
            are one or two.
        """
        sizes = np.cumsum([0, *(len(s.nodes) for s in surfaces)])
        facets = np.cumsum([0, *(len(s.quads) for s in surfaces)])
        self.surfaces, self._slight = surfaces, slight
        self.node_start: IntArray = sizes
        self.position = np.concatenate([s.reference for s in surfaces])
        self.quads = np.concatenate(
            [s.quads + first for s, first in zip(surfaces, sizes[:-1], strict=True)]
        )
        self.facets = [slice(a, b) for a, b in pairwise(facets.tolist())]
        #: Facets with all their nodes, and pieces of each.
        self.whole, self.pieces = self.quads, 1
        curved = [
            s.facets + first
            for s, first in zip(surfaces, sizes[:-1], strict=True)
            if s.facets is not None
        ]
        if curved:
            self.whole = np.concatenate(curved)
            self.pieces = len(self.quads) // len(self.whole)
        self._edges = np.array([s.edge for s in surfaces])
        self._middles = np.array([s.reference.mean(axis=0) for s in surfaces])
        self.skin = _SKIN * float(self._edges.min())
        self._bounds = np.array([-_DEEPEST * self.skin, max(reach, 0.0) + self.skin])
        #: Of the undeformed facets, (n_facets,) [mm²].
        self.facet_area = facet_areas(self.position, self.quads)
        self._ending = self._ending_edges()
        self._take(_ROOM * len(self.quads))
        self.search()

    def _ending_edges(self) -> BoolArray:
        """Edges at which surfaces end, of facets that match none, (n_facets, 4)."""
        corners = self.position[self.quads]
        vectors = corner_area_vectors(corners)
        normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        matching = matching_facets(corners, normals, self.facet_block, self.farthest)
        return ending_edges(self.quads, normals) & ~matching[:, None]

    def _take(self, room: int) -> None:
        """Make room for points."""
        #: Points, with room for more after the first `count` of them.
        self.room = PointsOnFacets(
            slave=np.zeros(room, np.int64),
            shapes=np.zeros((room, 4)),
            weights=np.zeros(room),
            cells=np.zeros((room, 2, 2)),
            facet=np.zeros(room, np.int64),
            xi=np.zeros((room, 2)),
        )

    @property
    def facet_block(self) -> IntArray:
        """Block of each facet, (n_facets,)."""
        blocks = [s.block for s in self.surfaces]
        return np.repeat(blocks, [f.stop - f.start for f in self.facets])

    @property
    def facet_position(self) -> IntArray:
        """Position of each facet among those of its surface, (n_facets,)."""
        return np.concatenate([np.arange(f.stop - f.start) for f in self.facets])

    def on_facets(self) -> PointsOnFacets:
        """The points on facets of `whole`, of which curved ones are cut piece by piece."""
        cut = self.now
        if self.pieces == 1:
            return cut
        own = cut.shapes @ FACET_CORNERS
        there, size = self._natural(cut.slave, own)
        values, slopes = facet_functions(there, self.whole.shape[1])
        reference = np.concatenate([s.reference for s in self.surfaces])
        slave, facet = cut.slave // self.pieces, cut.facet // self.pieces
        curved = _stretch(reference[self.whole[slave]], slopes) * size
        flat = _stretch(reference[self.quads[cut.slave]], bilinear(own)[1])
        cells = [self._natural(cut.slave, cut.cells[:, k])[0] for k in range(2)]
        return PointsOnFacets(
            slave,
            values,
            cut.weights * curved / flat,
            np.stack(cells, axis=1),
            facet,
            self._natural(cut.facet, cut.xi)[0],
        )

    def _natural(self, piece: IntArray, xi: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates on the facet of those on a piece, (n, 2), and the piece's share of areas."""
        ends = lobatto_points(math.isqrt(self.pieces))
        which = np.stack(np.divmod(piece % self.pieces, len(ends) - 1), axis=1)
        half = 0.5 * np.diff(ends)[which]
        return ends[which] + half * (xi + 1.0), half.prod(axis=1)

    def displace(self, displacements: tuple[FloatArray, ...]) -> None:
        """Place the surfaces at displacements of each body, world axes; none of a sector.

        Parameters
        ----------
        displacements
            (n_copies, n_nodes, 3) [mm] for each body.
        """
        for first, surface in zip(self.node_start, self.surfaces, strict=False):
            where = slice(int(first), int(first) + len(surface.nodes))
            self.position[where] = surface.reference
            if surface.body >= 0:
                self.position[where] += displacements[surface.body][surface.copy, surface.nodes]

    def search(self) -> None:
        """Find the neighbours of every facet at the present positions, and cut."""
        corners = self.position[self.quads]
        self._centre = corners.mean(axis=1)
        self._radius = np.linalg.norm(corners - self._centre[:, None], axis=2).max(axis=1)
        vectors = corner_area_vectors(corners)
        self._normal = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        result = [
            (*self._near_facets(m, s), share) for m, s, share in self._near_blocks(self.farthest)
        ]
        own = np.concatenate([np.empty(0, np.int64), *(f for f, _, _ in result)])
        near = np.concatenate([np.empty(0, np.int64), *(g for _, g, _ in result)])
        share = np.concatenate([np.empty(0), *(np.full(len(f), w) for f, _, w in result)])
        order = np.lexsort((near, own))
        start = np.searchsorted(own[order], np.arange(len(self.quads) + 1))
        self._near = Neighbours(start, near[order], share[order], self._bounds)
        self.cut()
        count(Operation.SEARCH, self.count)

    def cut(self) -> None:
        """Cut the facets along those that they face now: points follow the motion."""
        facets = CutFacets(self.position, self.quads, self._ending, self.facet_area)
        while True:
            self.count = int(
                cut_facets(facets, self._near, self._slight, self.pieces > 1, self.room)
            )
            if self.count <= len(self.room.slave):
                break
            self._take(2 * self.count)
        #: Points of the present cut, on facets as they are searched.
        self.now = PointsOnFacets._make(array[: self.count] for array in self.room)

    def carried(self, slave: IntArray, shapes: FloatArray, values: FloatArray) -> FloatArray:
        """Values (m, k) of points of an earlier cut at those of the present one, (n, k)."""
        new = np.empty((self.count, values.shape[1]))
        carry_over(slave, shapes, values, self.now.slave, self.now.shapes, new)
        return new

    @property
    def farthest(self) -> float:
        """Largest gap at which a point counts as facing a facet [mm]."""
        return float(self._bounds[1])

    def _near_blocks(self, margin: float) -> list[tuple[int, int, float]]:
        """Master and slave of each two blocks whose boxes overlap, and how much the pair counts.

        The finer one is slave; of two that are as fine the one that deforms; then the one that sees
        the other farther down, or else farther back, in its own axes: neither the numbers of blocks
        nor the place of the assembly count. Two that see each other alike are both.
        """
        low, high = np.empty((len(self.surfaces), 3)), np.empty((len(self.surfaces), 3))
        for k, facets in enumerate(self.facets):
            corners = self.position[self.quads[facets]].reshape(-1, 3)
            low[k], high[k] = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        pairs = []
        for i in range(len(low)):
            overlap = ((low[i] <= high[i + 1 :]) & (low[i + 1 :] <= high[i])).all(axis=1)
            for j in (np.flatnonzero(overlap) + i + 1).tolist():
                if max(self.surfaces[i].body, self.surfaces[j].body) >= 0:
                    pairs += [p for p in self._order(i, j) if self.surfaces[p[1]].computed]
        return pairs

    def _order(self, i: int, j: int) -> list[tuple[int, int, float]]:
        """(master, slave, share) of two blocks that come near."""
        one, two = self.surfaces[i], self.surfaces[j]
        way = self._middles[j] - self._middles[i]
        ahead = way @ one.rotation + way @ two.rotation  # as `one` sees `two`, less the reverse
        ranks = [
            (self._edges[i] - self._edges[j], self._edges[i]),
            (float(one.body < 0) - float(two.body < 0), 1.0),
            *((along, np.linalg.norm(way)) for along in ahead[::-1]),
        ]
        for rank, size in ranks:
            if abs(rank) > _ALIKE * size:
                return [(i, j, 1.0) if rank > 0.0 else (j, i, 1.0)]
        return [(i, j, 0.5), (j, i, 0.5)]

    def _near_facets(self, m: int, s: int) -> tuple[IntArray, IntArray]:
        """Facets of one block and those of another that each may come to face."""
        masters, slaves = self.facets[m], self.facets[s]
        tree = cKDTree(self._centre[masters])
        reach = self._radius[slaves] + self._radius[masters].max(initial=0.0) + self.farthest
        result = tree.query_ball_point(self._centre[slaves], reach)
        counts = [len(row) for row in result]
        own = np.repeat(np.arange(slaves.start, slaves.stop), counts)
        near = np.concatenate([np.empty(0, np.int64), *(np.array(r, np.int64) for r in result)])
        near = near.astype(np.int64) + masters.start
        away = np.linalg.norm(self._centre[own] - self._centre[near], axis=1)
        keep = away <= self._radius[own] + self._radius[near] + self.farthest
        keep &= np.einsum("fi,fi->f", self._normal[own], self._normal[near]) < -_NEIGHBOURS
        return own[keep], near[keep]


def closest_points(
    nodes: FloatArray, points: FloatArray, xi: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Closest points of facets to points, by Newton from points that are near.

    Without second derivatives: a step leaves the gap times the curvature of what it found. Cuts
    start from anywhere on bilinear facets (`fem.contact.cuts.closest_point`).

    Parameters
    ----------
    nodes
        One facet for each point, (n, n_nodes, 3) [mm].
    points
        (n, 3) [mm].
    xi
        Natural coordinates to start from, (n, 2).

    Returns
    -------
    tuple[FloatArray, FloatArray, FloatArray]
        Natural coordinates (n, 2), held within twice the facet, gaps (n,) [mm], normals (n, 3).
    """
    for _ in range(_STEPS):
        away, tangents = _seen(nodes, points, xi)
        metric = np.einsum("nki,nli->nkl", tangents, tangents)
        # A facet that a wild step of Newton's method has folded has no direction of its own.
        folded = np.linalg.det(metric) <= _FOLDED * (np.trace(metric, axis1=1, axis2=2) ** 2)
        metric[folded] = np.eye(2)
        right = np.einsum("nki,ni->nk", tangents, away)
        step = np.linalg.solve(metric, right[:, :, None])[:, :, 0]
        reached = np.clip(xi + step, -2.0, 2.0)
        way = np.abs(reached - xi).max(initial=0.0)
        xi = reached
        if way < _CLOSE:
            break
    away, tangents = _seen(nodes, points, xi)
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return xi, np.einsum("ni,ni->n", away, normal), normal


def _seen(nodes: FloatArray, points: FloatArray, xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points from those of facets at natural coordinates, (n, 3), and the tangents there."""
    values, slopes = facet_functions(xi, nodes.shape[1])
    away = points - np.einsum("na,nai->ni", values, nodes)
    return away, np.einsum("nak,nai->nki", slopes, nodes)


@dataclass(frozen=True)
class SearchedPoints(ContactPoints):
    """Points x_s = Σ N_a x_a of a slave facet that face a master facet: facets with one point.

    d and the normal are those at the natural coordinates of the closest point that the search
    found; while points slide from there, d leans.
    """

    corners: FloatArray
    """Of both facets before any displacement, m's first, relative to `origin`, world axes,
    (n, 2 n_nodes, 3) [mm]."""
    order: IntArray
    """Position of each point in the search, (n,)."""
    position_s: IntArray
    """Position of its facet in the contact facets of block s, (n,)."""
    cells: FloatArray
    """Box round its area in natural coordinates, lower then upper corner, (n, 2, 2)."""
    facet_areas: FloatArray
    """Area of its whole facet, (n,) [mm²]."""
    farthest: float
    """Largest gap at which the search counts a point as facing a facet [mm]."""
    origin: FloatArray
    """World axes, (3,) [mm] (`BlockSurface.origin`)."""

    def turned(self, turn: FloatArray, place: FloatArray, image: IntArray) -> SearchedPoints:
        """The same points after a rotation (3, 3) about a place (3,) that maps blocks (n,)."""
        about = place - self.origin
        return replace(
            self,
            block_m=image[self.block_m],
            block_s=image[self.block_s],
            corners=(self.corners - about) @ turn.T + about,
            offsets=self.offsets @ turn.T,
            tangents=self.tangents @ turn.T,
            sides=self.sides @ turn.T,
            axes=turn @ self.axes,
        )

    def joined(self, others: list[SearchedPoints]) -> SearchedPoints:
        """These points and others, sorted by block pair; `order` is that of the list."""
        every = [one._each for one in (self, *others)]
        each: dict[str, Any] = {
            name: np.concatenate([one[name] for one in every]) for name in self._each
        }
        each["order"] = np.arange(len(each["order"]))
        sort = np.lexsort((each["block_s"], each["block_m"]))
        return replace(self, **{name: values[sort] for name, values in each.items()})


def points_of_search(
    points: FacingPoints, clearance: float, normals: ContactNormals = ContactNormals.CURRENT
) -> SearchedPoints:
    """Points of a search at its present positions, with a rule of the normal."""
    result = points.on_facets()
    sizes = [len(s.quads) // points.pieces for s in points.surfaces]
    nodes = np.concatenate([s.nodes for s in points.surfaces])
    reference = np.concatenate([s.reference for s in points.surfaces])
    blocks = np.repeat([s.block for s in points.surfaces], sizes)
    order = np.lexsort((blocks[result.slave], blocks[result.facet]))
    master, slave, shapes = result.facet[order], result.slave[order], result.shapes[order]
    quads_m, quads_s = points.whole[master], points.whole[slave]
    position = np.einsum("na,nai->ni", shapes, points.position[quads_s])
    xi, _, normal = closest_points(points.position[quads_m], position, result.xi[order])
    values, by_nodes = facet_functions(xi, shapes.shape[1])
    slopes = np.concatenate([by_nodes, np.zeros_like(by_nodes)], axis=1).swapaxes(1, 2)[:, None]
    functions = np.concatenate([-values, shapes], axis=1)[:, None]
    corners = np.concatenate([reference[quads_m], reference[quads_s]], axis=1)
    tangents = (slopes[:, 0] @ corners)[:, None]
    first = tangents[:, 0, 0] - np.einsum("ni,ni->n", tangents[:, 0, 0], normal)[:, None] * normal
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    if normals is ContactNormals.REFERENCE:
        now = np.concatenate([points.position[quads_m], points.position[quads_s]], axis=1)
        slopes, tangents = np.zeros_like(slopes), (slopes[:, 0] @ now)[:, None]
    areas = points.facet_area.reshape(-1, points.pieces).sum(axis=1)
    return SearchedPoints(
        block_m=blocks[master],
        block_s=blocks[slave],
        quads_m=nodes[quads_m],
        quads_s=nodes[quads_s],
        functions=functions,
        slopes=slopes,
        offsets=functions @ corners,
        tangents=tangents,
        sides=np.stack([first, np.cross(normal, first)], axis=1)[:, None],
        weights=result.weights[order][:, None],
        clearance=clearance,
        corners=corners,
        order=order,
        position_s=points.facet_position[points.pieces * slave] // points.pieces,
        cells=result.cells[order],
        facet_areas=areas[slave],
        farthest=points.farthest,
        origin=points.surfaces[0].origin,
        **of_no_system(*corners.shape[:2]),
    )
