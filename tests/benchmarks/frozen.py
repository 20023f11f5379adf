"""Answers of two commits beside each other: what differs, and the ratio of CPU times.

``python -m tests.benchmarks.frozen OLD [NEW] [--only NAME ...] [--list]`` (``make frozen OLD=...``)

Commits are checked out to a temporary folder; NEW is by default the working tree. Both run the same
problems with this environment, by `validation.load_case`, `validation.solve` and the command line
alone, so that everything below may be rebuilt. Numbers are compared with a tolerance for each
problem, relative to the largest number of their kind in the answer (all forces, all moments …). The
exit status is 1 where one differs by more. Counts (nodes, iterations, steps) and CPU times are
printed where they differ, and do not count.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parents[2]
PACKAGES = ("geometry", "mbd", "fem", "validation")
#: What is left out of answers: times, memory, versions, residuals, which are round-off, and ratios
#: of forces that are compared.
_LEFT_OUT = {
    *("cpu_seconds", "compile_seconds", "peak_memory_mb", "work", "json_version", "provenance"),
    *("residual", "settling", "imbalance", "energy_balance", "search_change", "round_off"),
    *("element_updates_per_cpu_second", "bytes_per_block", "state_mb", "remarks", "memory"),
    "eccentricity",
}
#: Compiled code of all trees, by their sources.
KERNELS = ROOT / "out" / "kernels"
#: With more threads linear algebra sums in an order that changes from run to run.
_ALONE = {"OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "NUMBA_CACHE_DIR": str(KERNELS)}
#: CPU times that differ by more are marked [-].
_CPU = 0.1


@dataclass(frozen=True)
class Frozen:
    """One problem."""

    scene: str
    tolerance: float
    """Of numbers, relative to the largest of their kind [-]."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    deck: str = ""
    """Flavour of the deck that is compared instead of an answer; ``run``: it is solved."""


_TUBE = {"mesh.around": 12, "mesh.radial": 1, "mesh.axial": 4}
_HEXAGONS = {"assembly.layers": 2, "mesh.edge": 4, "mesh.radial": 1}
_STATIC = {"fem.method": "static", "fem.mesh": "scene", "fem.error_estimate": False}
_BARS = {"fem.method": "static", "fem.mesh": "scene"}
_EXPLICIT = {"fem.method": "explicit"}
_SHORT = {"fem.end_time": 0.002, "fem.ramp_time": 0.001}
_ONE, _TWO = {**_TUBE, "assembly.layers": 1}, {**_TUBE, "assembly.layers": 2}
_ROUGH, _SLIDES = {"effects.friction": 0.3}, {"effects.finite_sliding": True}
_IN_STEPS = {**_ROUGH, "fem.load_steps": 4}

#: Conforming contact, general contact or degree above 1, explicit; explicit with friction.
_MATCHED, _SEARCHED, _IN_TIME, _ROUGH_SEARCHED, _ROUGH_MATCHED = 1e-12, 1e-9, 1e-11, 1e-10, 1e-6

