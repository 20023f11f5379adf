"""One sweep: rows that a store lacks are computed; then tables, and the verdict on the designs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from validation.study.design import DesignRow
from validation.study.judge import Judgement, doubt, judge
from validation.study.report import print_table, summary
from validation.study.rowfile import StudyRows
from validation.study.run import Runner, sweep
from validation.study.study import Study


@dataclass(frozen=True)
class Swept:
    """What a sweep did and found."""

    results: StudyRows
    summary: dict[str, Any]
    """How many designs were computed and failed, and their CPU time [s]."""
    judgement: Judgement | None
    """Best and worst design of rigid blocks with deformable ones, where that was requested."""

    def print(self, console: Console) -> None:
        """Print designs and measures, and the verdict on them."""
        print_table(self.results, console)
        if self.judgement is not None:
            self.judgement.print(console)
        elif words := doubt(self.results):
            console.print(words)


def run_sweep(
    results: StudyRows,
    runner: Callable[[Study], Runner],
    on_row: Callable[[DesignRow], None],
    *,
    retry_failed: bool = False,
    judged: bool = False,
) -> Swept:
    """Compute the designs that the result file lacks; ``on_row`` takes each of them."""
    start = time.perf_counter()
    tally = sweep(results, runner(results.study), retry_failed=retry_failed, on_row=on_row)
    did = summary(results, tally, time.perf_counter() - start)
    return Swept(results, did, judge(results, runner) if judged else None)
