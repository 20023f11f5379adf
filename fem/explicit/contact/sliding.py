"""Contact with finite sliding: surfaces that need not conform, partners found by a search.

The search (`fem.explicit.contact.search`) has a skin: it is repeated only when two blocks together
may have moved by it, so a point without a facet cannot touch in between. See
`fem.explicit.contact.sliding_kernel` for the force.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.assembly.contact_state import ContactState
from fem.contact.friction import CoulombFriction
from fem.contact.law import ContactLaw
from fem.element.facet import bilinear
from fem.explicit.body import Body
from fem.explicit.contact.paired import check_stick, largest_stiffness, shifted
from fem.explicit.contact.paired_kernel import add_travel
from fem.explicit.contact.search import (
    BlockSurface,
    SlidingPoints,
    closest_points,
    facet_area_vectors,
)
from fem.explicit.contact.sliding_kernel import apply_surface, place_surface, sliding_forces
from fem.explicit.kernels.layout import LaneArray
from fem.explicit.state import State
from fem.explicit.step import Interaction, System
from geometry.mesh import FloatArray, IntArray


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

    def __post_init__(self) -> None:
        if self.friction is not None:
            check_stick(self.friction, self.counted_stiffness)

    def touched_nodes(self, group: int) -> IntArray:
        """Mesh nodes of the group on which contact may act, (n,)."""
        mine = [s.nodes for s in self.surfaces if s.group == group]
        return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *mine]))

    def nodal_stiffness(self, group: int) -> FloatArray | None:
        """Stiffness to count on each node, as `fem.explicit.contact.paired.FaceContact` does."""
        areas = self.nodal_areas(group)
        return None if areas is None else self.counted_stiffness * areas

    def nodal_areas(self, group: int) -> FloatArray | None:
        """`nodal_stiffness` for a law of stiffness one, largest of all copies; (n_nodes,) [mm²]."""
        mine = [s for s in self.surfaces if s.group == group]
        if not mine:
            return None
        moving = min(2, sum(s.group >= 0 for s in self.surfaces))
        largest = np.zeros(self.n_nodes[group])
        for surface in mine:
            total = np.zeros(self.n_nodes[group])
            area = np.linalg.norm(facet_area_vectors(surface.reference[surface.quads]), axis=1)
            np.add.at(total, surface.nodes[surface.quads], 0.25 * area[:, None])
            largest = np.maximum(largest, total)
        return moving * largest

    @cached_property
    def at_start(self) -> ContactState:
        """Contact before any displacement."""
        return sliding_state(self, None)

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
    rotations: FloatArray
    surface_rows: IntArray


class BoundSlidingContact:
    """Arrays of one run."""

    def __init__(self, statement: SlidingContact, bodies: tuple[Body, ...]) -> None:
        self._statement = statement
        self._law = shifted(statement.law.constants, statement.clearance)
        self._allowed: float | None = None
        self.points = _points(statement)
        points = self.points
        self._force = np.zeros_like(points.position)
        self._groups = [_group(points, g, body) for g, body in enumerate(bodies)]
        n = len(points.slave)
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

    def add_force(self, system: System, state: State) -> None:
        """Add contact forces at the current positions to the applied forces."""
        points = self.points
        for group, body, now in zip(self._groups, system.bodies, state.bodies, strict=True):
            place_surface(
                group.reference,
                group.rows,
                body.lanes,
                group.copies,
                group.rotations,
                now.displacement.ravel(),
                points.position[group.where],
            )
        self._search_if_moved(system, state)
        sliding_forces(
            points.position,
            points.quads,
            points.slave,
            points.shapes,
            points.weights,
            points.facet,
            points.xi,
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
        if self._searches[0] and 2.0 * moved < self.points.skin:
            return
        self._searches += 1
        for travel in self._travel:
            travel[:] = 0.0
        self.points.search()
        if self._slip is not None:
            self._slip[self.points.facet < 0] = 0.0

    @property
    def searches(self) -> int:
        """Searches so far."""
        return int(self._searches[0])

    def _gaps(self) -> FloatArray:
        """Gaps of all points, a large number where no facet is near, (n,) [mm]."""
        return _finite(self._gap, self._statement.clearance)

    def energy(self) -> float:
        """Energy stored at the last force evaluation [N mm]."""
        weights = self.points.weights
        stored = float(weights @ self._statement.law.stored_energy(-self._gaps()))
        if self._slip is not None and self._friction is not None:
            stored += 0.5 * self._friction[1] * float(weights @ (self._slip**2).sum(axis=1))
        return stored

    def dissipation(self) -> float:
        """Energy dissipated by friction up to the last force evaluation [N mm]."""
        return 0.0 if self._dissipated is None else float(self._dissipated[0])

    def fault(self, system: System) -> str | None:
        """Where the stiffness of the law exceeds what the time step allows, and the remedy."""
        counted = self._statement.counted_stiffness
        if self._statement.law.constants.linear_stiffness <= counted or not len(self._gap):
            return None
        deepest = int(np.argmin(self._gap))
        overclosure, law = -self._gaps()[deepest], self._statement.law
        stiffness, pressure = float(law.stiffness(overclosure)), float(law.pressure(overclosure))
        if stiffness <= counted or stiffness <= self._largest_stiffness(system):
            return None
        return (
            f"contact of block {int(self.points.block[deepest])} presses with {pressure:.3g} MPa "
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
        found: dict[str, LaneArray] = {
            "facet": self.points.facet,
            "closest": self.points.xi,
            "searches": self._searches,
        }
        found |= {f"travel.{k}": travel for k, travel in enumerate(self._travel)}
        if self._slip is not None and self._dissipated is not None:
            found |= {"slip": self._slip, "dissipated": self._dissipated}
        return found


def _finite(gap: FloatArray, clearance: float) -> FloatArray:
    gaps: FloatArray = np.minimum(gap, 1e30) + clearance
    return gaps


def _points(statement: SlidingContact) -> SlidingPoints:
    law = shifted(statement.law.constants, statement.clearance)
    return SlidingPoints(
        tuple(sorted(statement.surfaces, key=lambda s: s.group)),
        reach=-law.start,
    )


def sliding_state(
    statement: SlidingContact, displacements: tuple[FloatArray, ...] | None
) -> ContactState:
    """Contact of all facets that face another block at given displacements.

    Facets are those of the finer of two surfaces, one entry for each block that a facet faces,
    with the part of its area that faces it.

    Parameters
    ----------
    statement
        Surfaces and law.
    displacements
        Of each group, world axes, (n_copies, n_nodes, 3) [mm]; None: before any displacement.
    """
    points = _points(statement)
    if displacements is not None:
        for k, surface in enumerate(points.surfaces):
            if surface.group >= 0:
                where = slice(int(points.node_start[k]), int(points.node_start[k + 1]))
                points.position[where] += displacements[surface.group][surface.copy, surface.nodes]
        points.search()
    facing = np.flatnonzero(points.facet >= 0)
    master, slave = points.facet[facing], points.slave[facing]
    position = points.place()[facing]
    _, gap, normal = closest_points(points.position[points.quads[master]][:, None], position)
    overclosure = -gap[:, 0] - statement.clearance
    key = np.column_stack([points.facet_block[master], points.facet_block[slave], slave])
    entries, which = np.unique(key, axis=0, return_inverse=True)
    which = which.ravel()
    return ContactState(
        block_m=entries[:, 0],
        block_s=entries[:, 1],
        interface=None,
        corners=_faced_parts(points, entries[:, 2], which, points.cells[facing]),
        facet=which,
        positions=position,
        normals=normal[:, 0],
        point_areas=points.weights[facing],
        point_pressures=statement.law.pressure(overclosure),
        point_overclosures=overclosure,
    )


def _faced_parts(
    points: SlidingPoints, facets: IntArray, which: IntArray, cells: FloatArray
) -> FloatArray:
    """Corners of the part of each facet on which its points lie, (n_facets, 4, 3) [mm]."""
    low, high = np.full((len(facets), 2), 1.0), np.full((len(facets), 2), -1.0)
    np.minimum.at(low, which, cells[:, 0])
    np.maximum.at(high, which, cells[:, 1])
    xi = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high], axis=1)
    xi = np.concatenate([xi, np.stack([low[:, 0], high[:, 1]], 1)[:, None]], axis=1)
    corners = points.position[points.quads[facets]]
    parts: FloatArray = np.einsum("fpa,fai->fpi", bilinear(xi)[0], corners)
    return parts


def _group(points: SlidingPoints, number: int, body: Body) -> _Group:
    """Collect the surface nodes of one group, which follow each other."""
    surfaces = points.surfaces
    mine = [k for k, s in enumerate(surfaces) if s.group == number]
    if not mine:
        none = np.empty(0, dtype=np.int64)
        return _Group(slice(0, 0), np.empty((0, 3)), none, none, none, np.empty((0, 3, 3)), none)
    nodes = np.concatenate([surfaces[k].nodes for k in mine])
    rows = body.rows.row[nodes]
    assert body.applied_row is not None
    first, last = points.node_start[mine[0]], points.node_start[mine[-1] + 1]
    return _Group(
        where=slice(int(first), int(last)),
        reference=np.concatenate([surfaces[k].reference for k in mine]),
        rows=rows,
        applied=body.applied_row[rows].astype(np.int64),
        copies=np.repeat([surfaces[k].copy for k in mine], [len(surfaces[k].nodes) for k in mine]),
        rotations=np.ascontiguousarray(body.group.rotations),
        surface_rows=np.unique(rows),
    )