PROBLEMS = {
    "conforming": Frozen("tsb1-pipe", _MATCHED, {**_TWO, **_BARS}),
    "sliding and friction": Frozen(
        "tsb1-pipe", _SEARCHED, {**_ONE, **_STATIC, **_SLIDES, **_IN_STEPS}
    ),
    "pushed panel": Frozen(
        "pushed-panel", _MATCHED, {**_STATIC, "mesh.divisions": 1, "fem.motion_steps": 2}
    ),
    "elastic frame": Frozen("tsb1-pipe", _MATCHED, {**_TWO, **_STATIC, "effects.elastic_frame": 1}),
    "sliding": Frozen("tsb1-pipe", _SEARCHED, {**_TWO, **_STATIC, **_SLIDES}),
    "not matching": Frozen("column-nonmatching", _SEARCHED, _BARS),
    "friction": Frozen("tsb1-pipe", _MATCHED, {**_ONE, **_STATIC, **_IN_STEPS}),
    "whole tube, reduced": Frozen(
        "tsb1-pipe",
        _MATCHED,
        {**_ONE, **_STATIC, "fem.symmetry": "none", "fem.element": "reduced"},
    ),
    "degree 2": Frozen("thb0-tunnel", _SEARCHED, {**_HEXAGONS, **_BARS, "fem.degree": 2}),
    "degree 3": Frozen("tsb1-pipe", _SEARCHED, {**_ONE, **_STATIC, "fem.degree": 3}),
    "degree 4": Frozen("tsb1-pipe", _SEARCHED, {**_ONE, **_STATIC, "fem.degree": 4}),
    "refined": Frozen("tsb1-pipe", _SEARCHED, {**_TWO, "fem.accuracy.p_eff": 0.1}),
    "periodic cell": Frozen(
        "tsb1-pipe", _MATCHED, {**_TWO, **_STATIC, "fem.symmetry": "periodic cell"}
    ),
    "moving supports in turn": Frozen(
        "cattaneo-mindlin", _MATCHED, {**_STATIC, "mesh.elements": 2, "fem.motion_steps": 4}
    ),
    "springs": Frozen("beam-on-springs", _SEARCHED, {**_STATIC, "mesh.divisions": [24, 1, 1]}),
    "gap": Frozen("tsb1-pipe", _MATCHED, {**_TWO, **_STATIC, "contact.clearance": 0.05}),
    "explicit": Frozen("tsb1-pipe", _IN_TIME, {**_ONE, **_EXPLICIT}),
    "explicit, sliding": Frozen("tsb1-pipe", _IN_TIME, {**_ONE, **_EXPLICIT, **_SHORT, **_SLIDES}),
    "explicit, friction": Frozen(
        "tsb1-pipe", _ROUGH_MATCHED, {**_ONE, **_EXPLICIT, **_SHORT, **_ROUGH}
    ),
    "explicit, sliding and friction": Frozen(
        "tsb1-pipe", _ROUGH_SEARCHED, {**_ONE, **_EXPLICIT, **_SHORT, **_SLIDES, **_ROUGH}
    ),
    "explicit, rotation": Frozen("spinning-block", _IN_TIME, {"mesh.divisions": [4, 2, 2]}),
    "explicit, restarts": Frozen("column", _IN_TIME, {**_EXPLICIT, "load.pressure": 8.0}),
    "explicit, dampers": Frozen(
        "cantilever",
        _IN_TIME,
        {
            **_EXPLICIT,
            **_SHORT,
            "mesh.divisions": [10, 1, 2],
            "fem.element": "reduced",
            "effects.rayleigh.mass_proportional": 2.0,
            "effects.rayleigh.stiffness_proportional": 1e-8,
            "effects.bulk_viscosity": {},
        },
    ),
    "deck, general": Frozen("tsb1-pipe", 0.0, {**_ONE, **_IN_STEPS}, deck="general"),
    "deck, calculix": Frozen("thb0-tunnel", 0.0, _HEXAGONS, deck="calculix"),
    "deck in stages": Frozen("shifted-boxes", _MATCHED, {"fem.motion_steps": 4}, deck="run"),
}


# ---------------------------------------------------------------------------------------------
# One problem in a process of its own


def answered(problem: Frozen) -> dict[str, Any]:
    """Answer as plain data, and the CPU time [s]; files are written to the folder at hand."""
    from validation import load_case, solve

    case = load_case(problem.scene, problem.settings)
    start = time.process_time()
    if not problem.deck:
        data = solve(case).as_dict()
    else:
        words = [f"--set={key}={json.dumps(value)}" for key, value in problem.settings.items()]
        flavour = ["--flavour", problem.deck] if problem.deck != "run" else []
        command("export", problem.scene, "-o", "deck.inp", *flavour, *words)
        # The second line names the version.
        lines = Path("deck.inp").read_text("utf-8").splitlines()
        text = "\n".join(line for line in lines if not line.startswith("tubelock "))
        data = {"digest": hashlib.sha256(text.encode()).hexdigest()}
        if problem.deck == "run":
            command("deck", "deck.inp", "--run", "--json", "deck.json")
            data |= json.loads(Path("deck.json").read_text("utf-8"))
    return {"answer": data, "cpu": time.process_time() - start}


def command(*words: str) -> None:
    """Run a command in this process."""
    (tubelock,) = entry_points(group="console_scripts", name="tubelock")
    sys.argv = ["tubelock", *words]
    with contextlib.redirect_stdout(sys.stderr):
        try:
            tubelock.load()()
        except SystemExit as stop:
            if stop.code:
                raise


