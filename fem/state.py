"""The state of deformable blocks at one point of a path, as a static or explicit solver leaves it.

A state is arrays. What they mean is computed by functions of it: stresses and sections in
`fem.stresses`, all else in `fem.answer`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from fem.contact.search import SearchedPoints
from fem.contact.surfaces import ContactPoints
from fem.system.contact_state import ContactState, contact_state
from fem.system.reactions import PushCurve
from fem.system.sector import searched_in_all_sectors, vectors_in_all_sectors
from fem.system.system import Sector, System
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays, lengths, read_only

if TYPE_CHECKING:
    from fem.explicit.run import Run

_T = TypeVar("_T")


@dataclass
class Evidence(ReadOnlyArrays):
    """How a static state was found."""

    residuals: tuple[float, ...] = ()
    """Norm of the unbalanced forces over norm of the loads after each iteration [-]."""
    converged: bool = False
    """Whether the residual reached the tolerance."""
    frictional_dissipation: float = 0.0
    """Work lost in sliding on the way, zero without friction [N mm]. What slides in a load step
    does so at the limit, which counts with the mean of the pressures at its ends: with few load
    steps too much, by about a tenth with four."""
    stopped: float | None = None
    """Time of the first step of a motion without an equilibrium [s]; None: all have one."""
    status: str = ""
    """What happened, and what to do if it did not converge."""
    loose_blocks: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Blocks that could move while all contacts keep pressing: their place is not determined."""
    load_steps: int = 1
    """Parts in which the load was to be applied."""
    cpu_seconds: Mapping[str, float] = field(default_factory=dict)
    """CPU time: setup, newton, total [s]."""
    path: tuple[State, ...] = ()
    """States at the points of the path before this one."""
    coarser: State | None = None
    """State by half as many load steps, where friction made the way to the load count and both
    were compared."""
    curves: tuple[PushCurve, ...] = ()
    """Forces of supports that move in the last stage of several (`fem.static.solve`)."""

    @property
    def residual(self) -> float:
        """The last one [-]."""
        return self.residuals[-1]


@dataclass(frozen=True)
class State(ReadOnlyArrays):
    """State of an assembly at one point of a path; mm, N, MPa.

    Fields are of the blocks that are computed, each in its own axes; arrays of all blocks, copies
    of a sector included, are in world axes. Blocks share no nodes.
    """

    system: Sector
    """What was solved, on the points of contact of this state."""
    displacement: FloatArray
    """(n_nodes, 3) [mm]"""
    velocity: FloatArray | None = None
    """Of an explicit run half a step before its end, (n_nodes, 3) [mm/s]."""
    friction: FloatArray | None = None
    """On block s at the points of the system, world axes, (n_facets, n_points, 3) [MPa]; None
    without friction."""
    support_force: FloatArray | None = None
    """Of the supports on the nodes, (n_nodes, 3) [N]; None where nothing is held."""
    contact_force: FloatArray | None = None
    """What contact has to do to the nodes of an explicit run, (n_nodes, 3) [N]: inertia, damping
    and internal forces, less loads, weight and supports. None: internal forces less the others."""
    load_factor: float = 1.0
    """Share of the path of the loads."""
    time: float | None = None
    """Of an explicit run or of supports that move [s]; None: these went all their way."""
    evidence: Evidence = field(default_factory=Evidence)
    """How a static state was found."""
    run: Run | None = None
    """The explicit run that ended here; None for a static state."""

    @property
    def whole(self) -> System:
        """Blocks, loads, supports and contact of the whole."""
        return self.system.whole

    @property
    def finite_rotation(self) -> bool:
        """Whether the rigid rotation of each block is no strain: of explicit runs that state it."""
        return self.run is not None and self.run.stated.effects.finite_rotation

    @property
    def method(self) -> str:
        """``static`` or ``explicit``."""
        return "static" if self.run is None else "explicit"

    @property
    def residual(self) -> float | None:
        """Unbalanced over applied force [-]; None where an explicit run did not watch it."""
        return self.evidence.residual if self.run is None else self.run.residual

    # ---- arrays of all blocks

    @cached_property
    def displacements(self) -> tuple[FloatArray, ...]:
        """Of each body, (n_copies, n_nodes_of_a_block, 3) [mm]."""
        return tuple(self.system.expand(self.displacement))

    def displacement_of(self, block: int) -> FloatArray:
        """Of the nodes of a block that deforms, (n_nodes, 3) [mm]."""
        whole = self.whole
        return self.displacements[int(whole.body_number[block])][int(whole.copy_of[block])]

    @property
    def largest_displacement(self) -> float:
        """Of all nodes [mm]."""
        return max(float(lengths(u).max()) for u in self.displacements)

    @cached_property
    def support_forces(self) -> tuple[FloatArray, ...]:
        """Of the supports on the nodes of each body, alike [N]; () where nothing is held."""
        return () if self.support_force is None else tuple(self.system.expand(self.support_force))

    @cached_property
    def _searched(self) -> SearchedPoints | None:
        """All points of a search; None: facets are matched."""
        points = self.system.points
        if not isinstance(points, SearchedPoints):
            return None
        return searched_in_all_sectors(self.system, points)

    @property
    def points(self) -> ContactPoints:
        """Points of contact of all blocks."""
        return self._searched or self.whole.surfaces

    @cached_property
    def overclosures(self) -> FloatArray:
        """Of all points, (n_facets, n_points), or (n_points, 1) of a search [mm]."""
        if self._searched is not None:
            return self._searched.overclosures(self._searched.moved(self.displacement))
        points = self.system.points
        computed = points.overclosures(points.moved(self.displacement))
        return computed.ravel()[self.system.orbits.point_of]

    @cached_property
    def pressures(self) -> FloatArray:
        """Of all points, alike [MPa]."""
        law = self.whole.contact.law.on(self.points.block_m, self.points.block_s)
        return law.pressure(self.overclosures)

    @cached_property
    def frictions(self) -> FloatArray | None:
        """On block s at all points, world axes, (n_facets, n_points, 3) [MPa]; None without."""
        if self.friction is None:
            return None
        return vectors_in_all_sectors(self.system, self.friction, self._searched)

    @cached_property
    def contact_state(self) -> ContactState:
        """Contact facet by facet."""
        # A run solves in the axes of contact: those of the blocks would round differently.
        solved = self.overclosures if self.run is None else None
        at_points = self.points, self.frictions, solved
        return contact_state(self.whole, self.displacements, *at_points)


def once(function: Callable[[State], _T]) -> Callable[[State], _T]:
    """Function of a state whose value is computed when it is first asked for, and kept with it."""
    name = f"{function.__module__}.{function.__qualname__}"

    @wraps(function)
    def kept(state: State) -> _T:
        found = vars(state)
        if name not in found:
            found[name] = read_only(function(state))
        value: _T = found[name]
        return value

    return kept
