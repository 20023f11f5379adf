"""The state of deformable blocks at one point of a path, as a static or explicit solver leaves it.

`fem.answer.answer.answer_of` makes the answer of it that does not depend on the solver.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.contact.search import SearchedPoints
from fem.contact.surfaces import ContactPoints
from fem.element.stress import principal_stress
from fem.stresses.peaks import StressPeaks, joint_forces, moved_blocks, stress_peaks
from fem.stresses.recovery import Recovered, recover
from fem.stresses.sections import SolvedState, section_forces
from fem.system.contact_state import (
    CapAction,
    ContactMeasures,
    ContactState,
    cap_action,
    contact_measures,
    contact_state,
    corner_displacements,
)
from fem.system.loose import loose_blocks
from fem.system.reactions import PushCurve, push_curves, reactions
from fem.system.sector import searched_in_all_sectors, vectors_in_all_sectors
from fem.system.system import System
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.balance import Imbalance, imbalance, of_fixed_blocks, together
from geometry.parts.measures import JointResultants, Planes, SectionForces

if TYPE_CHECKING:
    from fem.explicit.setup.quasi_static import QuasiStaticReport
    from fem.explicit.solve import Run

#: Blocks move far where their displacement is this share of their size: relative errors of a
#: geometry that stays as built are as large.
_FAR = 0.05

#: Of sums of time steps [-].
_ROUND_OFF = 1e-9


def _turns(nodes: FloatArray, displacements: FloatArray) -> FloatArray:
    """Angles by which copies of a block turn, (n_copies,) [rad]: the nearest rigid motion.

    ``nodes`` are (n, 3), displacements of each copy (n_copies, n, 3) [mm] along any axes.
    """
    arm = nodes - nodes.mean(axis=0)
    gradients = np.einsum("cni,nj->cij", displacements, np.linalg.pinv(arm).T)
    spins = 0.5 * (gradients - gradients.transpose(0, 2, 1))
    return np.asarray(np.linalg.norm(spins, axis=(1, 2)) / np.sqrt(2.0))


class NoContactError(RefusedError):
    """Contact of single bodies, which have none."""


@dataclass
class Evidence(ReadOnlyArrays):
    """How a static state was found."""

    residuals: tuple[float, ...] = ()
    """Norm of the unbalanced forces over norm of the loads after each iteration [-]."""
    converged: bool = False
    """Whether the residual reached the tolerance."""
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

    Arrays are those of the blocks that are computed, each in its own axes; what is derived from
    them is of all blocks in world axes, copies of a sector included. Blocks share no nodes.
    """

    system: System
    """What was solved, on the points of contact of this state."""
    displacement: FloatArray
    """(n_nodes, 3) [mm]"""
    friction: FloatArray | None = None
    """On block s at the points of the system, world axes, (n_facets, n_points, 3) [MPa]; None
    without friction."""
    anchor: FloatArray | None = None
    """Slips without traction at these points, (n_facets, n_points, 0 or 2) [mm]: friction of the
    next point of the path begins there. None of an explicit run."""
    support_force: FloatArray | None = None
    """Of the supports on the nodes, (n_nodes, 3) [N]; None where nothing is held."""
    contact_force: FloatArray | None = None
    """What contact has to do to the nodes of an explicit run, (n_nodes, 3) [N]: inertia, damping
    and internal forces, less loads, weight and supports. None: internal forces less the others."""
    load_factor: float = 1.0
    """Share of the path of the loads."""
    time: float | None = None
    """Of an explicit run or of supports that move [s]; None: these went all their way."""
    frictional_dissipation: float = 0.0
    """Work lost in sliding, zero without friction, of a static state [N mm]. What slides in a load
    step does so at the limit, which counts with the mean of the pressures at its ends: with few
    load steps too much, by about a tenth with four."""
    evidence: Evidence = field(default_factory=Evidence)
    """How a static state was found."""
    run: Run | None = None
    """The explicit run that ended here; None for a static state."""

    @cached_property
    def deformable(self) -> System:
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

    @property
    def converged(self) -> bool:
        """Whether a static state is an equilibrium."""
        return self.evidence.converged

    @property
    def representative(self) -> IntArray:
        """Block that stands for each block, (n_blocks,)."""
        return self.system.orbits.representative

    # ---- nodes

    @cached_property
    def displacements(self) -> tuple[FloatArray, ...]:
        """Of each group of congruent blocks, (n_copies, n_nodes_of_a_block, 3) [mm]."""
        return tuple(self.system.expand(self.displacement))

    @cached_property
    def support_forces(self) -> tuple[FloatArray, ...]:
        """Of the supports on the nodes of each group, alike [N]; () where nothing is held."""
        return () if self.support_force is None else tuple(self.system.expand(self.support_force))

    @cached_property
    def nodal_displacements(self) -> FloatArray:
        """Of all nodes, body after body (`System.block_of_node`), (n_nodes, 3) [mm]."""
        return np.concatenate([u.reshape(-1, 3) for u in self.displacements])

    def displacement_of(self, block: int) -> FloatArray:
        """Of the nodes of a block that deforms, (n_nodes, 3) [mm]."""
        whole = self.deformable
        return self.displacements[int(whole.group_of[block])][int(whole.copy_of[block])]

    def principal(self, block: int) -> FloatArray:
        """Principal stresses at the nodes of a block that deforms, (n_nodes, 3) [MPa]."""
        whole = self.deformable
        of_group = self.recovered[int(whole.group_of[block])]
        return of_group.principal[int(whole.copy_of[block])]

    @cached_property
    def positions(self) -> FloatArray:
        """Of all nodes before the load acts, (n_nodes, 3) [mm]."""
        groups = self.deformable.bodies
        return np.concatenate([g.reference_positions().reshape(-1, 3) for g in groups])

    @cached_property
    def hexahedra(self) -> IntArray:
        """Corner nodes of all elements, (n_elements, 8)."""
        elements, first = [], 0
        for group in self.deformable.bodies:
            starts = first + group.n_nodes * np.arange(group.n_copies)
            elements.append((group.mesh.elements[None] + starts[:, None, None]).reshape(-1, 8))
            first += group.n_nodes * group.n_copies
        return np.concatenate(elements)

    @cached_property
    def recovered(self) -> tuple[Recovered, ...]:
        """Stresses of each group of congruent blocks at its nodes and integration points."""
        return tuple(
            recover(group, moved, finite_rotation=self.finite_rotation)
            for group, moved in zip(self.deformable.bodies, self.displacements, strict=True)
        )

    @property
    def _judged(self) -> IntArray | None:
        """Block that stands for each block where stresses are searched; None: all are."""
        return self.representative if self.run is None else None

    @cached_property
    def stress_peaks(self) -> StressPeaks:
        """Extremes of the stresses inside elements."""
        return stress_peaks(
            self.deformable,
            self.displacements,
            finite_rotation=self.finite_rotation,
            representative=self._judged,
        )

    @cached_property
    def nodal_stress_range(self) -> tuple[float, float]:
        """Least σ₃ and largest σ₁ at the nodes [MPa]."""
        result = [
            principal_stress(self.deformable.body_of(int(blocks[0])).nodal_stress(moved))
            for blocks, moved in moved_blocks(
                self.deformable,
                self.displacements,
                finite_rotation=self.finite_rotation,
                representative=self._judged,
            )
        ]
        return min(p[..., 2].min() for p in result), max(p[..., 0].max() for p in result)

    @property
    def largest_displacement(self) -> float:
        """Largest nodal displacement [mm]."""
        return max(float(np.linalg.norm(u, axis=2).max()) for u in self.displacements)

    @cached_property
    def largest_turn(self) -> float:
        """Largest angle by which a block turns [rad]."""
        groups = zip(self.deformable.bodies, self.displacements, strict=True)
        return max(float(_turns(g.mesh.nodes, u).max(initial=0.0)) for g, u in groups)

    @property
    def turns_as_small(self) -> bool:
        """Whether a block turns by an angle that is not small, and it is counted as if it were."""
        return not self.finite_rotation and self.largest_turn > _FAR

    @property
    def large_motion(self) -> float | None:
        """Largest displacement over the size of blocks that meet [-]; None where it is small.

        None as well where it is counted as it is: with finite sliding, and with finite rotation or
        of blocks that hardly turn.
        """
        whole = self.deformable
        if not whole.meets or (whole.contact.finite_sliding and not self.turns_as_small):
            return None
        share = self.largest_displacement / whole.assembly.characteristic_length
        return share if share > _FAR else None

    # ---- contact

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
        return self._searched or self.deformable.surfaces

    @cached_property
    def overclosures(self) -> FloatArray:
        """Of all points, (n_facets, n_points), or (n_points, 1) of a search [mm]."""
        if self._searched is not None:
            return self._searched.overclosures(self._searched.moved(self.displacement))
        computed = self.system.points.gaps(self.displacement).overclosure
        return computed.ravel()[self.system.orbits.point_of]

    @cached_property
    def pressures(self) -> FloatArray:
        """Of all points, alike [MPa]."""
        law = self.deformable.contact.law.on(self.points.block_m, self.points.block_s)
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
        return contact_state(self.deformable, self.displacements, *at_points)

    @cached_property
    def contact(self) -> ContactMeasures:
        """p_max, p_eff and the other measures of the paper."""
        if not self.deformable.meets:
            raise NoContactError(
                "contact: got single bodies, which have no contact; expected blocks that meet"
            )
        return contact_measures(self.deformable.assembly, self.contact_state)

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the contact forces between each two blocks, friction included."""
        return joint_forces(self.contact_state)

    @cached_property
    def cap(self) -> CapAction | None:
        """Where the maximum stiffness of the contact law acted; None for a law without one."""
        state = self.contact_state
        law = self.deformable.contact.law
        return cap_action(law, state.point_pressures, state.point_areas)

    @cached_property
    def reactions(self) -> dict[str, dict[str, Any]]:
        """Resultants of supports and rigid blocks by name: `geometry.parts.balance.Reactions`."""
        whole = self.deformable
        result = reactions(whole, self.support_forces, self.displacements)
        if whole.meets:
            rigid, loads = np.flatnonzero(whole.group_of < 0), whole.on_ground
            others = None if loads is None else self.load_factor * loads
            result = together(result, of_fixed_blocks(whole.assembly, self.joints, rigid, others))
        return result.as_json()

    @cached_property
    def imbalance(self) -> Imbalance:
        """What joints, loads, supports and inertia leave on a block, moments about deformed places.

        Internal forces of small rotations balance about the undeformed places: their moment about
        the deformed ones, of second order, is one of the terms.
        """
        whole = self.deformable
        others, loads = np.zeros((whole.assembly.n_blocks, 6)), whole.forces_in_frames()
        acting, needed = np.zeros(whole.assembly.n_blocks), self._contact_forces(loads)
        centres = whole.assembly.centroids + whole.offsets
        for number, (group, u) in enumerate(zip(whole.bodies, self.displacements, strict=True)):
            blocks = whole.deformable_blocks[whole.group_of[whole.deformable_blocks] == number]
            force = needed[number][whole.copy_of[blocks]]
            places = (group.reference_positions() + u)[whole.copy_of[blocks]]
            moment = np.cross(places - centres[blocks][:, None], force)
            others[blocks] = -np.hstack([force.sum(axis=1), moment.sum(axis=1)])
            sizes = np.linalg.norm(loads[number][whole.copy_of[blocks]], axis=2)
            acting[blocks] = sizes.sum(axis=1)
        return imbalance(
            whole.assembly,
            self.joints,
            acting=acting,
            others=others,
            centres=centres,
            free=whole.deformable_blocks,
        )

    @cached_property
    def _internal_forces(self) -> tuple[FloatArray, ...]:
        """K u of the nodes of each group, for balance and energy, (n_copies, n_nodes, 3) [N]."""
        groups = zip(self.deformable.bodies, self.displacements, strict=True)
        return tuple(
            g.internal_force(u @ g.rotations) @ g.rotations.transpose(0, 2, 1) for g, u in groups
        )

    def _contact_forces(self, loads: list[FloatArray]) -> tuple[FloatArray, ...]:
        """What contact has to do to the nodes of each group, (n_copies, n_nodes, 3) [N].

        From the loads on them in block frames (`System.forces_in_frames`).
        """
        if self.contact_force is not None:
            return tuple(self.system.expand(self.contact_force))
        held, result = self.support_forces, list[FloatArray]()
        for number, group in enumerate(self.deformable.bodies):
            load = loads[number] @ group.rotations.transpose(0, 2, 1)
            force = self._internal_forces[number] - load
            result.append(force - held[number] if held else force)
        return tuple(result)

    @cached_property
    def push_curves(self) -> tuple[PushCurve, ...]:
        """Force against displacement of each support that moves step by step."""
        if self.run is not None:
            return self.run.pushed
        path = (*self.evidence.path, self)
        steps = {s.time: s.support_forces for s in path if s.time is not None}
        if not steps or self.evidence.curves:
            return self.evidence.curves
        return push_curves(self.deformable, tuple(steps.items()))

    @property
    def reached(self) -> bool:
        """Whether supports that move have arrived where they are prescribed."""
        if self.run is None:
            return self.evidence.stopped is None
        arrival = self.run.stated.settled_after if self.deformable.moves else 0.0
        return self.run.time >= (1.0 - _ROUND_OFF) * arrival

    @property
    def slip(self) -> dict[str, float] | None:
        """Largest slip between facets that press and the size of its facet [mm].

        None where facets are searched. Facets that stay paired as built give no answer beyond a
        slip of one facet.
        """
        if self.deformable.contact.finite_sliding or not self.contact_state.n_facets:
            return None
        surfaces, pressing = self.deformable.surfaces, self.contact_state.pressures > 0.0
        moved = corner_displacements(self.deformable, self.displacements)
        on_m, on_s = np.split(moved, 2, axis=1)
        jump: FloatArray = on_s - on_m
        normal = surfaces.normals.mean(axis=1)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        along = np.einsum("fai,fi->fa", jump, normal)
        slip = np.linalg.norm(jump - along[:, :, None] * normal[:, None], axis=2).max(axis=1)
        size = np.sqrt(surfaces.areas)
        worst = int(np.argmax(np.where(pressing, slip / size, 0.0)))
        largest = float(slip[worst]) if pressing.any() else 0.0
        return {"largest": largest, "facet_size": float(size[worst])}

    @cached_property
    def loose_blocks(self) -> IntArray:
        """Blocks that no pressing contact holds in every direction, (n,).

        Pressures are determined, the places of these blocks are not. Not judged: friction, and
        explicit runs with searched facets or to another end than the static state.
        """
        contact = self.deformable.contact
        if self.run is None:
            return self.evidence.loose_blocks
        if self.quasi_static is None or contact.friction is not None or contact.finite_sliding:
            return np.zeros(0, dtype=np.int64)
        everyone = np.arange(self.deformable.assembly.n_blocks)
        where = self.deformable, self.displacements
        return loose_blocks(*where, self.pressures, self.points, everyone)

    # ---- sections

    @cached_property
    def _state(self) -> SolvedState:
        where = self.deformable, self.displacements
        return SolvedState(*where, self.contact_state, self.finite_rotation)

    def sections(self, cut: Planes) -> SectionForces:
        """Sum what elements and contacts transmit through planes.

        Of an explicit run those of its end; what viscosity and damping do is not counted.

        Raises
        ------
        SectionError
            As `fem.stresses.sections.section_forces`.
        """
        return section_forces(self._state, cut)

    # ---- the end of a run

    @cached_property
    def quasi_static(self) -> QuasiStaticReport | None:
        """How static the end of an explicit run is; None where nothing recommends a frequency."""
        if self.run is None:
            return None
        # Loaded here: it brings the compiler along, which static runs do without.
        from fem.explicit.setup.quasi_static import quasi_static_report

        return quasi_static_report(self.run)

    @property
    def released_at_start(self) -> float | None:
        """Energy that contact holds before any load acts, over the largest work of the loads [-].

        None where it is less than that work, as it is unless the law presses hard at zero
        clearance.
        """
        if self.run is None:
            return None
        history = self.run.history
        held, work = history.column("contact_energy")[:1], np.abs(history.column("external_work"))
        return float(held[0] / work.max()) if held.size and held[0] > work.max() > 0.0 else None

    # ---- energies of a static state

    @cached_property
    def strain_energy(self) -> float:
        """Of all blocks [N mm]."""
        forces = zip(self.displacements, self._internal_forces, strict=True)
        return 0.5 * sum(float((u * force).sum()) for u, force in forces)

    @cached_property
    def contact_energy(self) -> float:
        """What contact laws hold [N mm]."""
        points = self.points
        law = self.deformable.contact.law.on(points.block_m, points.block_s)
        stored = float((points.weights * law.stored_energy(self.overclosures)).sum())
        if self.frictions is None:
            return stored
        square = (self.frictions**2).sum(axis=-1)
        return stored + float((points.weights * square).sum()) / (2.0 * self.deformable.stick())

    @property
    def external_work(self) -> float:
        """Of loads, weight and supports on the way to the state [N mm].

        Of blocks in contact what they store and friction dissipates, less what contact holds before
        anything acts; of single bodies half of the loads along the displacements.
        """
        if not self.deformable.meets:
            return 0.5 * self.load_work
        return (
            self.strain_energy + self.contact_energy + self.frictional_dissipation - self._at_rest
        )

    @property
    def _at_rest(self) -> float:
        """Contact energy before any load acts [N mm]; 0 with interference, which takes work."""
        if self.deformable.surfaces.clearance < 0.0:
            return 0.0
        start = np.zeros_like(self.displacement)
        return replace(self, displacement=start, friction=None, anchor=None).contact_energy

    @property
    def work_of_motion(self) -> float | None:
        """Of the one support that moves, by the balance of energies [N mm].

        What the state stores and dissipates more than the state before the motion, less the work of
        the loads, which are constant then. None of explicit runs, of several supports that move,
        and of problems after another.
        """
        if self.run is not None or self.evidence.curves or len(self.push_curves) != 1:
            return None
        before = [one for one in self.evidence.path if not one.time]
        if not before and self.load_work:
            return None
        work = self.external_work - self.load_work
        return work - (before[-1].external_work - before[-1].load_work if before else 0.0)

    @property
    def load_work(self) -> float:
        """Full loads times displacements [N mm]."""
        system = self.system
        slots = system.slot_of[self.deformable.deformable_blocks]
        copies = np.repeat(np.bincount(slots, minlength=system.n_slots), np.diff(system.node_start))
        work = copies @ (self.displacement * system.external_force).sum(axis=1)
        return float(work)

    @property
    def energy_balance(self) -> float | None:
        """Error of the balance of energies [-]; None for static blocks in contact."""
        if self.run is not None:
            return self.run.energy_balance
        if self.deformable.meets:
            return None
        strain = self.strain_energy
        return abs(self.external_work - strain) / max(strain, 1e-300)
