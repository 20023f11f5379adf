"""The explicit model of an assembly: representative blocks, ramped loads, contact."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from fem.assembly.contact_state import (
    ContactState,
    block_surfaces,
    corner_displacements,
    facing_points,
    matched_pressures,
    matched_state,
    searched_state,
)
from fem.assembly.deformable import ALL_THE_WAY, DeformableAssembly
from fem.assembly.local_system import FreeMotions, LocalSystem, free_motions, local_system
from fem.assembly.symmetry import (
    Orbits,
    no_symmetry,
    searched_in_all_sectors,
    vectors_in_all_sectors,
)
from fem.contact.law import ContactLaw
from fem.contact.search import SearchedSurfaces, searched_surfaces
from fem.contact.surfaces import ContactError, ContactNormals
from fem.explicit.body import Body
from fem.explicit.contact.alike_pairs import alike_pairs
from fem.explicit.contact.paired import FaceContact, paired_frictions
from fem.explicit.contact.sliding import SlidingContact
from fem.explicit.kernels.layout import LaneArray, to_lanes
from fem.explicit.state import State
from fem.explicit.step import Interaction, System, placed_internal_force
from fem.problem.effects import EffectError, Effects
from fem.problem.model import (
    Amplitude,
    BlockGroup,
    InteractionModel,
    Model,
    NodalLoad,
    Support,
)
from geometry.mesh import FloatArray, IntArray

_Entries = TypeVar("_Entries", Support, NodalLoad)


@dataclass(frozen=True)
class CellHold:
    """Motions of a periodic cell as a whole, and the forces that prevent them.

    Nothing resists a shift of the cell or a turn about its axis, and forces of second order in the
    displacements push along them for ever (`fem.assembly.local_system`). Here the same constraint
    as in the static solver is one more term of the step: forces at the nodes of the contacts, the
    motions themselves, so large that loads, contact and internal forces leave the cell as a whole
    at rest.
    """

    motions: tuple[FloatArray, ...]
    """Of each group in block frames, (n_motions, n_copies, n_nodes, 3)."""
    forces: tuple[FloatArray, ...]
    """The same motions, zero where no contact acts."""

    def touched_nodes(self, group: int) -> IntArray:
        """Mesh nodes of the group on which the forces act, (n,)."""
        return np.flatnonzero(self.forces[group].any(axis=(0, 1, 3)))

    def nodal_stiffness(self, group: int) -> FloatArray | None:  # noqa: ARG002 - as of all
        """No stiffness: a constraint only removes motions."""
        return None

    def bind(self, bodies: tuple[Body, ...]) -> Interaction:
        """Prepare the force for the loop."""
        return _BoundHold(self, bodies)


class _BoundHold:
    """Arrays of one run, in lanes."""

    def __init__(self, statement: CellHold, bodies: tuple[Body, ...]) -> None:
        self._all = [_lanes(m, body) for m, body in zip(statement.motions, bodies, strict=True)]
        forces = [_lanes(f, body) for f, body in zip(statement.forces, bodies, strict=True)]
        work = sum(np.einsum("knil,mnil->km", m, f) for m, f in zip(self._all, forces, strict=True))
        self._inverse = np.linalg.inv(work)
        # Rows of the applied force are numbered in the order of the body's rows.
        touched = [np.flatnonzero(_applied_row(body) >= 0) for body in bodies]
        n = len(work)
        applied = [m[:, rows] for m, rows in zip(self._all, touched, strict=True)]
        self._applied = [m.reshape(n, -1) for m in applied]
        self._forces = [f[:, rows].reshape(n, -1) for f, rows in zip(forces, touched, strict=True)]
        self._all = [m.reshape(n, -1) for m in self._all]

    def add_force(self, system: System, state: State) -> None:
        """Take from the applied forces what moves the cell as a whole."""
        share = np.zeros(len(self._inverse))
        for k, now in enumerate(state.bodies):
            assert now.applied_force is not None
            share += self._applied[k] @ now.applied_force.ravel()
            # Without block frames K u balances about the reference positions to round-off.
            if now.frame is not None:
                share -= self._all[k] @ placed_internal_force(system.bodies[k], now).ravel()
        size = self._inverse @ share
        for forces, now in zip(self._forces, state.bodies, strict=True):
            assert now.applied_force is not None
            now.applied_force -= (size @ forces).reshape(now.applied_force.shape)

    def energy(self) -> float:
        """Nothing is stored."""
        return 0.0

    def dissipation(self) -> float:
        """Nothing is lost."""
        return 0.0

    def contact(self) -> tuple[SearchedSurfaces | None, FloatArray | None]:
        """No contact."""
        return None, None

    def fault(self, system: System) -> str | None:  # noqa: ARG002 - as of all
        """Never makes a run unstable."""
        return None

    def arrays(self) -> dict[str, LaneArray]:
        """Nothing evolves."""
        return {}


def _lanes(motions: FloatArray, body: Body) -> FloatArray:
    lanes = [to_lanes(motion, body.rows.order, body.dtype) for motion in motions]
    return np.stack(lanes).astype(np.float64)


def _applied_row(body: Body) -> IntArray:
    assert body.applied_row is not None
    return body.applied_row.astype(np.int64)


def cell_hold(
    deformable: DeformableAssembly, orbits: Orbits, blocks: list[IntArray]
) -> CellHold | None:
    """Hold of a periodic cell; None for what its supports hold.

    Parameters
    ----------
    deformable, orbits
        The cell and its symmetry.
    blocks
        Representatives of each group in the order of their copies.
    """
    if deformable.assembly.image_of is None:
        return None
    system = local_system(deformable, orbits)
    everywhere = free_motions(system, np.ones(system.n_nodes, dtype=np.bool_))
    contact = np.isin(np.arange(system.n_nodes), system.corner_nodes)
    at_contacts = free_motions(system, contact)
    assert everywhere is not None
    assert at_contacts is not None

    def by_group(motions: FloatArray) -> tuple[FloatArray, ...]:
        slots = [system.slot_of[mine] for mine in blocks]
        return tuple(
            np.stack([motions[:, system.nodes_of(int(slot))] for slot in group], axis=1)
            for group in slots
        )

    return CellHold(by_group(everywhere.motions), by_group(at_contacts.motions))


#: Pressure whose stiffness the critical time step counts in where the law has no cap [MPa].
COUNTED_PRESSURE = 1.0

#: How often the stiffness of a linear law counts, which begins and ends at once when a joint closes
#: and opens. Central differences keep ½ v₋ v₊ + ½ ω² x² while a point touches. It touches and
#: leaves within a step, so that one touch multiplies its kinetic energy by up to
#: 1 / (1 - (ω Δt)²/4): without bound at the critical step, by 4/3 at half of it.
TOUCHES = 4.0


@dataclass(frozen=True)
class ExplicitAssembly:
    """An assembly ready for `fem.explicit.solve.solve`: one copy for each representative block."""

    deformable: DeformableAssembly
    """The whole assembly."""
    orbits: Orbits
    """Which blocks are represented by which."""
    copy_of: IntArray
    """Copy of the model that stands for each block, -1 for rigid ones, (n_blocks,)."""
    model: Model
    """Representative blocks with contact."""
    sliding: SlidingContact | None = None
    """Contact of the model where a search finds facets; None: matched facets stay matched."""

    def contact_state(
        self,
        displacements: tuple[FloatArray, ...],
        searched: SearchedSurfaces | None = None,
        slips: FloatArray | None = None,
    ) -> ContactState:
        """Contact of the whole assembly at displacements of the model's groups, world axes.

        Parameters
        ----------
        displacements
            (n_copies, n_nodes, 3) [mm] of each group.
        searched, slips
            Points and elastic slips of the run there (`fem.explicit.step.Interaction.contact`).
            None: points are searched, and no friction acts.
        """
        whole, full = self.deformable, self.expand(displacements)
        friction = whole.contact.friction
        traction = None
        if self.sliding is not None:
            if searched is None:
                surfaces = searched_surfaces(facing_points(whole, full), self.sliding.clearance)
            else:
                surfaces = searched_in_all_sectors(whole, self.orbits, searched)
            if friction is not None and slips is not None:
                traction = -friction.stick_stiffness * slips[:, None]
                traction = vectors_in_all_sectors(whole, self.orbits, traction, surfaces)[:, 0]
            moved = corner_displacements(whole, full, surfaces)
            return searched_state(surfaces, moved, whole.contact, traction)
        if friction is not None and slips is not None:
            pairs = self.face_contact.pairs
            traction = paired_frictions(whole, self.orbits, pairs, full, slips)
            traction = vectors_in_all_sectors(whole, self.orbits, traction, None)
        return matched_state(whole, full, *matched_pressures(whole, full), traction)

    @property
    def face_contact(self) -> FaceContact:
        """Contact of the model on matched facets."""
        return next(i for i in self.model.interactions if isinstance(i, FaceContact))

    def expand(self, displacements: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        """World displacements of every block from those of the representatives.

        Parameters
        ----------
        displacements
            Of the model's groups, (n_copies, n_nodes, 3) [mm].

        Returns
        -------
        tuple[FloatArray, ...]
            Of the groups of `deformable`, all copies; of a periodic cell without its motion as
            a whole, as `fem.static.solve` gives them.
        """
        whole = self.deformable
        turns = whole.assembly.rotations
        result = [np.zeros((g.n_copies, g.n_nodes, 3)) for g in whole.model.groups]
        for block in whole.deformable_blocks:
            source = int(self.orbits.representative[block])
            group = int(whole.group_of[block])
            turn = turns[block] @ turns[source].T
            moved = displacements[group][self.copy_of[block]]
            result[group][whole.copy_of[block]] = moved if source == block else moved @ turn.T
        if self._free is None:
            return tuple(result)
        system, free = self._free
        return tuple(system.expand(free.without(system.localised(tuple(result)))))

    @cached_property
    def _free(self) -> tuple[LocalSystem, FreeMotions] | None:
        """Motions of a periodic cell as a whole; None for what is held."""
        if self.deformable.assembly.image_of is None:
            return None
        system = local_system(self.deformable, no_symmetry(self.deformable))
        free = free_motions(system, np.ones(system.n_nodes, dtype=np.bool_))
        assert free is not None
        return system, free


def explicit_assembly(
    deformable: DeformableAssembly,
    *,
    orbits: Orbits | None = None,
    effects: Effects | None = None,
    amplitude: Amplitude | None = None,
    counted_pressure: float = COUNTED_PRESSURE,
) -> ExplicitAssembly:
    """State the explicit problem of an assembly.

    Parameters
    ----------
    deformable
        Blocks, loads, supports, contact.
    orbits
        Blocks to compute once; by default every block is computed.
    effects
        Damping and the like; by default none. Gravity is that of the assembly.
    amplitude
        Factor of all loads in time; None: constant. On the way to a static state gravity is one of
        them; else it acts at once, as in Abaqus' steps.
    counted_pressure
        Pressure whose stiffness the critical time step counts in, see `counted_stiffness` [MPa].

    Raises
    ------
    FrictionError
        Friction with reference normals or too stiff a stick.
    ContactError
        Finite sliding with reference normals.
    EffectError
        Effects with another gravity than the assembly has.
    """
    orbits = no_symmetry(deformable) if orbits is None else orbits
    chosen = _representatives(deformable, orbits)
    copy = np.full(deformable.assembly.n_blocks, -1, dtype=np.int64)
    for blocks in chosen:
        copy[blocks] = np.arange(len(blocks))
    copy_of = copy[orbits.representative]
    model = deformable.model
    copies = [deformable.copy_of[blocks] for blocks in chosen]
    counted = counted_stiffness(deformable.contact.law, counted_pressure)
    contact = _contact(deformable, orbits, copy_of, counted) if deformable.meets else None
    interactions: list[InteractionModel] = [contact] if contact else []
    hold = cell_hold(deformable, orbits, chosen)
    if hold is not None:
        interactions.append(hold)
    return ExplicitAssembly(
        deformable=deformable,
        orbits=orbits,
        copy_of=copy_of,
        model=Model(
            groups=tuple(_some_copies(g, k) for g, k in zip(model.groups, copies, strict=True)),
            supports=tuple(_in_time(_some(s, copies[s.group]), amplitude) for s in model.supports),
            loads=tuple(
                replace(_some(f, copies[f.group]), amplitude=amplitude) for f in model.loads
            ),
            effects=_with_gravity(effects, deformable.gravity, amplitude),
            interactions=tuple(interactions),
        ),
        sliding=contact if isinstance(contact, SlidingContact) else None,
    )


def _in_time(support: Support, amplitude: Amplitude | None) -> Support:
    """Support that moves as the loads grow, where no table says when."""
    if amplitude is None or support.amplitude is not ALL_THE_WAY:
        return support
    return replace(support, amplitude=amplitude)


def _with_gravity(
    effects: Effects | None, gravity: FloatArray | None, amplitude: Amplitude | None
) -> Effects:
    """Effects with the gravity of the assembly, which is stated there and nowhere else."""
    if effects is None:
        return Effects(gravity=gravity)
    if effects.gravity is not None and (gravity is None or (effects.gravity != gravity).any()):
        stated = "none" if gravity is None else gravity.tolist()
        raise EffectError(
            f"effects.gravity: got {effects.gravity.tolist()} where the assembly has {stated}; "
            "expected it in `Problem` alone, for static and explicit runs alike"
        )
    if gravity is None or effects.adaptive_mass_damping is None:
        return replace(effects, gravity=gravity)
    return replace(effects, gravity=gravity, gravity_amplitude=amplitude)


def _contact(
    deformable: DeformableAssembly, orbits: Orbits, copy_of: IntArray, counted: float
) -> FaceContact | SlidingContact:
    """Contact of the representatives: on matched facets, or where a search finds them."""
    contact = deformable.contact
    sliding = contact.finite_sliding
    if sliding and contact.normals is ContactNormals.REFERENCE:
        raise ContactError(
            "normals: got reference normals with finite sliding, which an explicit run measures "
            "along current ones; expected ContactNormals.CURRENT, or a static run"
        )
    common: dict[str, Any] = {
        "n_nodes": tuple(group.n_nodes for group in deformable.model.groups),
        "law": contact.law,
        "clearance": deformable.surfaces.clearance,
        "counted_stiffness": counted,
        "friction": contact.friction,
    }
    if sliding:
        surfaces = block_surfaces(deformable, orbits, copy_of)
        return SlidingContact(surfaces=surfaces, symmetry=orbits.order, **common)
    pairs = alike_pairs(deformable, orbits, copy_of)
    return FaceContact(pairs=pairs, normals=contact.normals, **common)


def counted_stiffness(law: ContactLaw, pressure: float = COUNTED_PRESSURE) -> float:
    """Stiffness of a law that the critical time step counts in [MPa/mm]; of several, the largest.

    The stiffness at ``pressure`` [MPa], which a run then watches; where the law is linear there,
    nothing exceeds it, and it counts `TOUCHES` times.
    """
    return max(_counted(one, pressure) for one in law.members)


def _counted(law: ContactLaw, pressure: float) -> float:
    largest = law.constants.linear_stiffness
    there = float(law.stiffness(law.overclosure(pressure)))
    return there if there < largest else TOUCHES * largest


def _representatives(deformable: DeformableAssembly, orbits: Orbits) -> list[IntArray]:
    """Representative blocks of each group in the order of their copies.

    Blocks at the same place in every second layer follow each other: then so do the blocks
    they touch, and contact finds both in neighbouring lanes.
    """
    assembly = deformable.assembly
    n = assembly.n_blocks
    by_layer = np.lexsort((np.arange(n), assembly.layer))
    place = np.empty(n, dtype=np.int64)
    place[by_layer] = np.arange(n) - np.searchsorted(
        assembly.layer[by_layer], assembly.layer[by_layer]
    )
    order = np.lexsort((assembly.layer, place, assembly.layer % 2))
    stands = order[orbits.representative[order] == order]
    groups = deformable.group_of[stands]
    return [stands[groups == g] for g in range(len(deformable.model.groups))]


def _some_copies(group: BlockGroup, copies: IntArray) -> BlockGroup:
    return replace(
        group, rotations=group.rotations[copies], translations=group.translations[copies]
    )


def _new_numbers(copies: IntArray, kept: IntArray) -> tuple[IntArray, IntArray]:
    """Entries whose copy is kept, and the new number of that copy."""
    number = np.full(int(max(copies.max(initial=0), kept.max())) + 1, -1, dtype=np.int64)
    number[kept] = np.arange(len(kept))
    mine = np.flatnonzero(number[copies] >= 0)
    return mine, number[copies[mine]]


def _some(entries: _Entries, kept: IntArray) -> _Entries:
    """Entries of kept copies: the arrays of a support or a load have a row for each."""
    mine, copies = _new_numbers(entries.copies, kept)
    given = {f.name: getattr(entries, f.name) for f in fields(entries)}
    rows: dict[str, Any] = {name: a[mine] for name, a in given.items() if isinstance(a, np.ndarray)}
    return replace(entries, **(rows | {"copies": copies}))
