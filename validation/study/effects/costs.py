"""What each effect changes in the answer of a tube, and what it costs.

The base has no effect at all. Each effect is added to it by itself. The answer is the state
at which adaptive mass damping arrives; Rayleigh's mass damping takes the place of that. Costs
are CPU times of the same number of steps, in turns with the base, the least of some rounds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fem.dynamics import stated_run
from fem.explicit.output.checkpoint import state_arrays
from fem.explicit.solve import initial_state, prepare
from fem.explicit.state import Lanes
from fem.explicit.step import ExplicitSystem, step
from fem.explicit.timed import TimedSystem
from fem.system.effects import PAPER_RAYLEIGH
from validation.build.cell import refuse_cell
from validation.build.problem import fem_section, scene_problem
from validation.case import scene_case
from validation.errors import InputError, named
from validation.run.deformable import deformable_answer, on_its_mesh
from validation.run.probe import Numbers, change, numbers_of
from validation.scene.deformable import (
    BulkViscositySection,
    EffectsSection,
    FrictionSection,
    Method,
    RayleighSection,
)
from validation.scene.read import DeformableScene
from validation.study.run import answered
from validation.study.study import Study

#: Steps of one timing, after as many for warming up; and rounds of which the least counts.
TIMED_STEPS = 60
ROUNDS = 3
#: Standard gravity downward [mm/s²].
GRAVITY = (0.0, 0.0, -9806.65)
#: Clearance that is switched on where a scene has none [mm].
CLEARANCE = 0.01
#: Coefficient of friction that is switched on where a scene has none [-].
FRICTION = 0.1
#: Change beyond which an effect matters, where nothing else is said.
TOLERANCE = 0.01
#: Periods of the lowest excited mode that a run with constant critical damping is given.
_PERIODS = 20.0


def bare(scene: DeformableScene) -> DeformableScene:
    """Return the scene without any effect, to be run explicitly to its static state."""
    still = {"method": Method.EXPLICIT, "damping": "static", "frames": 0}
    closed = {"clearance": 0.0, "spacing": 0.0, "pairs": ()}
    return scene.changed({"fem": still, "contact": closed, "effects": EffectsSection()})


def effects_of(scene: DeformableScene, mass_damping: float) -> tuple[tuple[Any, ...], ...]:
    """Every effect with the scene's own value, or a usual one where the scene has none.

    Name, the value that is switched on, what it changes in the scene by place, and a note.
    """
    own = scene.effects
    rayleigh = own.rayleigh or RayleighSection()
    beta = rayleigh.stiffness_proportional or PAPER_RAYLEIGH.stiffness_proportional or 0.0
    viscosity = own.bulk_viscosity or BulkViscositySection()
    b1, b2 = viscosity.linear_bulk_viscosity, viscosity.quadratic_bulk_viscosity
    friction = own.friction or FrictionSection(coefficient=FRICTION)
    gravity = own.gravity or GRAVITY
    clearance = scene.contact.clearance or CLEARANCE
    damped = RayleighSection(mass_proportional=mass_damping)
    by_rate = RayleighSection(stiffness_proportional=beta)
    critical = "critical for the lowest excited mode; in place of adaptive damping"
    return (
        (
            "friction",
            f"μ = {friction.coefficient:g}",
            {"effects.friction": friction, "contact.pairs": scene.contact.pairs},
            "",
        ),
        (
            "Rayleigh mass",
            f"α = {mass_damping:.3g} /s",
            {"fem.damping": None, "effects.rayleigh": damped},
            critical,
        ),
        ("Rayleigh stiffness", f"β = {beta:g} s", {"effects.rayleigh": by_rate}, ""),
        ("bulk viscosity", f"b₁ = {b1:g}, b₂ = {b2:g}", {"effects.bulk_viscosity": viscosity}, ""),
        ("finite rotation", "on", {"effects.finite_rotation": True}, ""),
        ("finite sliding", "on", {"effects.finite_sliding": True}, ""),
        ("frame elasticity", "on", {"effects.elastic_frame": True}, ""),
        ("clearance", f"{clearance:g} mm", {"contact.clearance": clearance}, ""),
        ("gravity", f"{abs(gravity[2]):g} mm/s² down", {"effects.gravity": gravity}, ""),
    )


def compiled_forms() -> frozenset[tuple[str, str]]:
    """Compiled functions of the solver and the signatures they have been compiled for so far."""
    result = set()
    for name, module in list(sys.modules.items()):
        if name.startswith("fem."):
            for value in list(vars(module).values()):
                for form in getattr(value, "nopython_signatures", ()):
                    result.add((value.__name__, str(form)))
    return frozenset(result)


def _stated(scene: DeformableScene, name: str) -> TimedSystem:
    with named(name):
        return stated_run(scene_problem(scene, name), scene.in_time)


def ready(scene: DeformableScene, name: str) -> tuple[ExplicitSystem, Lanes]:
    """Model of a scene at its first step."""
    statement = _stated(scene, name)
    system = prepare(statement, time_step=0.5 * statement.critical.critical_time_step)
    return system, initial_state(system)


def advance(system: ExplicitSystem, state: Lanes) -> float:
    """Do some steps; CPU seconds of one."""
    start = time.thread_time()
    for _ in range(TIMED_STEPS):
        step(system, state)
    return (time.thread_time() - start) / TIMED_STEPS


def _bits(scene: DeformableScene, name: str) -> bytes:
    system, state = ready(scene, name)
    advance(system, state)
    return b"".join(now.displacement.tobytes() for now in state.bodies)


def _bytes(system: ExplicitSystem, state: Lanes) -> int:
    arrays = sum(a.nbytes for a in state_arrays(system, state).values())
    return arrays + sum(body.constant_bytes for body in system.bodies)


@dataclass(frozen=True)
class EffectStudy(Study):
    """A deformable tube without any effect, and with one at a time: answers, and costs of a step.

    Costs of an effect are over those without it in the same process.
    """

    base: DeformableScene = field(kw_only=True)
    answers: bool = field(kw_only=True)
    """Whether runs to the static state are made: else costs alone."""
    effects: tuple[tuple[Any, ...], ...] = field(kw_only=True)
    """As `effects_of` gives them."""
    times: dict[str, float] = field(kw_only=True)
    """``ramp_time`` and ``end_time`` [s] of a run with an effect; the second where no adaptive
    damping ends it."""

    def content(self, number: int) -> Any:
        """Return scene, effect and times."""
        changed = self._scene(number).model_dump(mode="json")
        return [self.base.model_dump(mode="json"), changed, self.answers]

    def _scene(self, number: int) -> DeformableScene:
        """Scene of a design; the first has no effect."""
        if number == 0:
            return self.base
        scene, times = self.base.changed(self.effects[number - 1][2]), dict(self.times)
        if scene.fem.damping is not None:
            del times["end_time"]
        return scene.changed({"fem": times})

    @cached_property
    def _first_bits(self) -> bytes:
        """Bits of the base before any effect was on in this process."""
        return _bits(self.base, self.name)

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Costs of a design and, where asked for, its answer."""
        scene, first_bits = self._scene(number), self._first_bits
        if number == 0:
            system, state = ready(scene, self.name)
            cost: dict[str, Any] = {"bytes": _bytes(system, state)}
        else:
            cost, bits = _measured(scene, self.base, self.name)
            effect, setting, _, note = self.effects[number - 1]
            cost |= {"name": effect, "setting": setting, "note": note}
            cost["same_bits"] = bits == first_bits
        answer = None
        if self.answers:
            answer = asdict(_answer(scene, self.name, arrives=number == 0))
        if number == 0:
            cost["seconds_per_step"] = min(advance(system, state) for _ in range(ROUNDS))
        return {"cost": cost, "answer": answer}, []


