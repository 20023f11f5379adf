"""What an explicit run computes: a system whose loads and supports act in time, and the times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fem.contact.law import COUNTED_PRESSURE, counted_stiffness
from fem.contact.search import corner_area_vectors
from fem.system.body import Body
from fem.system.contact_state import block_surfaces
from fem.system.effects import Effects
from fem.system.loose import unresisted_motions
from fem.system.reactions import MovingSupport, moving_supports
from fem.system.system import Sector
from fem.system.time_step import CriticalTimeStep, critical_time_step
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True)
class RecommendedTimes:
    """Times of a quasi-static run."""

    frequency: float
    """Lowest frequency that the loads excite, an estimate from above [Hz]."""
    lowest_frequency: float
    """Lowest frequency of all, excited or not [Hz]."""
    ramp_time: float
    """Smooth step of the loads [s]."""
    end_time: float
    """Latest end of a run that stops when it is static [s]."""


@dataclass(frozen=True)
class Times:
    """When a run loads, has loaded and ends [s]."""

    ramp: float = 0.0
    """Duration of the smooth step of the loads."""
    settled: float = 0.0
    """When loads and supports have arrived: a static state may be found from then on."""
    end: float = math.inf
    """Latest end of the run."""
    recommended: RecommendedTimes | None = None
    """Times recommended by the lowest excited frequency; None for single bodies."""


@dataclass(frozen=True)
class TimedSystem:
    """A system, its effects in time, and the times and the start of a run.

    Raises
    ------
    ModelError
        Forces that turn with their blocks, or springs, beside effects that exclude them.
    """

    system: Sector
    """The blocks that are computed; loads and supports have their amplitudes."""
    blocks: tuple[IntArray, ...]
    """Representative blocks of each body in the order in which the loop has their copies."""
    effects: Effects
    """Damping, viscosity, rotation, gravity."""
    times: Times = field(default_factory=Times)
    """Ramp and end."""
    counted_pressure: float = COUNTED_PRESSURE
    """Pressure whose contact stiffness the critical time step counts in where no cap is
    below it [MPa]."""
    stick: float = 1.0
    """With friction, stiffness of points that stick [MPa/mm]."""
    displacements: Sequence[FloatArray] | None = None
    """Of the bodies at time 0, world axes, (n_copies, n_nodes, 3) [mm]; None: as placed."""
    velocities: Sequence[FloatArray] | None = None
    """Alike [mm/s]; None: at rest."""

    @cached_property
    def critical(self) -> CriticalTimeStep:
        """The largest stable step."""
        counted = [self.counted_stiffness * areas for areas in self.contact_areas]
        return critical_time_step(self.bodies, self.effects, counted)

    def until(
        self,
        end: float,
        displacements: Sequence[FloatArray] | None = None,
        velocities: Sequence[FloatArray] | None = None,
    ) -> TimedSystem:
        """The same from another start to another end [s]."""
        times = replace(self.times, end=end)
        return replace(self, times=times, displacements=displacements, velocities=velocities)

    @cached_property
    def moving(self) -> tuple[MovingSupport, ...]:
        """Supports that move."""
        return moving_supports(self.system.whole)

    @property
    def counted_stiffness(self) -> float:
        """Stiffness of the contact law that the critical time step counts in [MPa/mm]."""
        return counted_stiffness(self.system.whole.contact.law, self.counted_pressure)

    @cached_property
    def contact_areas(self) -> tuple[FloatArray, ...]:
        """Contact area at each node of each body, (n_nodes,) [mm²]; () where blocks do not meet.

        Of the copy that has most, times the number of sides that move. Contact springs of stiffness
        w k between points of two blocks have K_ab = w k c_a c_b n nᵀ with |c_a| = N_a and Σ N = 1
        on each side: row sums bound them by the diagonal w k N_a times that number.
        """
        if not self.system.whole.meets:
            return ()
        if self.system.whole.contact.finite_sliding:
            return _areas_of_surfaces(self.system)
        return _areas_of_facets(self.system)

    @property
    def copy_of(self) -> IntArray:
        """Copy in the loop that moves as each block does; -1 of rigid ones, (n_blocks,)."""
        copy = np.full(self.system.whole.assembly.n_blocks, -1)
        for mine in self.blocks:
            copy[mine] = np.arange(len(mine))
        return copy[self.system.orbits.representative]

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """With the copies that are computed."""
        return tuple(
            body.with_same_stiffness(rotations=body.rotations[k], translations=body.translations[k])
            for body, k in zip(self.system.whole.bodies, self._copies, strict=True)
        )

    @property
    def _copies(self) -> list[IntArray]:
        """Copies of each body that are computed, in the order in which the loop has them."""
        return [self.system.whole.copy_of[blocks] for blocks in self.blocks]

    def starts(self, number: int) -> IntArray:
        """First node of a body's copies in the loop, -1 of all other blocks, (n_blocks,)."""
        starts, blocks = np.full(self.system.whole.assembly.n_blocks, -1), self.blocks[number]
        starts[blocks] = self.bodies[number].n_nodes * np.arange(len(blocks))
        return starts

    @property
    def n_elements(self) -> int:
        """Hexahedra that are computed."""
        return sum(body.mesh.n_elements * body.n_copies for body in self.bodies)

    def expand(self, vectors: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        """Displacements or forces of every block from those of the representatives.

        Parameters
        ----------
        vectors
            Of the bodies, world axes, (n_copies, n_nodes, 3).

        Returns
        -------
        tuple[FloatArray, ...]
            Of the bodies of the whole, all copies; of a periodic cell without its motion as
            a whole, as `fem.static.solve` gives them.
        """
        return tuple(self.system.expand(self.of_system(vectors)))

    def of_system(self, vectors: tuple[FloatArray, ...]) -> FloatArray:
        """The same of the nodes of the system, block frames, (n_nodes, 3)."""
        moved, free = self.in_system(vectors), unresisted_motions(self.system)
        return moved if free is None else free.without(moved)

    def in_system(self, vectors: tuple[FloatArray, ...]) -> FloatArray:
        """Vectors of the nodes of the system, its motion as a whole included, (n_nodes, 3)."""
        result = np.empty((self.system.n_nodes, 3))
        turns = self.system.whole.assembly.rotations
        for blocks, moved in zip(self.blocks, vectors, strict=True):
            for block, world in zip(blocks.tolist(), moved, strict=True):
                slot = int(self.system.slot_of[block])
                result[self.system.nodes_of(slot)] = world @ turns[block]
        return result


def _areas_of_facets(system: Sector) -> tuple[FloatArray, ...]:
    """`TimedSystem.contact_areas` of matched facets."""
    points = system.points
    sides = np.stack([points.block_m, points.block_s])
    moving = (system.slot_of[sides] >= 0).sum(axis=0)
    each = np.einsum("f,fp,fpa->fa", moving, points.weights, np.abs(points.functions))
    total: FloatArray = np.bincount(points.rows.ravel(), each.ravel(), system.n_nodes + 1)
    areas = tuple(np.zeros(body.n_nodes) for body in system.whole.bodies)
    for block in system.whole.deformable_blocks.tolist():
        largest = areas[system.whole.body_number[block]]
        np.maximum(largest, total[system.rows[block, : len(largest)]], out=largest)
    return areas


def _areas_of_surfaces(system: Sector) -> tuple[FloatArray, ...]:
    """The same of surfaces that a search goes through."""
    surfaces = block_surfaces(system)
    moving = min(2, sum(s.body >= 0 for s in surfaces))
    largest = tuple(np.zeros(body.n_nodes) for body in system.whole.bodies)
    for surface in surfaces:
        if surface.body >= 0:
            area = np.linalg.norm(corner_area_vectors(surface.reference[surface.quads]), axis=1)
            corners = np.broadcast_to(0.25 * moving * area[:, None], surface.quads.shape)
            at, most = surface.nodes[surface.quads].ravel(), largest[surface.body]
            np.maximum(most, np.bincount(at, corners.ravel(), len(most)), out=most)
    return largest
