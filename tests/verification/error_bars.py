"""Whether error bars hold, and how much wider than errors they are: ``error-bars``.

Each problem of `tests.verification.error_problems` is solved on finer and finer meshes as by
default; its error is judged by a mesh that is none of these, finer towards the edges, or by a
closed form. What was solved is kept in ``out/error-bars.json``: a second call goes on with the
problems that are missing, and judges those that are there by the rule of `fem.accuracy` as it then
is.
"""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

from fem import Problem
from fem.accuracy.converge import TARGETS, WITH_FRICTION, converge, usual_work
from fem.accuracy.errors import OnMesh, growing, is_reached, sequence_bars, unresolved, with_stick
from fem.accuracy.ladder import Rung, ladder_for
from geometry import Measure
from geometry.machine.work import budget
from tests.verification.error_problems import FINER_FROM, Case, cases

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
    kept = of_default(problem)
    if case.finer is not None:
        kept["finer"] = reference(problem, reference_mesh(case.finer, len(kept["meshes"])))
    return kept | {"cpu_seconds": time.process_time() - start}


def of_default(problem: Problem) -> dict[str, Any]:
    """Numbers of all meshes that the default solves, and what its rule depends on."""
    with budget(usual_work(problem)):
        found = converge(problem)
    meshes = [mesh.as_json() | {"rung": asdict(mesh.rung)} for mesh in found.meshes.meshes]
    of = {"searched": problem.searches, "friction": problem.coulomb is not None}
    return of | {"stick": dict(found.stick), "meshes": meshes}


def reference_mesh(finer: Rung, n: int) -> Rung:
    """Mesh of the reference: finer towards the edges than each of the n meshes of the answer."""
    while finer in FINER_FROM and n >= FINER_FROM[finer][0]:
        finer = FINER_FROM[finer][1]
    return finer


def reference(problem: Problem, rung: Rung) -> dict[str, float]:
    """Values on a mesh."""
    ladder = (ladder_for(TARGETS, problem)[0], rung)
    return converge(problem, ladder=ladder).meshes.meshes[-1].values


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


def default_answer(kept: Mapping[str, Any]) -> tuple[int, dict[str, Measure]]:
    """Number of the meshes after which `converge` stops, and the answer there."""
    meshes, targets = kept["meshes"], WITH_FRICTION if kept["friction"] else TARGETS
    history = [
        OnMesh(
            measured(mesh),
            Rung(**mesh["rung"]),
            mesh["fineness"],
            mesh["fineness_along"],
            mesh["load_step_changes"],
        )
        for mesh in meshes
    ]
    for n in range(1, len(meshes) + 1):
        bars = sequence_bars(history[:n], searched=kept["searched"]) if n > 1 else {}
        bars = with_stick(bars, kept["stick"])
        remarks = unresolved(history[:n]) | growing(history[:n])
        answer = {
            name: replace(m, error=bars.get(name), remark=remarks.get(name, ""))
            for name, m in history[n - 1].measures.items()
        }
        if is_reached(answer, targets, n):
            break
    return n, answer


def judged(case: Case, kept: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """A row for each measure that has a reference."""
    n, answer = default_answer(kept)
    stress = max(abs(m.value) for name, m in answer.items() if name != "max_displacement")
    for name, value in (kept["finer"] if case.finer is not None else case.exact()).items():
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
            "kind": "closed form" if case.finer is None else "another mesh",
            "error [%]": 100.0 * error / size,
            "holds": error <= bar or exact,
            "bar/error": None if exact else bar / error,
            "printed": _not_a_number(measure),
        }


def _not_a_number(measure: Measure) -> str:
    """Why a value is printed as none to use; empty where it is a number."""
    if measure.error is None:
        return "no bar"
    return "a remark" if measure.remark else "" if measure.is_number else "not resolved"


def stored() -> dict[str, Any]:
    """Solutions that were kept, by problem."""
    found: dict[str, Any] = json.loads(STORED.read_text("utf-8")) if STORED.exists() else {}
    return found


def rows() -> Iterable[dict[str, Any]]:
    """Every measure of all problems; those that are missing are solved and kept first."""
    for case in cases():
        found = stored()
        if case.name not in found:
            kept = limited(case)
            found = stored() | {case.name: kept}
            STORED.parent.mkdir(exist_ok=True)
            STORED.write_text(json.dumps(found, indent=1, default=float), "utf-8")
        if TOO_DEAR not in found[case.name]:
            yield from judged(case, found[case.name])


def problems() -> Iterable[dict[str, Any]]:
    """A row for each problem that was kept: values with error bars, their errors in brackets."""
    found = stored()
    for case in cases():
        if TOO_DEAR in found.get(case.name, {TOO_DEAR: 0}):
            continue
        by_name = {row["measure"]: row for row in judged(case, found[case.name])}
        first = next(iter(by_name.values()))
        row = {"problem": case.name, "reference": first["kind"], "meshes": first["meshes"]}
        yield row | {
            title: _cell(by_name[name]) for name, title in SHORT.items() if name in by_name
        }


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
    return solved(next(case for case in cases() if case.name == name))


def summary() -> Iterable[dict[str, Any]]:
    """Share of bars that hold and median of bar over error, of the problems that were kept."""
    found = stored()
    solved_ones = [c for c in cases() if c.name in found and TOO_DEAR not in found[c.name]]
    every = [row for c in solved_ones for row in judged(c, found[c.name])]
    numbers = [row for row in every if not row["printed"]]
    special = {
        word: [c.name for c in solved_ones if word in c.name]
        for word in ("friction", "own", "boxes")
    }
    special["gaps"] = [c.name for c in solved_ones if "clear" in c.name or "spacing" in c.name]
    yield _share("all numbers", numbers)
    yield _share(f"errors above {VISIBLE} %", [r for r in numbers if r["error [%]"] > VISIBLE])
    for word, names in special.items():
        yield _share(f"problems: {word}", [r for r in numbers if r["problem"] in names])
    for key in ("kind", "meshes", "measure"):
        for value in sorted({row[key] for row in every}):
            yield _share(f"{key}: {value}", [row for row in numbers if row[key] == value])
    yield _share("printed as not resolved", [row for row in every if row["printed"]])
    seconds = sum(found[c.name]["cpu_seconds"] for c in solved_ones)
    yield {"of": f"{len(solved_ones)} of {len(cases())} problems: {seconds:.0f} CPU s"}
    for case in cases():
        if case.name not in {known.name for known in solved_ones}:
            dear = found.get(case.name, {}).get(TOO_DEAR)
            yield {"of": f"{case.name}: " + (f"more than {dear} CPU s" if dear else "not run")}


def _share(words: str, chosen: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    ratios = [row["bar/error"] for row in chosen if row["bar/error"] is not None]
    held = sum(row["holds"] for row in chosen)
    return {
        "of": words,
        "bars": len(chosen),
        "hold": held,
        "hold [%]": 100.0 * held / len(chosen) if chosen else None,
        "median bar/error": median(ratios) if ratios else None,
    }
