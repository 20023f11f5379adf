"""Programs that measure: what they are asked, and times that other processes disturb least."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from validation.output.files import prepare_file


def measuring(about: str | None, width: int, **flags: str) -> tuple[argparse.Namespace, Console]:
    """What a program that measures is asked, and its console: ``--json FILE|-`` and flags."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--json", metavar="FILE|-")
    for flag, words in flags.items():
        parser.add_argument(f"--{flag}", action="store_true", help=words)
    requested = parser.parse_args()
    if requested.json not in (None, "-"):
        prepare_file(Path(requested.json))
    return requested, Console(stderr=requested.json == "-", width=width, markup=False)


def best_cpu_seconds(work: Callable[[], object], *, repeats: int = 1, trials: int = 12) -> float:
    """Least CPU time of one call among ``trials`` batches of ``repeats`` calls [s].

    One call before the first batch compiles and warms the caches.
    """
    return _best(work, repeats, trials, time.process_time)


def best_wall_seconds(work: Callable[[], object], *, repeats: int = 1, trials: int = 300) -> float:
    """Least elapsed time of one call [s]; for threads, whose waiting counts as CPU time.

    Many short trials: both cores must be free for once.
    """
    return _best(work, repeats, trials, time.perf_counter)


def _best(
    work: Callable[[], object], repeats: int, trials: int, clock: Callable[[], float]
) -> float:
    work()
    best = float("inf")
    for _ in range(trials):
        start = clock()
        for _ in range(repeats):
            work()
        best = min(best, (clock() - start) / repeats)
    return best
