"""Cost of accuracy: methods on finer and finer meshes, and how they differ from the finest answer.

The finest answer is static and has error bars of its own: that of the narrowest error bars where
blocks are refined, else that of one more mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fem.accuracy.converge import MOST_SECONDS, TARGETS, why_not_refined
from fem.method import Explicit, Static
from geometry.answer import Answer
from validation.case import Case, Method, refuse_cell
from validation.errors import InputError
from validation.output.answer_files import answer_of_data
from validation.output.files import processor
from validation.study.costs.report import QUANTITIES, CostResult, CostRow, cpu_seconds
from validation.study.run import answered
from validation.study.study import CaseStudy

#: Multiples of the coarsest mesh, by method.
LEVELS = {"rigid": (1, 2, 4, 6), "static": (1, 2, 3, 4, 6), "explicit": (1, 2, 4)}
QUICK_LEVELS = {"rigid": (1, 2), "static": (1, 2), "explicit": (1,)}
#: Relative error bars that refined blocks are solved to; the last are those of the finest answer.
ACCURACIES, QUICK_ACCURACIES = (0.1, 0.03, 0.01), (0.1, 0.03)
#: Elements of the coarsest mesh along a wave or an edge, through the wall and in the direction that
#: is left: pressures peak on the flanks of waves, so elements are shortest along these.
_COARSEST = (4, 1, 2)
#: Cases that are cheaper are solved twice: the first loads modules [CPU s].
_CHEAP = 3.0
#: Effects that errors cannot be measured with, and why.
_REFUSED = {
    "friction": "errors are measured against a static solution, which depends on no history",
    "elastic_frame": "expected rigid frame blocks, which rigid and deformable answers share",
}


# ---------------------------------------------------------------------------------------------
# Cases


def coarsest_mesh(case: Case) -> dict[str, Any]:
    """Values of ``[mesh]`` whose multiples are the meshes of `cost`.

    Raises
    ------
    InputError
        A scene whose methods and meshes cannot be compared.
    """
    name, head = case.name, f"{case.name}: block.type {case.kind!r}"
    if case.problem.blocks.detection is not None or not case.meets:
        raise InputError(
            f"{head}: the cost of accuracy is that of contact pressures on finer and finer meshes; "
            "expected a scene whose blocks meet and have [mesh], such as tsb1-pipe, thb0-tunnel "
            "or planar-sine"
        )
    refuse_cell(case, "cost")
    for effect, why in _REFUSED.items():
        if any(on for key, on in case.values.items() if key.startswith(f"effects.{effect}")):
            raise InputError(f"{name}: effects.{effect}: {why}; remove {effect}")
    counts = case.element_counts | case.coarse_mesh(*_COARSEST)
    if not counts:
        raise InputError(
            f"{head}: the cost of accuracy is measured on nested meshes, and this scene gives a "
            "mesh of its own to every block; expected a family with [mesh], such as tsb1-pipe, "
            "thb0-tunnel or planar-sine"
        )
    return counts


def cost_cases(case: Case, *, quick: bool = False) -> dict[str, Case]:
    """Methods on meshes of a scene by name, the finest one last."""
    counts, limits = coarsest_mesh(case), case.method
    levels, accuracies = (QUICK_LEVELS, QUICK_ACCURACIES) if quick else (LEVELS, ACCURACIES)
    static = Static(
        mesh="scene",
        error_estimate=False,
        max_work=limits.max_work or MOST_SECONDS,
        max_memory=limits.max_memory,
    )
    explicit = Explicit(
        damping="static",
        max_work=limits.max_work,
        max_memory=limits.max_memory,
    )

    def on(level: int) -> Case:
        times = {
            key: level * n if isinstance(n, int) else tuple(level * k for k in n)
            for key, n in counts.items()
        }
        return case.varied({"mesh": times})

    methods: dict[str, Method | str] = {"rigid": "rigid", "static": static, "explicit": explicit}
    cases = {
        f"{name}, mesh ×{level}": on(level).with_method(method)
        for name, method in methods.items()
        for level in levels[name]
    }
    finest = max(levels["static"])
    bars, refined = replace(static, error_estimate=True), on(finest).with_method(static)
    if why_not_refined(refined.problem) is None:
        for share in accuracies:
            targets = dict.fromkeys(TARGETS, share)
            asked = replace(bars, mesh="converged", accuracy=targets)
            cases[f"converged, ± {100 * share:g} %"] = refined.with_method(asked)
    else:
        cases[f"static, mesh ×{finest + 2}"] = on(finest + 2).with_method(bars)
    return cases


# ---------------------------------------------------------------------------------------------
# Running


@dataclass(frozen=True)
class _Measured(CaseStudy):
    """Cases whose CPU time counts."""

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Return the cheaper of two answers, and the processor."""
        first = self._answer(number)
        again = self._answer(number) if _seconds(first) < _CHEAP else first
        return {"answer": min(first, again, key=_seconds), "processor": processor()}, []

    def _answer(self, number: int) -> dict[str, Any]:
        return super().results(number)[0]["answer"]


def _seconds(answer: dict[str, Any]) -> float:
    return cpu_seconds(answer_of_data(answer))


def run_cost(
    case: Case,
    store: Path,
    *,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> CostResult:
    """Measure what the store lacks, one after another: others would change its CPU time.

    ``progress`` is called with words after each run.

    Raises
    ------
    InputError
        A scene that cannot be measured, or one whose finest case has no answer.
    """
    cases = cost_cases(case, quick=quick)
    names = tuple(cases)
    study = _Measured(case.name, "fem", (("case", names),), cases=tuple(cases.values()))
    failures, answers, processors = {}, {}, set()
    for row in answered(study, store, progress, every=False):
        if row["status"] == "ok":
            answers[row["case"]] = answer_of_data(row["answer"])
            processors.add(row["processor"])
        else:
            failures[row["case"]] = row["message"]
    if names[-1] in failures:
        raise InputError(f"{case.name}: {names[-1]}: {failures[names[-1]]}")
    rows = (
        CostRow(name, answer, _errors(answer, answers[names[-1]]))
        for name, answer in answers.items()
    )
    counts = coarsest_mesh(case)
    sizes = [n for given in counts.values() for n in ([given] if isinstance(given, int) else given)]
    mesh = f"{' × '.join(map(str, sizes))} ({', '.join(counts)})"
    processors_named = " and ".join(sorted(processors))
    return CostResult(case.name, case.load_words, mesh, tuple(rows), processors_named, failures)


def _errors(answer: Answer, finest: Answer) -> dict[str, float]:
    """Relative differences from the finest answer, by measure [-]."""
    return {
        name: abs(answer[name].value / finest[name].value - 1.0)
        for name in QUANTITIES
        if name in answer.measures
    }
