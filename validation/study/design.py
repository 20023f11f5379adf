"""One design of a study: its answer as a row."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isnan
from typing import Any, Literal

from geometry.parts.dimensions import dimensions
from mbd.options import Rigid
from validation.case import Case
from validation.errors import InputError
from validation.scene.keys.idle import is_idle
from validation.study.study import BUILT, COLUMNS, RANKING, SceneStudy, Study, Value


@dataclass(frozen=True)
class Row:
    """One design of a study and what came out."""

    number: int
    status: Literal["ok", "failed"]
    """``failed``: nothing could be computed, `message` says why. A tube that carries no load is
    ``ok``: that is an answer."""
    message: str
    """Why it failed; of an answer, error bars that are wider than requested, values that are not
    to be used, and parameters on which it does not depend."""
    parameters: dict[str, Value]
    results: dict[str, Any]
    """By the names in `COLUMNS`; empty if failed."""
    cpu_seconds: float
    """CPU time of the design [s]."""
    worker: tuple[int, float] = (0, 0.0)
    """Process that computed it and the CPU time it had used by then [s]."""

    @property
    def flat(self) -> dict[str, Any]:
        """Parameters, results and what became of it, by the columns of a study."""
        own = ("number", "status", "message", "cpu_seconds")
        return self.parameters | self.results | {name: getattr(self, name) for name in own}

    def as_json(self) -> dict[str, Any]:
        """All that holds wherever the design stands in a study; what is no number is absent."""
        names = ("parameters", "status", "message", "cpu_seconds")
        absent = {k: None for k, v in self.results.items() if isinstance(v, float) and isnan(v)}
        return {name: getattr(self, name) for name in names} | {"results": self.results | absent}


def run_design(study: Study, number: int) -> Row:
    """Compute one design, counted from 0; whatever goes wrong with it becomes its message."""
    rigid = study.quantity == "rigid"
    # Other threads of the process may be at work on other designs; fem may use several itself.
    clock = time.thread_time if rigid else time.process_time
    start = clock()
    failure, results, remarks = "", dict[str, Any](), list[str]()
    try:
        results, remarks = study.results(number)
    except Exception as error:
        words = " ".join(str(error).split()).removeprefix(f"{study.name}[{number}]: ")
        words = words or "no message"
        failure = words if isinstance(error, ValueError) else f"{type(error).__name__}: {words}"
    return Row(
        number=number,
        status="failed" if failure else "ok",
        message=failure or "; ".join(remarks),
        parameters=study.design(number),
        results=results,
        cpu_seconds=clock() - start,
        worker=(os.getpid(), time.process_time()),
    )


def idle_parameters(study: SceneStudy, file: Case) -> list[str]:
    """Parameters on which no answer of a design's method depends."""
    method = "rigid" if study.quantity == "rigid" else file.method.name
    none = {f"rigid.{name}" for name in _NO_COLUMN} if method == "rigid" else set()
    paths = [path for path, _ in study.parameters]
    return [path for path in paths if path in none or is_idle(path, file.scene, method)]


def refuse_idle_parameters(study: SceneStudy) -> None:
    """Refuse a rigid study that varies what no rigid answer depends on: its rows would be equal."""
    if study.quantity != "rigid":
        return
    try:
        idle = set(study.varied).intersection(study.idle_parameters())
    except ValueError:
        return  # a design that cannot be computed says nothing; its row will say why
    if idle:
        raise InputError(
            f"{study.name}: {', '.join(sorted(idle))}: no answer of rigid blocks depends on it, so "
            'rows would be equal; remove it from [parameters], or ask quantity = "fem"'
        )


def failed_row(study: Study, number: int, message: str) -> Row:
    """Row of a design whose process did not live to report it."""
    return Row(number, "failed", message, study.design(number), {}, 0.0)


#: What ``[rigid]`` can ask and no column shows.
_NO_COLUMN = ("collapse", "sliding", "ranges", "margin")


def rigid_results(case: Case) -> dict[str, Any]:
    """Results of rigid blocks by the names of `COLUMNS`, and nothing that no column has."""
    from validation.solving import repeatable, solve

    case = case if isinstance(case.method, Rigid) else case.with_method("rigid")
    assert isinstance(case.method, Rigid)
    idle: dict[str, Any] = dict.fromkeys(_NO_COLUMN, False)
    answer = repeatable(solve(case.with_method(replace(case.method, **idle))))
    result, friction = answer.details, answer.details.friction
    # With friction the forces and the verdict are those with it: a load that is carried only if
    # joints were pressed beforehand is not in equilibrium by itself.
    found: dict[str, Any] = {
        "mechanism": str(result.mechanism),
        "equilibrium": int(result.shown),
        "residual": (result if friction is None else friction).equilibrium.residual,
        "n_blocks": result.n_blocks,
        "n_contacts": result.n_contacts,
        "iterations": result.equilibrium.iterations,
        **_built(dimensions(result.blocks).as_json()),
    }
    if "crushing_factor" in answer.measures:
        found["crushing_factor"] = answer["crushing_factor"].value
    measures = result.shown_measures
    names = ("effective_count_percent", "effective_area_percent", "p_eff", "p_eff_pooled", "p_max")
    for name in names:
        found[name] = None if measures is None else getattr(measures, name)
    return found


def _built(report: Mapping[str, Any]) -> dict[str, Any]:
    """What is built, from the dimensions of an answer."""
    return {name: report.get(name) for name in BUILT}


def stated_accuracy(case: Case, accuracy: float | Mapping[str, float] | None) -> Case:
    """Case of a scene with the error bars that a study requests; None: without what none needs."""
    from fem.accuracy.converge import TARGETS

    if isinstance(accuracy, float):
        accuracy = dict.fromkeys(TARGETS, accuracy)
    if accuracy:
        return case.stating(case.scene.changed({"fem.accuracy": accuracy}))
    if case.scene.fem.method == "explicit":
        return case.stating(case.scene.changed({"fem.static_reference": False}))
    return case


def fem_results(case: Case) -> tuple[dict[str, Any], list[str]]:
    """Value and error bar of each measure, and what is to be known of them.

    Solved as `tubelock fem` does: on finer and finer meshes, or on its own. A value that its mesh
    does not resolve, or that grows with every refinement, is absent.
    """
    from fem.accuracy.converge import TARGETS
    from fem.accuracy.errors import AT_AN_EDGE
    from fem.accuracy.parts import Accuracy
    from validation.solving import repeatable, solve

    answer = repeatable(solve(case, otherwise=dict.fromkeys(TARGETS, RANKING)))
    measures, result = answer.measures, dict[str, Any]()
    named: dict[str, list[str]] = {}
    for name, measure in measures.items():
        if name not in COLUMNS["fem"]:
            continue
        if measure.remark not in ("", AT_AN_EDGE):  # that is said of every design by default
            named.setdefault(measure.remark, []).append(name)
        usable = measure.resolved and not measure.remark
        result[name] = measure.value if usable else None
        result[f"{name}_error"] = measure.error if usable else None
    accuracy = answer.parts.get("accuracy")
    missed = []
    if isinstance(accuracy, Accuracy):
        missed = accuracy.request_rows(accuracy.not_reached)
    result |= {
        "residual": answer.details.residual,
        "energy_balance": answer.details.energy_balance,
        "n_elements": answer.details.deformable.model.n_elements,
        **_built(answer.report["dimensions"]),
    }
    remarks = [f"{', '.join(names)}: {remark}" for remark, names in named.items()]
    return result, [*missed, *remarks]
