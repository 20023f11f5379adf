"""Work and precision of a scene: runs kept by content, errors against an extrapolated reference.

The reference is static: the finest rung of `fem --accuracy` where a run climbs so far, judged by
the rungs before by the same rule; else of incompatible-mode elements on meshes finer than
all that are measured, extrapolated to vanishing mesh size. Its own error is added to every claim.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fem.accuracy.errors import error_bar
from geometry.mesh import FloatArray
from validation.errors import InputError
from validation.scene.family import AssemblyScene
from validation.study.costs.analysis import (
    Extrapolated,
    Point,
    cheapest,
    fitted_order,
    norm,
    observed_order,
    pareto_front,
    richardson,
)
from validation.study.costs.measure import measure, warm_up
from validation.study.costs.plan import QUANTITIES, CostPlan, Judge
from validation.study.costs.settings import BaseMesh, CostSetting
from validation.study.design import Row
from validation.study.rowfile import StudyRows
from validation.study.run import runner_for, sweep
from validation.study.study import Study

#: What a measurement holds; another number where it holds other things than before.
_CONTENT = 3
#: Factor by which an error falls at least from one rung, or one degree, to the next.
_HALVED = 2.0
#: Accuracies that are answered in words.
TARGETS = (0.1, 0.01, 0.001)


@dataclass(frozen=True)
class CostRow:
    """A setting, what it answered, its relative errors."""

    setting: CostSetting
    measured: dict[str, Any]
    """What `measure` gave."""
    errors: dict[str, float]
    """By quantity; rigid blocks have no displacement and no stress."""

    @property
    def cost(self) -> float:
        """Least CPU time of the repeats: what others do to the machine only adds [s]."""
        return float(min(self.measured["cpu_seconds"]))


@dataclass(frozen=True)
class CostStudy:
    """All settings of a scene with their errors, and the reference."""

    name: str
    plan: CostPlan
    rows: tuple[CostRow, ...]
    reference: dict[str, Extrapolated]
    """By quantity; the value of the field is its pressures on the partition."""
    reference_errors: dict[str, float]
    """Relative error of the reference by quantity."""
    reference_seconds: float
    """CPU time of the reference solutions [s]."""
    failures: dict[str, str] = field(default_factory=dict)
    """Settings that have no answer, and why."""

    @property
    def measured(self) -> tuple[str, str]:
        """Processors and days of the runs, each once."""
        processors = sorted({row.measured["processor"] for row in self.rows})
        days = sorted({row.measured["date"] for row in self.rows})
        return " and ".join(processors), " to ".join(dict.fromkeys((days[0], days[-1])))

    def points(self, quantity: str) -> tuple[list[CostRow], list[Point]]:
        """Rows that answer a quantity, and where they lie."""
        rows = [row for row in self.rows if quantity in row.errors]
        return rows, [Point(row.cost, row.errors[quantity]) for row in rows]

    def front(self, quantity: str, method: str = "") -> list[CostRow]:
        """Rows that no other row, of one method or of all, beats, by ascending cost."""
        rows, points = self.points(quantity)
        chosen = [i for i, row in enumerate(rows) if method in ("", row.setting.curve)]
        return [rows[chosen[k]] for k in pareto_front([points[i] for i in chosen])]

    def families(self) -> dict[str, list[CostRow]]:
        """Rows by family, coarse to fine."""
        result: dict[str, list[CostRow]] = {}
        for row in self.rows:
            result.setdefault(row.setting.family, []).append(row)
        return {k: sorted(v, key=lambda row: row.setting.level) for k, v in result.items()}

    def order(self, family: str, quantity: str) -> dict[str, float | None]:
        """Observed order of a family in one quantity; None where it has too few meshes.

        ``against_reference`` is the slope of its errors over mesh size, near 0 where the method,
        not the mesh, errs; ``by_itself`` that of its finest three meshes among themselves.
        """
        rows = [row for row in self.families()[family] if quantity in row.errors]
        levels = [row.setting.level for row in rows]
        floor = self.reference_errors[quantity]
        fitted = fitted_order(levels, [row.errors[quantity] for row in rows], floor=floor)
        own = None
        if len(rows) >= 3:
            own = observed_order(
                levels[-3:],
                [_value(row.measured, quantity) for row in rows[-3:]],
                _weights(rows[-1].measured, quantity),
            )
        return {"against_reference": fitted, "by_itself": own}

    def choose(self, quantity: str, target: float) -> CostRow | None:
        """Cheapest setting that reliably keeps an accuracy; None if none is known to."""
        rows, points = self.points(quantity)
        best = cheapest(points, finer_meshes(rows), target, self.reference_errors[quantity])
        return None if best is None else rows[best]

    def best(self, quantity: str) -> CostRow:
        """Setting of least error."""
        return min(self.points(quantity)[0], key=lambda row: row.errors[quantity])


def finer_meshes(rows: list[CostRow]) -> list[list[int]]:
    """Positions of the finer meshes of each row's family; of a lone mesh, of what it varies."""
    meshes = Counter(row.setting.family for row in rows)
    result = []
    for row in rows:
        own = row.setting
        lone = meshes[own.family] == 1
        names = {own.family, own.family.partition(",")[0] if lone else own.family}
        finer = (r.setting.family in names and r.setting.level > own.level for r in rows)
        result.append([i for i, counts in enumerate(finer) if counts])
    return result


