"""Points of surfaces and the search for the facets they face.

Points lie on every facet of every block (`fem.explicit.contact.quadrature`); of two blocks that
come near, those of the finer one look for facets of the other. Spatial trees find candidates, the
closest point on each is found by Newton, and of those that hold it the nearest is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from fem.explicit.contact.quadrature import FacetPoints, cut_points, gauss_points
from fem.explicit.contact.sliding_kernel import closest_on_facets
from geometry.mesh import FloatArray, IntArray

#: Skin of the search over the shortest mean edge of a facet.
_SKIN = 0.1

#: Facets looked at for each point.
_CANDIDATES = 12

#: A point this far outside a facet, in natural coordinates, still belongs to it.
_RIM = 1e-6

#: A facet whose corners lie this far outside another, in natural coordinates, is still inside it.
_NESTED = 1e-3

#: Facets that look at each other: least cosine between one normal and the other's opposite.
_OPPOSITE = 0.3


@dataclass(frozen=True)
class BlockSurface:
    """The facets of one block that can touch others."""

    block: int
    """Number of the block, for messages."""
    group: int
    """Group of the model; -1 for a rigid block."""
    copy: int
    """Copy of that group; 0 for a rigid block."""
    rotation: FloatArray
    """Placement, (3, 3)."""
    nodes: IntArray
    """Mesh nodes on the surface, (n_nodes,)."""
    reference: FloatArray
    """Their positions before any displacement, world axes, (n_nodes, 3) [mm]."""
    quads: IntArray
    """Facets as positions in `nodes`, counter-clockwise from outside, (n_facets, 4)."""

    @property
    def edge(self) -> float:
        """Mean edge of the facets [mm]."""
        corners = self.reference[self.quads]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def facet_area_vectors(corners: FloatArray) -> FloatArray:
    """Vector areas of facets (n, 4, 3): (n, 3) [mm²]."""
    areas: FloatArray = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return areas


class SlidingPoints:
    """Points on all surfaces, and which facet each faces at present."""

    def __init__(self, surfaces: tuple[BlockSurface, ...], *, reach: float) -> None:
        """Place the points and search the facets that they face at the start.

        Parameters
        ----------
        surfaces
            Of all blocks; those of one group follow each other.
        reach
            Distance below which contact acts [mm].
        """
        sizes = np.cumsum([0, *(len(s.nodes) for s in surfaces)])
        facets = np.cumsum([0, *(len(s.quads) for s in surfaces)])
        self.surfaces = surfaces
        self.node_start: IntArray = sizes
        self.position = np.concatenate([s.reference for s in surfaces])
        self.quads = np.concatenate(
            [s.quads + first for s, first in zip(surfaces, sizes[:-1], strict=True)]
        )
        self.facets = [slice(a, b) for a, b in pairwise(facets.tolist())]
        self._reach = max(reach, 0.0)
        self._edges = np.array([s.edge for s in surfaces])
        self.skin = _SKIN * float(self._edges.min())
        corners = self.position[self.quads]
        points = gauss_points(corners)
        self._take(points)
        self.search()
        cut = cut_points(points, corners, self._crossed())
        if cut is not points:
            self._take(cut)
            self.search()

    def _take(self, points: FacetPoints) -> None:
        """Replace the points; none has a facet yet."""
        self.slave, self.shapes = points.facet, points.shapes
        self.weights, self.cells = points.weights, points.cells
        self._first = np.searchsorted(self.slave, np.arange(len(self.quads) + 1))
        n = len(self.slave)
        self.facet = np.full(n, -1, dtype=np.int64)
        self.xi = np.zeros((n, 2))

    def _crossed(self) -> dict[int, FloatArray]:
        """Facets that lie neither inside one facet of another block nor away from all.

        Each with the corners of the facets that its edges may cross.
        """
        faced = self.facet.reshape(len(self.quads), -1)
        one = np.flatnonzero((faced == faced[:, :1]).all(axis=1) & (faced[:, 0] >= 0))
        own = self.position[self.quads[one]]
        master = np.repeat(faced[one, 0], 4)
        xi, _, _ = closest_points(self.position[self.quads[master]][:, None], own.reshape(-1, 3))
        inside = (np.abs(xi).reshape(len(one), 8) <= 1.0 + _NESTED).all(axis=1)
        nested = np.zeros(len(self.quads), dtype=np.bool_)
        nested[one[inside]] = True
        found: dict[int, list[FloatArray]] = {}
        low, high = self._bounds()
        for m, s in self._near_blocks(low, high):
            corners = self.position[self.quads[self.facets[m]]]
            tree = cKDTree(corners.mean(axis=1))
            facets = np.arange(self.facets[s].start, self.facets[s].stop)
            facets = facets[~nested[facets]]
            placed = self.position[self.quads[facets]]
            near = ((placed.max(axis=1) >= low[m]) & (placed.min(axis=1) <= high[m])).all(axis=1)
            for facet, mine in zip(facets[near].tolist(), placed[near], strict=True):
                others = self._opposite(mine, corners, tree)
                if len(others):
                    found.setdefault(facet, []).append(others)
        return {facet: np.concatenate(others) for facet, others in sorted(found.items())}

    def _opposite(self, own: FloatArray, corners: FloatArray, tree: cKDTree) -> FloatArray:
        """Facets of another block, (k, 4, 3), that look at one facet from near."""
        looked = np.concatenate([own, own.mean(axis=0, keepdims=True)])
        _, found = tree.query(looked, k=min(_CANDIDATES, tree.n))
        others = corners[np.unique(found)]
        vectors = facet_area_vectors(others)
        normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        away = np.einsum("kai,ki->ka", own.mean(axis=0) - others, normals).mean(axis=1)
        looks = facet_area_vectors(own[None])[0]
        against = normals @ looks < -_OPPOSITE * np.linalg.norm(looks)
        near: FloatArray = others[against & (np.abs(away) <= self._reach + self.skin)]
        return near

    @property
    def block(self) -> IntArray:
        """Block that each point lies on, (n,)."""
        return self.facet_block[self.slave]

    @property
    def facet_block(self) -> IntArray:
        """Block of each facet, (n_facets,)."""
        blocks = [s.block for s in self.surfaces]
        return np.repeat(blocks, [f.stop - f.start for f in self.facets])

    def place(self) -> FloatArray:
        """Positions of the points, world axes, (n, 3) [mm]."""
        corners = self.position[self.quads[self.slave]]
        positions: FloatArray = np.einsum("pa,pai->pi", self.shapes, corners)
        return positions

    def search(self) -> None:
        """Give every point the facet it faces, if one is within reach and skin."""
        self.facet[:] = -1
        best = np.full(len(self.facet), np.inf)
        low, high = self._bounds()
        trees: dict[int, cKDTree] = {}
        for m, s in self._near_blocks(low, high):
            if m not in trees:
                corners = self.position[self.quads[self.facets[m]]]
                trees[m] = cKDTree(corners.mean(axis=1))
            self._search_pair(m, s, trees[m], (low[m], high[m]), best)

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Boxes round the surfaces, grown by what a point may be away; (n_blocks, 3) each."""
        margin = self._reach + self.skin
        low, high = np.empty((len(self.surfaces), 3)), np.empty((len(self.surfaces), 3))
        for k, facets in enumerate(self.facets):
            corners = self.position[self.quads[facets]].reshape(-1, 3)
            low[k], high[k] = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        return low, high

    def _near_blocks(self, low: FloatArray, high: FloatArray) -> list[tuple[int, int]]:
        """Master and slave of each two blocks whose boxes overlap; the finer one is slave."""
        pairs = []
        for i in range(len(low)):
            overlap = ((low[i] <= high[i + 1 :]) & (low[i + 1 :] <= high[i])).all(axis=1)
            for j in np.flatnonzero(overlap) + i + 1:
                if max(self.surfaces[i].group, self.surfaces[j].group) < 0:
                    continue
                finer = j if self._edges[j] <= self._edges[i] * (1.0 + 1e-9) else i
                pairs.append((int(i + j - finer), int(finer)))
        return pairs

    def _search_pair(
        self, m: int, s: int, tree: cKDTree, box: tuple[FloatArray, FloatArray], best: FloatArray
    ) -> None:
        facets = self.facets[s]
        points = np.arange(self._first[facets.start], self._first[facets.stop])
        own = self.position[self.quads[self.slave[points]]]
        x = np.einsum("pa,pai->pi", self.shapes[points], own)
        inside = ((x >= box[0]) & (x <= box[1])).all(axis=1)
        points, own, x = points[inside], own[inside], x[inside]
        if not len(points):
            return
        count = min(_CANDIDATES, tree.n)
        _, found = tree.query(x, k=count)
        candidate = np.asarray(found).reshape(len(points), count) + self.facets[m].start
        xi, gap, normal = closest_points(self.position[self.quads[candidate]], x)
        looks = facet_area_vectors(own)
        least = -_OPPOSITE * np.linalg.norm(looks, axis=1, keepdims=True)
        against = np.einsum("pki,pi->pk", normal, looks) < least
        on_facet = (np.abs(xi) <= 1.0 + _RIM).all(axis=2) & against
        on_facet &= (gap <= self._reach + self.skin) & (gap >= -0.5 * self._edges[m])
        distance = np.where(on_facet, np.abs(gap), np.inf)
        choice = distance.argmin(axis=1)
        row = np.arange(len(points))
        better = distance[row, choice] < best[points]
        row, choice, points = row[better], choice[better], points[better]
        best[points] = distance[row, choice]
        self.facet[points] = candidate[row, choice]
        self.xi[points] = xi[row, choice]


def closest_points(
    corners: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Closest points of facets to points, by Newton from the centres.

    Parameters
    ----------
    corners
        Facets for each point, (n, k, 4, 3) [mm].
    points
        (n, 3) [mm].

    Returns
    -------
    tuple[FloatArray, FloatArray, FloatArray]
        Natural coordinates (n, k, 2), held within twice the facet, gaps (n, k) [mm], normals
        (n, k, 3).
    """
    shape = corners.shape[:2]
    xi, gap, normal = np.empty((*shape, 2)), np.empty(shape), np.empty((*shape, 3))
    closest_on_facets(corners, points, xi, gap, normal)
    return xi, gap, normal
