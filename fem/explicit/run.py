"""How an explicit run went: what it took, how near it came to rest, how it ended."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fem.explicit.damping import round_off, settling
from fem.explicit.output.energy import Energies, History
from fem.explicit.step import Loop
from fem.explicit.timed import TimedSystem
from fem.system.reactions import PushCurve
from fem.system.time_step import CriticalTimeStep

#: Samples without a smaller residual after which it is compared with round-off.
_STILL_SAMPLES = 40

#: A residual that stands below so many times the estimate of round-off is round-off: resting runs
#: have 0.2 to 3 times the estimate.
_ROUND_OFF_FACTOR = 4.0

#: Way still to go over the way gone (`fem.explicit.damping.settling`) of a run that has arrived: in
#: a soft assembly small forces still move much.
_SETTLED = 1e-3


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


@dataclass
class Rest:
    """Whether a run comes to rest, at its samples."""

    below: float
    """Relative force residual of a static state, see `fem.explicit.damping.residual`."""
    stops: bool
    """Whether the run ends there."""
    settling: float | None = None
    """Last estimate of the way still to go over the way gone, where mass damping adapts."""
    round_off: float | None = None
    """Residual that round-off leaves, estimated where the run stalled at it."""
    least: float = math.inf
    """Smallest residual so far."""
    still: int = 0
    """Samples since then."""

    def judge(self, loop: Loop, found: float, *, loaded: bool) -> Status:
        """Whether the run may end with a residual, once loads and supports have arrived."""
        self.settling = settling(loop)
        if not (self.stops and loaded):
            return Status.FINISHED
        if found <= self.below and (self.settling is None or self.settling <= _SETTLED):
            # Where cuts lag behind, a residual is small about another state.
            here = all(each.follows() for each in loop.interactions)
            return Status.CONVERGED if here else Status.FINISHED
        return Status.STALLED if self._stalls(loop, found) else Status.FINISHED

    def _stalls(self, loop: Loop, found: float) -> bool:
        """Whether the residual has stopped falling at what round-off leaves of it."""
        self.still = self.still + 1 if found > self.least else 0
        self.least = min(found, self.least)
        if self.still < _STILL_SAMPLES or self.least <= self.below:
            return False
        self.still, estimate = 0, round_off(loop)
        self.round_off = estimate if self.least <= _ROUND_OFF_FACTOR * estimate else None
        return self.round_off is not None


@dataclass(frozen=True)
class Cost:
    """What a run took in this process."""

    cpu_seconds: float
    """CPU time of the loop, compilation left out."""
    compile_seconds: float
    """CPU time in which loops were compiled on the way; zero where all were kept."""
    element_updates: int
    """Elements times steps done."""
    n_bytes: int
    """Memory of the arrays that evolve, and of stiffness, mass and connectivity of the loop."""

    @property
    def element_updates_per_cpu_second(self) -> float:
        """Whole-step rate."""
        return self.element_updates / max(self.cpu_seconds, 1e-12)


@dataclass(frozen=True)
class Run:
    """How a run went; `fem.state.State` has the arrays of its end."""

    stated: TimedSystem
    """What was computed."""
    status: Status
    """How the run ended."""
    n_steps: int
    """Steps done since time 0."""
    time_step: float
    """[s]"""
    history: History
    """Energies, balance and relative force residual of all samples, of the whole assembly."""
    rest: Rest | None
    """How near it came to rest; None where not watched."""
    cost: Cost
    """Times and memory."""
    restarts: int = 0
    """How often it began again because contact outgrew its time step."""

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
            for support, of in zip(self.stated.moving, forces, strict=True)
        )

    @property
    def energy_balance(self) -> float:
        """Largest error of the balance over all samples, relative to the energy turned over."""
        return float(np.abs(self.history.column("energy_balance")).max(initial=0.0))