def effect_costs(
    scene: DeformableScene,
    name: str,
    store: Path,
    *,
    tolerance: float = TOLERANCE,
    answers: bool = True,
    told: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measure every effect of a deformable tube, and tell what was measured.

    An effect matters where it changes one of p_max, p_eff or the largest displacement by more than
    the tolerance. Without ``answers``, no runs to the static state are made: costs alone. The
    store, a file of rows, keeps what was measured.

    Returns
    -------
    dict[str, Any]
        Of the scene without effects, p_max, p_eff [MPa] and displacement [mm], CPU time of a step
        [s] and bytes of state and constants. ``costs``: for each effect the change of the three
        [%], and time of a step, memory and critical time step over those without it; how many
        compiled forms it needed that nothing before it had; how many forms the base compiled when
        it ran again after it, zero if off is absent; and whether the base then gave the same bits.
    """
    fem_section(scene, name)
    refuse_cell(scene, name, "effects")
    base = bare(scene)
    statement = _stated(base, name)
    assert statement.recommended is not None  # blocks meet
    frequency, ramp = statement.recommended.frequency, statement.ramp_time
    effects = effects_of(base, 4.0 * np.pi * frequency)
    study = EffectStudy(
        name,
        "fem",
        (("effect", ("no effect", *(effect for effect, *_ in effects))),),
        base=base,
        answers=answers,
        effects=effects,
        times={"ramp_time": ramp, "end_time": ramp + _PERIODS / frequency},
    )
    plain, *rows = answered(study, store, told)
    costs = []
    for row in rows:
        cost = dict(row["cost"])
        moved = None
        if answers:
            moved = change(Numbers(**plain["answer"]), Numbers(**row["answer"]))
            cost |= {key: 100.0 * value for key, value in asdict(moved).items()}
        costs.append(cost | {"matters": None if moved is None else moved.matters(tolerance)})
    return {
        "scene": name,
        "load": scene.load_words,
        "tolerance": tolerance,
        **plain["cost"],
        **(plain["answer"] or {}),
        "costs": costs,
    }


def _answer(scene: DeformableScene, name: str, *, arrives: bool = False) -> Numbers:
    """Numbers of an explicit run, which ``arrives`` at its static state or is rejected."""
    solved = deformable_answer(on_its_mesh(scene_case(scene, name))).details
    run = solved.run
    assert run is not None
    stopped = str(run.status) == "stopped"
    if stopped or (arrives and str(run.status) != "converged"):
        remedy = "a larger limit of work (fem.max_work)" if stopped else "a larger fem.end_time"
        raise InputError(
            f"{name}: a run did not arrive at its static state by {run.time:.3g} s; expected "
            f"{remedy}, or none"
        )
    return numbers_of(solved)


def _measured(
    scene: DeformableScene, base: DeformableScene, name: str
) -> tuple[dict[str, Any], bytes]:
    """Costs of a scene with one effect over those of the base, and the base's bits after it."""
    before = compiled_forms()
    system, state = ready(scene, name)
    advance(system, state)
    new = len(compiled_forms() - before)
    before = compiled_forms()
    bits = _bits(base, name)
    again = len(compiled_forms() - before)
    plain_system, plain_state = ready(base, name)
    advance(plain_system, plain_state)
    rounds = [(advance(plain_system, plain_state), advance(system, state)) for _ in range(ROUNDS)]
    plain, mine = (min(column) for column in zip(*rounds, strict=True))
    row = {
        "step": mine / plain,
        "memory": _bytes(system, state) / _bytes(plain_system, plain_state),
        "time_step": system.time_step / plain_system.time_step,
        "new_forms": new,
        "off_compiles": again,
    }
    return row, bits
