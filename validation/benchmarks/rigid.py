"""Rigid-block benchmarks: ``python -m validation.benchmarks.rigid [--json FILE|-] [--full]``.

Rows: dual Newton against clarabel on the same G at three sizes; the self-stress test against the
HiGHS linear program; a whole analysis of TSB1 pipe; with ``--full`` half a million contacts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape

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
from validation.output.console import listing, measuring
from validation.output.files import write_json
from validation.run.rigid.answer import run_rigid
from validation.run.stages import peak_memory_mb
from validation.scene.read import load_scene


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


def newton_against_clarabel(settings: list[str]) -> BenchmarkRow:
    """Time both solvers on the same contact Jacobian (TSB1 pipe)."""
    assembly = build_scene(load_scene("tsb1-pipe", settings)).assembly
    load = load_case(assembly, "pipe", 0.01)
    contacts = contact_jacobian(assembly)
    force = generalized_force(assembly, load, contacts.free_blocks, contacts.length)
    ours, a = _cpu(lambda: newton_equilibrium(contacts.jacobian, force))
    other, b = _cpu(lambda: clarabel_equilibrium(contacts.jacobian, force))
    assert a.holds
    assert b.holds
    n = len(contacts.index)
    return BenchmarkRow(
        "equilibrium, TSB1 pipe", n, ours, "clarabel", other, other / ours, peak_memory_mb()
    )


def self_stress_against_highs(settings: list[str]) -> BenchmarkRow:
    """Time the classification by self-stress against the linear programs in HiGHS."""
    assembly = build_scene(load_scene("tsb1-pipe", settings)).assembly
    load = load_case(assembly, "pipe", 0.01)
    contacts = contact_jacobian(assembly)
    force = generalized_force(assembly, load, contacts.free_blocks, contacts.length)
    ours, a = _cpu(lambda: classify(contacts.jacobian, force))
    other, b = _cpu(lambda: solve_linear_programs(contacts.jacobian, force))
    assert a.mechanism is b.mechanism
    n = len(contacts.index)
    return BenchmarkRow(
        "mechanism class", n, ours, "HiGHS, three LPs", other, other / ours, peak_memory_mb()
    )


def whole_analysis(settings: list[str], name: str) -> BenchmarkRow:
    """Time everything from the scene to the measures."""
    seconds, run = _cpu(lambda: run_rigid(load_scene("tsb1-pipe", settings)))
    return BenchmarkRow(name, run.result.n_contacts, seconds, "–", None, None, peak_memory_mb())


def benchmark(*, full: bool) -> list[BenchmarkRow]:
    """Run every row; ``full`` adds half a million contacts."""
    rows = [whole_analysis([], "whole analysis, TSB1 pipe 84 × 8 × 20")]
    rows += [newton_against_clarabel(_scene(*size, 12)) for size in _SIZES]
    rows.append(self_stress_against_highs(_scene(24, 4, 6, 6)))
    if full:
        rows.append(whole_analysis(_scene(288, 28, 68, 12), "whole analysis, refined"))
    return rows


_SIZES = ((42, 4, 10), (60, 6, 14), (84, 8, 20))


def print_rows(rows: list[BenchmarkRow], console: Console) -> None:
    """Print the rows as a table."""
    heads = ("contacts", "ours [s]", "other", "other [s]", "ratio", "peak [MB]")
    title = "Rigid blocks, one thread: CPU seconds"
    table = listing(title, "problem", numbers=map(escape, heads))
    table.columns[3].justify = "left"
    for row in rows:
        other = "" if row.other_cpu_seconds is None else f"{row.other_cpu_seconds:.3f}"
        ratio = "" if row.ratio is None else f"{row.ratio:.1f}"
        table.add_row(
            row.name,
            str(row.contacts),
            f"{row.cpu_seconds:.3f}",
            row.other,
            other,
            ratio,
            f"{row.peak_memory_mb:.0f}",
        )
    console.print(table)


def main() -> None:
    """Run the benchmark from the command line."""
    asked, console = measuring(__doc__, 118, full="half a million contacts too")
    rows = benchmark(full=asked.full)
    print_rows(rows, console)
    write_json(asked.json, [asdict(row) for row in rows])


if __name__ == "__main__":
    main()
