"""Contact with finite sliding: surfaces that need not conform, partners found by a search.

Points lie on the finer surface of each two blocks. A search by spatial trees gives every point
the facet it faces, with a skin: it is repeated only when the blocks together have moved by the
skin, so a point without a facet cannot touch in between. See `fem.sliding_kernel` for the force.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from fem.body import Body
from fem.central_difference import Interaction, System
from fem.contact_kernels import add_travel
from fem.contact_law import ContactLaw
from fem.explicit_contact import shifted
from fem.friction import CoulombFriction
from fem.layout import LaneArray
from fem.sliding_kernel import apply_surface, place_surface, sliding_forces
from fem.state import State
from geometry.mesh import FloatArray, IntArray

#: Skin of the search over the shortest mean edge of a facet.
_SKIN = 0.1

#: Facets looked at for each point.
_CANDIDATES = 12

#: A point this far outside a facet, in natural coordinates, still belongs to it.
_RIM = 1e-6


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


@dataclass(frozen=True)
class SlidingContact:
    """Contact between any facets of different blocks."""

    surfaces: tuple[BlockSurface, ...]
    """One for each block."""
    n_nodes: tuple[int, ...]
    """Nodes of one block of each group."""
    law: ContactLaw
    """Pressure as a function of overclosure."""
    clearance: float
    """Added to every gap [mm]."""
    counted_stiffness: float
    """Stiffness of the law that the critical time step counts in [MPa/mm]."""
    friction: CoulombFriction | None = None
    """None: absent."""
    points_per_edge: int = 2
    """Gauss points along each edge of a facet. Two are exact where facets of the finer surface
    lie inside those of the coarser one; more lower the error where they cross."""

    def touched_nodes(self, group: int) -> IntArray:
        """Mesh nodes of the group on which contact may act, (n,)."""
        mine = [s.nodes for s in self.surfaces if s.group == group]
        return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *mine]))

    def nodal_stiffness(self, group: int) -> FloatArray | None:
        """Stiffness to count on each node, as `fem.explicit_contact.FaceContact` does."""
        mine = [s for s in self.surfaces if s.group == group]
        if not mine:
            return None
        moving = min(2, sum(s.group >= 0 for s in self.surfaces))
        largest = np.zeros(self.n_nodes[group])
        for surface in mine:
            total = np.zeros(self.n_nodes[group])
            area = np.linalg.norm(_facet_areas(surface.reference[surface.quads]), axis=1)
            np.add.at(total, surface.nodes[surface.quads], 0.25 * area[:, None])
            largest = np.maximum(largest, total)
        return moving * self.counted_stiffness * largest

    def bind(self, bodies: tuple[Body, ...]) -> Interaction:
        """Prepare the force for the loop."""
        return BoundSlidingContact(self, bodies)


def _facet_areas(corners: FloatArray) -> FloatArray:
    """Vector areas of facets (n, 4, 3): (n, 3) [mm²]."""
    areas: FloatArray = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return areas


def _shapes(xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bilinear shape functions (..., 4) and slopes (..., 4, 2) at natural coordinates (..., 2)."""
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    factor = 1.0 + xi[..., None, :] * signs
    slopes = 0.25 * signs * factor[..., ::-1]
    return 0.25 * factor.prod(axis=-1), slopes


@dataclass(frozen=True)
class _Group:
    """Surface nodes of one group."""

    where: slice
    reference: FloatArray
    rows: IntArray
    applied: IntArray
    copies: IntArray
    rotations: FloatArray
    surface_rows: IntArray


