"""A run of explicit dynamics around `fem.central_difference.step`."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from fem.body import Body, make_body
from fem.central_difference import (
    Interaction,
    System,
    set_applied_force,
    set_internal_force,
    step,
)
from fem.energy import Energies, copy_energies, energies
from fem.history import History
from fem.kernels import PARALLEL, SERIAL
from fem.model import Model
from fem.state import BodyState, State, initial_body_state, world_vectors
from fem.time_step import CriticalTimeStep, TimeStepError, critical_time_step
from geometry.mesh import FloatArray

#: A block that holds this many times the energy put into the whole model runs away.
RUNAWAY = 100.0

PRECISIONS = {"float64": np.float64, "float32": np.float32}


class UnstableRun(RuntimeError):  # noqa: N818
    """The solution grows without bound: time, block and remedy are in the message."""


@dataclass(frozen=True)
class Progress:
    """What a progress callback is told."""

    time: float
    """[s]"""
    end_time: float
    """[s]"""
    step: int
    """Steps done."""
    n_steps: int
    """Steps of the whole run."""
    energies: Energies
    """At `time`."""


@dataclass(frozen=True)
class ExplicitResult:
    """The end of a run, in world axes."""

    model: Model
    """The statement."""
    displacements: tuple[FloatArray, ...]
    """Of each group, (n_copies, n_nodes, 3) [mm], at `time`."""
    velocities: tuple[FloatArray, ...]
    """Half a step before `time` [mm/s]."""
    time: float
    """[s]"""
    n_steps: int
    """Steps done."""
    time_step: float
    """[s]"""
    critical: CriticalTimeStep
    """The largest stable step."""
    history: History
    """Energies and balance."""
    energies: Energies
    """At the last sample."""
    energy_balance: float
    """Largest error of the balance over all samples, relative to the energy turned over."""
    cpu_seconds: float
    """Of the loop, this process."""
    status: str
    """``finished``, ``interrupted`` or ``converged``."""

    @property
    def element_updates_per_cpu_second(self) -> float:
        """Elements times steps over CPU time of the loop."""
        return self.model.n_elements * self.n_steps / max(self.cpu_seconds, 1e-12)


def prepare(
    model: Model,
    *,
    time_step: float,
    precision: str = "float64",
    threads: int = 1,
    interactions: Sequence[Interaction] = (),
) -> System:
    """Make a model ready for the loop.

    Parameters
    ----------
    model
        The statement.
    time_step
        [s]
    precision
        ``float64`` or ``float32``.
    threads
        1 for the serial loops, more for shared rows.
    interactions
        Contact.
    """
    if precision not in PRECISIONS:
        raise TimeStepError(f"fem.precision: got {precision!r}, expected float64 or float32")
    if threads < 1:
        raise TimeStepError(f"fem.threads: got {threads}, expected at least 1")
    if threads > 1:
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    dtype = PRECISIONS[precision]
    bodies = tuple(make_body(model, k, dtype=dtype) for k in range(len(model.groups)))
    kernels = SERIAL if threads == 1 else PARALLEL
    return System(model, bodies, time_step, kernels, tuple(interactions))


def initial_state(
    system: System,
    *,
    displacements: Sequence[FloatArray] | None = None,
    velocities: Sequence[FloatArray] | None = None,
) -> State:
    """State at time 0 with the velocity half a step earlier, v_{-½} = v_0 - ½ Δt a_0.

    Parameters
    ----------
    system
        The model.
    displacements, velocities
        One array for each group, world axes, (n_copies, n_nodes, 3); None: at rest.
    """
    model = system.model
    n = len(system.bodies)
    u = [None] * n if displacements is None else list(displacements)
    v = [None] * n if velocities is None else list(velocities)
    state = State(
        bodies=tuple(
            initial_body_state(body, model.effects, u[k], v[k])
            for k, body in enumerate(system.bodies)
        ),
        mass_damping=0.0
        if model.effects.adaptive_mass_damping is not None
        else model.effects.mass_damping,
    )
    for body, now in zip(system.bodies, state.bodies, strict=True):
        set_internal_force(system, body, now, sample=False)
        forget_rates(now)
        set_applied_force(body, now, 0.0)
    for interaction in system.interactions:
        interaction.add_force(system, state)
    for body, now in zip(system.bodies, state.bodies, strict=True):
        now.velocity -= 0.5 * system.time_step * acceleration(body, now, state.mass_damping)
        if body.support is not None:
            _stop_supported(body, now)
    return state


def forget_rates(now: BodyState) -> None:
    """Start rates from zero: the first evaluation has no step before it."""
    damping, viscous = now.stiffness_damping, now.viscous
    if damping is not None:
        if now.frame is None:
            now.internal_force[:] = damping.elastic
        damping.viscous[:] = 0.0
        damping.dissipated[:] = 0.0
    if viscous is not None:
        viscous.stress[:] = 0.0
        viscous.dissipated[:] = 0.0


def acceleration(body: Body, now: BodyState, mass_damping: float | None) -> FloatArray:
    """Accelerations of the forces that the state holds, placement frame, (n_rows, 3, lanes)."""
    force = -now.internal_force.astype(np.float64)
    if body.applied_row is not None and now.applied_force is not None:
        touched = body.applied_row >= 0
        force[touched] += now.applied_force[body.applied_row[touched]]
    result: FloatArray = force / body.mass[:, None, None]
    if body.acceleration is not None:
        result += body.acceleration
    if mass_damping is not None:
        result -= mass_damping * now.velocity
    return result


def _stop_supported(body: Body, now: BodyState) -> None:
    """Remove the supported components of the first velocity: supports start from rest."""
    support = body.support
    assert support is not None
    flat = now.velocity.ravel()
    index = support.base[:, None] + body.lanes * np.arange(3)
    for k in range(len(index)):
        n = support.direction[k]
        flat[index[k]] -= n * (n @ flat[index[k]])


def choose_time_step(
    critical: CriticalTimeStep, time_step: float | None, safety_factor: float
) -> float:
    """Time step of a run.

    Raises
    ------
    TimeStepError
        A time step above the critical one or a safety factor outside (0, 1].
    """
    if time_step is None:
        if not 0.0 < safety_factor <= 1.0:
            raise TimeStepError(f"fem.safety_factor: got {safety_factor}, expected 0 < factor <= 1")
        return safety_factor * critical.critical_time_step
    if not (math.isfinite(time_step) and time_step > 0.0):
        raise TimeStepError(f"fem.time_step: got {time_step} s, expected a finite positive number")
    if time_step > critical.critical_time_step:
        raise TimeStepError(
            f"fem.time_step: got {time_step:.4g} s, expected at most the critical time step "
            f"{critical.critical_time_step:.4g} s of {critical.group}"
        )
    return time_step


def solve(
    model: Model,
    *,
    end_time: float,
    time_step: float | None = None,
    safety_factor: float = 0.9,
    precision: str = "float64",
    threads: int = 1,
    sample_interval: int = 50,
    displacements: Sequence[FloatArray] | None = None,
    velocities: Sequence[FloatArray] | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> ExplicitResult:
    """Run explicit dynamics from time 0 to ``end_time``.

    Parameters
    ----------
    model
        The statement.
    end_time
        [s]
    time_step
        [s]; None: ``safety_factor`` times the critical time step.
    safety_factor
        In (0, 1].
    precision
        ``float64`` or ``float32``.
    threads
        Threads of the loops.
    sample_interval
        Steps between two samples of the energies, which also watch over stability.
    displacements, velocities
        Initial state, world axes, one (n_copies, n_nodes, 3) for each group.
    progress
        Called at every sample.

    Raises
    ------
    TimeStepError, StateError
        Input that cannot be run.
    UnstableRun
        The solution grew without bound.
    """
    critical = critical_time_step(model)
    dt = choose_time_step(critical, time_step, safety_factor)
    system = prepare(model, time_step=dt, precision=precision, threads=threads)
    state = initial_state(system, displacements=displacements, velocities=velocities)
    n_steps = math.ceil(end_time / dt * (1.0 - 1e-12))
    history = History()
    started = clock.process_time()
    while state.step < n_steps:
        sample = state.step % sample_interval == 0 or state.step == n_steps - 1
        step(system, state, sample=sample)
        if sample:
            values = energies(system, state)
            history.observe(values)
            watch(system, state, history)
            history.append((state.step - 1) * dt, state.step - 1, values, 0.0, 0.0)
            if progress is not None:
                progress(Progress((state.step - 1) * dt, end_time, state.step - 1, n_steps, values))
    cpu = clock.process_time() - started
    pairs = list(zip(system.bodies, state.bodies, strict=True))
    return ExplicitResult(
        model=model,
        displacements=tuple(world_vectors(b, s.displacement) for b, s in pairs),
        velocities=tuple(world_vectors(b, s.velocity) for b, s in pairs),
        time=system.time(state),
        n_steps=state.step,
        time_step=dt,
        critical=critical,
        history=history,
        energies=values,
        energy_balance=float(np.abs(history.column("energy_balance")).max()),
        cpu_seconds=cpu,
        status="finished",
    )


def watch(system: System, state: State, history: History) -> None:
    """Stop a run whose energy is not finite or far beyond what was put in.

    Raises
    ------
    UnstableRun
        With time, block and remedy.
    """
    put_in = history.put_in
    for body, now in zip(system.bodies, state.bodies, strict=True):
        energy = copy_energies(now)[: body.n_copies]
        bad = ~(energy <= RUNAWAY * put_in) if put_in > 0.0 else ~np.isfinite(energy)
        if bad.any():
            copy = int(np.flatnonzero(bad)[0])
            raise UnstableRun(
                f"unstable at t = {system.time(state):.6g} s (step {state.step}): the energy of "
                f"{body.group.name}[{copy}] is {energy[copy]:.3g} N mm, {put_in:.3g} N mm were put "
                f"in; take a smaller fem.safety_factor (time step {system.time_step:.4g} s)"
            )
