"""CPU time and memory of runs beside the work that `geometry.machine.work` counts of them.

``python -m tests.benchmarks.work [--fit] [RUN ...]``: each run is a process of its own. The ratio
of counted work to CPU time is the speed of this machine over the reference machine, the same for
all runs where the count is good. ``--fit`` prints a new table for `geometry.machine.work.SECONDS`,
which leaves the median ratio as it is: least squares of the runs' relative errors, in which the
present table counts too (Tikhonov's regularisation: some operations cost little in every run).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import nnls

from geometry.machine.system import peak_memory_mb
from geometry.machine.work import SECONDS, Operation, budget
from geometry.mesh import FloatArray
from validation import load_case, solve

_TWO = "tsb1-pipe static assembly.layers=2"
#: Scene, method and settings of each run.
RUNS = (
    f"{_TWO} fem.accuracy.p_max_point=0.01",
    f"{_TWO} fem.accuracy.p_max_point=0.03",
    f"{_TWO} fem.accuracy.u=0.01 fem.accuracy.p_eff=0.01",
    _TWO,
    f"{_TWO} effects.friction=0.3",
    "tsb1-pipe static assembly.layers=12",
    "tsb1-tunnel static assembly.layers=2 contact.clearance=0.05",
    "tsb1-beam static assembly.layers=2",
    "thb0-tunnel static assembly.layers=2",
    "planar-sine static",
    "osteomorphic static",
    "arch static block.thickness=150 assembly.voussoirs=11 effects.friction=0.7",
    "octahedra static effects.gravity=[0,0,-9810] effects.friction=0.6",
    "wall static",
    "hertz-ball static",
    "tsb1-pipe explicit assembly.layers=2",
    "tsb1-pipe rigid assembly.layers=2 effects.friction=0.3",
    "wall rigid rigid.collapse=true rigid.sliding=true rigid.ranges=true rigid.margin=true",
)
#: Error of a run's counted work beside that of an operation's present seconds [-].
_TRUSTED = 0.2


def measured(run: str) -> dict[str, Any]:
    """CPU time beyond the start [s], peak memory [MB], counted work [s] and operations."""
    scene, method, *settings = run.split()
    case = load_case(scene, settings, method=method)
    start = time.process_time()
    with budget() as spent:
        _ = solve(case).report
    return {
        "cpu": time.process_time() - start,
        "memory": peak_memory_mb(),
        "work": spent.seconds,
        "operations": dict(spent.done),
    }


def ratios(runs: Sequence[Mapping[str, Any]], seconds: Mapping[Operation, float]) -> FloatArray:
    """Counted work over CPU time of each run with such seconds of an operation [-]."""
    return np.array(
        [
            sum(n * seconds[Operation(kind)] for kind, n in run["operations"].items()) / run["cpu"]
            for run in runs
        ]
    )


def fitted(runs: Sequence[Mapping[str, Any]]) -> dict[Operation, float]:
    """Seconds of an operation by kind on the reference machine."""
    speed = np.median(ratios(runs, SECONDS))
    alone = [
        ratios(runs, dict.fromkeys(Operation, 0.0) | {kind: SECONDS[kind]}) for kind in Operation
    ]
    trusted = _TRUSTED * np.eye(len(Operation))
    factors, _ = nnls(
        np.concatenate([np.transpose(alone) / speed, trusted]),
        np.concatenate([np.ones(len(runs)), trusted.sum(axis=1)]),
    )
    return {kind: factor * SECONDS[kind] for kind, factor in zip(Operation, factors, strict=True)}


def main() -> None:
    """Print a row of each run that is named, by default of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", metavar="RUN", default=RUNS)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--fit", action="store_true", help="print a table of seconds by operation")
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measured(given.runs[0])))
        return
    results = []
    print(f"{'CPU s':>7} {'work s':>7} {'ratio':>6} {'MB':>6}")
    for run in given.runs:
        command = [sys.executable, "-m", "tests.benchmarks.work", "--one", run]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        one = json.loads(done.stdout.splitlines()[-1])
        results.append(one)
        ratio = one["work"] / one["cpu"]
        print(
            f"{one['cpu']:7.2f} {one['work']:7.2f} {ratio:6.2f} {one['memory']:6.0f}  {run}",
            flush=True,
        )
    if given.fit:
        table = fitted(results)
        for kind, value in table.items():
            print(f"    Operation.{kind.name}: {value:.2g},  # now {SECONDS[kind]:.2g}")
        for name, seconds in {"now": SECONDS, "fitted": table}.items():
            least, most = np.quantile(ratios(results, seconds), (0.0, 1.0))
            print(f"ratios, {name}: {least:.2f} to {most:.2f}")


if __name__ == "__main__":
    main()
