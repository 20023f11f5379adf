"""What each effect of a scene changes in its answer, and what it costs.

The effects are those of the scene, switched off one at a time. The reference run is explicit, to
its static state. Costs are CPU times of the same number of steps, with and without the effect in
turns, the least of some rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fem.dynamics import stated_run
from fem.explicit.output.checkpoint import bytes_of
from fem.explicit.start import prepare
from fem.explicit.step import Loop, step
from fem.explicit.timed import TimedSystem
from fem.method import Explicit
from validation.case import Case, refuse_cell, solve
from validation.errors import InputError, named
from validation.study.effects.probe import Quantities, change, quantities_of
from validation.study.effects.switches import effects_of, key_changes, without_effect
from validation.study.run import answered
from validation.study.study import CaseStudy, case_content

#: Steps of one timing, after as many for warming up; and rounds of which the least counts.
TIMED_STEPS = 60
ROUNDS = 3
#: Change beyond which an effect matters, where nothing else is said.
TOLERANCE = 0.01
#: Periods of the lowest excited mode that a run with constant critical damping is given.
_PERIODS = 20.0


def to_rest(case: Case) -> Case:
    """Return the case as an explicit run that arrives at rest.

    Mass-proportional damping takes the place of the adaptive one.
    """
    explicit = case.with_method("explicit")
    rayleigh = explicit.method.rayleigh  # type: ignore[union-attr]
    by_mass = rayleigh is not None and rayleigh.mass_proportional is not None
    return explicit.varied({"fem.damping": None if by_mass else "static"})


def _in_time(case: Case, ramp: float, end: float) -> Case:
    """Return the case with the ramp [s] of all runs, and the end where no damping ends it."""
    assert isinstance(case.method, Explicit)
    times = {"ramp_time": ramp} | ({} if case.method.damping is not None else {"end_time": end})
    return case.varied({"fem": times})


def _stated(case: Case) -> TimedSystem:
    assert isinstance(case.method, Explicit)
    with named(case.name):
        return stated_run(case.problem, case.method)


def ready(case: Case) -> Loop:
    """Model of a case at its first step."""
    statement = _stated(case)
    return prepare(statement, time_step=0.5 * statement.critical.critical_time_step)


def take_steps(loop: Loop) -> float:
    """Do some steps; CPU seconds of one."""
    start = time.thread_time()
    for _ in range(TIMED_STEPS):
        step(loop)
    return (time.thread_time() - start) / TIMED_STEPS


@dataclass(frozen=True)
class EffectStudy(CaseStudy):
    """A deformable tube with all its effects, and without one at a time: answers, costs of a step.

    Costs of an effect are over those without it in the same process.
    """

    answers: bool = field(kw_only=True)
    """Whether runs to the static state are made: else costs alone."""

    def content(self, number: int) -> Any:
        """Return both cases, and whether they are answered."""
        return [case_content(self.cases[0]), case_content(self.cases[number]), self.answers]

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Costs of a design and, where asked for, its answer."""
        case, base = self.case(number), self.case(0)
        if number == 0:
            loop = ready(case)
            cost: dict[str, Any] = {"bytes": bytes_of(loop)}
            take_steps(loop)
            cost["seconds_per_step"] = min(take_steps(loop) for _ in range(ROUNDS))
        else:
            changes = [change.as_json() for change in key_changes(base, case)]
            cost = {"changes": changes, **_measured(base, case)}
        answer = asdict(_answer(case)) if self.answers else None
        return {"cost": cost, "answer": answer}, []


def effect_costs(
    case: Case,
    store: Path,
    *,
    tolerance: float = TOLERANCE,
    answers: bool = True,
    told: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measure every effect of a deformable tube, and tell what was measured.

    An effect matters where p_max, p_eff or the largest displacement change by more than the
    tolerance without it. Without ``answers``, no runs to the static state are made: costs alone.
    The store, a file of rows, keeps what was measured.

    Returns
    -------
    dict[str, Any]
        ``changes``: keys in which the reference run differs from the scene, each with ``key``,
        ``from`` and ``to``. Of the reference run p_max, p_eff [MPa] and displacement [mm], CPU time
        of a step [s] and bytes of state and constants. ``costs``: for each effect the keys that
        switch it off, what that changes of the three [%], and time of a step, memory and critical
        time step with it over those without it.
    """
    refuse_cell(case, "effects")
    effects = effects_of(case)
    if not effects:
        raise InputError(
            f"{case.name}: got a scene without effects, where there is none to switch off; "
            "expected one at least, such as --set effects.friction=0.3"
        )
    base = to_rest(case)
    statement = _stated(base)
    assert statement.times.recommended is not None  # blocks meet
    frequency, ramp = statement.times.recommended.frequency, statement.times.ramp
    assert isinstance(base.method, Explicit)
    end = base.method.end_time or ramp + _PERIODS / frequency
    every = {"all": base} | {str(e): to_rest(without_effect(base, e)) for e in effects}
    cases = tuple(_in_time(one, ramp, end) for one in every.values())
    named_effects = (("effect", tuple(every)),)
    study = EffectStudy(case.name, "fem", named_effects, cases=cases, answers=answers)
    plain, *rows = answered(study, store, told)
    costs = []
    for row in rows:
        cost, moved = {"name": row["effect"].replace("_", " "), **row["cost"]}, None
        if answers:
            moved = change(Quantities(**plain["answer"]), Quantities(**row["answer"]))
            cost |= {key: 100.0 * value for key, value in asdict(moved).items()}
        costs.append(cost | {"matters": None if moved is None else moved.matters(tolerance)})
    return {
        "scene": case.name,
        "load": case.load_words,
        "changes": [change.as_json() for change in key_changes(case, study.case(0))],
        "tolerance": tolerance,
        **plain["cost"],
        **(plain["answer"] or {}),
        "costs": costs,
    }


def _answer(case: Case) -> Quantities:
    """Numbers of an explicit run, which arrives at its static state or is rejected."""
    solved = solve(case).details
    run = solved.run
    assert run is not None
    stopped = str(run.status) == "stopped"
    assert isinstance(case.method, Explicit)
    at_rest = case.method.damped(moves=case.problem.motion is not None) == "static"
    if stopped or (at_rest and str(run.status) != "converged"):
        remedy = "a larger limit of work (fem.max_work)" if stopped else "a larger fem.end_time"
        raise InputError(
            f"{case.name}: a run did not arrive at its static state by {run.time:.3g} s; expected "
            f"{remedy}, or none"
        )
    return quantities_of(solved)


def _measured(case: Case, without: Case) -> dict[str, float]:
    """Costs of a case over those without one of its effects."""
    loop, plain_loop = ready(case), ready(without)
    take_steps(loop)
    take_steps(plain_loop)
    rounds = [(take_steps(plain_loop), take_steps(loop)) for _ in range(ROUNDS)]
    plain, mine = (min(column) for column in zip(*rounds, strict=True))
    return {
        "step": mine / plain,
        "memory": bytes_of(loop) / bytes_of(plain_loop),
        "time_step": loop.time_step / plain_loop.time_step,
    }
