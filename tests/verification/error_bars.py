"""Whether error bars hold, and how much wider than errors they are: ``error-bars``.

Each problem of `tests.verification.error_problems` is solved on finer and finer meshes.
The default answer is the one at which `fem.solve_static` stops; its error is judged by a mesh
that is finer towards the edges, or by a closed form. What was solved is kept in
``out/error-bars.json``: a second call goes on with the problems that are missing, and judges
those that are there by the rule of `fem.accuracy` as it then is.
"""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

from fem import Problem, solve_static
from fem.accuracy.converge import TARGETS, converge, usual_work
from fem.accuracy.errors import OnMesh, growing, is_reached, sequence_bars, unresolved
from fem.accuracy.ladder import Rung, ladder_for
from geometry import Measure
from geometry.machine.work import budget
from tests.verification.error_problems import FINER_THAN, Case, cases, twelve_tubes

#: Meshes of the default.
DEFAULT = ladder_for(TARGETS)
STORED = Path("out/error-bars.json")
#: CPU time of one problem with its reference at most [s], and how one that takes more is kept.
MOST_SECONDS, TOO_DEAR = 600, "too dear"
#: Errors that matter to a reader [%]: bars of smaller ones may well be many times as wide.
VISIBLE = 0.1
#: Closed forms hold to the tolerance of the solver, relative to the displacement or to the largest
#: pressure or stress.
ROUNDING = 1e-6
#: Columns of the table of problems.
SHORT = {
    "max_displacement": "u [mm]",
    "p_eff": "p_eff [MPa]",
    "p_max_point": "p at a point [MPa]",
    "sigma_1_averaged": "averaged σ₁ [MPa]",
}


def solved(case: Case) -> dict[str, Any]:
    """Solve a problem as by default, and for its reference; plain data that is kept."""
    start = time.process_time()
    problem = case.problem()
    refined = replace(problem, degree=1)
    kept: dict[str, Any] = {"meshes": []}
    if problem.degree > 1:
        answer = solve_static(problem)
        kept["answer"] = {name: [m.value, m.error] for name, m in answer.measures.items()}
    else:
        with budget(usual_work(refined)):
            kept["meshes"] = converge(refined).meshes.as_json()
    if case.reference != "closed form":
        kept["finer"] = on_one_mesh(refined, reference_mesh(case, len(kept["meshes"])))
    return kept | {"cpu_seconds": time.process_time() - start}


def reference_mesh(case: Case, n: int) -> Rung:
    """Mesh of the reference: finer towards the edges than each of the n meshes of the answer."""
    chosen = case.finer
    while chosen in FINER_THAN and n > FINER_THAN[chosen][0]:
        chosen = FINER_THAN[chosen][1]
    return chosen


def on_one_mesh(problem: Problem, rung: Rung) -> dict[str, Any]:
    """What is reported of one mesh."""
    return converge(problem, ladder=(DEFAULT[0], rung)).meshes.meshes[-1].as_json()


def measured(mesh: Mapping[str, Any]) -> dict[str, Measure]:
    """Measures of a mesh that was kept."""
    return {
        name: Measure(
            value,
            "mm" if name == "max_displacement" else "MPa",
            resolved=name not in mesh["not_resolved"],
        )
        for name, value in mesh["measures"].items()
    }


def default_answer(meshes: Sequence[Mapping[str, Any]]) -> tuple[int, dict[str, Measure]]:
    """Number of the meshes after which `converge` stops, and the answer there."""
    history = [
        OnMesh(
            measured(mesh),
            rung,
            mesh["fineness"],
            mesh["fineness_along"],
            mesh["load_step_changes"],
        )
        for rung, mesh in zip(DEFAULT, meshes, strict=False)
    ]
    for n in range(2, len(meshes) + 1):
        bars = sequence_bars(history[:n])
        remarks = unresolved(history[:n]) | growing(history[:n])
        answer = {
            name: replace(m, error=bars.get(name), remark=remarks.get(name, ""))
            for name, m in history[n - 1].measures.items()
        }
        if is_reached(answer, TARGETS, n) or n == len(DEFAULT):
            break
    return n, answer


def references(case: Case, kept: Mapping[str, Any], n: int) -> dict[str, tuple[float, str]]:
    """Value and kind of the reference of each measure that has one."""
    if case.reference == "closed form":
        return {name: (value, "closed form") for name, value in case.exact().items()}
    finer = kept["finer"] if len(kept["meshes"]) == n else kept["meshes"][-1]
    return {name: (value, "finer") for name, value in finer["measures"].items()}


