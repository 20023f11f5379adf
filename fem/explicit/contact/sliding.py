"""Contact with finite sliding: surfaces that need not conform, partners found by a search.

The search (`fem.contact.search`) has a skin: it is repeated only when two blocks together may have
moved by it, so a facet without neighbour cannot touch in between. Cuts follow when they may have
moved by a hundredth of that, a thousandth of an edge: what stale cuts err by is its square. See
`fem.explicit.contact.sliding_kernel` for the force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.assembly.contact_state import ContactState, searched_state
from fem.contact.friction import CoulombFriction
from fem.contact.law import ContactLaw, LawConstants
from fem.contact.search import (
    BlockSurface,
    FacingPoints,
    SearchedSurfaces,
    facet_area_vectors,
    searched_surfaces,
)
from fem.explicit.body import Body
from fem.explicit.contact.compiled_law import compiled_law
from fem.explicit.contact.paired import check_stick, largest_stiffness
from fem.explicit.contact.sliding_kernel import (
    add_travel,
    apply_surface,
    place_surface,
    sliding_forces,
)
from fem.explicit.kernels.layout import LaneArray
from fem.explicit.state import State
from fem.explicit.step import Interaction, System
from geometry.mesh import FloatArray, IntArray

#: Motion of two blocks together after which cuts follow it, over the skin of the search.
_CUT_SKIN = 1e-2

#: Share of a facet's nodal forces by which the points of a sliver may err: a fifth fewer points.
_SLIGHT = 1e-7

#: Steps between two looks whether anything has moved at all since the last cut …
_LOOK = 1024

#: … by this share of the skin: what comes to rest is cut where it rests.
_AT_REST = 1e-6


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
    symmetry: int = 1
    """Order of the sector; 1: every block is computed."""

    def __post_init__(self) -> None:
        if self.friction is not None:
            check_stick(self.friction, self.counted_stiffness)

    def touched_nodes(self, group: int) -> IntArray:
        """Mesh nodes of the group on which contact may act, (n,)."""
        members = [s.nodes for s in self.surfaces if s.group == group]
        return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *members]))

    def nodal_stiffness(self, group: int) -> FloatArray | None:
        """Stiffness to count on each node, as `fem.explicit.contact.paired.FaceContact` does."""
        areas = self.nodal_areas(group)
        return None if areas is None else self.counted_stiffness * areas

    def nodal_areas(self, group: int) -> FloatArray | None:
        """`nodal_stiffness` for a law of stiffness one, largest of all copies; (n_nodes,) [mm²]."""
        members = [s for s in self.surfaces if s.group == group]
        if not members:
            return None
        moving = min(2, sum(s.group >= 0 for s in self.surfaces))
        largest = np.zeros(self.n_nodes[group])
        for surface in members:
            total = np.zeros(self.n_nodes[group])
            area = np.linalg.norm(facet_area_vectors(surface.reference[surface.quads]), axis=1)
            np.add.at(total, surface.nodes[surface.quads], 0.25 * area[:, None])
            largest = np.maximum(largest, total)
        return moving * largest

    @cached_property
    def at_start(self) -> ContactState:
        """What faces what before any displacement, in the sector that is computed; no pressures."""
        points = searched_surfaces(_points(self), self.clearance)
        return searched_state(points, np.zeros_like(points.corners), None)

    def bind(self, bodies: tuple[Body, ...]) -> Interaction:
        """Prepare the force for the loop."""
        return BoundSlidingContact(self, bodies)


@dataclass(frozen=True)
class _Group:
    """Surface nodes of one group."""

    where: slice
    reference: FloatArray
    rows: IntArray
    applied: IntArray
    copies: IntArray
    turns: FloatArray
    turn_of: IntArray
    surface_rows: IntArray


class BoundSlidingContact:
    """Arrays of one run."""

    def __init__(self, statement: SlidingContact, bodies: tuple[Body, ...]) -> None:
        self._statement = statement
        # Of all points, or of each, and when it was found, where pairs of blocks have others.
        self._law: ContactLaw = statement.law
        self._constants: LawConstants | FloatArray | None = None
        self._law_at = -1
        self._allowed: float | None = None
        self.points = _points(statement)
        points = self.points
        self._force = np.zeros_like(points.position)
        self._groups = [_group(points, g, body) for g, body in enumerate(bodies)]
        # Ways since the last search, and since the last cut.
        self._travel = [np.zeros((2, body.n_copies)) for body in bodies]
        # Searches and cuts so far; a checkpoint that is read changes the first, not the second.
        self._counts = np.zeros(2, dtype=np.int64)
        self._known = 0
        self._searched, self._cut = points.position.copy(), points.position.copy()
        self._friction: FloatArray | None = None
        # Of each point, and when it was found, where pairs of blocks have others.
        self._of_points: FloatArray | None = None
        self._rubs_at = -1
        self._dissipated: FloatArray | None = None
        if statement.friction is not None:
            friction = statement.friction
            self._friction = np.array([friction.coefficient, friction.stick_stiffness])
            self._dissipated = np.zeros(1)
        self._take_room()

    def _take_room(self) -> None:
        """Gaps and elastic slips of as many points as there is room for."""
        room = len(self.points.room.slave)
        self._gap = np.full(room, np.inf)
        self._slip = None if self._friction is None else np.zeros((room, 3))

    def add_force(self, system: System, state: State) -> None:
        """Add contact forces at the current positions to the applied forces."""
        points = self.points
        self._follow(state)
        for group, body, now, travel in zip(
            self._groups, system.bodies, state.bodies, self._travel, strict=True
        ):
            place_surface(
                group.reference,
                group.rows,
                body.lanes,
                group.copies,
                group.turns,
                group.turn_of,
                now.displacement.ravel(),
                points.position[group.where],
            )
            gone = np.zeros(body.n_copies)
            add_travel(group.surface_rows, now.velocity, system.time_step, gone)
            np.add(travel, gone, out=travel)
        if not self._counts[0]:
            self._search()
        n = points.count
        sliding_forces(
            points.position,
            points.quads,
            points.now.slave,
            points.now.shapes,
            points.now.weights,
            points.now.facet,
            points.now.xi,
            self._compiled_law(),
            self._rubs(),
            None if self._slip is None else self._slip[:n],
            self._dissipated,
            self._gap[:n],
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
                group.turns,
                group.turn_of,
                now.applied_force.ravel(),
            )

    def _compiled_law(self) -> LawConstants | FloatArray:
        """Constants of the law of all points, or of that of each, (n, 7)."""
        several = len(self._statement.law.members) > 1
        if self._constants is None or (several and self._law_at != self._known):
            block, now = self.points.facet_block, self.points.now
            self._law = self._statement.law.on(block[now.facet], block[now.slave])
            self._constants = compiled_law(self._law, self._statement.clearance)
            self._law_at = self._known
        return self._constants

    def _rubs(self) -> FloatArray | None:
        """Friction of all points, (2,), or of each, (n, 2), where pairs of blocks have others."""
        friction = self._statement.friction
        if friction is None or not friction.of_pairs:
            return self._friction
        if self._rubs_at != self._known or self._of_points is None:
            block, now = self.points.facet_block, self.points.now
            result = friction.on(block[now.facet], block[now.slave])
            self._of_points = np.column_stack(
                [result, np.full(len(now.facet), friction.stick_stiffness)]
            )
            self._rubs_at = self._known
        return self._of_points

    def _follow(self, state: State) -> None:
        """Search or cut at the last positions, if two blocks together have moved since by a skin.

        At the last ones: elastic slips know the way of a point from there on.
        """
        if self._counts.sum() != self._known:
            self._resume()
        if not self._known:
            return
        moved = 2.0 * np.max([travel.max(axis=1) for travel in self._travel], axis=0)
        skin = self.points.skin
        if moved[0] > skin:
            self._search()
        elif moved[1] > _CUT_SKIN * skin or (
            state.step % _LOOK == 0 and moved[1] > _AT_REST * skin
        ):
            self._renew(self.points.cut)
            self._counts[1] += 1
            self._known += 1

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
        kept = None if slip is None else slip[: points.count].copy()
        make()
        if len(points.room.slave) > len(self._gap):
            self._take_room()
        if self._slip is not None and kept is not None:
            self._slip[:] = 0.0
            self._slip[: points.count] = points.carried(*before, kept)
        self._cut[:] = points.position
        for travel in self._travel:
            travel[1] = 0.0

    def _resume(self) -> None:
        """Make the points of a checkpoint: those of the positions at its last search and cut."""
        points = self.points
        position, xi = points.position.copy(), points.room.xi.copy()
        points.position[:] = self._searched
        points.search()
        points.position[:] = self._cut
        points.cut()
        points.position[:], points.room.xi[:] = position, xi
        self._known = int(self._counts.sum())

    @property
    def searches(self) -> int:
        """Searches so far."""
        return int(self._counts[0])

    def _gaps(self) -> FloatArray:
        """Gaps of all points, (n,) [mm]."""
        return self._gap[: self.points.count] + self._statement.clearance

    def energy(self) -> float:
        """Energy stored at the last force evaluation [N mm]."""
        weights = self.points.now.weights
        stored = float(weights @ self._law.stored_energy(-self._gaps()))
        if self._slip is not None and self._friction is not None:
            slip = self._slip[: self.points.count]
            stored += 0.5 * self._friction[1] * float(weights @ (slip**2).sum(axis=1))
        return stored

    def dissipation(self) -> float:
        """Energy dissipated by friction up to the last force evaluation [N mm]."""
        return 0.0 if self._dissipated is None else float(self._dissipated[0])

    def contact(self) -> tuple[SearchedSurfaces | None, FloatArray | None]:
        """Points at the last force evaluation, and their elastic slips (n, 3) [mm], world axes."""
        surfaces = searched_surfaces(self.points, self._statement.clearance)
        return surfaces, None if self._slip is None else self._slip[surfaces.order]

    def fault(self, system: System) -> str | None:
        """Where the stiffness of the law exceeds what the time step allows, and the remedy."""
        counted = self._statement.counted_stiffness
        stiffest = max(law.constants.linear_stiffness for law in self._statement.law.members)
        if stiffest <= counted or not self.points.count:
            return None
        deepest = self._law.stiffest(-self._gaps())
        overclosure, law = -self._gaps()[deepest], self._law.one(deepest)
        stiffness, pressure = float(law.stiffness(overclosure)), float(law.pressure(overclosure))
        if stiffness <= counted or stiffness <= self._largest_stiffness(system):
            return None
        block = int(self.points.facet_block[self.points.now.slave[deepest]])
        return (
            f"contact pressure at block {block} reached {pressure:.3g} MPa "
            f"and a stiffness of {stiffness:.3g} MPa/mm; the time step {system.time_step:.4g} s "
            f"allows {self._largest_stiffness(system):.3g}; take a smaller fem.safety_factor or "
            "set contact.maximum_stiffness"
        )

    def _largest_stiffness(self, system: System) -> float:
        """Stiffness of the law that is stable at the time step [MPa/mm]."""
        if self._allowed is None:
            self._allowed = largest_stiffness(system, self._statement.nodal_areas)
        return self._allowed

    def arrays(self) -> dict[str, LaneArray]:
        """Arrays that evolve, by name."""
        result: dict[str, LaneArray] = {
            "position": self.points.position,
            "searched": self._searched,
            "cut": self._cut,
            "closest": self.points.room.xi,
            "counts": self._counts,
        }
        result |= {f"travel.{k}": travel for k, travel in enumerate(self._travel)}
        if self._slip is not None and self._dissipated is not None:
            result |= {"slip": self._slip, "dissipated": self._dissipated}
        return result


def _points(statement: SlidingContact) -> FacingPoints:
    return FacingPoints(
        tuple(sorted(statement.surfaces, key=lambda s: s.group)),
        reach=-statement.law.start - statement.clearance,
        symmetry=statement.symmetry,
        slight=_SLIGHT,
    )


def _group(points: FacingPoints, number: int, body: Body) -> _Group:
    """Collect the surface nodes of one group, which follow each other."""
    surfaces = points.surfaces
    members = [k for k, s in enumerate(surfaces) if s.group == number]
    if not members:
        none, empty = np.empty(0, dtype=np.int64), np.empty((0, 3))
        return _Group(slice(0, 0), empty, none, none, none, np.empty((0, 3, 3)), none, none)
    sizes = [len(surfaces[k].nodes) for k in members]
    nodes = np.concatenate([surfaces[k].nodes for k in members])
    rows = body.rows.row[nodes]
    assert body.applied_row is not None
    first, last = points.node_start[members[0]], points.node_start[members[-1] + 1]
    return _Group(
        where=slice(int(first), int(last)),
        reference=np.concatenate([surfaces[k].reference for k in members]),
        rows=rows,
        applied=body.applied_row[rows].astype(np.int64),
        copies=np.repeat([surfaces[k].copy for k in members], sizes),
        turns=np.stack([surfaces[k].rotation for k in members]),
        turn_of=np.repeat(np.arange(len(members)), sizes),
        surface_rows=np.unique(rows),
    )
