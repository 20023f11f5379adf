"""A run of explicit dynamics around `fem.explicit.step.step`."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fem.explicit.body import world_vectors
from fem.explicit.damping import (
    adapt,
    applied_forces,
    forces_of_supports,
    free_part,
    gravity_forces,
    load_forces,
    residual,
)
from fem.explicit.output.checkpoint import (
    StopRequest,
    bytes_of,
    read_checkpoint,
    stop_requests,
    write_checkpoint,
)
from fem.explicit.output.energy import Energies, History, copy_energies, energies
from fem.explicit.run import CUT_SHORT, Cost, Rest, Run, Status
from fem.explicit.start import prepare
from fem.explicit.step import Loop, damped_internal_force, step
from fem.explicit.timed import TimedSystem
from fem.method import Explicit
from fem.state import State
from fem.system.body import Body
from fem.system.effects import LEAST_FACTOR
from fem.system.time_step import CriticalTimeStep, TimeStepError
from geometry.errors import RefusedError
from geometry.machine.work import Budget, Operation, budget, compiling, count
from geometry.machine.work import clock as cpu_clock
from geometry.mesh import FloatArray

#: A block that holds this many times the energy put into the whole model runs away.
RUNAWAY = 100.0

#: Share of the energy turned over by which a run may gain or lose some, and still be an answer.
LARGEST_IMBALANCE = 0.02
#: Round-off of positions in units of their last digit, after sums over nodes and turned frames.
_ROUND_OFF = 100.0

_DEFAULT = Explicit()


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
    bodies: tuple[Body, ...]
    """Congruent blocks with their mesh, all copies."""
    displacements: tuple[FloatArray, ...]
    """Of each body, (n_copies, n_nodes, 3) [mm]."""
    last: bool = False
    """Whether the run ended here."""
    restart: int = 0
    """How often the run had started again: frames with a smaller number are of an abandoned run."""


def choose_time_step(critical: CriticalTimeStep, method: Explicit) -> float:
    """Time step of a run."""
    time_step, longest = method.time_step, critical.critical_time_step
    if time_step is None:
        return method.safety_factor * longest
    if time_step > longest:
        raise TimeStepError(
            f"time_step: got {time_step:.4g} s, expected at most the critical time step "
            f"{longest:.4g} s of {critical.body}"
        )
    if time_step < LEAST_FACTOR * longest:
        raise TimeStepError(
            f"time_step: got {time_step:.4g} s, expected at least {LEAST_FACTOR:g} of the critical "
            f"time step, {longest:.4g} s of {critical.body}"
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


def run_explicit(
    stated: TimedSystem,
    method: Explicit = _DEFAULT,
    output: Output | None = None,
    *,
    resume: Path | None = None,
    restarts: int = 0,
) -> State:
    """Run explicit dynamics from time 0, or from a checkpoint, to the end that is stated.

    Ctrl-C and SIGTERM stop the run after the step at hand, write the checkpoint if there is one
    and return with `Status.INTERRUPTED`; limits of work or CPU time do so after the next sample,
    with `Status.STOPPED`.

    Parameters
    ----------
    stated
        What is computed.
    method
        Time step, threads, samples, residual and limits; all else of it is stated.
    output
        Callbacks, of all blocks, and checkpoint.
    resume
        Checkpoint to continue from; the same problem must be stated.
    restarts
        How often it began before.

    Raises
    ------
    TimeStepError, StateError, CheckpointError
        Input that cannot be run.
    UnstableRun
        The solution grew without bound, or its energies do not balance; nothing not finite is
        passed to a callback.
    """
    dt = choose_time_step(stated.critical, method)
    loop = prepare(stated, time_step=dt, threads=method.threads)
    history = History() if resume is None else read_checkpoint(resume, loop)
    to_rest = stated.effects.adaptive_mass_damping is not None
    # A run that is not damped to the static state watches the residual and goes on.
    watched = to_rest or stated.times.recommended is not None
    rest = Rest(method.residual, to_rest) if watched else None
    first, started = loop.step, clock.process_time()
    # What is not finite is for the watchdog to tell, at the next sample.
    silent = np.errstate(all="ignore")
    with silent, stop_requests() as request, compiling() as compiled, budget() as spent:
        course = _Course(loop, method, output or Output(), history, rest, spent, restarts)
        status = course.steps(request)
    cost = Cost(
        cpu_seconds=clock.process_time() - started - compiled.cpu_seconds,
        compile_seconds=compiled.cpu_seconds,
        element_updates=stated.n_elements * (loop.step - first),
        n_bytes=bytes_of(loop),
    )
    run = Run(stated, status, loop.step, loop.time_step, history, rest, cost, restarts)
    _refuse_imbalance(run, displacements_of(loop))
    whole = replace(run, history=history.times(stated.system.orbits.copies))
    return _state_at_end(loop, whole)


@dataclass
class _Course:
    """What is around the steps: samples, watchdog, frames, checkpoints, limits."""

    loop: Loop
    method: Explicit
    output: Output
    history: History
    rest: Rest | None
    spent: Budget
    """Work of this process."""
    restarts: int

    def __post_init__(self) -> None:
        self.n_steps = math.ceil(self.loop.stated.times.end / self.loop.time_step * (1.0 - 1e-12))
        self.ends = cpu_clock(self.method.max_seconds)
        self.counted, self.last_checkpoint = self.loop.step, clock.monotonic()

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
        most, late = self.method.max_work, clock.process_time() >= self.ends
        worked = most is not None and self.spent.seconds >= most
        if self.loop.step == self.n_steps or not (late or worked):
            return False
        self.spent.mark("work" if worked else "clock")
        return True

    def sample_due(self) -> bool:
        """Whether the coming step is sampled: regularly, at the end, and before each frame."""
        number = self.loop.step
        regular = number % self.method.sample_interval == 0 or number == self.n_steps - 1
        return regular or self.frame_due(number + 1)

    def sample(self) -> Status:
        """Energies at the beginning of the step just done; whether the run has arrived."""
        loop = self.loop
        number = loop.step - 1
        time = number * loop.time_step
        now = energies(loop)
        stated, copies = loop.stated, loop.stated.system.orbits.copies
        if stated.moving:
            forces = stated.expand(forces_of_supports(loop, time))
            self.history.pushes.append((time, *(each.force(forces) for each in stated.moving)))
        self.history.observe(now)
        watch(loop, self.history)
        shown, status = math.nan, Status.FINISHED
        if self.rest is not None:
            shown = residual(loop).relative
            status = self.rest.judge(loop, shown, loaded=time >= stated.times.settled)
        self.history.append(time, number, now, loop.mass_damping or 0.0, shown)
        if self.output.progress is not None:
            left = stated.times.end, number + 1, self.n_steps
            told = Progress(time, *left, now.times(copies), self.history.residual)
            self.output.progress(told)
        return status

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
        stated = loop.stated
        moved = stated.expand(displacements_of(loop))
        # The end comes after all that were due before, where it lies between two of them.
        number = self.frame_number(loop.step - 1) + 1 if ended else self.frame_number(loop.step)
        bodies, again = stated.system.whole.bodies, self.restarts
        self.output.on_frame(Frame(number, loop.time, bodies, moved, last=ended, restart=again))

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
    """Displacements of each body in world axes, (n_copies, n_nodes, 3) [mm]."""
    return tuple(world_vectors(body, body.now.displacement) for body in loop.bodies)


def _refuse_imbalance(result: Run, displacements: tuple[FloatArray, ...]) -> None:
    """Reject the end of a run that made energy out of nothing, or lost some."""
    balance = result.energy_balance
    if result.status in CUT_SHORT or balance <= LARGEST_IMBALANCE:
        return
    if result.history.turnover > _round_off_energy(result.stated.bodies, displacements):
        raise UnstableRun(
            f"unstable: energies, damping and friction differ from the external work by "
            f"{100.0 * balance:.3g} % of the energy turned over, at most "
            f"{100.0 * LARGEST_IMBALANCE:g} % may be; take a smaller `time_step` or "
            f"`safety_factor` (time step {result.time_step:.4g} s)"
        )


def _round_off_energy(bodies: tuple[Body, ...], displacements: tuple[FloatArray, ...]) -> float:
    """Strain energy of the round-off of all positions [N mm]: what turns over less is no energy."""
    total = 0.0
    for body, moved in zip(bodies, displacements, strict=True):
        reach = np.abs(body.reference_positions()).max() + np.abs(moved).max(initial=0.0)
        error = _ROUND_OFF * np.finfo(np.float64).eps * reach
        stiffest = float(np.abs(body.stiffness.diagonal()).max())
        total += stiffest * body.n_nodes * body.n_copies * error**2
    return total


def _state_at_end(loop: Loop, run: Run) -> State:
    """State of the displacements that a loop has, with the forces of the step that they begin."""
    stated, system, time = loop.stated, loop.stated.system, loop.time
    before = [body.now.velocity.copy() for body in loop.bodies]
    velocity = stated.of_system(tuple(map(world_vectors, loop.bodies, before)))
    displacements = displacements_of(loop)
    moved = stated.in_system(displacements)
    step(loop)
    contact, supports = [], []
    for body, earlier in zip(loop.bodies, before, strict=True):
        change, mean = body.now.velocity - earlier, 0.5 * (body.now.velocity + earlier)
        inertia = change / loop.time_step + (loop.mass_damping or 0.0) * mean
        inner = body.mass[:, None, None] * inertia
        inner += damped_internal_force(loop, body)
        inner -= gravity_forces(loop, body, time)
        unbalanced = inner - applied_forces(body)
        held = unbalanced - free_part(body, unbalanced)
        supports.append(world_vectors(body, held))
        contact.append(world_vectors(body, inner - load_forces(body) - held))
    searched, friction = loop.interactions[0].contact(moved) if loop.interactions else (None, None)
    held_nodes = len(system.whole.supports.block) > 0
    return State(
        system=system if searched is None else system.on(searched),
        displacement=stated.of_system(displacements),
        velocity=velocity,
        friction=friction,
        support_force=stated.of_system(tuple(supports)) if held_nodes else None,
        contact_force=stated.of_system(tuple(contact)),
        time=time,
        run=run,
    )


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
                f"{body.body.name}[{copy}] is {energy[copy]:.3g} N mm, the external work "
                f"{put_in:.3g} N mm; take a smaller `safety_factor` (time step "
                f"{loop.time_step:.4g} s)"
            )
