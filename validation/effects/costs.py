"""What each effect changes in the answer of a tube, and what it costs.

The base has no effect at all. Each effect is added to it by itself. The answer is the state
at which adaptive mass damping arrives; Rayleigh's mass damping takes the place of that. Costs
are CPU times of the same number of steps, in turns with the base, the least of some rounds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fem.decks.problem import PAPER_RAYLEIGH
from fem.explicit.output.checkpoint import state_arrays
from fem.explicit.solve import initial_state, prepare
from fem.explicit.state import State
from fem.explicit.step import System, step
from fem.problem.time_step import critical_time_step
from validation.build.cell import refuse_cell
from validation.build.deformable import build_deformable, fem_section
from validation.effects.probe import Answer, Change, answer_of, change
from validation.errors import InputError
from validation.run.solve import run_explicit, scene_statement
from validation.scene.deformable import (
    BulkViscositySection,
    Damping,
    EffectsSection,
    FrictionSection,
    Method,
    RayleighSection,
)
from validation.scene.read import DeformableScene

#: Steps of one timing, after as many for warming up; and rounds of which the least counts.
TIMED_STEPS = 60
ROUNDS = 3
#: Standard gravity downward [mm/s²].
GRAVITY = (0.0, 0.0, -9806.65)
#: Clearance that is switched on where a scene has none [mm].
CLEARANCE = 0.01
#: Coefficient of friction that is switched on where a scene has none [-].
FRICTION = 0.1
#: Periods of the lowest excited mode that a run with constant critical damping is given.
_PERIODS = 20.0


@dataclass(frozen=True)
class Effect:
    """An effect that can be added to a scene without any."""

    name: str
    setting: str
    """The value that is switched on."""
    changes: Mapping[str, Any]
    """Of the scene, by place."""
    note: str = ""


@dataclass(frozen=True)
class EffectCost:
    """What an effect changes and costs."""

    effect: Effect
    change: Change | None
    """Of the answer; None where none was measured."""
    step: float
    """CPU time of a step over that of the base [-]."""
    memory: float
    """State and constants over those of the base [-]."""
    time_step: float
    """Critical time step over that of the base [-]."""
    new_forms: int
    """Compiled forms of kernels that the effect needed and nothing before it had."""
    off_compiles: int
    """Forms that the base compiled when it ran again after the effect: zero if off is absent."""
    same_bits: bool
    """Whether the base then gave the bits that it gave before any effect was used."""

    def matters(self, tolerance: float) -> bool | None:
        """Whether it changes any quantity by more than a share; None where none was measured."""
        return None if self.change is None else self.change.matters(tolerance)


@dataclass(frozen=True)
class EffectReport:
    """The base and all effects."""

    scene: str
    answer: Answer | None
    """Of the base; None where the static state was not asked for."""
    seconds_per_step: float
    bytes: int
    costs: tuple[EffectCost, ...]


def bare(scene: DeformableScene) -> DeformableScene:
    """Return the scene without any effect, to be run explicitly to its static state."""
    still = {"method": Method.EXPLICIT, "damping": Damping.STATIC, "frames": 0}
    closed = {"clearance": 0.0, "spacing": 0.0}
    return scene.changed({"fem": still, "contact": closed, "effects": EffectsSection()})


def effects_of(scene: DeformableScene, mass_damping: float) -> tuple[Effect, ...]:
    """Every effect with the scene's own value, or a usual one where the scene has none."""
    own = scene.effects
    rayleigh = own.rayleigh or RayleighSection()
    beta = rayleigh.stiffness_proportional or PAPER_RAYLEIGH.stiffness_proportional or 0.0
    viscosity = own.bulk_viscosity or BulkViscositySection()
    friction = own.friction or FrictionSection(coefficient=FRICTION)
    gravity = own.gravity or GRAVITY
    clearance = scene.contact.clearance or CLEARANCE
    return (
        Effect("friction", f"μ = {friction.coefficient:g}", {"effects.friction": friction}),
        Effect(
            "Rayleigh mass",
            f"α = {mass_damping:.3g} /s",
            {
                "fem.damping": None,
                "effects.rayleigh": RayleighSection(mass_proportional=mass_damping),
            },
            "critical for the lowest excited mode; in place of adaptive damping",
        ),
        Effect(
            "Rayleigh stiffness",
            f"β = {beta:g} s",
            {"effects.rayleigh": RayleighSection(stiffness_proportional=beta)},
        ),
        Effect(
            "bulk viscosity",
            f"b₁ = {viscosity.linear_bulk_viscosity:g}, "
            f"b₂ = {viscosity.quadratic_bulk_viscosity:g}",
            {"effects.bulk_viscosity": viscosity},
        ),
        Effect("finite rotation", "on", {"effects.finite_rotation": True}),
        Effect("finite sliding", "on", {"effects.finite_sliding": True}),
        Effect("frame elasticity", "on", {"effects.elastic_frame": True}),
        Effect("clearance", f"{clearance:g} mm", {"contact.clearance": clearance}),
        Effect("gravity", f"{abs(gravity[2]):g} mm/s² down", {"effects.gravity": gravity}),
    )


