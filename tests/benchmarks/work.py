"""What runs take, beside what `geometry.machine.work` counts of them: one line for each.

``python -m tests.benchmarks.work [--fit] [--no-record] [NAME ...]`` (in ``make bench``)

CPU time and peak memory are those of a process of its own, the answer included and pictures not.
The first ratio is the counted work over the CPU time: the speed of this machine over the reference
machine, the same for all lines where the count is good. The second one is the CPU time over that of
the run before. ``--fit`` prints what an operation takes on this machine, by non-negative least
squares on relative errors: a new table for `geometry.machine.work.SECONDS`, once and on purpose.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.optimize import nnls

from geometry.machine.system import peak_memory_mb, write_whole
from geometry.machine.work import SECONDS, Operation, budget
from validation import Case, load_case, solve

LAST = Path(__file__).with_name("work.json")

#: What `own_panel` makes, in place of a scene.
OWN_PANEL = "panel of an OBJ"
#: Scene, method and settings of each line.
RUNS: Mapping[str, tuple[str, str, Mapping[str, Any]]] = {
    "p_max_point = 1 %": (
        "tsb1-pipe",
        "static",
        {"assembly.layers": 2, "fem.accuracy.p_max_point": 0.01},
    ),
    "p_max_point = 3 %": (
        "tsb1-pipe",
        "static",
        {"assembly.layers": 2, "fem.accuracy.p_max_point": 0.03},
    ),
    "u = 1 %, p_eff = 1 %": (
        "tsb1-pipe",
        "static",
        {"assembly.layers": 2, "fem.accuracy.u": 0.01, "fem.accuracy.p_eff": 0.01},
    ),
    "tsb1-pipe, 2 layers": ("tsb1-pipe", "static", {"assembly.layers": 2}),
    "tsb1-pipe, 12 layers": ("tsb1-pipe", "static", {"assembly.layers": 12}),
    "thb0-tunnel": ("thb0-tunnel", "static", {"assembly.layers": 2}),
    "planar-sine": ("planar-sine", "static", {}),
    "osteomorphic": ("osteomorphic", "static", {}),
    "tsb1-beam, 2 layers": ("tsb1-beam", "static", {"assembly.layers": 2}),
    "friction 0.3, 2 layers": (
        "tsb1-pipe",
        "static",
        {"assembly.layers": 2, "effects.friction": 0.3},
    ),
    "gap 0.05, 2 layers": (
        "tsb1-tunnel",
        "static",
        {"assembly.layers": 2, "contact.clearance": 0.05},
    ),
    "arch of 11, friction 0.7": (
        "arch",
        "static",
        {"block.thickness": 150.0, "assembly.voussoirs": 11, "effects.friction": 0.7},
    ),
    "panel of 3 x 3, friction 0.6": (OWN_PANEL, "static", {"effects.friction": 0.6}),
    "wall, friction 0.6": ("wall", "static", {}),
    "hertz-ball": ("hertz-ball", "static", {}),
    "rigid tube with friction": (
        "tsb1-pipe",
        "rigid",
        {"assembly.layers": 2, "effects.friction": 0.3},
    ),
    "rigid wall, all extras": (
        "wall",
        "rigid",
        {f"rigid.{name}": True for name in ("collapse", "sliding", "ranges", "margin")},
    ),
}


def own_panel(folder: Path, n: int = 3) -> Path:
    """Write a scene of n x n truncated tetrahedra in a fixed ring, blocks of an OBJ [mm]."""
    edge, half, lean = 100.0, 30.0, 0.3
    lines, fixed = list[str](), list[str]()
    for i, j in product(range(-1, n + 1), repeat=2):
        if {i, j} <= {-1, n}:
            continue
        outside = not {i, j}.isdisjoint({-1, n})
        side, name = (1 if (i + j) % 2 == 0 else -1), f"{'F' if outside else 'B'}_{i}_{j}"
        fixed += [name] * outside
        lines.append(f"o {name}")
        for z in (-half, half):
            x, y = edge / 2.0 + side * lean * z, edge / 2.0 - side * lean * z
            for a, b in ((-x, -y), (x, -y), (x, y), (-x, y)):
                lines.append(f"v {i * edge + a:.9g} {j * edge + b:.9g} {z:.9g}")
        # The last eight points.
        faces = ("-8 -5 -6 -7", "-4 -3 -2 -1", "-8 -7 -3 -4", "-7 -6 -2 -3", "-6 -5 -1 -2")
        lines += [f"f {face}" for face in (*faces, "-5 -8 -4 -1")]
    (folder / "panel.obj").write_text("\n".join(lines) + "\n", "utf-8")
    scene = folder / "panel.toml"
    scene.write_text(
        f"""[block]