class BoundSlidingContact:
    """Arrays of one run."""

    def __init__(self, statement: SlidingContact, bodies: tuple[Body, ...]) -> None:
        self._statement = statement
        self._law = shifted(statement.law.constants, statement.clearance)
        self._reach = -self._law.start
        surfaces = sorted(statement.surfaces, key=lambda s: s.group)
        sizes = np.cumsum([0, *(len(s.nodes) for s in surfaces)])
        facets = np.cumsum([0, *(len(s.quads) for s in surfaces)])
        self._surfaces = surfaces
        self._facets = [slice(a, b) for a, b in pairwise(facets.tolist())]
        self._position = np.concatenate([s.reference for s in surfaces])
        self._force = np.zeros_like(self._position)
        self._quads = np.concatenate(
            [s.quads + first for s, first in zip(surfaces, sizes[:-1], strict=True)]
        )
        self._groups = [_group(surfaces, sizes, g, body) for g, body in enumerate(bodies)]
        self._make_points(statement.points_per_edge)
        self._edges = np.array([s.edge for s in surfaces])
        self._skin = _SKIN * float(self._edges.min())
        n = len(self._slave)
        self._facet = np.full(n, -1, dtype=np.int64)
        self._xi = np.zeros((n, 2))
        self._gap = np.full(n, np.inf)
        self._travel = [np.zeros(body.n_copies) for body in bodies]
        self._searches = np.zeros(1, dtype=np.int64)
        self._friction: FloatArray | None = None
        self._slip: FloatArray | None = None
        self._dissipated: FloatArray | None = None
        if statement.friction is not None:
            given = statement.friction
            self._friction = np.array([given.coefficient, given.stick_stiffness])
            self._slip, self._dissipated = np.zeros((n, 3)), np.zeros(1)

    def _make_points(self, per_edge: int) -> None:
        line, weight = np.polynomial.legendre.leggauss(per_edge)
        xi = np.stack([g.ravel() for g in np.meshgrid(line, line, indexing="ij")], axis=1)
        area = np.outer(weight, weight).ravel()
        values, slopes = _shapes(xi)
        corners = self._position[self._quads]
        tangents = np.einsum("pak,fai->fpki", slopes, corners)
        measure = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2)
        self._slave = np.repeat(np.arange(len(self._quads)), len(xi))
        self._shapes = np.tile(values, (len(self._quads), 1))
        self._weights = (measure * area).ravel()
        self._per_facet = len(xi)

    def add_force(self, system: System, state: State) -> None:
        """Add contact forces at the current positions to the applied forces."""
        for group, body, now in zip(self._groups, system.bodies, state.bodies, strict=True):
            place_surface(
                group.reference,
                group.rows,
                body.lanes,
                group.copies,
                group.rotations,
                now.displacement.ravel(),
                self._position[group.where],
            )
        self._search_if_moved(system, state)
        sliding_forces(
            self._position,
            self._quads,
            self._slave,
            self._shapes,
            self._weights,
            self._facet,
            self._xi,
            self._law,
            self._friction,
            self._slip,
            self._dissipated,
            self._gap,
            self._force,
        )
        for group, body, now in zip(self._groups, system.bodies, state.bodies, strict=True):
            if now.applied_force is None:
                continue
            apply_surface(
                self._force[group.where],
                group.applied,
                body.lanes,
                group.copies,
                group.rotations,
                now.applied_force.ravel(),
            )

    def _search_if_moved(self, system: System, state: State) -> None:
        """Search when two blocks together may have moved by the skin since the last search."""
        for group, now, travel in zip(self._groups, state.bodies, self._travel, strict=True):
            add_travel(group.surface_rows, now.velocity, system.time_step, travel)
        moved = max((float(travel.max()) for travel in self._travel), default=0.0)
        if self._searches[0] and 2.0 * moved < self._skin:
            return
        self._searches += 1
        for travel in self._travel:
            travel[:] = 0.0
        self._search()

    def _search(self) -> None:
        """Give every point the facet it faces, if one is within reach and skin."""
        before = self._facet.copy()
        self._facet[:] = -1
        best = np.full(len(self._facet), np.inf)
        low, high = self._bounds()
        trees: dict[int, cKDTree] = {}
        for m, s in self._near_blocks(low, high):
            if m not in trees:
                corners = self._position[self._quads[self._facets[m]]]
                trees[m] = cKDTree(corners.mean(axis=1))
            self._search_pair(m, s, trees[m], (low[m], high[m]), best)
        if self._slip is not None:
            self._slip[(before >= 0) & (self._facet < 0)] = 0.0

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Boxes round the surfaces, grown by what a point may be away; (n_blocks, 3) each."""
        margin = max(self._reach, 0.0) + self._skin
        low, high = np.empty((len(self._surfaces), 3)), np.empty((len(self._surfaces), 3))
        for k, facets in enumerate(self._facets):
            corners = self._position[self._quads[facets]].reshape(-1, 3)
            low[k], high[k] = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        return low, high

    def _near_blocks(self, low: FloatArray, high: FloatArray) -> list[tuple[int, int]]:
        """Master and slave of each two blocks whose boxes overlap; the finer one is slave."""
        pairs = []
        for i in range(len(low)):
            overlap = ((low[i] <= high[i + 1 :]) & (low[i + 1 :] <= high[i])).all(axis=1)
            for j in np.flatnonzero(overlap) + i + 1:
                if max(self._surfaces[i].group, self._surfaces[j].group) < 0:
                    continue
                finer = j if self._edges[j] <= self._edges[i] * (1.0 + 1e-9) else i
                pairs.append((int(i + j - finer), int(finer)))
        return pairs

    def _search_pair(
        self, m: int, s: int, tree: cKDTree, box: tuple[FloatArray, FloatArray], best: FloatArray
    ) -> None:
        facets = self._facets[s]
        points = np.arange(facets.start * self._per_facet, facets.stop * self._per_facet)
        own = self._position[self._quads[self._slave[points]]]
        x = np.einsum("pa,pai->pi", self._shapes[points], own)
        inside = ((x >= box[0]) & (x <= box[1])).all(axis=1)
        points, own, x = points[inside], own[inside], x[inside]
        if not len(points):
            return
        count = min(_CANDIDATES, tree.n)
        _, found = tree.query(x, k=count)
        candidate = np.asarray(found).reshape(len(points), count) + self._facets[m].start
        xi, gap, normal = closest_points(self._position[self._quads[candidate]], x)
        against = np.einsum("pki,pi->pk", normal, _facet_areas(own)) < 0.0
        on_facet = (np.abs(xi) <= 1.0 + _RIM).all(axis=2) & against
        on_facet &= (gap <= max(self._reach, 0.0) + self._skin) & (gap >= -0.5 * self._edges[m])
        distance = np.where(on_facet, np.abs(gap), np.inf)
        choice = distance.argmin(axis=1)
        row = np.arange(len(points))
        better = distance[row, choice] < best[points]
        row, choice, points = row[better], choice[better], points[better]
        best[points] = distance[row, choice]
        self._facet[points] = candidate[row, choice]
        self._xi[points] = xi[row, choice]

    @property
    def searches(self) -> int:
        """Searches so far."""
        return int(self._searches[0])

    def point_pressures(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Blocks, areas [mm²] and pressures [MPa] of all slave points at the last forces, (n,)."""
        owner = np.repeat(
            [s.block for s in self._surfaces], [f.stop - f.start for f in self._facets]
        )
        pressure = self._statement.law.pressure(-self._gaps())
        return owner[self._slave], self._weights, pressure

    def point_positions(self) -> FloatArray:
        """Positions of all slave points at the last forces, world axes, (n, 3) [mm]."""
        corners = self._position[self._quads[self._slave]]
        positions: FloatArray = np.einsum("pa,pai->pi", self._shapes, corners)
        return positions

    def _gaps(self) -> FloatArray:
        """Gaps of all points, a large number where no facet is near, (n,) [mm]."""
        gaps: FloatArray = np.minimum(self._gap, 1e30) + self._statement.clearance
        return gaps

    def energy(self) -> float:
        """Energy stored at the last force evaluation [N mm]."""
        stored = float(self._weights @ self._statement.law.stored_energy(-self._gaps()))
        if self._slip is not None and self._friction is not None:
            stored += 0.5 * self._friction[1] * float(self._weights @ (self._slip**2).sum(axis=1))
        return stored

    def dissipation(self) -> float:
        """Energy dissipated by friction up to the last force evaluation [N mm]."""
        return 0.0 if self._dissipated is None else float(self._dissipated[0])

    def fault(self, system: System) -> str | None:
        """Where the stiffness of the law exceeds what the time step counted in."""
        counted = self._statement.counted_stiffness
        if self._statement.law.constants.linear_stiffness <= counted or not len(self._gap):
            return None
        deepest = int(np.argmin(self._gap))
        stiffness = float(self._statement.law.stiffness(-self._gaps()[deepest]))
        if stiffness <= counted:
            return None
        owner = self.point_pressures()[0][deepest]
        return (
            f"contact of block {int(owner)}: stiffness {stiffness:.3g} MPa/mm; the time step "
            f"{system.time_step:.4g} s counts {counted:.3g}; take a smaller fem.safety_factor or "
            "set contact.maximum_stiffness"
        )

    def arrays(self) -> dict[str, LaneArray]:
        """Arrays that evolve, by name."""
        found: dict[str, LaneArray] = {
            "facet": self._facet,
            "closest": self._xi,
            "searches": self._searches,
        }
        found |= {f"travel.{k}": travel for k, travel in enumerate(self._travel)}
        if self._slip is not None and self._dissipated is not None:
            found |= {"slip": self._slip, "dissipated": self._dissipated}
        return found