def compiled_forms() -> frozenset[tuple[str, str]]:
    """Compiled functions of the solver and the signatures they have been compiled for so far."""
    found = set()
    for name, module in list(sys.modules.items()):
        if name.startswith("fem."):
            for value in list(vars(module).values()):
                for form in getattr(value, "nopython_signatures", ()):
                    found.add((value.__name__, str(form)))
    return frozenset(found)


def ready(scene: DeformableScene, name: str) -> tuple[System, State]:
    """Model of a scene at its first step."""
    statement = scene_statement(scene, name, build_deformable(scene, name))
    model = statement.assembly.model
    system = prepare(model, time_step=0.5 * critical_time_step(model).critical_time_step)
    return system, initial_state(system)


def advance(system: System, state: State) -> float:
    """Do some steps; CPU seconds of one."""
    start = time.thread_time()
    for _ in range(TIMED_STEPS):
        step(system, state)
    return (time.thread_time() - start) / TIMED_STEPS


def _bits(scene: DeformableScene, name: str) -> bytes:
    system, state = ready(scene, name)
    advance(system, state)
    return b"".join(now.displacement.tobytes() for now in state.bodies)


def _bytes(system: System, state: State) -> int:
    arrays = sum(a.nbytes for a in state_arrays(system, state).values())
    return arrays + sum(body.constant_bytes for body in system.bodies)


@dataclass(frozen=True)
class _Base:
    """The scene without effects, and what every effect is compared with."""

    scene: DeformableScene
    name: str
    bits: bytes
    ramp_time: float
    frequency: float
    answer: Answer | None
    """None where the static state is not asked for."""


def effect_costs(
    scene: DeformableScene,
    name: str,
    *,
    answers: bool = True,
    told: Callable[[str], None] | None = None,
) -> EffectReport:
    """Measure every effect of a deformable tube, and tell what is measured next.

    Without ``answers``, no runs to the static state are made: costs alone.

    Raises
    ------
    InputError
        For a scene that cannot be run, or a base that does not arrive at its static state.
    """
    fem_section(scene, name)
    refuse_cell(scene, name, "effects")
    base = bare(scene)
    say = told or (lambda _: None)
    say("no effect")
    first_bits = _bits(base, name)
    system, state = ready(base, name)
    statement = scene_statement(base, name, build_deformable(base, name))
    answer = None
    if answers:
        found = run_explicit(name, base)
        result = found.solution.explicit
        assert result is not None
        if str(result.status) != "converged":
            raise InputError(
                f"{name}: the scene without effects did not arrive at its static state by "
                f"{result.time:.3g} s; expected a larger fem.end_time, or none"
            )
        answer = answer_of(found.solution)
    step_time = min(advance(system, state) for _ in range(ROUNDS))
    assert statement.recommended is not None  # blocks meet
    frequency = statement.recommended.frequency
    given = _Base(base, name, first_bits, statement.ramp_time, frequency, answer)
    costs = tuple(_measure(given, say))
    return EffectReport(
        scene=name,
        answer=answer,
        seconds_per_step=step_time,
        bytes=_bytes(system, state),
        costs=costs,
    )


def _measure(base: _Base, say: Callable[[str], None]) -> Iterator[EffectCost]:
    """Measure one effect after the other."""
    name = base.name
    for effect in effects_of(base.scene, 4.0 * np.pi * base.frequency):
        say(effect.name)
        scene = base.scene.changed(effect.changes)
        times = {"ramp_time": base.ramp_time}
        if scene.fem.damping is None:
            times["end_time"] = base.ramp_time + _PERIODS / base.frequency
        scene = scene.changed({"fem": times})
        before = compiled_forms()
        system, state = ready(scene, name)
        advance(system, state)
        new = len(compiled_forms() - before)
        before = compiled_forms()
        bits = _bits(base.scene, name)
        again = len(compiled_forms() - before)
        plain_system, plain_state = ready(base.scene, name)
        advance(plain_system, plain_state)
        rounds = [
            (advance(plain_system, plain_state), advance(system, state)) for _ in range(ROUNDS)
        ]
        plain, mine = (min(column) for column in zip(*rounds, strict=True))
        moved = None
        if base.answer is not None:
            moved = change(base.answer, answer_of(run_explicit(name, scene).solution))
        yield EffectCost(
            effect,
            change=moved,
            step=mine / plain,
            memory=_bytes(system, state) / _bytes(plain_system, plain_state),
            time_step=system.time_step / plain_system.time_step,
            new_forms=new,
            off_compiles=again,
            same_bits=bits == base.bits,
        )
