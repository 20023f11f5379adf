"""Rigid-block benchmarks: ``python -m tests.benchmarks.rigid [--json FILE|-]``.

Rows: a whole analysis of TSB1 pipe; dual Newton against clarabel on the same G at three sizes; the
self-stress test against the HiGHS linear program.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from geometry.loads import named_load
from geometry.machine.system import peak_memory_mb
from mbd import contact_jacobian
from mbd.equilibrium import clarabel_equilibrium, newton_equilibrium
from mbd.mechanism import classify
from tests.benchmarks.stopwatch import measuring
from tests.support.linear_programs import solve_linear_programs
from validation import load_case, solve
from validation.output.console import tabled
from validation.output.files import write_json


@dataclass(frozen=True)
class BenchmarkRow:
    """One problem, by one solver or by two."""

    name: str
    contacts: int
    cpu_seconds: float
    other: str = "–"
    other_cpu_seconds: float | None = None
    peak_memory_mb: float = 0.0
    """Peak resident memory of the process so far [MB]."""


def _cpu(call: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = call()
    return time.process_time() - start, result


def _scene(around: int, radial: int, axial: int, layers: int) -> list[str]:
    mesh = f"mesh={{around={around},radial={radial},axial={axial}}}"
    return [mesh, f"assembly.layers={layers}"]


#: What is computed, on which scene, our solver, the other's name and solver, what both agree on.
_PEERS: tuple[tuple[Any, ...], ...] = (
    *(
        ("equilibrium", _scene(*size, 12), newton_equilibrium, "clarabel", clarabel_equilibrium)
        for size in ((42, 4, 10), (60, 6, 14), (84, 8, 20))
    ),
    ("mechanism", _scene(24, 4, 6, 6), classify, "HiGHS, three LPs", solve_linear_programs),
)
_AGREED = {"equilibrium": "holds", "mechanism": "mechanism"}


def compared(
    name: str, settings: list[str], ours: Callable[..., Any], other: str, theirs: Callable[..., Any]
) -> BenchmarkRow:
    """Time two solvers on the same contact Jacobian (TSB1 pipe)."""
    assembly = load_case("tsb1-pipe", settings).problem.blocks
    contacts = contact_jacobian(assembly)
    load = named_load("pipe", 0.01).on(assembly)
    force = contacts.rows(load.wrenches)
    seconds, a = _cpu(lambda: ours(contacts.jacobian, force))
    other_seconds, b = _cpu(lambda: theirs(contacts.jacobian, force))
    assert getattr(a, _AGREED[name])
    assert getattr(a, _AGREED[name]) == getattr(b, _AGREED[name])
    n = len(contacts.index)
    return BenchmarkRow(name, n, seconds, other, other_seconds, peak_memory_mb())


def whole_analysis(settings: list[str]) -> BenchmarkRow:
    """Time everything from the scene to the measures."""
    seconds, run = _cpu(lambda: solve(load_case("tsb1-pipe", settings, method="rigid")))
    n = run.details.n_contacts
    return BenchmarkRow("whole analysis", n, seconds, peak_memory_mb=peak_memory_mb())


_COLUMNS: dict[str, Callable[[BenchmarkRow], str]] = {
    "problem": lambda row: row.name,
    "contacts": lambda row: f"{row.contacts}",
    "ours [s]": lambda row: f"{row.cpu_seconds:.3f}",
    "other": lambda row: row.other,
    "other [s]": lambda row: f"{row.other_cpu_seconds:.3f}" if row.other_cpu_seconds else "–",
    "peak [MB]": lambda row: f"{row.peak_memory_mb:.0f}",
}


def main() -> None:
    """Run the benchmark from the command line."""
    asked, console = measuring(__doc__, 118)
    rows = [whole_analysis([]), *(compared(*peer) for peer in _PEERS)]
    console.print(tabled("TSB1 pipe, rigid blocks, one thread: CPU seconds", rows, _COLUMNS))
    write_json(asked.json, [asdict(row) for row in rows])


if __name__ == "__main__":
    main()
