"""Contact with finite sliding: surfaces that need not conform, partners found by a search.

The search (`fem.contact.search`) has a skin: it is repeated only when two blocks together may have
moved by it, so a facet without neighbour cannot touch in between. Cuts follow when they may have
moved by a hundredth of that, a thousandth of an edge: what stale cuts err by is its square. See
`fem.explicit.contact.sliding_kernel` for the force.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fem.contact.friction import slip_sides
from fem.contact.search import FacingPoints, SearchedPoints, points_of_search
from fem.element.functions import facet_functions
from fem.explicit.body import LaneBody
from fem.explicit.contact.contact import BlockContact
from fem.explicit.contact.sliding_kernel import (
    SurfaceNodes,
    add_travel,
    apply_surface,
    place_surface,
    sliding_forces,
)
from fem.explicit.kernels.layout import LaneArray
from fem.explicit.step import Loop
from fem.explicit.timed import TimedSystem
from fem.system.contact_state import facing_points
from geometry.mesh import FloatArray, IntArray

#: Motion of two blocks together after which cuts follow it, over the skin of the search.
_CUT_SKIN = 1e-2

#: Share of a facet's nodal forces by which the points of a sliver may err: a fifth fewer points.
SLIGHT = 1e-7

#: Cost of a point over that of one on paired facets.
_COST = 8.0

#: Steps between two looks whether anything has moved at all since the last cut …
_LOOK = 1024

#: … by this share of the skin: what comes to rest is cut where it rests.
_AT_REST = 1e-6


class _Surface(NamedTuple):
    """Surface of one body."""

    where: slice
    """Its nodes among those of all."""
    nodes: SurfaceNodes
    rows: IntArray
    """Body rows on the surface, each once, (n,)."""


class SlidingContact(BlockContact):
    """Contact between any facets of different blocks."""

    def __init__(self, stated: TimedSystem, bodies: tuple[LaneBody, ...]) -> None:
        super().__init__(stated)
        self.points = facing_points(stated.system, copy_of=stated.copy_of, slight=SLIGHT)
        points = self.points
        self._force = np.zeros_like(points.position)
        self._surfaces = [_surface(points, k, body) for k, body in enumerate(bodies)]
        # Ways since the last search, and since the last cut.
        self._travel = [np.zeros((2, body.n_copies)) for body in bodies]
        # Searches and cuts so far; a checkpoint that is read changes the first, not the second.
        self._counts = np.zeros(2, dtype=np.int64)
        self._known = 0
        # Whether the run may end here: then cuts follow every motion.
        self._asked = np.zeros(1, dtype=np.int64)
        self._searched, self._cut = points.position.copy(), points.position.copy()
        self._dissipated = np.zeros(1) if self._rubs else None
        self._set_constants_of_points()
        self._take_room()

    def _set_constants_of_points(self) -> None:
        block, now = self.points.facet_block, self.points.now
        self._set_constants(block[now.facet], block[now.slave])

    def _take_room(self) -> None:
        """Gaps and elastic slips of as many points as there is room for."""
        room = len(self.points.room.slave)
        self._gap = np.full(room, np.inf)
        self._slip = np.zeros((room, 3)) if self._rubs else None

    def add_force(self, loop: Loop) -> None:
        """Add contact forces at the current positions to the applied forces."""
        points = self.points
        self._follow(loop)
        for surface, body, travel in zip(self._surfaces, loop.bodies, self._travel, strict=True):
            flat, position = body.now.displacement.ravel(), points.position[surface.where]
            place_surface(surface.nodes, body.lanes, flat, position)
            gone = np.zeros(body.n_copies)
            add_travel(surface.rows, body.now.velocity, loop.time_step, gone)
            np.add(travel, gone, out=travel)
        if not self._counts[0]:
            self._search()
        n = points.count
        sliding_forces(
            points.position,
            points.quads,
            points.now,
            self._constants,
            None if self._slip is None else self._slip[:n],
            self._dissipated,
            self._gap[:n],
            self._force,
        )
        for surface, body in zip(self._surfaces, loop.bodies, strict=True):
            if body.now.applied_force is None:
                continue
            flat, force = body.now.applied_force.ravel(), self._force[surface.where]
            apply_surface(surface.nodes, body.lanes, force, flat)

    def _follow(self, loop: Loop) -> None:
        """Search or cut at the last positions, if two blocks together have moved since by a skin.

        At the last ones: elastic slips know the way of a point from there on.
        """
        if self._counts.sum() != self._known:
            self._resume()
        if not self._known:
            return
        moved, skin = self._moved(), self.points.skin
        look = loop.step % _LOOK == 0 or self._asked[0]
        self._asked[0] = 0
        if moved[0] > skin:
            self._search()
        elif moved[1] > _CUT_SKIN * skin or (look and moved[1] > _AT_REST * skin):
            self._renew(self.points.cut)
            self._counts[1] += 1
            self._known += 1

    def _moved(self) -> FloatArray:
        """Way of two blocks together since the last search and since the last cut, (2,) [mm]."""
        ways = np.array([travel.max(axis=1) for travel in self._travel])
        return np.asarray(2.0 * ways.max(axis=0))

    def follows(self) -> bool:
        """Whether cuts are those of the present positions; else the next step makes them."""
        self._asked[0] = self._moved()[1] > _AT_REST * self.points.skin
        return not self._asked[0]

    def _search(self) -> None:
        """Find the neighbours of all facets anew, and cut."""
        self._renew(self.points.search)
        self._searched[:] = self.points.position
        self._counts[0] += 1
        self._known += 1
        for travel in self._travel:
            travel[0] = 0.0

    def _renew(self, make: Callable[[], None]) -> None:
        """Make other points; each takes the elastic slip of the nearest one before."""
        points, slip = self.points, self._slip
        before = points.now.slave.copy(), points.now.shapes.copy()
        kept = None if slip is None else self._slips()
        make()
        self._set_constants_of_points()
        if len(points.room.slave) > len(self._gap):
            self._take_room()
        if self._slip is not None and kept is not None:
            carried = points.carried(*before, kept)
            self._slip[:] = 0.0
            self._slip[: points.count, :2] = np.einsum("ni,nki->nk", carried[:, :3], self._sides())
            self._slip[: points.count, 2] = carried[:, 3]
        self._cut[:] = points.position
        for travel in self._travel:
            travel[1] = 0.0

    def _sides(self) -> FloatArray:
        """Directions of slip on the master of all points, (n, 2, 3)."""
        points, now = self.points, self.points.now
        slopes = facet_functions(now.xi, 4)[1]
        corners = points.position[points.quads[now.facet]]
        return slip_sides(np.einsum("nak,nai->nki", slopes, corners))

    def _slips(self) -> FloatArray:
        """Elastic slips in world axes [mm], and whether a point touches, (n, 4)."""
        assert self._slip is not None
        slip = self._slip[: self.points.count]
        world = np.einsum("nk,nki->ni", slip[:, :2], self._sides())
        return np.concatenate([world, slip[:, 2:]], axis=1)

    def _resume(self) -> None:
        """Make the points of a checkpoint: those of the positions at its last search and cut."""
        points = self.points
        position, xi = points.position.copy(), points.room.xi.copy()
        points.position[:] = self._searched
        points.search()
        points.position[:] = self._cut
        points.cut()
        self._set_constants_of_points()
        points.position[:], points.room.xi[:] = position, xi
        self._known = int(self._counts.sum())

    @property
    def searches(self) -> int:
        """Searches so far."""
        return int(self._counts[0])

    def _gaps(self) -> FloatArray:
        """Gaps of all points, (n,) [mm]."""
        return self._gap[: self.points.count] + self._clearance

    def touched_points(self) -> float:
        """Points of the present cut, which cost more than paired ones."""
        return _COST * self.points.count

    def energy(self) -> float:
        """Energy stored at the last force evaluation [N mm]."""
        weights = self.points.now.weights
        stored = float(weights @ self._law.stored_energy(-self._gaps()))
        if self._slip is not None:
            slip = self._slip[: self.points.count, :2]
            stored += 0.5 * self._stated.stick * float(weights @ (slip**2).sum(axis=1))
        return stored

    def dissipation(self) -> float:
        """Energy dissipated by friction up to the last force evaluation [N mm]."""
        return 0.0 if self._dissipated is None else float(self._dissipated[0])

    def contact(self, moved: FloatArray) -> tuple[SearchedPoints | None, FloatArray | None]:  # noqa: ARG002 - points know where they are
        """Points at the last force evaluation, and their friction."""
        points = points_of_search(self.points, self._clearance)
        if self._slip is None:
            return points, None
        return points, -self._stated.stick * self._slips()[points.order, None, :3]

    def _deepest(self) -> tuple[int, float, int, int] | None:
        if not self.points.count:
            return None
        gaps, now, block = self._gaps(), self.points.now, self.points.facet_block
        which = self._law.stiffest(-gaps)
        m, s = block[[now.facet[which], now.slave[which]]].tolist()
        return which, float(gaps[which]), m, s

    def arrays(self) -> dict[str, LaneArray]:
        """Arrays that evolve, by name."""
        result: dict[str, LaneArray] = {
            "position": self.points.position,
            "searched": self._searched,
            "cut": self._cut,
            "closest": self.points.room.xi,
            "counts": self._counts,
            "asked": self._asked,
        }
        result |= {f"travel.{k}": travel for k, travel in enumerate(self._travel)}
        if self._slip is not None and self._dissipated is not None:
            result |= {"slip": self._slip, "dissipated": self._dissipated}
        return result


def _surface(points: FacingPoints, number: int, body: LaneBody) -> _Surface:
    """Collect the surface nodes of one body, which follow each other."""
    surfaces = points.surfaces
    members = [k for k, s in enumerate(surfaces) if s.body == number]
    if not members:
        none, empty = np.empty(0, dtype=np.int64), np.empty((0, 3))
        nothing = SurfaceNodes(empty, none, none, none, np.empty((0, 3, 3)), none)
        return _Surface(slice(0, 0), nothing, none)
    sizes = [len(surfaces[k].nodes) for k in members]
    rows = body.rows.row[np.concatenate([surfaces[k].nodes for k in members])]
    assert body.applied_row is not None
    first, last = points.node_start[members[0]], points.node_start[members[-1] + 1]
    nodes = SurfaceNodes(
        reference=np.concatenate([surfaces[k].reference for k in members]),
        rows=rows,
        applied=body.applied_row[rows].astype(np.int64),
        copies=np.repeat([surfaces[k].copy for k in members], sizes),
        turns=np.stack([surfaces[k].rotation for k in members]),
        turn_of=np.repeat(np.arange(len(members)), sizes),
    )
    return _Surface(slice(int(first), int(last)), nodes, np.unique(rows))