type = "mesh"
units = "mm"
[[parts]]
file = "panel.obj"
[assembly]
fixed = {json.dumps(fixed)}
[effects]
gravity = [0.0, 0.0, -9810.0]
""",
        "utf-8",
    )
    return scene


def measured(name: str) -> dict[str, Any]:
    """CPU time [s], peak memory [MB] and operations of one run in this process."""
    scene, method, settings = RUNS[name]
    with TemporaryDirectory() as folder:
        source = own_panel(Path(folder)) if scene == OWN_PANEL else scene
        case = load_case(source, settings, method=method)
        return _measured(case)


def _measured(case: Case) -> dict[str, Any]:
    with budget() as spent:
        answer = solve(case)
        _ = answer.report
    return {
        "cpu": time.process_time(),
        "memory": peak_memory_mb(),
        "work": spent.seconds,
        "operations": dict(spent.done),
    }


def apart(name: str) -> dict[str, Any]:
    """The same in a process of its own."""
    command = [sys.executable, "-m", "tests.benchmarks.work", "--one", name]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def fitted(runs: Sequence[Mapping[str, Any]], idle: float) -> dict[str, float]:
    """Seconds of an operation by kind, from CPU times beyond those of an idle process."""
    counts = np.array([[run["operations"].get(kind, 0.0) for kind in Operation] for run in runs])
    times = np.array([run["cpu"] - idle for run in runs])
    sizes = counts.max(axis=0)
    scaled = counts / np.where(sizes > 0.0, sizes, 1.0) / times[:, None]
    found = nnls(scaled, np.ones(len(times)))[0] / np.where(sizes > 0.0, sizes, 1.0)
    return {str(kind): float(value) for kind, value in zip(Operation, found, strict=True)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the lines that are named, by default all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="lines; by default all")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--fit", action="store_true", help="print a table of seconds by operation")
    parser.add_argument("--no-record", action="store_true", help="keep the run before")
    given = parser.parse_args(arguments)
    if given.one:
        print(json.dumps(measured(given.one)))
        return
    last = json.loads(LAST.read_text("utf-8")) if LAST.is_file() else {}
    found = {}
    print(f"{'run':28} {'CPU s':>7} {'work s':>7} {'ratio':>6} {'before':>7} {'MB':>6}")
    for name in given.names or RUNS:
        run = found[name] = apart(name)
        before = f"{run['cpu'] / last[name]['cpu']:7.2f}" if name in last else f"{'':7}"
        ratio = run["work"] / run["cpu"]
        row = f"{run['cpu']:7.2f} {run['work']:7.2f} {ratio:6.2f} {before} {run['memory']:6.0f}"
        print(f"{name:28} {row}", flush=True)
    if given.fit:
        table = fitted(list(found.values()), 1.2)
        for kind, value in table.items():
            print(
                f"    Operation.{kind.upper()}: {value:.2g},  # now {SECONDS[Operation(kind)]:.2g}"
            )
    if not given.no_record:
        text = json.dumps(last | found, indent=1) + "\n"
        write_whole(LAST, lambda path: path.write_text(text, "utf-8"))


if __name__ == "__main__":
    main()
