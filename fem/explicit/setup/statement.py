"""The explicit problem of deformable blocks and the times of its run, stated once.

Times that nobody gives are those that the lowest excited frequency recommends. Of single bodies
no static state is expected: nothing is recommended, and the ramp takes half of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeVar

import numpy as np

from fem.contact.law import ContactLaw
from fem.contact.search import SearchedPoints
from fem.contact.surfaces import ContactError, ContactNormals, refuse_overlap
from fem.explicit.contact.alike_pairs import alike_pairs
from fem.explicit.contact.paired import FaceContact, paired_frictions
from fem.explicit.contact.sliding import SlidingContact, surface_areas
from fem.explicit.setup.cell_hold import cell_hold
from fem.explicit.setup.quasi_static import (
    FRACTION_WHILE_LOADING,
    RecommendedTimes,
    recommended_times,
)
from fem.explicit.solve import Run
from fem.problem import Motion
from fem.state import State
from fem.system.effects import EffectError, Effects
from fem.system.forces import ALL_THE_WAY, SmoothStepAmplitude, TabularAmplitude
from fem.system.model import Amplitude, Model, NodalLoad, Support
from fem.system.sector import (
    SymmetryError,
    largest_cyclic_orbits,
    require_sector,
    with_half_turn,
)
from fem.system.state import (
    block_surfaces,
    searched_state,
)
from fem.system.system import Orbits, System, free_motions
from fem.system.time_step import TimeStepError, scale_masses
from geometry.mesh import FloatArray, IntArray

_Entries = TypeVar("_Entries", Support, NodalLoad)

#: Pressure whose stiffness the critical time step counts in where the law has no cap [MPa].
COUNTED_PRESSURE = 1.0

#: Contact pressures that the critical time step counts in, one after the other [MPa].
_COUNTED_PRESSURES = tuple(COUNTED_PRESSURE * 4.0**k for k in range(6))

#: How often the stiffness of a linear law counts, which begins and ends at once when a joint closes
#: and opens. Central differences keep ½ v₋ v₊ + ½ ω² x² while a point touches. It touches and
#: leaves within a step, so that one touch multiplies its kinetic energy by up to
#: 1 / (1 - (ω Δt)²/4): without bound at the critical step, by 4/3 at half of it.
TOUCHES = 4.0

#: Gaps beyond this part of the size of a block are no rounding of single precision.
_APART = 1e-6


@dataclass(frozen=True)
class ExplicitStatement:
    """The explicit problem of an assembly, one copy for each representative, and its times."""

    system: System
    """The blocks that are computed, with their contact, loads and supports."""
    blocks: tuple[IntArray, ...]
    """Block of each copy of the model's groups."""
    model: Model
    """Representative blocks with contact, loads and supports in time."""
    recommended: RecommendedTimes | None
    """Times recommended by the lowest excited frequency; None for single bodies."""
    ramp_time: float
    """Duration of the smooth step of the loads [s]."""
    end_time: float
    """Latest end of the run [s]."""
    counted_pressure: float
    """Pressure whose contact stiffness the critical time step counts in where no cap is
    below it [MPa]."""
    velocities: tuple[FloatArray, ...] | None = None
    """Of the model's groups at time 0, (n_copies, n_nodes, 3) [mm/s]; None: at rest."""
    settled_after: float = 0.0
    """When loads and supports have arrived: a static state may be found from then on [s]."""

    def counting_more(self) -> ExplicitStatement | None:
        """The same with a larger contact pressure counted; None where that counts no stiffness.

        A run whose contact outgrows its time step starts again with it.
        """
        law = self.system.contact.law
        now = counted_stiffness(law, self.counted_pressure)
        for pressure in _COUNTED_PRESSURES:
            counted = counted_stiffness(law, pressure)
            if pressure > self.counted_pressure and counted > now:
                contact = replace(self.contact, counted_stiffness=counted)
                interactions = (contact, *self.model.interactions[1:])
                model = replace(self.model, interactions=interactions)
                return replace(self, model=model, counted_pressure=pressure)
        return None

    @property
    def contact(self) -> FaceContact | SlidingContact:
        """Contact of the model, of blocks that meet."""
        contact = self.model.interactions[0]
        assert isinstance(contact, FaceContact | SlidingContact)
        return contact

    def state(self, run: Run) -> State:
        """State of the whole assembly at the end of a run."""
        system, slips, copies = self.system, run.slips, self.system.orbits.copies
        if run.searched is not None:
            system = system.on(run.searched)
        energies = None if run.energies is None else run.energies.times(copies)
        return State(
            system=system,
            displacement=self._of_system(run.displacements),
            friction=None if slips is None else self._friction(run.displacements, slips),
            support_force=self._of_system(run.support_forces) if run.support_forces else None,
            contact_force=self._of_system(run.contact_forces),
            time=run.time,
            finite_rotation=self.model.effects.finite_rotation,
            run=replace(run, energies=energies, history=run.history.times(copies)),
            statement=self,
        )

    def _friction(self, displacements: tuple[FloatArray, ...], slips: FloatArray) -> FloatArray:
        """Of elastic slips on block s at all points, world axes, (n_facets, n_points, 3) [MPa]."""
        contact, friction = self.contact, self.system.contact.friction
        if isinstance(contact, FaceContact):
            moved = self._in_system(displacements)
            return paired_frictions(self.system, contact.pairs, moved, slips)
        assert friction is not None
        return -friction.stick_stiffness * slips[:, None]

    def expand(self, vectors: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        """Displacements or forces of every block from those of the representatives.

        Parameters
        ----------
        vectors
            Of the model's groups, world axes, (n_copies, n_nodes, 3).

        Returns
        -------
        tuple[FloatArray, ...]
            Of the groups of the whole, all copies; of a periodic cell without its motion as
            a whole, as `fem.static.solve` gives them.
        """
        return tuple(self.system.expand(self._of_system(vectors)))

    def _of_system(self, vectors: tuple[FloatArray, ...]) -> FloatArray:
        """The same of the nodes of the system, block frames, (n_nodes, 3)."""
        moved, free = self._in_system(vectors), free_motions(self.system)
        return moved if free is None else free.without(moved)

    def _in_system(self, displacements: tuple[FloatArray, ...]) -> FloatArray:
        """Vectors of the nodes of the system, its motion as a whole included, (n_nodes, 3)."""
        result = np.empty((self.system.n_nodes, 3))
        turns = self.system.assembly.rotations
        for blocks, moved in zip(self.blocks, displacements, strict=True):
            for block, world in zip(blocks.tolist(), moved, strict=True):
                slot = int(self.system.slot_of[block])
                result[self.system.nodes_of(slot)] = world @ turns[block]
        return result


def explicit_statement(
    deformable: System,
    *,
    effects: Effects | None = None,
    symmetry: Literal["auto", "none", "sector"] = "none",
    ramp_time: float | None = None,
    end_time: float | None = None,
    mass_scaling: float | None = None,
    counted_pressure: float = COUNTED_PRESSURE,
    motion: Motion | None = None,
) -> ExplicitStatement:
    """State the explicit problem of an assembly.

    Parameters
    ----------
    deformable
        Blocks, loads, supports, contact.
    effects
        Damping and the like; by default none. Gravity is that of the assembly: on the way to a
        static state it grows with the loads, else it acts at once, as in Abaqus' steps.
    symmetry
        ``none``: every block is computed; ``sector``: it must be possible that one block of each
        layer stands for all; ``auto``: that is done where it is exact, with a half turn as well
        where facets are matched.
    ramp_time, end_time
        [s]; None: recommended. The load stays as long after another ramp.
    mass_scaling
        Step that every element is to allow, over the shortest; None: absent.
    counted_pressure
        Pressure whose contact stiffness the critical time step counts in, see `counted_stiffness`
        [MPa].
    motion
        Of every block at time 0; None: at rest.

    Raises
    ------
    SymmetryError
        A sector that is none.
    TimeStepError
        Single bodies without an end.
    ContactError, EffectError, FrictionError, ModelError, TimeStepError
        If the model, a load or an option is not valid for an explicit run.
    """
    if mass_scaling is not None:
        deformable = replace(deformable, bodies=scale_masses(deformable.bodies, mass_scaling))
    # What presses before any load acts is counted too.
    before = -deformable.surfaces.clearance
    at_start = max(float(law.pressure(before)) for law in deformable.contact.law.members)
    counted_pressure = max(counted_pressure, 2.0 * at_start)
    effects = _with_gravity(effects, deformable.gravity)
    system = deformable.in_sector(_orbits(deformable, symmetry, motion))
    blocks = _representatives(system)
    contact = _contact(system, blocks, counted_pressure) if system.meets else None
    if isinstance(contact, SlidingContact):
        system = system.on(contact.at_start)
    model = _representative_model(system, blocks, effects, contact)
    times, ramp, end = _times(system, effects, ramp_time, end_time)
    moved = _end_of_motion(deformable, ramp)
    if end_time is None:
        end += max(moved - ramp, 0.0)
    model = _in_time(model, ramp, rubs=deformable.contact.friction is not None)
    return ExplicitStatement(
        system=system,
        blocks=blocks,
        model=model,
        recommended=times,
        ramp_time=ramp,
        end_time=end,
        counted_pressure=counted_pressure,
        velocities=None if motion is None else motion.velocities(model),
        settled_after=max(ramp, moved),
    )


def _orbits(
    deformable: System,
    symmetry: Literal["auto", "none", "sector"],
    motion: Motion | None,
) -> Orbits:
    """Blocks that shape, loads, supports and motion at the start make equal."""
    if symmetry == "none" or not deformable.meets:
        return deformable.orbits
    moving = [] if motion is None else [motion.velocity, motion.angular_velocity]
    if any(np.abs(np.cross(deformable.assembly.axis, way)).max() > 0.0 for way in moving):
        if symmetry == "sector":
            raise SymmetryError(
                'symmetry: got "sector", but blocks move across the axis at the start; expected '
                '"auto" or "none"'
            )
        return deformable.orbits
    if symmetry == "sector":
        require_sector(deformable)
    orbits = largest_cyclic_orbits(deformable)
    half = symmetry == "auto" and motion is None and not deformable.contact.finite_sliding
    return with_half_turn(deformable, orbits) if half else orbits


def _end_of_motion(deformable: System, ramp: float) -> float:
    """When supports that move have arrived [s]; 0 without any."""
    moving = [s.amplitude for s in deformable.supports if s.displacement.any()]
    if ramp <= 0.0 and any(share is ALL_THE_WAY for share in moving):
        raise TimeStepError(
            "ramp_time: got 0 with a support that moves; expected the time of its smooth "
            "step in seconds, or a table of its motion"
        )
    ends = [s.times[-1] for s in moving if isinstance(s, TabularAmplitude) and s is not ALL_THE_WAY]
    return max(ends, default=0.0)


def _times(
    system: System, effects: Effects, ramp_time: float | None, end_time: float | None
) -> tuple[RecommendedTimes | None, float, float]:
    """Times that are recommended, where any are; ramp and end of the run [s]."""
    deformable, points = system, system.points
    if not deformable.meets:
        if end_time is None:
            raise TimeStepError(
                "`end_time` is missing: an explicit run of single bodies needs its end in seconds"
            )
        return None, 0.5 * end_time if ramp_time is None else ramp_time, end_time
    if isinstance(points, SearchedPoints):
        start = searched_state(points, np.zeros_like(points.corners), None)
        reach = deformable.contact.law.allowed_overclosure(deformable.surfaces.clearance)
        refuse_overlap(start.block_m, start.block_s, start.deepest, reach)
    damped = effects.adaptive_mass_damping is not None
    times = recommended_times(system, damped=damped, closing=_apart(system))
    ramp = times.ramp_time if ramp_time is None else ramp_time
    return times, ramp, ramp + times.end_time - times.ramp_time if end_time is None else end_time


def _apart(system: System) -> bool:
    """Whether two blocks that face each other are apart before any load acts.

    A clearance, a spacing or the placement of the blocks makes the gap. With a search, a free block
    that faces nothing is apart as well.
    """
    points = system.points
    sides = np.stack([points.block_m, points.block_s], axis=1)
    if system.contact.finite_sliding:
        shapes = system.assembly.shapes
        can_touch = np.array([len(shape.contact_quads) > 0 for shape in shapes])
        moving = system.blocks[can_touch[system.assembly.shape_of[system.blocks]]]
        if not np.isin(system.slot_of[moving], system.slot_of[sides]).all():
            return True
    closed = points.overclosures(np.zeros((*points.rows.shape, 3)))
    _, joint = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    smallest = np.full(joint.max(initial=-1) + 1, np.inf)
    np.minimum.at(smallest, joint.ravel(), -closed.max(axis=1))
    return bool((smallest > _APART * system.assembly.characteristic_length).any())


def _with_gravity(effects: Effects | None, gravity: FloatArray | None) -> Effects:
    """Effects with the gravity of the assembly, which is stated there and nowhere else."""
    if effects is None:
        return Effects(gravity=gravity)
    if effects.gravity is not None and (gravity is None or (effects.gravity != gravity).any()):
        stated = "none" if gravity is None else gravity.tolist()
        raise EffectError(
            f"effects.gravity: got {effects.gravity.tolist()} where the assembly has {stated}; "
            "expected it in `Problem` alone, for static and explicit runs alike"
        )
    return replace(effects, gravity=gravity)


def _representative_model(
    system: System,
    blocks: tuple[IntArray, ...],
    effects: Effects,
    contact: FaceContact | SlidingContact | None,
) -> Model:
    """Model of representative blocks, without times."""
    copies = [system.copy_of[mine] for mine in blocks]
    hold = cell_hold(system, blocks)
    return Model(
        groups=tuple(
            g.with_same_stiffness(rotations=g.rotations[k], translations=g.translations[k])
            for g, k in zip(system.bodies, copies, strict=True)
        ),
        supports=tuple(_some(s, copies[s.group]) for s in system.supports),
        loads=tuple(_some(f, copies[f.group]) for f in system.forces),
        effects=effects,
        interactions=tuple(i for i in (contact, hold) if i is not None),
    )


def _in_time(model: Model, ramp: float, *, rubs: bool) -> Model:
    """Model whose loads grow in a smooth step [s], and supports where no table says when.

    On the way to a static state gravity grows too. With friction, which remembers what drags,
    adaptive damping is less while the load grows.
    """
    amplitude: Amplitude | None = SmoothStepAmplitude(ramp) if ramp > 0 else None
    effects, supports = model.effects, model.supports
    adaptive = effects.adaptive_mass_damping
    if adaptive is not None and rubs:
        adaptive = replace(
            adaptive, loading_time=ramp, fraction_while_loading=FRACTION_WHILE_LOADING
        )
        effects = replace(effects, adaptive_mass_damping=adaptive)
    if adaptive is not None and effects.gravity is not None:
        effects = replace(effects, gravity_amplitude=amplitude)
    if amplitude is not None:
        supports = tuple(
            replace(s, amplitude=amplitude) if s.amplitude is ALL_THE_WAY else s for s in supports
        )
    loads = tuple(replace(load, amplitude=amplitude) for load in model.loads)
    return replace(model, supports=supports, loads=loads, effects=effects)


def _contact(
    system: System, blocks: tuple[IntArray, ...], counted_pressure: float
) -> FaceContact | SlidingContact:
    """Contact of the representatives: on matched facets, or where a search finds them."""
    contact = system.contact
    sliding = contact.finite_sliding
    if sliding and contact.normals is ContactNormals.REFERENCE:
        raise ContactError(
            "normals: got reference normals with finite sliding, which an explicit run measures "
            "along current ones; expected ContactNormals.CURRENT, or a static run"
        )
    copy = np.full(system.assembly.n_blocks, -1, dtype=np.int64)
    for mine in blocks:
        copy[mine] = np.arange(len(mine))
    copy_of = copy[system.orbits.representative]
    common: dict[str, Any] = {
        "law": contact.law,
        "clearance": system.surfaces.clearance,
        "counted_stiffness": counted_stiffness(contact.law, counted_pressure),
        "friction": contact.friction,
    }
    if sliding:
        surfaces = block_surfaces(system, copy_of)
        areas = surface_areas(surfaces, tuple(g.n_nodes for g in system.bodies))
        return SlidingContact(
            surfaces=surfaces, areas=areas, symmetry=system.orbits.order, **common
        )
    return FaceContact(
        pairs=alike_pairs(system, copy_of),
        areas=_areas(system),
        normals=contact.normals,
        **common,
    )


def _areas(system: System) -> tuple[FloatArray, ...]:
    """`ExplicitContact.areas` of matched facets."""
    points = system.points
    sides = np.stack([points.block_m, points.block_s])
    moving = (system.slot_of[sides] >= 0).sum(axis=0)
    each = np.einsum("f,fp,fpa->fa", moving, points.weights, np.abs(points.functions))
    total: FloatArray = np.bincount(points.rows.ravel(), each.ravel(), system.n_nodes + 1)
    areas = tuple(np.zeros(group.n_nodes) for group in system.bodies)
    for block in system.deformable_blocks.tolist():
        largest = areas[system.group_of[block]]
        np.maximum(largest, total[system.rows.of_block(block)], out=largest)
    return areas


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


def _representatives(system: System) -> tuple[IntArray, ...]:
    """Representative blocks of each group in the order of their copies.

    Blocks at the same place in every second layer follow each other: then so do the blocks
    they touch, and contact finds both in neighbouring lanes.
    """
    assembly, representative = system.assembly, system.orbits.representative
    n = assembly.n_blocks
    by_layer = np.lexsort((np.arange(n), assembly.layer))
    place = np.empty(n, dtype=np.int64)
    place[by_layer] = np.arange(n) - np.searchsorted(
        assembly.layer[by_layer], assembly.layer[by_layer]
    )
    order = np.lexsort((assembly.layer, place, assembly.layer % 2))
    stands = order[representative[order] == order]
    groups = system.group_of[stands]
    return tuple(stands[groups == g] for g in range(len(system.bodies)))


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
