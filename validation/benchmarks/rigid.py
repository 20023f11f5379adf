"""Rigid-block benchmarks: ``python -m validation.benchmarks.rigid [--json FILE|-] [--full]``.

Rows: dual Newton against clarabel on the same G at three sizes; the self-stress test against the
HiGHS linear program; a whole analysis of TSB1 pipe; with ``--full`` half a million contacts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

from geometry.loads import load_case
from mbd import (
    clarabel_equilibrium,
    classify,
    contact_jacobian,
    generalized_force,
    newton_equilibrium,
    solve_linear_programs,
)
from validation.build.blocks import build_scene
from validation.output.console import measuring, tabled
from validation.output.files import write_json
from validation.run.rigid.answer import run_rigid
from validation.run.stages import peak_memory_mb
from validation.scene.read import load_scene

Solver: TypeAlias = Callable[..., Any]


@dataclass(frozen=True)
class BenchmarkRow:
    """One comparison measured in one run."""

    name: str
    contacts: int
    cpu_seconds: float
    other: str
    other_cpu_seconds: float | None
    ratio: float | None
    """CPU seconds of the other over ours."""
    peak_memory_mb: float
    """Peak resident memory of the process so far [MB]."""


def _cpu(call: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = call()
    return time.process_time() - start, result


def _scene(around: int, radial: int, axial: int, layers: int) -> list[str]:
    return [
        f"mesh.around={around}",
        f"mesh.radial={radial}",
        f"mesh.axial={axial}",
        f"assembly.layers={layers}",
    ]


def compared(problem: tuple[str, Solver, str, Solver, str], settings: list[str]) -> BenchmarkRow:
    """Time two solvers on the same contact Jacobian (TSB1 pipe)."""
    name, ours, peer, theirs, both = problem
    assembly = build_scene(load_scene("tsb1-pipe", settings)).assembly
    load = load_case(assembly, "pipe", 0.01)
    contacts = contact_jacobian(assembly)
    force = generalized_force(assembly, load, contacts.free_blocks, contacts.length)
    seconds, a = _cpu(lambda: ours(contacts.jacobian, force))
    peer_seconds, b = _cpu(lambda: theirs(contacts.jacobian, force))
    assert getattr(a, both)
    assert getattr(a, both) == getattr(b, both)
    n, ratio = len(contacts.index), peer_seconds / seconds
    return BenchmarkRow(name, n, seconds, peer, peer_seconds, ratio, peak_memory_mb())


def whole_analysis(settings: list[str], name: str) -> BenchmarkRow:
    """Time everything from the scene to the measures."""
    seconds, run = _cpu(lambda: run_rigid(load_scene("tsb1-pipe", settings)))
    return BenchmarkRow(name, run.result.n_contacts, seconds, "–", None, None, peak_memory_mb())


def benchmark(*, full: bool) -> list[BenchmarkRow]:
    """Run every row; ``full`` adds half a million contacts."""
    rows = [whole_analysis([], "whole analysis, TSB1 pipe 84 × 8 × 20")]
    rows += [compared(_EQUILIBRIUM, _scene(*size, 12)) for size in _SIZES]
    rows.append(compared(_MECHANISM, _scene(24, 4, 6, 6)))
    if full:
        rows.append(whole_analysis(_scene(288, 28, 68, 12), "whole analysis, refined"))
    return rows


_SIZES = ((42, 4, 10), (60, 6, 14), (84, 8, 20))
_CLARABEL = "clarabel", clarabel_equilibrium
#: What is computed, our solver, the other's name and solver, and what both must agree on.
_EQUILIBRIUM = "equilibrium, TSB1 pipe", newton_equilibrium, *_CLARABEL, "holds"
_MECHANISM = "mechanism class", classify, "HiGHS, three LPs", solve_linear_programs, "mechanism"

_COLUMNS: dict[str, Callable[[BenchmarkRow], str]] = {
    "problem": lambda row: row.name,
    "contacts": lambda row: f"{row.contacts}",
    "ours [s]": lambda row: f"{row.cpu_seconds:.3f}",
    "other": lambda row: row.other,
    "other [s]": lambda row: _number(row.other_cpu_seconds, 3),
    "ratio": lambda row: _number(row.ratio, 1),
    "peak [MB]": lambda row: f"{row.peak_memory_mb:.0f}",
}


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def main() -> None:
    """Run the benchmark from the command line."""
    asked, console = measuring(__doc__, 118, full="half a million contacts too")
    rows = benchmark(full=asked.full)
    console.print(tabled("Rigid blocks, one thread: CPU seconds", rows, _COLUMNS))
    write_json(asked.json, [asdict(row) for row in rows])


if __name__ == "__main__":
    main()
