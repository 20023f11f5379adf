"""A small study of walls and a runner in this process."""

from __future__ import annotations

import itertools
import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path

from validation.study.design import Row, run_design
from validation.study.study import Study

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

    def rows(self, numbers: Iterable[int]) -> Iterator[Row]:
        for number in itertools.islice(numbers, self.limit):
            yield run_design(self.study, number)


def content(path: Path) -> list[tuple]:
    """All rows without their CPU time, and so without their digest."""
    with sqlite3.connect(path) as connection:
        rows = connection.execute("SELECT * FROM rows ORDER BY number")
        place = [column[0] for column in rows.description].index("cpu_seconds")
        return [row[:place] + row[place + 1 : -1] for row in rows]
