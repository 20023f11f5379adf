"""What each effect of a scene changes in its answer, and what it costs.

The effects are those of the scene, switched off one at a time. The reference run is explicit, to
its static state. Costs are CPU times of the same number of steps, with and without the effect in
turns, the least of some rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from fem.dynamics import stated_run
from fem.explicit.output.checkpoint import bytes_of
from fem.explicit.start import prepare
from fem.explicit.step import Loop, step
from fem.explicit.timed import TimedSystem
from fem.method import Explicit
from validation.case import Case, refuse_cell, solve
from validation.errors import InputError, named
from validation.output.console import tabled
from validation.scene.deformable import stated_share
from validation.scene.keys.toml_text import flat
from validation.study.effects.probe import (
    KeyChange,
    Quantities,
    change,
    effects_of,
    key_changes,
    quantities_of,
    without_effect,
)
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
    return explicit.changed({"fem.damping": None if by_mass else "static"})


def _in_time(case: Case, ramp: float, end: float) -> Case:
    """Return the case with the ramp [s] of all runs, and the end where no damping ends it."""
    assert isinstance(case.method, Explicit)
    times = {"ramp_time": ramp} | ({} if case.method.damping is not None else {"end_time": end})
    return case.changed(dict(flat({"fem": times})))


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


#: Name of the figure.
PICTURE = "effects.png"


def bound(case: Case, tolerance: str | None) -> float:
    """Change beyond which an effect matters: as asked, as ``effects.auto`` says, or 1 %."""
    return case.auto or TOLERANCE if tolerance is None else stated_share("--tolerance", tolerance)


#: Quantities whose changes are shown, by their names in rows.
_CHANGES = {"p_max": "p_max", "p_eff": "p_eff", "displacement": "u"}


def _change(key: str) -> Callable[[Mapping[str, Any]], str]:
    """Words for the change of a quantity."""

    def words(cost: Mapping[str, Any]) -> str:
        value = cost.get(key)
        return "–" if value is None else "0" if abs(value) < 5e-4 else f"{value:+.3g} %"

    return words


def _keys(changes: Sequence[Mapping[str, Any]]) -> str:
    """Changed keys: key, from, to."""
    return ", ".join(KeyChange(c["key"], c["from"], c["to"]).words for c in changes)


def effects_table(measured: Mapping[str, Any]) -> Table:
    """Return one row for each effect of `effect_costs`."""
    answer = ""
    if "p_max" in measured:
        answer = "p_max {p_max:.4g} MPa, p_eff {p_eff:.4g} MPa, u {displacement:.4g} mm, ".format(
            **measured
        )
    matters = f"> {100 * measured['tolerance']:.3g} %"
    columns: dict[str, str | Callable[[Mapping[str, Any]], str]] = {
        "without": "{name}",
        **{head: _change(key) for key, head in _CHANGES.items()},
        matters: lambda cost: {True: "yes", False: "no", None: "–"}[cost["matters"]],
        "CPU time": "× {step:.2f}",
        "memory": "× {memory:.2f}",
        "Δt": "× {time_step:.2f}",
    }
    off = "\n".join(f"without {c['name']}: {_keys(c['changes'])}" for c in measured["costs"])
    table = tabled(
        f"{measured['scene']}: its effects switched off one at a time\n"
        f"reference run ({_keys(measured['changes']) or 'the scene'}): "
        f"{answer}{1e6 * measured['seconds_per_step']:.1f} CPU µs per step, "
        f"{measured['bytes'] / 2**20:.2f} MiB",
        measured["costs"],
        columns,
        words=len(columns),
        caption=f"{matters}: without it, one of p_max, p_eff, u changes by more. CPU time of a "
        f"step, memory, Δt: with the effect over without it.\n{off}",
        caption_justify="left",
    )
    for column in (0, 1, 2, 3):
        table.columns[column].no_wrap = True
    return table


def draw_effects(measured: Mapping[str, Any], path: Path) -> None:
    """Draw changes and costs, one group of bars for each effect."""
    from matplotlib.ticker import FuncFormatter

    from validation.output.pictures.gallery import save_figure, subplots, wrapped
    from validation.output.pictures.scales import BLUE, ORANGE, SKY, VERMILION

    costs = measured["costs"]
    figure, (left, right) = subplots(1, 2, size=(10, 4.6), sharey=True)
    rows = range(len(costs))
    columns = (
        (
            left,
            0.0,
            [[cost.get(key, 0.0) for key in _CHANGES] for cost in costs],
            (("p_max", BLUE), ("p_eff", SKY), ("largest u", VERMILION)),
        ),
        (
            right,
            1.0,
            [(cost["step"], cost["memory"]) for cost in costs],
            (("CPU time of a step", BLUE), ("memory", ORANGE)),
        ),
    )
    for axes, start, values, series in columns:
        height = 0.8 / len(series)
        for k, (label, colour) in enumerate(series):
            places = [row + (k - 0.5 * (len(series) - 1)) * height for row in rows]
            widths = [of[k] - start for of in values]
            axes.barh(places, widths, left=start, height=height, label=label, color=colour)
        axes.legend(
            fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False
        )
        axes.tick_params(axis="both", labelsize=8)
        axes.grid(axis="x", alpha=0.3)
    left.set_xscale("symlog", linthresh=0.01)
    left.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    left.set_xlabel("change without the effect [%] (linear within ±0.01 %)")
    left.axvline(0.0, color="black", linewidth=0.8)
    left.set_yticks(list(rows), [f"without {cost['name']}" for cost in costs])
    left.invert_yaxis()
    right.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"× {value:g}"))
    right.set_xlabel("with the effect over without it [–]")
    right.axvline(1.0, color="black", linewidth=0.8)
    title = f"{measured['scene']}: {measured['load']}; explicit FEM"
    title = wrapped(f"{title}, effects switched off one at a time", 10.0)
    figure.suptitle(title, x=0.02, ha="left", fontsize="medium")
    save_figure(figure, path)
