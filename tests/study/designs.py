"""A small study of walls and a runner in this process."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from validation.study.rowfile import StudyRows
from validation.study.run import run_design
from validation.study.study import DesignRow, Study

#: Sixteen walls of which four cannot be built (no rows), each a few milliseconds.
WALLS = """
scene = "brick-stack"
[parameters]
load.pressure = { from = 0.01, to = 0.04, step = 0.01 }
"load.layer" = [1, 2, 3, 9]
[settings]
load.case = "beam"
mesh.divisions = [2, 1, 1]
assembly = { columns = 2, layers = 3 }
"""


class Here:
    """Runs designs in this process, at most ``limit`` of them."""

    def __init__(self, study: Study, limit: int | None = None) -> None:
        self.study, self.limit = study, limit

    def rows(self, numbers: Iterable[int]) -> Iterator[DesignRow]:
        for number in itertools.islice(numbers, self.limit):
            yield run_design(self.study, number)


def content(path: Path, study: Study) -> list[dict[str, Any]]:
    """All rows without their CPU time, as a sweep that computes nothing gives them."""
    rows = list(StudyRows(path, study).rows())
    for row in rows:
        del row["cpu_seconds"]
    return rows
