"""Explicit dynamics by central differences, velocities at half steps.

    a_n = M⁻¹ (f_applied - f_internal - C v_n)
    v_{n+½} = v_{n-½} + Δt a_n
    u_{n+1} = u_n + Δt v_{n+½}

`step` is that, term by term; `fem.explicit.solve.run_explicit` is the run around it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fem.contact.search import SearchedPoints
from fem.explicit import block_frame
from fem.explicit.body import BodyLoad, LaneBody
from fem.explicit.kernels import (
    Applied,
    Damper,
    Drag,
    KernelSet,
    Loads,
    MovingRows,
    Placing,
    add_at,
    dot_lanes,
    dot_rows,
    enforce,
    hold,
    set_spins,
    viscous_power,
    widths,
)
from fem.explicit.kernels.layout import LaneArray
from fem.explicit.state import BodyState, LoadState
from fem.explicit.timed import TimedSystem
from geometry.mesh import FloatArray


class Interaction(ABC):
    """Forces between blocks (contact), one more term of the step; has arrays of its own."""

    begins_with_loads: ClassVar[bool] = False
    """Whether `add_force` overwrites the applied forces: it begins with the loads."""

    @abstractmethod
    def add_force(self, loop: Loop) -> None:
        """Add forces of the current positions to the applied forces of the bodies."""

    def touched_points(self) -> float:
        """Points of contact, counted as `geometry.machine.work.Operation.TOUCH`."""
        return 0.0

    def energy(self) -> float:
        """Energy stored at the last force evaluation [N mm]."""
        return 0.0

    def dissipation(self) -> float:
        """Energy dissipated up to the last force evaluation [N mm]."""
        return 0.0

    def contact(self, moved: FloatArray) -> tuple[SearchedPoints | None, FloatArray | None]:  # noqa: ARG002 - most have none
        """Points that a search found, and friction on block s, of the last force evaluation.

        At ``moved``, displacements of the nodes of the system, (n_nodes, 3) [mm]. Friction is that
        of all points, world axes, (n_facets, n_points, 3) [MPa]; None: absent.
        """
        return None, None

    def fault(self, loop: Loop) -> str | None:  # noqa: ARG002 - most have none
        """What makes the run unstable and what to do, where the time step is too large; or None."""
        return None

    def follows(self) -> bool:
        """Whether the forces are those of the present positions; else the next step makes them."""
        return True

    def arrays(self) -> dict[str, LaneArray]:
        """Arrays that evolve and must be in a checkpoint, by name; written in place."""
        return {}


@dataclass
class Loop:
    """What is stepped: constants, the arrays that change, and where they are in time."""

    stated: TimedSystem
    """What is computed."""
    bodies: tuple[LaneBody, ...]
    """In lanes, each with its state."""
    time_step: float
    """[s]"""
    kernels: KernelSet
    """Serial or parallel loops."""
    interactions: tuple[Interaction, ...] = ()
    """Contact; empty when blocks do not meet."""
    step: int = 0
    """Steps done."""
    mass_damping: float | None = None
    """Current mass-proportional coefficient [1/s]."""

    @property
    def time(self) -> float:
        """Time of the displacements [s]."""
        return self.step * self.time_step


def step(loop: Loop, *, sample: bool = False) -> None:
    """Advance by one time step.

    With ``sample`` the energies at the time of the forces (the beginning of the step) are left
    in the state, for `fem.explicit.output.energy.energies`.
    """
    time = loop.time
    for body in loop.bodies:
        set_internal_force(loop, body, sample=sample)
        if body.now.applied_force is not None:
            set_applied_force(loop, body, time)
    for interaction in loop.interactions:
        interaction.add_force(loop)
    for body in loop.bodies:
        now = body.now
        falling = None if body.acceleration is None else gravity_at(loop, body, time)
        ramped = None if now.momentum is None else falling
        before = after = 0.0
        if ramped is not None:
            before = ramped_gravity_power(body, ramped)
        advance(loop, body, falling, sample=sample)
        if body.held is not None:
            # `update` took the work of loads with the velocity before this correction.
            after -= held_load_power(body)
            enforce_support(loop, body)
            after += held_load_power(body)
        if ramped is not None:
            after += ramped_gravity_power(body, ramped, moved=True)
        half = 0.5 * loop.time_step
        now.external_work.add(half * before, half * after)
    loop.step += 1


def set_internal_force(loop: Loop, body: LaneBody, *, sample: bool) -> None:
    """Stress divergence f = K u in the block frame, with the viscous terms that act on it."""
    now, kernels = body.now, loop.kernels
    frame = now.frame
    if frame is not None:
        block_frame.fit(body, frame, now.displacement, kernels)
    if now.elastic_before is not None:
        before = now.elastic_before
        before.force, now.internal_force = now.internal_force, before.force
    displacement = now.local_displacement
    torque = None if frame is None else frame.torque
    flat, force = displacement.ravel(), now.internal_force.ravel()
    kernels.stiffness_product(*body.rows.packed, flat, force, _flat(torque), body.lanes)
    if sample:
        dot_lanes(displacement, now.internal_force, now.strain_energy)
        now.strain_energy *= 0.5
    if now.stiffness_damping is not None:
        add_stiffness_damping(loop, body)
    if now.viscous is not None:
        add_bulk_viscosity(loop, body, displacement, torque)
    if frame is not None:
        # What makes forces of known torque torque-free.
        set_spins(frame.torque, frame.compliance, frame.placing[3])


def add_stiffness_damping(loop: Loop, body: LaneBody) -> None:
    """F += β K v in the block frame, as (β/Δt)(K u_n - K u_{n-1})."""
    now = body.now
    damping, frame = now.stiffness_damping, now.frame
    coefficient = loop.stated.effects.stiffness_damping
    assert damping is not None
    assert coefficient is not None
    moving = now.velocity if frame is None else frame.increment
    assert moving is not None
    loop.kernels.add_stiffness_damping(
        body.lanes,
        body.rows.chunks,
        coefficient / loop.time_step,
        now.local_displacement.ravel(),
        moving.ravel(),
        damping.elastic.ravel(),
        damping.viscous.ravel(),
        now.internal_force.ravel(),
        None if frame is None else frame.torque.ravel(),
        damping.dissipated.ravel(),
    )


def damping_ratio(loop: Loop, now: BodyState) -> Any:
    """β/Δt where `update` makes the damping force; or None."""
    if now.elastic_before is None:
        return None
    coefficient = loop.stated.effects.stiffness_damping
    assert coefficient is not None
    return coefficient / loop.time_step


def placed_internal_force(body: LaneBody) -> LaneArray:
    """Internal force of the last step in the placement axes, (n_rows, 3, lanes) [N]."""
    now = body.now
    if now.frame is None:
        return now.internal_force
    return block_frame.placed_force(body, now.frame, now.internal_force)


def damped_internal_force(loop: Loop, body: LaneBody) -> LaneArray:
    """Return the same with all viscous terms, (n_rows, 3, lanes) [N]."""
    now = body.now
    if now.elastic_before is None:
        return placed_internal_force(body)
    change = now.internal_force - now.elastic_before.force
    return now.internal_force + damping_ratio(loop, now) * change


def add_bulk_viscosity(
    loop: Loop, body: LaneBody, displacement: LaneArray, torque: LaneArray | None
) -> None:
    """F += Bᵀ q (see `fem.explicit.body`)."""
    data, viscous = body.viscosity, body.now.viscous
    assert data is not None
    assert viscous is not None
    u, gradient, stress = displacement.ravel(), data.gradient.ravel(), viscous.stress.ravel()
    loop.kernels.viscous_pressure(
        body.lanes,
        data.element_chunks,
        data.element_rows.ravel(),
        gradient,
        data.linear,
        data.quadratic,
        1.0 / loop.time_step,
        u,
        viscous.strain.ravel(),
        stress,
        viscous.dissipated.ravel(),
    )
    force = body.now.internal_force.ravel()
    rows = data.pointer, data.corner, gradient, stress
    loop.kernels.add_viscous_force(body.lanes, body.rows.chunks, u, force, _flat(torque), *rows)


def set_applied_force(loop: Loop, body: LaneBody, time: float) -> None:
    """Loads at ``time``, which contact adds to, if it does not begin with them itself."""
    now = body.now
    force, loads = now.applied_force, now.loads
    if force is None:
        return
    if loads is not None:
        factors = [load_factor(load, time) for load in body.loads]
        turning = any(load.following is not None for load in body.loads)
        if turning or loads.factor.tolist() != factors:
            set_loads(body, loads, factors)
    begun = loop.interactions and loop.interactions[0].begins_with_loads
    if begun or (loads is not None and loads.force is force):
        return
    force[:] = 0.0 if loads is None else loads.force


def load_factor(load: BodyLoad, time: float) -> float:
    """Amplitude of a load at a time."""
    return 1.0 if load.amplitude is None else load.amplitude(time)


def set_loads(body: LaneBody, loads: LoadState, factors: list[float]) -> None:
    """Forces of the loads at their amplitudes; those that follow the block frame turn with it."""
    loads.factor[:] = factors
    loads.force[:] = 0.0
    for load, factor in zip(body.loads, factors, strict=True):
        following, frame, values = load.following, body.now.frame, load.values
        if following is not None and frame is not None:
            turn = frame.turn[:, :, following.copies]
            turned = following.forces + np.einsum("ijn,nj->ni", turn, following.forces)
            values = turned.ravel()[following.order]
        add_at(loads.force.ravel(), load.applied.start, load.applied.pointer, values, factor)


def held_load_power(body: LaneBody) -> float:
    """Power of the loads on rows with supports at the velocity that the state holds [N mm/s]."""
    loads, (row, applied) = body.now.loads, body.held_loads
    if loads is None or not len(row):
        return 0.0
    velocity, force = body.now.velocity.ravel(), loads.force.ravel()
    return float(dot_rows(velocity, row, force, applied, 3 * body.lanes))


def gravity_at(loop: Loop, body: LaneBody, time: float) -> LaneArray | None:
    """Acceleration of gravity at a time, (3, lanes) [mm/s²]; None without."""
    amplitude = loop.stated.effects.gravity_amplitude
    if body.acceleration is None or amplitude is None:
        return body.acceleration
    return amplitude(time) * body.acceleration


def ramped_gravity_power(body: LaneBody, falling: LaneArray, *, moved: bool = False) -> float:
    """Power of a gravity that changes in time [N mm/s]; another one has a potential.

    The momentum is summed anew where the velocity has ``moved`` since the last call.
    """
    known = body.now.momentum
    assert known is not None
    if moved or math.isnan(known[0]):
        np.matmul(body.mass, body.now.velocity.reshape(len(body.mass), -1), out=known)
    return float(known @ falling.ravel())


def advance(loop: Loop, body: LaneBody, falling: LaneArray | None, *, sample: bool) -> None:
    """v_{n+½} = v_{n-½} + Δt a_n and u_{n+1} = u_n + Δt v_{n+½}."""
    now, dt, frame, before = body.now, loop.time_step, body.now.frame, body.now.elastic_before
    drag = damper = placing = applied = loads = None
    half = 0.0
    if loop.mass_damping is not None and now.mass_damping_work is not None:
        half = 0.5 * loop.mass_damping * dt
        drag = Drag((1.0 - half) / (1.0 + half), half, now.mass_damping_work.ravel())
    if before is not None:
        damper = Damper(damping_ratio(loop, now), before.force.ravel(), before.work.ravel())
    if frame is not None:
        placing = Placing(frame.placing.ravel(), body.reference)
    if now.applied_force is not None and body.applied_row is not None:
        applied = Applied(body.applied_row, now.applied_force.ravel())
    if now.loads is not None:
        loads = Loads(now.loads.force.ravel(), now.loads.work.ravel())
    arguments = (
        body.lanes,
        *widths(body.lanes),
        body.rows.chunks,
        MovingRows(
            body.mass,
            now.internal_force.ravel(),
            now.displacement.ravel(),
            now.velocity.ravel(),
            dt,
            dt / (1.0 + half),
        ),
        _flat(now.kinetic if sample else None),
        drag,
        damper,
        placing,
        applied,
        loads,
        _flat(falling),
    )
    if sample not in body.moves:
        body.moves[sample] = loop.kernels.update.code(*arguments)
    body.moves[sample](*arguments)


def _flat(array: LaneArray | None) -> LaneArray | None:
    return None if array is None else array.ravel()


def enforce_support(loop: Loop, body: LaneBody) -> None:
    """Prescribed components of displacement and velocity, and the work of moving supports."""
    now = body.now
    damper = now.elastic_before
    viscous_before = 0.0 if damper is None else supported_viscous_power(loop, body)
    loss = None if loop.mass_damping is None else 0.5 * loop.mass_damping * loop.time_step
    u, v = now.displacement.ravel(), now.velocity.ravel()
    lost_before = lost_after = 0.0
    held = body.held
    assert held is not None
    if len(held.still_mass):
        runs = held.still
        lost_after += hold(runs.start, runs.pointer, held.still_mass, loss, u, v)
    if len(held.base):
        time, dt = loop.time, loop.time_step
        last, current, following = (held.prescribed(time + k * dt) for k in (-1, 0, 1))
        before, after, more_before, more_after = enforce(
            held.base,
            body.lanes,
            held.direction,
            following,
            (following - current) / dt,
            (current - last) / dt,
            held.mass,
            0.0 if loss is None else loss,
            u,
            v,
        )
        now.support_work.add(before, after)
        lost_before, lost_after = lost_before + more_before, lost_after + more_after
    if loss is not None:
        now.support_loss.add(lost_before, lost_after)
    if damper is not None:
        # `update` took the velocity before this correction.
        change = supported_viscous_power(loop, body) - viscous_before
        damper.support_loss.add(0.0, 0.5 * change)


def supported_viscous_power(loop: Loop, body: LaneBody) -> float:
    """Power of the damping force of `update` at supported nodes [N mm/s]; 0 where there is none."""
    now = body.now
    before = now.elastic_before
    if before is None or not len(body.supported):
        return 0.0
    return viscous_power(
        body.supported,
        damping_ratio(loop, now),
        now.internal_force.ravel(),
        before.force.ravel(),
        now.velocity.ravel(),
    )
