"""The explicit problem of deformable blocks and the times of its run, stated once.

Times that nobody gives are those that the lowest excited frequency recommends. Of single bodies
no static state is expected: nothing is recommended, and the ramp takes half of the run.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from fem.contact.friction import FrictionError
from fem.contact.law import COUNTED_PRESSURE, counted_stiffness
from fem.contact.normals import ContactNormals
from fem.contact.search import SearchedPoints, points_of_search
from fem.contact.surfaces import ContactError, refuse_overlap
from fem.explicit.contact.sliding import SLIGHT
from fem.explicit.setup.quasi_static import FRACTION_WHILE_LOADING, recommended_times
from fem.explicit.timed import RecommendedTimes, TimedSystem, Times
from fem.problem import Motion
from fem.system.body import ModelError, refuse_turning_springs
from fem.system.contact_state import facing_points, searched_state
from fem.system.effects import EffectError, Effects
from fem.system.rows import ALL_THE_WAY, SmoothStepAmplitude, TabularAmplitude
from fem.system.sector import SymmetryError, largest_sector, require_sector
from fem.system.system import Sector, System
from fem.system.time_step import TimeStepError
from geometry.mesh import FloatArray, IntArray

#: Contact pressures that the critical time step counts in, one after the other [MPa].
_COUNTED_PRESSURES = tuple(COUNTED_PRESSURE * 4.0**k for k in range(6))

#: Gaps beyond this part of the size of a block are no rounding of single precision.
_APART = 1e-6


def counting_more(stated: TimedSystem) -> TimedSystem | None:
    """The same with a larger contact pressure counted; None where that counts no stiffness.

    A run whose contact outgrows its time step starts again with it. Single bodies have no contact.
    """
    if not stated.system.whole.meets:
        return None
    for pressure in _COUNTED_PRESSURES:
        more = replace(stated, counted_pressure=pressure)
        higher = pressure > stated.counted_pressure
        if higher and more.counted_stiffness > stated.counted_stiffness:
            return more
    return None


def timed_system(
    deformable: System,
    *,
    effects: Effects | None = None,
    symmetry: Literal["auto", "none", "sector"] = "none",
    ramp_time: float | None = None,
    end_time: float | None = None,
    counted_pressure: float = COUNTED_PRESSURE,
    motion: Motion | None = None,
) -> TimedSystem:
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
    turning = effects is not None and effects.finite_rotation
    check_timed(deformable, finite_rotation=turning, ramp_time=ramp_time, end_time=end_time)
    # What presses before any load acts is counted too.
    before = -deformable.surfaces.clearance
    at_start = max(float(law.pressure(before)) for law in deformable.contact.law.members)
    counted_pressure = max(counted_pressure, 2.0 * at_start)
    effects = _with_gravity(effects, deformable.gravity)
    system = blocks_in_time(deformable, symmetry, motion)
    blocks = _representatives(system)
    rubs = deformable.meets and deformable.contact.friction is not None
    stick = _stick(deformable, counted_pressure) if rubs else 1.0
    if deformable.contact.finite_sliding:
        system = _at_start(system)
    times, ramp, end = _times(system, effects, ramp_time, end_time)
    moved = _end_of_motion(deformable)
    if end_time is None:
        end += max(moved - ramp, 0.0)
    stated = TimedSystem(
        system=_in_time(system, ramp),
        blocks=blocks,
        effects=_growing(effects, ramp, rubs=deformable.contact.friction is not None),
        times=Times(ramp, max(ramp, moved), end, times),
        counted_pressure=counted_pressure,
        stick=stick,
    )
    if motion is None:
        return stated
    return replace(stated, velocities=motion.velocities(stated.bodies))


def check_timed(
    system: System, *, finite_rotation: bool, ramp_time: float | None, end_time: float | None
) -> None:
    """Reject what no explicit run has, by what is known before it; errors as `timed_system`."""
    if finite_rotation:
        refuse_turning_springs(system.bodies)
    elif any(load.follows_block for load in system.forces):
        raise ModelError("loads: follows_block needs finite rotation; set effects.finite_rotation")
    at_once = ramp_time is not None and ramp_time <= 0.0
    if at_once and any(share is ALL_THE_WAY for share in system.supports.tables):
        raise TimeStepError(
            "ramp_time: got 0 with a support that moves; expected the time of its smooth "
            "step in seconds, or a table of its motion"
        )
    if not system.meets:
        if end_time is None:
            raise TimeStepError(
                "`end_time` is missing: an explicit run of single bodies needs its end in seconds"
            )
        return
    for law in system.contact.law.members:
        _ = law.constants  # laws of one's own have none
    if system.contact.normals is not ContactNormals.REFERENCE:
        return
    if system.contact.finite_sliding:
        raise ContactError(
            "normals: got reference normals with finite sliding, which an explicit run measures "
            "along current ones; expected ContactNormals.CURRENT, or a static run"
        )
    if system.contact.friction is not None:
        raise FrictionError(
            "friction: got contact with reference normals, expected current normals"
        )


def blocks_in_time(
    system: System,
    symmetry: Literal["auto", "none", "sector"],
    motion: Motion | None,
) -> Sector:
    """Blocks that shape, loads, supports and motion at the start make equal."""
    if symmetry == "none" or not system.meets:
        return system.computed
    moving = [] if motion is None else [motion.velocity, motion.angular_velocity]
    if any(np.abs(np.cross(system.assembly.axis, way)).max() > 0.0 for way in moving):
        if symmetry == "sector":
            raise SymmetryError(
                'symmetry: got "sector", but blocks move across the axis at the start; expected '
                '"auto" or "none"'
            )
        return system.computed
    if symmetry == "sector":
        require_sector(system)
    half = symmetry == "auto" and motion is None and not system.contact.finite_sliding
    return largest_sector(system, half_turn=half)


def _end_of_motion(system: System) -> float:
    """When supports that move have arrived [s]; 0 without any."""
    moving = system.supports.tables
    ends = [s.times[-1] for s in moving if isinstance(s, TabularAmplitude) and s is not ALL_THE_WAY]
    return max(ends, default=0.0)


def _times(
    system: Sector, effects: Effects, ramp_time: float | None, end_time: float | None
) -> tuple[RecommendedTimes | None, float, float]:
    """Times that are recommended, where any are; ramp and end of the run [s]."""
    deformable, points = system.whole, system.points
    if not deformable.meets:
        assert end_time is not None
        return None, 0.5 * end_time if ramp_time is None else ramp_time, end_time
    if isinstance(points, SearchedPoints):
        start = searched_state(points, np.zeros_like(points.corners), None)
        reach = deformable.contact.law.allowed_overclosure(deformable.surfaces.clearance)
        refuse_overlap(start.block_m, start.block_s, start.deepest, reach)
    damped = effects.adaptive_mass_damping is not None
    times = recommended_times(system, damped=damped, closing=_apart(system))
    ramp = times.ramp_time if ramp_time is None else ramp_time
    return times, ramp, ramp + times.end_time - times.ramp_time if end_time is None else end_time


def _apart(system: Sector) -> bool:
    """Whether two blocks that face each other are apart before any load acts.

    A clearance, a spacing or the placement of the blocks makes the gap. With a search, a free block
    that faces nothing is apart as well.
    """
    points, whole = system.points, system.whole
    sides = np.stack([points.block_m, points.block_s], axis=1)
    if whole.contact.finite_sliding:
        shapes = whole.assembly.shapes
        can_touch = np.array([len(shape.contact_quads) > 0 for shape in shapes])
        moving = system.blocks[can_touch[whole.assembly.shape_of[system.blocks]]]
        if not np.isin(system.slot_of[moving], system.slot_of[sides]).all():
            return True
    closed = points.overclosures(np.zeros((*points.rows.shape, 3)))
    _, joint = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    smallest = np.full(joint.max(initial=-1) + 1, np.inf)
    np.minimum.at(smallest, joint.ravel(), -closed.max(axis=1))
    return bool((smallest > _APART * whole.assembly.characteristic_length).any())


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


def _in_time(system: Sector, ramp: float) -> Sector:
    """Blocks whose loads grow in a smooth step [s], and supports where no table says when."""
    if ramp <= 0.0:
        return system
    whole, amplitude = system.whole, SmoothStepAmplitude(ramp)
    tables = (amplitude if of is ALL_THE_WAY else of for of in whole.supports.tables)
    supports = replace(whole.supports, tables=tuple(tables))
    forces = tuple(replace(load, amplitude=amplitude) for load in whole.forces)
    return replace(system, whole=replace(whole, supports=supports, forces=forces))


def _growing(effects: Effects, ramp: float, *, rubs: bool) -> Effects:
    """Effects on the way to a static state: gravity grows with the loads.

    With friction, which remembers what drags, adaptive damping is less while the load grows.
    """
    adaptive = effects.adaptive_mass_damping
    if adaptive is None:
        return effects
    if rubs:
        adaptive = replace(
            adaptive, loading_time=ramp, fraction_while_loading=FRACTION_WHILE_LOADING
        )
        effects = replace(effects, adaptive_mass_damping=adaptive)
    if effects.gravity is None or ramp <= 0.0:
        return effects
    return replace(effects, gravity_amplitude=SmoothStepAmplitude(ramp))


def _stick(system: System, counted_pressure: float) -> float:
    """Stiffness of points that stick: the most that the time step allows unless stated [MPa/mm]."""
    counted = counted_stiffness(system.contact.law, counted_pressure)
    stick = system.stick(counted)
    if stick > counted:
        raise FrictionError(
            f"stick_stiffness: got {stick} MPa/mm, expected at most {counted:.4g}, the contact "
            "stiffness included in the critical time step"
        )
    return stick


def _at_start(system: Sector) -> Sector:
    """The same with the points of a search before any displacement."""
    points = facing_points(system, slight=SLIGHT)
    return system.on(points_of_search(points, system.whole.surfaces.clearance))


def _representatives(system: Sector) -> tuple[IntArray, ...]:
    """Representative blocks of each body in the order of their copies.

    Blocks at the same place in every second layer follow each other: then so do the blocks
    they touch, and contact finds both in neighbouring lanes.
    """
    assembly, representative = system.whole.assembly, system.orbits.representative
    n = assembly.n_blocks
    by_layer = np.lexsort((np.arange(n), assembly.layer))
    place = np.empty(n, dtype=np.int64)
    place[by_layer] = np.arange(n) - np.searchsorted(
        assembly.layer[by_layer], assembly.layer[by_layer]
    )
    order = np.lexsort((assembly.layer, place, assembly.layer % 2))
    stands = order[representative[order] == order]
    bodies = system.whole.body_number[stands]
    return tuple(stands[bodies == g] for g in range(len(system.whole.bodies)))
