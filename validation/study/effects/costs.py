"""What each effect changes in the answer of a tube, and what it costs.

The base has no effect at all. Each effect is added to it by itself. The answer is the state
at which adaptive mass damping arrives; Rayleigh's mass damping takes the place of that. Costs
are CPU times of the same number of steps, in turns with the base, the least of some rounds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from fem.dynamics import stated_run
from fem.explicit.output.checkpoint import state_arrays
from fem.explicit.setup.statement import ExplicitStatement
from fem.explicit.solve import initial_state, prepare
from fem.explicit.state import State
from fem.explicit.step import ExplicitSystem, step
from fem.system.effects import PAPER_RAYLEIGH
from fem.system.time_step import critical_time_step
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


def _stated(scene: DeformableScene, name: str) -> ExplicitStatement:
    with named(name):
        return stated_run(scene_problem(scene, name), scene.in_time)


def ready(scene: DeformableScene, name: str) -> tuple[ExplicitSystem, State]:
    """Model of a scene at its first step."""
    statement = _stated(scene, name)
    model = statement.model
    system = prepare(model, time_step=0.5 * critical_time_step(model).critical_time_step)
    return system, initial_state(system)


def advance(system: ExplicitSystem, state: State) -> float:
    """Do some steps; CPU seconds of one."""
    start = time.thread_time()
    for _ in range(TIMED_STEPS):
        step(system, state)
    return (time.thread_time() - start) / TIMED_STEPS


def _bits(scene: DeformableScene, name: str) -> bytes:
    system, state = ready(scene, name)
    advance(system, state)
    return b"".join(now.displacement.tobytes() for now in state.bodies)


def _bytes(system: ExplicitSystem, state: State) -> int:
    arrays = sum(a.nbytes for a in state_arrays(system, state).values())
    return arrays + sum(body.constant_bytes for body in system.bodies)


def effect_costs(
    scene: DeformableScene,
    name: str,
    *,
    tolerance: float = TOLERANCE,
    answers: bool = True,
    told: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measure every effect of a deformable tube, and tell what is measured next.

    An effect matters where it changes one of p_max, p_eff or the largest displacement by more than
    the tolerance. Without ``answers``, no runs to the static state are made: costs alone.

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
    base, say = bare(scene), told or (lambda _: None)
    say("no effect")
    first_bits = _bits(base, name)
    system, state = ready(base, name)
    answer = _answer(base, name, arrives=True) if answers else None
    step_time = min(advance(system, state) for _ in range(ROUNDS))
    statement = _stated(base, name)
    assert statement.recommended is not None  # blocks meet
    frequency, ramp = statement.recommended.frequency, statement.ramp_time
    costs = []
    effects = list(effects_of(base, 4.0 * np.pi * frequency))
    for number, (effect, setting, changes, note) in enumerate(effects, 1):
        say(f"{effect}, {number} of {len(effects)}")
        changed = base.changed(changes)
        times = {"ramp_time": ramp}
        if changed.fem.damping is None:
            times["end_time"] = ramp + _PERIODS / frequency
        changed = changed.changed({"fem": times})
        row, bits = _measured(changed, base, name)
        row |= {"name": effect, "setting": setting, "note": note, "same_bits": bits == first_bits}
        moved = None if answer is None else change(answer, _answer(changed, name))
        if moved is not None:
            row |= {key: 100.0 * value for key, value in asdict(moved).items()}
        costs.append(row | {"matters": None if moved is None else moved.matters(tolerance)})
    return {
        "scene": name,
        "load": scene.load_words,
        "tolerance": tolerance,
        "seconds_per_step": step_time,
        "bytes": _bytes(system, state),
        **({} if answer is None else asdict(answer)),
        "costs": costs,
    }


def _answer(scene: DeformableScene, name: str, *, arrives: bool = False) -> Numbers:
    """Numbers of an explicit run, which ``arrives`` at its static state or is rejected."""
    found = deformable_answer(on_its_mesh(scene_case(scene, name))).details
    result = found.explicit
    assert result is not None
    stopped = str(result.status) == "stopped"
    if stopped or (arrives and str(result.status) != "converged"):
        remedy = "a larger limit of work (fem.max_work)" if stopped else "a larger fem.end_time"
        raise InputError(
            f"{name}: a run did not arrive at its static state by {result.time:.3g} s; expected "
            f"{remedy}, or none"
        )
    return numbers_of(found)


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