def judged(case: Case, kept: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """A row for each measure that has a reference."""
    if "answer" in kept:
        n = len(kept["meshes"])
        answer = {
            name: Measure(value, "mm" if name == "max_displacement" else "MPa", error=error)
            for name, (value, error) in kept["answer"].items()
        }
    else:
        n, answer = default_answer(kept["meshes"])
    stress = max(abs(m.value) for name, m in answer.items() if name != "max_displacement")
    for name, (value, kind) in references(case, kept, n).items():
        measure = answer[name]
        rounding = ROUNDING * (abs(value) if name == "max_displacement" else stress)
        size = max(abs(value), rounding)
        bar, error = measure.error or 0.0, abs(measure.value - value)
        exact = error <= rounding
        yield {
            "problem": case.name,
            "meshes": n,
            "measure": name,
            "value": measure.value,
            "bar [%]": 100.0 * bar / size,
            "reference": value,
            "kind": kind,
            "error [%]": 100.0 * error / size,
            "holds": error <= bar or exact,
            "bar/error": None if exact else bar / error,
            "printed": _not_a_number(measure),
        }


def _not_a_number(measure: Measure) -> str:
    """Why a value is printed as none to use; empty where it is a number."""
    return "a remark" if measure.remark else "" if measure.is_number else "not resolved"


def stored() -> dict[str, Any]:
    """Solutions that were kept, by problem."""
    found: dict[str, Any] = json.loads(STORED.read_text("utf-8")) if STORED.exists() else {}
    return found


def rows(chosen: Sequence[Case] | None = None) -> Iterable[dict[str, Any]]:
    """Every measure of some problems; those that are missing are solved and kept first."""
    for case in cases() if chosen is None else chosen:
        found = stored()
        if case.name not in found:
            found[case.name] = limited(case)
            STORED.parent.mkdir(exist_ok=True)
            STORED.write_text(json.dumps(found, indent=1, default=float), "utf-8")
        if TOO_DEAR not in found[case.name]:
            yield from judged(case, found[case.name])


def problems(chosen: Sequence[Case] | None = None) -> Iterable[dict[str, Any]]:
    """A row for each problem that was kept: values with error bars, their errors in brackets."""
    found = stored()
    for case in cases() if chosen is None else chosen:
        if TOO_DEAR in found.get(case.name, {TOO_DEAR: 0}):
            continue
        by_name = {row["measure"]: row for row in judged(case, found[case.name])}
        row = {"problem": case.name, "reference": next(iter(by_name.values()))["kind"]}
        yield row | {
            title: _cell(by_name[name]) for name, title in SHORT.items() if name in by_name
        }


def twelve() -> Iterable[dict[str, Any]]:
    """Twelve drawn tubes, a row each, and how many bars hold, in all and of each measure."""
    chosen = twelve_tubes()
    numbers = [row for row in rows(chosen) if not row["printed"]]
    yield from problems(chosen)
    for name in ("all numbers", *dict.fromkeys(row["measure"] for row in numbers)):
        of = [row for row in numbers if name in ("all numbers", row["measure"])]
        share = _share(name, of)
        words = f"{share['hold']} of {share['bars']} hold, median {share['median bar/error']:.2g}"
        yield {"problem": name, "bars": words}


def _cell(row: Mapping[str, Any]) -> str:
    """``value ± bar (error)``, the latter two in per cent of the reference."""
    if row["printed"]:
        return str(row["printed"])
    bar, error = row["bar [%]"], row["error [%]"]
    return f"{row['value']:.4g} ± {bar:.2g} % ({error:.1g} %)" + ("" if row["holds"] else " missed")


def limited(case: Case) -> dict[str, Any]:
    """What `solved` keeps, or that it takes more than `MOST_SECONDS`."""
    with ProcessPoolExecutor(1, get_context("spawn"), _limit) as pool:
        try:
            return pool.submit(_solved, case.name).result()
        except BrokenProcessPool:
            return {TOO_DEAR: MOST_SECONDS}


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))


def _solved(name: str) -> dict[str, Any]:
    return solved(next(case for case in (*cases(), *twelve_tubes()) if case.name == name))


def summary() -> Iterable[dict[str, Any]]:
    """Share of bars that hold and median of bar over error, of the problems that were kept."""
    found = stored()
    solved_ones = [c for c in cases() if c.name in found and TOO_DEAR not in found[c.name]]
    every = [row for c in solved_ones for row in judged(c, found[c.name])]
    numbers = [row for row in every if not row["printed"]]
    of_half = [
        [row for row in numbers if row["problem"] in {case.name for case in cases()[k::2]}]
        for k in (0, 1)
    ]
    names = dict.fromkeys(row["measure"] for row in every)
    yield _share("all numbers", numbers)
    yield _share(
        f"errors above {VISIBLE} %", [row for row in numbers if row["error [%]"] > VISIBLE]
    )
    yield _share("first, third, … problem (rule chosen)", of_half[0])
    yield _share("second, fourth, … problem (rule judged)", of_half[1])
    for kind in dict.fromkeys(row["kind"] for row in every):
        yield _share(f"reference: {kind}", [r for r in numbers if r["kind"] == kind])
    for name in names:
        yield _share(name, [row for row in numbers if row["measure"] == name])
    yield _share("bars over 30 %: printed as not resolved", [r for r in every if r["printed"]])
    seconds = sum(found[c.name].get("cpu_seconds", 0.0) for c in solved_ones)
    yield {"of": f"{len(solved_ones)} of {len(cases())} problems: {seconds:.0f} CPU s"}
    for case in cases():
        if case.name not in {known.name for known in solved_ones}:
            dear = found.get(case.name, {}).get(TOO_DEAR)
            yield {"of": f"{case.name}: " + (f"more than {dear} CPU s" if dear else "not run")}


def _share(words: str, chosen: list[dict[str, Any]]) -> dict[str, Any]:
    ratios = [row["bar/error"] for row in chosen if row["bar/error"] is not None]
    held = sum(row["holds"] for row in chosen)
    return {
        "of": words,
        "bars": len(chosen),
        "hold": held,
        "hold [%]": 100.0 * held / len(chosen) if chosen else None,
        "median bar/error": median(ratios) if ratios else None,
    }
