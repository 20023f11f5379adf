"""What a static or explicit solver found: displacements of groups of blocks, contact, stresses.

`fem.answer.answer_of` makes the answer of it that does not depend on the solver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.element.stress import principal_stress
from fem.static.loose import loose_blocks
from fem.static.result import StaticResult
from fem.stresses.peaks import StressPeaks, joint_forces, moved_blocks, stress_peaks
from fem.stresses.recovery import Recovered, internal_forces, recover
from fem.stresses.sections import SolvedState, section_forces
from fem.system.build import DeformableAssembly
from fem.system.reactions import PushCurve, push_curves, reactions
from fem.system.sector import local_forces
from fem.system.state import (
    CapAction,
    ContactMeasures,
    ContactState,
    cap_action,
    contact_measures,
    corner_displacements,
)
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.balance import Imbalance, imbalance, of_fixed_blocks, together
from geometry.parts.measures import JointResultants, Planes, SectionForces

if TYPE_CHECKING:
    from fem.explicit.setup.quasi_static import QuasiStaticReport
    from fem.explicit.setup.statement import ExplicitStatement
    from fem.explicit.solve import ExplicitResult

#: Blocks move far where their displacement is this share of their size: relative errors of a
#: geometry that stays as built are as large.
_FAR = 0.05

#: Of sums of time steps [-].
_ROUND_OFF = 1e-9

#: Relative force residual at which a run to the static state stops [-].
RESIDUAL = 1.0e-4


def _turns(nodes: FloatArray, displacements: FloatArray) -> FloatArray:
    """Angles by which copies of a block turn, (n_copies,) [rad]: the nearest rigid motion.

    ``nodes`` are (n, 3), displacements of each copy (n_copies, n, 3) [mm] along any axes.
    """
    arm = nodes - nodes.mean(axis=0)
    gradients = np.einsum("cni,nj->cij", displacements, np.linalg.pinv(arm).T)
    spins = 0.5 * (gradients - gradients.transpose(0, 2, 1))
    return np.asarray(np.linalg.norm(spins, axis=(1, 2)) / np.sqrt(2.0))


class SolutionError(RefusedError):
    """A quantity that the solution does not have."""


@dataclass(frozen=True)
class Solution(ReadOnlyArrays):
    """A state of deformable blocks; world axes, mm, N, MPa.

    Nodes are those of all blocks that deform, block after block (`block_of_node`); blocks share no
    nodes. Contacts are the facets on which blocks meet.
    """

    deformable: DeformableAssembly
    """The model that was solved."""
    group_displacements: tuple[FloatArray, ...]
    """Of each group of congruent blocks, (n_copies, n_nodes_of_a_block, 3) [mm]."""
    contact_state: ContactState
    """Contact point by point."""
    finite_rotation: bool
    """Whether the rigid rotation of each block is no strain."""
    solver: StaticResult | ExplicitResult
    """Result of the solver: residual, energies, steps."""
    statement: ExplicitStatement | None = None
    """Statement of an explicit run, with its times; None for a static state."""
    restarts: int = 0
    """How often an explicit run began again because contact outgrew its time step."""
    static_below: float = RESIDUAL
    """Residual below which the end of an explicit run counts as static [-]."""

    @property
    def static(self) -> StaticResult | None:
        """Result of a static solver; None for an explicit run."""
        return self.solver if isinstance(self.solver, StaticResult) else None

    @property
    def explicit(self) -> ExplicitResult | None:
        """Result of an explicit run; None for a static state."""
        return None if isinstance(self.solver, StaticResult) else self.solver

    @property
    def method(self) -> str:
        """``static`` or ``explicit``."""
        return "explicit" if self.static is None else "static"

    @property
    def residual(self) -> float | None:
        """Unbalanced over applied force [-]; None where an explicit run did not watch it."""
        return self.solver.residual

    @property
    def coarser_loading(self) -> Solution | None:
        """The state by half as many load steps; None where it was not solved."""
        coarse = None if self.static is None else self.static.coarser_loading
        if coarse is None:
            return None
        return replace(
            self,
            solver=coarse,
            group_displacements=coarse.displacements,
            contact_state=coarse.contact_state,
        )

    # ---- nodes

    @cached_property
    def displacements(self) -> FloatArray:
        """Of all nodes, (n_nodes, 3) [mm]."""
        return np.concatenate([u.reshape(-1, 3) for u in self.group_displacements])

    def displacement(self, block: int) -> FloatArray:
        """Of the nodes of a block that deforms, (n_nodes, 3) [mm]."""
        whole = self.deformable
        return self.group_displacements[int(whole.group_of[block])][int(whole.copy_of[block])]

    def principal(self, block: int) -> FloatArray:
        """Principal stresses at the nodes of a block that deforms, (n_nodes, 3) [MPa]."""
        whole = self.deformable
        of_group = self.recovered[int(whole.group_of[block])]
        return of_group.principal[int(whole.copy_of[block])]

    @cached_property
    def positions(self) -> FloatArray:
        """Of all nodes before the load acts, (n_nodes, 3) [mm]."""
        groups = self.deformable.model.groups
        return np.concatenate([g.reference_positions().reshape(-1, 3) for g in groups])

    @cached_property
    def block_of_node(self) -> IntArray:
        """Number of the block of each node, (n_nodes,)."""
        whole = self.deformable
        parts = []
        for number, group in enumerate(whole.model.groups):
            mine = whole.deformable_blocks[whole.group_of[whole.deformable_blocks] == number]
            mine = mine[np.argsort(whole.copy_of[mine])]
            parts.append(np.repeat(mine, group.n_nodes))
        return np.concatenate(parts)

    @cached_property
    def hexahedra(self) -> IntArray:
        """Corner nodes of all elements, (n_elements, 8)."""
        elements, first = [], 0
        for group in self.deformable.model.groups:
            starts = first + group.n_nodes * np.arange(group.n_copies)
            elements.append((group.mesh.elements[None] + starts[:, None, None]).reshape(-1, 8))
            first += group.n_nodes * group.n_copies
        return np.concatenate(elements)

    @cached_property
    def recovered(self) -> tuple[Recovered, ...]:
        """Stresses of each group of congruent blocks at its nodes and integration points."""
        return tuple(
            recover(group, moved, finite_rotation=self.finite_rotation)
            for group, moved in zip(
                self.deformable.model.groups, self.group_displacements, strict=True
            )
        )

    @property
    def _representative(self) -> IntArray | None:
        """Block that stands for each block, (n_blocks,), where a symmetry is known."""
        return None if self.static is None else self.static.representative

    @cached_property
    def stress_peaks(self) -> StressPeaks:
        """Extremes of the stresses inside elements."""
        return stress_peaks(
            self.deformable,
            self.group_displacements,
            finite_rotation=self.finite_rotation,
            representative=self._representative,
        )

    @cached_property
    def nodal_stress_range(self) -> tuple[float, float]:
        """Least σ₃ and largest σ₁ at the nodes [MPa]."""
        result = [
            principal_stress(self.deformable.group(int(blocks[0])).nodal_stress(moved))
            for blocks, moved in moved_blocks(
                self.deformable,
                self.group_displacements,
                finite_rotation=self.finite_rotation,
                representative=self._representative,
            )
        ]
        return min(p[..., 2].min() for p in result), max(p[..., 0].max() for p in result)

    @property
    def largest_displacement(self) -> float:
        """Largest nodal displacement [mm]."""
        return max(float(np.linalg.norm(u, axis=2).max()) for u in self.group_displacements)

    @cached_property
    def turns_as_small(self) -> bool:
        """Whether a block turns by an angle that is not small, and it is counted as if it were."""
        if self.finite_rotation:
            return False
        groups = zip(self.deformable.model.groups, self.group_displacements, strict=True)
        return any(float(_turns(g.mesh.nodes, u).max(initial=0.0)) > _FAR for g, u in groups)

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
    def contact(self) -> ContactMeasures:
        """p_max, p_eff and the other measures of the paper."""
        if not self.deformable.meets:
            raise SolutionError(
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
        whole, forces = self.deformable, self.solver.support_forces
        result = reactions(whole.model, forces, self.group_displacements)
        if whole.meets:
            rigid = np.flatnonzero(whole.group_of < 0)
            result = together(result, of_fixed_blocks(whole.assembly, self.joints, rigid))
        return result.as_json()

    @cached_property
    def imbalance(self) -> Imbalance:
        """What joints, loads, supports and inertia leave on a block, moments about deformed places.

        Internal forces of small rotations balance about the undeformed places: their moment about
        the deformed ones, of second order, is one of the terms.
        """
        whole = self.deformable
        others, loads = np.zeros((whole.assembly.n_blocks, 6)), local_forces(whole)
        acting, needed = np.zeros((whole.assembly.n_blocks, 3)), self._contact_forces(loads)
        centres = whole.assembly.centroids + whole.offsets
        for number, (group, u) in enumerate(
            zip(whole.model.groups, self.group_displacements, strict=True)
        ):
            blocks = whole.deformable_blocks[whole.group_of[whole.deformable_blocks] == number]
            force = needed[number][whole.copy_of[blocks]]
            places = (group.reference_positions() + u)[whole.copy_of[blocks]]
            moment = np.cross(places - centres[blocks][:, None], force)
            others[blocks] = -np.hstack([force.sum(axis=1), moment.sum(axis=1)])
            acting[blocks] = loads[number][whole.copy_of[blocks]].sum(axis=1)
        return imbalance(
            whole.assembly,
            self.joints,
            loads=acting,
            others=others,
            centres=centres,
            free=whole.deformable_blocks,
        )

    def _contact_forces(self, loads: list[FloatArray]) -> tuple[FloatArray, ...]:
        """What contact has to do to the nodes of each group, (n_copies, n_nodes, 3) [N].

        From the loads on them in block frames (`local_forces`).
        """
        if self.explicit is not None:
            return self.explicit.contact_forces
        model, held, result = self.deformable.model, self.solver.support_forces, []
        for number, (group, u) in enumerate(
            zip(model.groups, self.group_displacements, strict=True)
        ):
            force = internal_forces(group, u, finite_rotation=self.finite_rotation)
            force -= loads[number] @ group.rotations.transpose(0, 2, 1)
            result.append(force - held[number] if held else force)
        return tuple(result)

    @cached_property
    def push_curves(self) -> tuple[PushCurve, ...]:
        """Force against displacement of each support that moves step by step."""
        if self.explicit is not None:
            sector = self.statement is not None and self.statement.system.orbits.copies > 1
            return () if sector else self.explicit.pushed
        assert self.static is not None
        if not self.static.pushed:
            return self.static.curves
        return push_curves(self.deformable.model, self.static.pushed)

    @property
    def reached(self) -> bool:
        """Whether supports that move have arrived where they are prescribed."""
        run, stated = self.explicit, self.statement
        if run is None or stated is None:
            return self.static is None or self.static.reached
        arrival = stated.settled_after if self.deformable.moves else 0.0
        return run.time >= (1.0 - _ROUND_OFF) * arrival

    @property
    def slip(self) -> dict[str, float] | None:
        """Largest slip between facets that press and the size of its facet [mm].

        None where facets are searched. Facets that stay paired as built give no answer beyond a
        slip of one facet.
        """
        if self.deformable.contact.finite_sliding or not self.contact_state.n_facets:
            return None
        surfaces, pressing = self.deformable.surfaces, self.contact_state.pressures > 0.0
        moved = corner_displacements(self.deformable, self.group_displacements)
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
        model = self.deformable
        if self.static is not None:
            return self.static.loose_blocks
        judged = model.contact.friction is None and not model.contact.finite_sliding
        if self.quasi_static is None or not judged:
            return np.zeros(0, dtype=np.int64)
        return loose_blocks(
            model,
            self.group_displacements,
            self.contact_state.point_pressures.reshape(model.surfaces.weights.shape),
            model.surfaces,
            np.arange(model.assembly.n_blocks),
        )

    # ---- sections

    @cached_property
    def _state(self) -> SolvedState:
        whole, moved = self.deformable, self.group_displacements
        return SolvedState(whole, moved, self.contact_state, self.finite_rotation)

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
        result, stated = self.explicit, self.statement
        if result is None or stated is None or stated.recommended is None:
            return None
        # Loaded here: it brings the compiler along, which static runs do without.
        from fem.explicit.setup.quasi_static import quasi_static_report

        return quasi_static_report(
            result,
            ramp_time=stated.settled_after,
            frequency=stated.recommended.frequency,
            largest_residual=self.static_below,
        )

    @property
    def released_at_start(self) -> float | None:
        """Energy that contact holds before any load acts, over the largest work of the loads [-].

        None where it is less than that work, as it is unless the law presses hard at zero
        clearance.
        """
        if self.explicit is None:
            return None
        history = self.explicit.history
        held, work = history.column("contact_energy")[:1], np.abs(history.column("external_work"))
        return float(held[0] / work.max()) if held.size and held[0] > work.max() > 0.0 else None

    @property
    def energy_balance(self) -> float | None:
        """Error of the balance of energies [-]; None for static blocks in contact."""
        if self.explicit is not None:
            return self.explicit.energy_balance
        if self.static is None or self.deformable.meets:
            return None
        strain = self.static.strain_energy
        return abs(self.static.external_work - strain) / max(strain, 1e-300)