# ---------------------------------------------------------------------------------------------
# Running


def scene_content(scene: AssemblyScene) -> dict[str, Any]:
    """What a scene states apart from how it is solved: no mesh, no solver."""
    return scene.model_dump(mode="json", exclude={"mesh", "rigid", "fem"})


@dataclass(frozen=True)
class SettingStudy(Study):
    """Settings of a scene, each run by itself: its numbers and its CPU time."""

    scene: AssemblyScene = field(kw_only=True)
    base: BaseMesh = field(kw_only=True)
    settings: tuple[CostSetting, ...] = field(kw_only=True)
    _warm: set[tuple[str, ...]] = field(default_factory=set, compare=False, repr=False)

    def content(self, number: int) -> Any:
        """Return all that a measurement depends on; the name of a family is not among it."""
        setting, scene = self.settings[number], self.scene
        return {
            "measurement": _CONTENT,
            "scene": scene_content(scene),
            "solver": scene.rigid.solver,
            "fem": scene.fem.model_dump(mode="json"),
            "mesh": setting.mesh(self.base),
            "elements": setting.mesh_words,
            "base": self.base.at(1),
            "method": setting.method,
            "changes": sorted(setting.changes),
            "ramp_factor": setting.ramp_factor,
            "hold_periods": setting.hold_periods,
            "damping_ratio": setting.damping_ratio,
        }

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Run a setting, the first of its kind on the coarsest mesh beforehand: kernels compile."""
        setting = self.settings[number]
        kernels = (setting.method, *(v for k, v in setting.changes if k != "fem.residual"))
        if kernels not in self._warm:
            self._warm.add(kernels)
            warm_up(self.name, self.scene, self.base, replace(setting, level=1))
        return {"measurement": measure(self.name, self.scene, self.base, setting)}, []


def setting_study(
    name: str, scene: AssemblyScene, base: BaseMesh, settings: Iterable[CostSetting]
) -> SettingStudy:
    """Study of some settings, each once."""
    each = tuple(dict.fromkeys(settings))
    named = (("setting", tuple(setting.name for setting in each)),)
    return SettingStudy(name, "fem", named, scene=scene, base=base, settings=each)


def run_cost(
    name: str,
    scene: AssemblyScene,
    plan: CostPlan,
    store: Path,
    *,
    progress: Callable[[int, int, str], None] | None = None,
) -> CostStudy:
    """Measure what the store lacks of a scene that `require_cost_scene` lets in, and compare.

    ``progress`` is called after each run with its number, the number of runs, and what it was. One
    runs at a time: others would change its CPU time.
    """
    study = setting_study(name, scene, plan.base, (*plan.settings, *plan.references))
    results = StudyRows(store, study)
    answered = sum(status == "ok" for status in results.status.values())
    done, missing = 0, study.n_designs - answered

    def follow(row: Row) -> None:
        nonlocal done
        done += 1
        setting = study.settings[row.number]
        if row.status == "failed" and setting in plan.references:
            raise InputError(row.message)
        if progress is not None:
            progress(done, missing, setting.name)

    sweep(results, runner_for(study), retry_failed=True, on_row=follow)
    rows = dict(zip(study.settings, results.rows(), strict=True))
    known = {s: row["measurement"] for s, row in rows.items() if row["status"] == "ok"}
    failures = {s.name: row["message"] for s, row in rows.items() if s not in known}
    of_plan = {setting: known[setting] for setting in plan.settings if setting in known}
    if not of_plan:
        first = next(iter(failures.values()))
        raise InputError(f"{name}: none of the settings has an answer; the first: {first}")
    references = {setting: known[setting] for setting in plan.references}
    return replace(compare_settings(name, plan, of_plan, references), failures=failures)


def compare_settings(
    name: str,
    plan: CostPlan,
    known: dict[CostSetting, dict[str, Any]],
    references: dict[CostSetting, dict[str, Any]],
) -> CostStudy:
    """Let the judges say what is right, and measure every error against it."""
    finest = references[plan.references[-1]]
    weights = {q: _weights(finest, q) for q in QUANTITIES}
    reference = {
        q: _judged(judge, [_value(references[s], q) for s in judge.settings], weights[q])
        for judge in plan.judges
        for q in judge.quantities
    }
    sizes = {q: norm(reference[q].value, weights[q]) for q in QUANTITIES}
    rows = []
    for setting, result in known.items():
        errors = {
            q: norm(_value(result, q) - reference[q].value, weights[q]) / sizes[q]
            for q in QUANTITIES
            if q == "pressure_l2" or q in result["scalars"]
        }
        rows.append(CostRow(setting, result, errors))
    return CostStudy(
        name=name,
        plan=plan,
        rows=tuple(rows),
        reference=reference,
        reference_errors={q: reference[q].error / sizes[q] for q in QUANTITIES},
        reference_seconds=sum(min(result["cpu_seconds"]) for result in references.values()),
    )


def _judged(judge: Judge, values: list[FloatArray], weights: FloatArray) -> Extrapolated:
    if judge.extrapolated:
        return richardson([setting.level for setting in judge.settings], values, weights)
    *coarser, last = values
    falls = [(value, _HALVED**k) for k, value in enumerate(reversed(coarser), 1)]
    return Extrapolated(last, error_bar(last, falls, partial(norm, weights=weights)), None)


def _value(measured: dict[str, Any], quantity: str) -> FloatArray:
    if quantity == "pressure_l2":
        return np.array(measured["pressures"])
    return np.array([measured["scalars"][quantity]])


def _weights(finest: dict[str, Any], quantity: str) -> FloatArray:
    return np.array(finest["areas"]) if quantity == "pressure_l2" else np.ones(1)


# ---------------------------------------------------------------------------------------------
# Answers


def percent(share: float) -> str:
    """A share as a person writes it."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def answers(study: CostStudy) -> list[str]:
    """Cost of each accuracy that the reference is known well enough to judge."""
    return [
        _answer(study, quantity, target)
        for quantity in QUANTITIES
        for target in TARGETS
        if study.reference_errors[quantity] < target or study.choose(quantity, target) is not None
    ]


def _answer(study: CostStudy, quantity: str, target: float) -> str:
    head = f"{percent(target)} in {quantity}"
    row = study.choose(quantity, target)
    if row is not None:
        return f"{head}: {row.setting.name}, {row.cost:.2g} CPU s"
    best = study.best(quantity)
    least = percent(best.errors[quantity])
    return f"{head}: not reached; best is {best.setting.name}: {least} in {best.cost:.2g} CPU s"