def runs(name: str, trees: Sequence[Path]) -> list[dict[str, Any]]:
    """The same in each tree at the same time, again where machine code was compiled."""
    kernels = len(list(KERNELS.rglob("*")))
    with contextlib.ExitStack() as stack:
        folders = [Path(stack.enter_context(TemporaryDirectory())) for _ in trees]
        begun = [
            subprocess.Popen(
                # Not this file's folder, but the tree is where packages are imported from.
                [sys.executable, "-P", __file__, "--one", name],
                cwd=folder,
                env=os.environ | _ALONE | {"PYTHONPATH": str(tree)},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            for tree, folder in zip(trees, folders, strict=True)
        ]
        results = []
        for run in begun:
            out, errors = run.communicate()
            last = errors.strip().splitlines()[-1:] or ["no answer"]
            results.append({"failed": last[0]} if run.returncode else json.loads(out))
    if len(list(KERNELS.rglob("*"))) != kernels:
        return runs(name, trees)
    return results


# ---------------------------------------------------------------------------------------------
# Comparison


def entries(data: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested data with their places."""
    if isinstance(data, Mapping) and data.get("group") == "time":
        return
    if isinstance(data, Mapping):
        for key, value in data.items():
            if key == "status":
                yield f"{place}.status", str(value).split()[0]
            elif key not in _LEFT_OUT:
                yield from entries(value, f"{place}.{key}" if place else key)
    elif isinstance(data, list):
        for number, value in enumerate(data):
            yield from entries(value, f"{place}[{number}]")
    else:
        yield place, data


def kind(place: str) -> str:
    """Numbers of one kind have one scale: ``joints[3].normal_force`` is a force.

    A measure and its error bar are one of their own.
    """
    if place.startswith("measures."):
        return place.rpartition(".")[0]
    words = place.replace("]", "").replace("[", ".").split(".")
    last = next(word for word in reversed(words) if not word.isdigit())
    return last.rpartition("_")[2]


def differences(
    old: Mapping[str, Any], new: Mapping[str, Any], tolerance: float
) -> tuple[list[str], list[str], float]:
    """Lines of what differs beyond the tolerance, of counts that differ; largest difference."""
    ours, theirs = dict(entries(new)), dict(entries(old))
    scales: dict[str, float] = {}
    for place, value in [*ours.items(), *theirs.items()]:
        if isinstance(value, float) and math.isfinite(value):
            scales[kind(place)] = max(scales.get(kind(place), 0.0), abs(value))
    wrong, counts, largest = [], [], 0.0
    for place in dict.fromkeys([*theirs, *ours]):
        a, b = theirs.get(place, "absent"), ours.get(place, "absent")
        if repr(a) == repr(b):
            continue
        if isinstance(a, float) and isinstance(b, float):
            share = abs(a - b) / scales[kind(place)]
            largest = max(largest, share)
            if not share <= tolerance:
                wrong.append(f"{place}: {a!r} -> {b!r}, {share:.1e}")
        elif isinstance(a, int) and isinstance(b, int):
            counts.append(f"{place}: {a} -> {b}")
        else:
            wrong.append(f"{place}: {a!r} -> {b!r}")
    return wrong, counts, largest


def compared(name: str, trees: Sequence[Path]) -> bool:
    """Print one problem; whether its answers are the same."""
    old, new = runs(name, trees)
    problem = PROBLEMS[name]
    if "failed" in old or "failed" in new:
        same = old == new
        print(f"{name:31} {'both fail' if same else 'FAILS'}", flush=True)
        for title, run in (("old", old), ("new", new)):
            print(f"    {title}: {run.get('failed', 'an answer')}", flush=True)
        return False
    wrong, counts, largest = differences(old["answer"], new["answer"], problem.tolerance)
    ratio = new["cpu"] / old["cpu"]
    told = "the same" if largest == 0.0 and not wrong else f"within {largest:.1e}"
    told = f"{len(wrong)} DIFFER, most {largest:.1e}" if wrong else told
    mark = "  <- CPU" if abs(ratio - 1.0) > _CPU else ""
    print(f"{name:31} {told:28} CPU {new['cpu']:6.2f} s, x {ratio:.2f}{mark}", flush=True)
    for line in [*counts[:8], *wrong[:12]]:
        print(f"    {line}", flush=True)
    if len(counts) > 8 or len(wrong) > 12:
        print(f"    ... {len(counts)} counts and {len(wrong)} values in all", flush=True)
    return not wrong


# ---------------------------------------------------------------------------------------------


@contextlib.contextmanager
def checked_out(commit: str | None) -> Iterator[Path]:
    """Folder of a commit; None: the working tree."""
    if commit is None:
        yield ROOT
        return
    with TemporaryDirectory() as folder:
        tree = Path(folder, "tree")
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(tree), commit], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def main() -> None:
    """Compare the problems that are named, by default all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("old", nargs="?", metavar="OLD", help="commit that is compared with")
    parser.add_argument("new", nargs="?", metavar="NEW", help="commit; by default the working tree")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=PROBLEMS, default=[*PROBLEMS])
    parser.add_argument("--list", action="store_true", help="print the names of all problems")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(answered(PROBLEMS[given.one])))
    elif given.list:
        for name, problem in PROBLEMS.items():
            print(f"{name:31} {problem.scene:20} {problem.tolerance:.0e}")
    elif given.old is None:
        parser.error("got no commit; expected OLD, such as HEAD~1")
    else:
        # A run that is ended leaves no folder behind.
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        with checked_out(given.old) as old, checked_out(given.new) as new:
            for tree in (old, new):
                packages = [str(tree / name) for name in PACKAGES]
                subprocess.run([sys.executable, "-m", "compileall", "-q", *packages], check=True)
            same = [compared(name, (old, new)) for name in given.only]
        print(f"{sum(same)} of {len(same)} problems have the same answer")
        sys.exit(not all(same))


if __name__ == "__main__":
    main()