def _group(surfaces: list[BlockSurface], sizes: IntArray, number: int, body: Body) -> _Group:
    """Collect the surface nodes of one group, which follow each other."""
    mine = [k for k, s in enumerate(surfaces) if s.group == number]
    if not mine:
        none = np.empty(0, dtype=np.int64)
        return _Group(slice(0, 0), np.empty((0, 3)), none, none, none, np.empty((0, 3, 3)), none)
    nodes = np.concatenate([surfaces[k].nodes for k in mine])
    rows = body.rows.row[nodes]
    assert body.applied_row is not None
    return _Group(
        where=slice(int(sizes[mine[0]]), int(sizes[mine[-1] + 1])),
        reference=np.concatenate([surfaces[k].reference for k in mine]),
        rows=rows,
        applied=body.applied_row[rows].astype(np.int64),
        copies=np.repeat([surfaces[k].copy for k in mine], [len(surfaces[k].nodes) for k in mine]),
        rotations=np.ascontiguousarray(body.group.rotations),
        surface_rows=np.unique(rows),
    )


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
    xi = np.zeros((*corners.shape[:2], 2))
    mixed = 0.25 * (
        corners[..., 0, :] - corners[..., 1, :] + corners[..., 2, :] - corners[..., 3, :]
    )
    for _ in range(12):
        values, slopes = _shapes(xi)
        d = points[:, None] - np.einsum("nka,nkai->nki", values, corners)
        tangents = np.einsum("nkac,nkai->nkci", slopes, corners)
        matrix = np.einsum("nkci,nkdi->nkcd", tangents, tangents)
        twist = np.einsum("nki,nki->nk", d, mixed)
        matrix[..., 0, 1] -= twist
        matrix[..., 1, 0] -= twist
        right = np.einsum("nkci,nki->nkc", tangents, d)
        xi = np.clip(xi + np.linalg.solve(matrix, right[..., None])[..., 0], -2.0, 2.0)
    values, slopes = _shapes(xi)
    d = points[:, None] - np.einsum("nka,nkai->nki", values, corners)
    tangents = np.einsum("nkac,nkai->nkci", slopes, corners)
    normal = np.cross(tangents[..., 0, :], tangents[..., 1, :])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return xi, np.einsum("nki,nki->nk", d, normal), normal
