"""A run of explicit dynamics around `fem.explicit.step.step`."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from fem.contact.search import SearchedPoints
from fem.explicit.body import world_vectors
from fem.explicit.damping import (
    adapt,
    applied_forces,
    forces_of_supports,
    free_part,
    gravity_forces,
    load_forces,
    residual,
    round_off,
    settling,
)
from fem.explicit.output.checkpoint import (
    StopRequest,
    bytes_of,
    read_checkpoint,
    stop_requests,
    write_checkpoint,
)
from fem.explicit.output.energy import Energies, History, copy_energies, energies
from fem.explicit.start import prepare
from fem.explicit.step import Loop, damped_internal_force, step
from fem.explicit.timed import TimedSystem
from fem.system.body import Body
from fem.system.effects import LEAST_FACTOR, SAFETY_FACTOR
from fem.system.reactions import MovingSupport, PushCurve, moving_supports
from fem.system.time_step import CriticalTimeStep, TimeStepError
from geometry.compilation.clocks import compiling
from geometry.errors import RefusedError
from geometry.machine.work import Budget, Operation, budget, count
from geometry.mesh import FloatArray

#: A block that holds this many times the energy put into the whole model runs away.
RUNAWAY = 100.0

#: Share of the energy turned over by which a run may gain or lose some, and still be an answer.
LARGEST_IMBALANCE = 0.02
#: Relative force residual at which a run to the static state stops [-].
RESIDUAL = 1.0e-4
#: Round-off of positions in units of their last digit, after sums over nodes and turned frames.
_ROUND_OFF = 100.0

#: Samples without a smaller residual after which it is compared with round-off.
_STILL_SAMPLES = 40

#: A residual that stands below so many times the estimate of round-off is round-off: resting runs
#: have 0.2 to 3 times the estimate.
_ROUND_OFF_FACTOR = 4.0


class UnstableRun(RefusedError):  # noqa: N818
    """The solution grows without bound, or makes energy; the remedy is in the message."""

    of_input = False


@dataclass(frozen=True)
class Progress:
    """What a progress callback is told at every sample."""

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
    residual: float | None
    """Force residual, where the run watches it."""

    def __str__(self) -> str:
        """Time, step, energies and residual."""
        energies = self.energies
        words = (
            f"step {self.step} of {self.n_steps}, t {1e3 * self.time:.4g} ms, "
            f"kinetic {energies.kinetic_energy:.3g}, strain {energies.strain_energy:.3g} N mm"
        )
        return words if self.residual is None else f"{words}, residual {self.residual:.1e}"


@dataclass(frozen=True)
class Frame:
    """What a frame callback is given: the displacements at one time, world axes."""

    number: int
    """0, 1, 2, …"""
    time: float
    """[s]"""
    groups: tuple[Body, ...]
    """Congruent blocks with their mesh."""
    displacements: tuple[FloatArray, ...]
    """Of each group, (n_copies, n_nodes, 3) [mm]."""
    last: bool = False
    """Whether the run ended here."""
    restart: int = 0
    """How often the run had started again: frames with a smaller number are of an abandoned run."""


class Status(StrEnum):
    """How a run ended."""

    FINISHED = "finished"
    """Reached its end time."""
    CONVERGED = "converged"
    """Stopped early: the force residual fell below its bound."""
    STALLED = "stalled at round-off"
    """Stopped early: the force residual stands at what round-off leaves."""
    INTERRUPTED = "interrupted"
    """Stopped on request; continue from the checkpoint."""
    STOPPED = "stopped"
    """Stopped at its limit of work or CPU time; continue from the checkpoint."""


#: How a run ends that has not arrived, and that a checkpoint continues.
CUT_SHORT = (Status.INTERRUPTED, Status.STOPPED)


@dataclass(frozen=True)
class Run:
    """How a run went and what it left in the blocks that are computed, in world axes.

    `fem.explicit.setup.timed_system` makes the `fem.state.State` of the whole assembly of it.
    """

    stated: TimedSystem
    """What was computed."""
    status: Status
    """How the run ended."""
    displacements: tuple[FloatArray, ...]
    """Of each group, (n_copies, n_nodes, 3) [mm], at `time`."""
    velocities: tuple[FloatArray, ...]
    """Half a step before `time` [mm/s]."""
    n_steps: int
    """Steps done since time 0."""
    time_step: float
    """[s]"""
    history: History
    """Energies, balance and relative force residual of all samples."""
    settling: float | None
    """Last estimate of the way still to go over the way gone; None where not watched."""
    round_off: float | None
    """Residual that round-off leaves, estimated where the run stalled at it; else None."""
    cpu_seconds: float
    """CPU time of the loop in this process, compilation left out."""
    element_updates: int
    """Elements times steps done in this process."""
    n_bytes: int
    """Memory of the arrays that evolve, and of stiffness, mass and connectivity of the loop."""
    support_forces: tuple[FloatArray, ...] = ()
    """Of the supports on the nodes of each group at `time`, (n_copies, n_nodes, 3) [N]; () where
    nothing is held."""
    contact_forces: tuple[FloatArray, ...] = ()
    """What contact has to do to the nodes at `time`, alike [N]: inertia, damping and internal
    forces, less loads, weight and supports."""
    searched: SearchedPoints | None = None
    """Points of contact at `time`, of the blocks that are computed; None: matched facets."""
    friction: FloatArray | None = None
    """On block s at all points, world axes, (n_facets, n_points, 3) [MPa]; None without."""
    compile_seconds: float = 0.0
    """CPU time in which loops were compiled on the way; zero where all were kept."""
    restarts: int = 0
    """How often it began again because contact outgrew its time step."""
    static_below: float = RESIDUAL
    """Residual below which its end counts as static [-]."""

    @property
    def time(self) -> float:
        """Of the displacements [s]."""
        return self.n_steps * self.time_step

    @property
    def critical(self) -> CriticalTimeStep:
        """The largest stable step."""
        return self.stated.critical

    @property
    def energies(self) -> Energies | None:
        """At the last sample; None before the first."""
        return self.history.energies

    @property
    def residual(self) -> float | None:
        """Last force residual, relative; None when the run did not watch it."""
        return self.history.residual

    @property
    def pushed(self) -> tuple[PushCurve, ...]:
        """Force against displacement of each support that moves, at the samples."""
        if len(self.history.pushes) < 2:
            return ()
        times, *forces = zip(*self.history.pushes, strict=True)
        return tuple(
            support.curve(dict(zip(times, of, strict=True)))
            for support, of in zip(moving_supports(self.stated.system), forces, strict=True)
        )

    @property
    def energy_balance(self) -> float:
        """Largest error of the balance over all samples, relative to the energy turned over."""
        return float(np.abs(self.history.column("energy_balance")).max(initial=0.0))

    @property
    def element_updates_per_cpu_second(self) -> float:
        """Whole-step rate of this process."""
        return self.element_updates / max(self.cpu_seconds, 1e-12)


def choose_time_step(
    critical: CriticalTimeStep, time_step: float | None, safety_factor: float
) -> float:
    """Time step of a run."""
    if time_step is None:
        if not LEAST_FACTOR <= safety_factor <= 1.0:
            raise TimeStepError(
                f"safety_factor: got {safety_factor}, expected a number from {LEAST_FACTOR:g} to 1"
            )
        return safety_factor * critical.critical_time_step
    if not (math.isfinite(time_step) and time_step > 0.0):
        raise TimeStepError(f"time_step: got {time_step} s, expected a finite positive number")
    if time_step > critical.critical_time_step:
        raise TimeStepError(
            f"time_step: got {time_step:.4g} s, expected at most the critical time step "
            f"{critical.critical_time_step:.4g} s of {critical.group}"
        )
    if time_step < LEAST_FACTOR * critical.critical_time_step:
        raise TimeStepError(
            f"time_step: got {time_step:.4g} s, expected at least {LEAST_FACTOR:g} of the critical "
            f"time step, {critical.critical_time_step:.4g} s of {critical.group}"
        )
    return time_step


@dataclass(frozen=True)
class Output:
    """Callbacks and files of a run; all off by default."""

    progress: Callable[[Progress], None] | None = None
    """Called at every sample."""
    on_frame: Callable[[Frame], None] | None = None
    """Called with the displacements every `frame_interval`, and at the end."""
    frame_interval: float = math.inf
    """[s]"""
    checkpoint: Path | None = None
    """File that is written where the run is cut short, and every `checkpoint_seconds`."""
    checkpoint_seconds: float = 60.0
    """Wall time between two checkpoints [s]."""


@dataclass(frozen=True)
class StopCriterion:
    """When a quasi-static run has arrived."""

    residual: float
    """Relative force residual, see `fem.explicit.damping.residual`."""
    not_before: float = 0.0
    """End of the loading [s]."""
    settling: float = 1e-3
    """Bound on `fem.explicit.damping.settling`, the way still to go over the way gone, where the
    run adapts its mass damping: in a soft assembly small forces still move much."""


def run_explicit(
    stated: TimedSystem,
    *,
    end_time: float,
    time_step: float | None = None,
    safety_factor: float = SAFETY_FACTOR,
    threads: int = 1,
    sample_interval: int = 50,
    displacements: Sequence[FloatArray] | None = None,
    velocities: Sequence[FloatArray] | None = None,
    stop: StopCriterion | None = None,
    max_work: float = math.inf,
    max_seconds: float = math.inf,
    output: Output | None = None,
    resume: Path | None = None,
) -> Run:
    """Run explicit dynamics from time 0, or from a checkpoint, to ``end_time``.

    Ctrl-C and SIGTERM stop the run after the step at hand, write the checkpoint if there is one
    and return with `Status.INTERRUPTED`.

    Parameters
    ----------
    stated
        What is computed.
    end_time
        [s]
    time_step
        [s]; None: ``safety_factor`` times the critical time step.
    safety_factor
        In (0, 1].
    threads
        Threads of the loops; the bits of the result do not depend on it.
    sample_interval
        Steps between two samples of the energies, which also watch over stability.
    displacements, velocities
        Initial state, world axes, one (n_copies, n_nodes, 3) for each group.
    stop
        Stop early at the static state.
    max_work, max_seconds
        Work of the loop (`geometry.machine.work`) [reference s], and its CPU time [s]: after the
        next sample it ends as by Ctrl-C, with `Status.STOPPED`.
    output
        Callbacks and checkpoint.
    resume
        Checkpoint to continue from; the same problem must be stated.

    Raises
    ------
    TimeStepError, StateError, CheckpointError
        Input that cannot be run.
    UnstableRun
        The solution grew without bound, or its energies do not balance; nothing not finite is
        passed to a callback.
    """
    if not (math.isfinite(end_time) and end_time > 0.0):
        raise TimeStepError(f"end_time: got {end_time} s, expected a finite positive number")
    if sample_interval < 1:
        raise TimeStepError(f"sample_interval: got {sample_interval}, expected at least 1")
    dt = choose_time_step(stated.critical, time_step, safety_factor)
    loop = prepare(
        stated, time_step=dt, threads=threads, displacements=displacements, velocities=velocities
    )
    history = History() if resume is None else read_checkpoint(resume, loop)
    run = _Course(
        loop=loop,
        history=history,
        output=output or Output(),
        stop=stop,
        end_time=end_time,
        n_steps=math.ceil(end_time / dt * (1.0 - 1e-12)),
        sample_interval=sample_interval,
        max_work=max_work,
        ends=clock.process_time() + max_seconds,
        moving=moving_supports(stated.system),
    )
    first = run.counted = loop.step
    started = clock.process_time()
    with stop_requests() as request, compiling() as compiled, budget() as run.spent:
        status = run.steps(request)
    result = Run(
        stated=stated,
        status=status,
        time_step=loop.time_step,
        history=history,
        settling=run.settling,
        round_off=run.round_off if status is Status.STALLED else None,
        cpu_seconds=clock.process_time() - started - compiled.cpu_seconds,
        compile_seconds=compiled.cpu_seconds,
        element_updates=stated.n_elements * (loop.step - first),
        n_bytes=bytes_of(loop),
        displacements=displacements_of(loop),
        velocities=tuple(world_vectors(body, body.now.velocity) for body in loop.bodies),
        n_steps=loop.step,
        **_forces_at_end(loop),
    )
    _refuse_imbalance(result)
    return result


@dataclass
class _Course:
    """What is around the steps: samples, watchdog, frames, checkpoints."""

    loop: Loop
    history: History
    output: Output
    stop: StopCriterion | None
    end_time: float
    n_steps: int
    sample_interval: int
    max_work: float = math.inf
    """Limit of the work of this process [reference s]."""
    ends: float = math.inf
    """Limit of the CPU time of this process [s]."""
    spent: Budget = field(default_factory=Budget)
    """Work of this process."""
    counted: int = 0
    """Steps whose work was counted."""
    settling: float | None = None
    round_off: float | None = None
    still: int = 0
    least_residual: float = math.inf
    moving: tuple[MovingSupport, ...] = ()
    """Supports that move."""
    last_checkpoint: float = field(default_factory=clock.monotonic)

    def steps(self, request: StopRequest) -> Status:
        loop = self.loop
        adaptive = loop.stated.effects.adaptive_mass_damping
        status = Status.FINISHED
        self.frame()
        while loop.step < self.n_steps and status is Status.FINISHED:
            sample = self.sample_due()
            step(loop, sample=sample)
            if sample:
                status = self.sample()
            if adaptive is not None and loop.step % adaptive.interval == 0:
                adapt(loop, adaptive)
            if sample and status is Status.FINISHED and self.at_limit():
                status = Status.STOPPED
            if request.requested:
                status = Status.INTERRUPTED
            self.frame(ended=status in (Status.CONVERGED, Status.STALLED))
            self.checkpoint(force=status in CUT_SHORT)
        return status

    def at_limit(self) -> bool:
        """Count the steps since the last call; whether a limit is reached before the end."""
        steps, self.counted = self.loop.step - self.counted, self.loop.step
        count(Operation.STEP, float(steps * self.loop.stated.n_elements))
        count(Operation.TOUCH, steps * sum(i.touched_points() for i in self.loop.interactions))
        late = clock.process_time() >= self.ends
        if self.loop.step == self.n_steps or not (late or self.spent.seconds >= self.max_work):
            return False
        self.spent.mark("work" if self.spent.seconds >= self.max_work else "clock")
        return True

    def sample_due(self) -> bool:
        """Whether the coming step is sampled: regularly, at the end, and before each frame."""
        number = self.loop.step
        regular = number % self.sample_interval == 0 or number == self.n_steps - 1
        return regular or self.frame_due(number + 1)

    def sample(self) -> Status:
        """Energies at the beginning of the step just done; whether the run has arrived."""
        loop = self.loop
        number = loop.step - 1
        time = number * loop.time_step
        now = energies(loop)
        if self.moving:
            forces = loop.stated.expand(forces_of_supports(loop, time))
            self.history.pushes.append((time, *(each.force(forces) for each in self.moving)))
        self.history.observe(now)
        watch(loop, self.history)
        shown = math.nan
        if self.stop is not None:
            shown, self.settling = residual(loop).relative, settling(loop)
        self.history.append(time, number, now, loop.mass_damping or 0.0, shown)
        if self.output.progress is not None:
            reported = Progress(
                time, self.end_time, number + 1, self.n_steps, now, self.history.residual
            )
            self.output.progress(reported)
        if self.stop is None or time < self.stop.not_before:
            return Status.FINISHED
        settled = self.settling is None or self.settling <= self.stop.settling
        if shown <= self.stop.residual and settled:
            return Status.CONVERGED
        return Status.STALLED if self.stalled(shown, self.stop.residual) else Status.FINISHED

    def stalled(self, residual: float, bound: float) -> bool:
        """Whether the residual has stopped falling at what round-off leaves of it."""
        if not bound:
            return False
        self.still = self.still + 1 if residual > self.least_residual else 0
        self.least_residual = min(residual, self.least_residual)
        if self.still < _STILL_SAMPLES or self.least_residual <= bound:
            return False
        self.still = 0
        self.round_off = round_off(self.loop)
        return self.least_residual <= _ROUND_OFF_FACTOR * self.round_off

    def frame_number(self, number: int) -> int:
        """Number of the frame interval that the time of step ``number`` lies in."""
        return int(number * self.loop.time_step / self.output.frame_interval * (1.0 + 1e-12))

    def frame_due(self, number: int) -> bool:
        """Whether a frame is due at step ``number``."""
        if self.output.on_frame is None:
            return False
        if number in (0, self.n_steps):
            return True
        return self.frame_number(number) > self.frame_number(number - 1)

    def frame(self, *, ended: bool = False) -> None:
        """Pass the displacements on when a frame is due, and where the run ended."""
        loop = self.loop
        ended = ended or loop.step == self.n_steps
        if self.output.on_frame is None or not (ended or self.frame_due(loop.step)):
            return
        fields = displacements_of(loop)
        # The end comes after all that were due before, where it lies between two of them.
        number = self.frame_number(loop.step - 1) + 1 if ended else self.frame_number(loop.step)
        groups = loop.stated.bodies
        self.output.on_frame(Frame(number, loop.time, groups, fields, last=ended))

    def checkpoint(self, *, force: bool) -> None:
        """Write the checkpoint when it is time."""
        path = self.output.checkpoint
        if path is None:
            return
        now = clock.monotonic()
        if force or now - self.last_checkpoint >= self.output.checkpoint_seconds:
            write_checkpoint(path, self.loop, self.history)
            self.last_checkpoint = now


def displacements_of(loop: Loop) -> tuple[FloatArray, ...]:
    """Displacements of each group in world axes, (n_copies, n_nodes, 3) [mm]."""
    return tuple(world_vectors(body, body.now.displacement) for body in loop.bodies)


def _refuse_imbalance(result: Run) -> None:
    """Reject the end of a run that made energy out of nothing, or lost some."""
    balance = result.energy_balance
    if result.status in CUT_SHORT or balance <= LARGEST_IMBALANCE:
        return
    if result.history.turnover > _round_off_energy(result):
        raise UnstableRun(
            f"unstable: energies, damping and friction differ from the external work by "
            f"{100.0 * balance:.3g} % of the energy turned over, at most "
            f"{100.0 * LARGEST_IMBALANCE:g} % may be; take a smaller `time_step` or "
            f"`safety_factor` (time step {result.time_step:.4g} s)"
        )


def _round_off_energy(result: Run) -> float:
    """Strain energy of the round-off of all positions [N mm]: what turns over less is no energy."""
    total = 0.0
    for group, moved in zip(result.stated.bodies, result.displacements, strict=True):
        reach = np.abs(group.reference_positions()).max() + np.abs(moved).max(initial=0.0)
        error = _ROUND_OFF * np.finfo(np.float64).eps * reach
        stiffest = float(np.abs(group.stiffness.diagonal()).max())
        total += stiffest * group.n_nodes * group.n_copies * error**2
    return total


def _forces_at_end(loop: Loop) -> dict[str, Any]:
    """Forces of the displacements that a loop has, from the step that they begin."""
    time, before = loop.time, [body.now.velocity.copy() for body in loop.bodies]
    moved = loop.stated.in_system(displacements_of(loop))
    step(loop)
    contact, supports = [], []
    for body, velocity in zip(loop.bodies, before, strict=True):
        change, mean = body.now.velocity - velocity, 0.5 * (body.now.velocity + velocity)
        inertia = change / loop.time_step + (loop.mass_damping or 0.0) * mean
        inner = body.mass[:, None, None] * inertia
        inner += damped_internal_force(loop, body)
        inner -= gravity_forces(loop, body, time)
        unbalanced = inner - applied_forces(body)
        held = unbalanced - free_part(body, unbalanced)
        supports.append(world_vectors(body, held))
        contact.append(world_vectors(body, inner - load_forces(body, time) - held))
    searched, friction = loop.interactions[0].contact(moved) if loop.interactions else (None, None)
    return {
        "support_forces": tuple(supports) if len(loop.stated.system.supports.block) else (),
        "contact_forces": tuple(contact),
        "searched": searched,
        "friction": friction,
    }


def watch(loop: Loop, history: History) -> None:
    """Stop a run whose energy is not finite or far beyond what was put in."""
    for interaction in loop.interactions:
        fault = interaction.fault(loop)
        if fault is not None:
            raise UnstableRun(f"t = {loop.time:.6g} s (step {loop.step}): {fault}")
    put_in = history.put_in
    for body in loop.bodies:
        energy = copy_energies(body.now)[: body.n_copies]
        bad = ~(energy <= RUNAWAY * put_in) if put_in > 0.0 else ~np.isfinite(energy)
        if bad.any():
            copy = int(np.flatnonzero(bad)[0])
            raise UnstableRun(
                f"unstable at t = {loop.time:.6g} s (step {loop.step}): the energy of "
                f"{body.group.name}[{copy}] is {energy[copy]:.3g} N mm, the external work "
                f"{put_in:.3g} N mm; take a smaller `safety_factor` (time step "
                f"{loop.time_step:.4g} s)"
            )
