"""Rows kept by content: a file of JSON lines, one row a line, only ever appended to.

A line has a digest of what was asked, the program that answered, the row, and a digest of itself::

    {"question": "5f1c…", "program": "0.1.0+3f2a…", "row": {…}, "digest": "9b04…"}

Equal questions have one row whoever asks, and the latest line counts. A line that was cut or
changed is found when the file is opened and is not used: its row is computed again. So a process
killed at any moment loses at most the rows it was computing.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import heapq
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from filelock import FileLock, Timeout

from geometry.errors import unreadable
from geometry.machine.system import release
from validation.errors import InputError
from validation.output.files import prepare_file, program
from validation.output.files import write_csv as write_table
from validation.scene.read import read_text
from validation.study.study import MEASURES, DesignRow, Study

#: What a line begins with, and what its digest stands behind.
_BEGIN, _DIGEST = b'{"question": "', b', "digest": "'


@contextmanager
def store_or_none(path: str | Path | None) -> Iterator[Path]:
    """File of rows: the one that is named, or one that goes at the end."""
    with TemporaryDirectory() as folder:
        yield Path(folder) / "rows.jsonl" if path is None else Path(path)


class RowFile:
    """Rows of this program in a file, and how many others it has.

    Whoever computes for it is `alone`. A file where nothing can be written is read.
    """

    def __init__(self, path: Path) -> None:
        """Open the file, which need not exist, and read all of it.

        Raises
        ------
        InputError
            A file without any row, or one that cannot be read or written.
        """
        self.path = path
        self.damaged = 0
        """Lines that are not what was written."""
        self.of_other_programs: Counter[str] = Counter()
        """Rows by the version of the program that computed them."""
        self._places: dict[str, int] = {}
        self._end = 0
        why = unreadable(path)
        if why not in (None, "no such file"):
            raise InputError(f"{path}: {why}; expected a file of results, such as x.jsonl")
        if _writable(path):
            prepare_file(path)
        self._read_on()

    def _read_on(self) -> None:
        """Read what was appended since."""
        if not self.path.exists():
            return
        try:
            with self.path.open("rb") as file:
                ours = self._end > 0 or _BEGIN.startswith(file.read(len(_BEGIN)))
                file.seek(self._end)
                for line in file:
                    if not line.endswith(b"\n"):
                        break  # cut, or being written
                    content = _content(line)
                    if content is None:
                        self.damaged += 1
                    elif content["program"] != program():
                        self.of_other_programs[content["program"]] += 1
                    else:
                        self._places[content["question"]] = self._end
                        self._note(content["question"], content["row"])
                    self._end += len(line)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror or error})") from None
        if not (ours or self._places or self.of_other_programs):
            raise InputError(
                f"{self.path}: exists and is not a file of results (JSON lines); choose another"
            )

    def _note(self, question: str, row: Mapping[str, Any]) -> None:
        """Take notice of a row; nothing by default."""

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Be the only one that computes for this file."""
        if not _writable(self.path):
            raise InputError(
                f"{self.path}: lies where nothing can be written, and results are missing in it; "
                "copy it, and give the copy"
            )
        lock = FileLock(f"{self.path}.lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise InputError(
                f"{self.path}: another process is computing for this file; wait for it (its rows "
                "can be used then), or give another file"
            ) from None
        try:
            self._read_on()
            yield
        finally:
            release(lock)

    def put(self, question: str, row: Mapping[str, Any]) -> None:
        """Append a row, which counts from now on."""
        content = {"question": question, "program": program(), "row": row}
        body = json.dumps(content, default=_plain)[:-1].encode()
        line = body + _DIGEST + _digest(body)
        try:
            with self.path.open("ab+", buffering=0) as file:
                if file.seek(0, os.SEEK_END):
                    file.seek(-1, os.SEEK_END)
                    if file.read(1) != b"\n":
                        line = b"\n" + line  # a writer was killed in the middle of a line
                if file.write(line) < len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise InputError(
                f"{self.path}: {error.strerror or error}; rows already in it are kept: make room "
                "or free the file, then run the same command to go on"
            ) from None
        self._read_on()

    def get(self, question: str) -> dict[str, Any] | None:
        """Return the row that this program wrote last; None where there is none."""
        return next(self.at([question])) if question in self._places else None

    def at(self, questions: Iterable[str]) -> Iterator[dict[str, Any]]:
        """Rows of questions that have one, one after another."""
        if not self._places:
            return
        with self.path.open("rb") as file:
            for question in questions:
                file.seek(self._places[question])
                yield json.loads(file.readline())["row"]

    def __len__(self) -> int:
        """Count the questions that this program answered."""
        return len(self._places)


def _content(line: bytes) -> dict[str, Any] | None:
    """Content of a line; None where it is not what was written."""
    body, _, digest = line.rpartition(_DIGEST)
    return json.loads(line) if body and digest == _digest(body) else None


def _digest(body: bytes) -> bytes:
    """End of a line: the digest of all before it."""
    return hashlib.sha256(body).hexdigest()[:32].encode() + b'"}\n'


def _plain(value: Any) -> Any:
    """Return a number of numpy as JSON has it."""
    return value.item()


def _writable(path: Path) -> bool:
    """Whether a file, or one in its place, can be written; its lock lies beside it."""
    if not path.exists():
        return True
    return os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)


# ---------------------------------------------------------------------------------------------
# Studies


class StudyRows(RowFile):
    """The rows of one study in a file, which may have rows of others.

    Each row has the values of its parameters, and so belongs to the same design however the
    values are listed.
    """

    def __init__(self, path: Path, study: Study) -> None:
        """Open the file (`RowFile`)."""
        self.study = study
        self.status: dict[int, str] = {}
        """``ok`` or ``failed``, by the number of the design."""
        self._has: set[str] = set()
        """Of the study's `MEASURES` those that a row has."""
        super().__init__(path)

    def _note(self, question: str, row: Mapping[str, Any]) -> None:
        number = self._number(question, row)
        if number is not None:
            self.status[number] = row["status"]
            results = row["results"]
            self._has.update(m for m in self._measures if results.get(m) is not None)

    @property
    def _measures(self) -> tuple[str, ...]:
        return MEASURES[self.study.quantity]

    def _number(self, question: str, row: Mapping[str, Any]) -> int | None:
        """Return the design that a row answers; None: it is a row of something else."""
        try:
            number = self.study.number(row["parameters"])
        except (KeyError, TypeError):
            return None
        return number if self.study.question(number) == question else None

    def add(self, row: DesignRow) -> None:
        """Append a row."""
        of = {"study": self.study.name, "quantity": self.study.quantity}
        self.put(self.study.question(row.number), of | row.as_json())

    def take(self, path: Path) -> None:
        """Add the rows that another file has of this study, whichever program computed them.

        Raises
        ------
        InputError
            A file that cannot be read, or that has no row of this study.
        """
        if unreadable(path) is not None:
            raise InputError(f"{path}: {unreadable(path)}; expected a file of results")
        known = 0
        with self.alone(), path.open("rb") as file:
            for content in filter(None, map(_content, file)):
                number = self._number(content["question"], content["row"])
                known += number is not None
                if number is not None and number not in self.status:
                    by = content["program"]
                    of = {} if by == program() else {"program": by}
                    self.put(content["question"], of | content["row"])
        if not known:
            raise InputError(
                f"{path}: has no row of {self.study.name}; expected the results of the same "
                "designs (-o), such as those of another version of tubelock"
            )

    def counts(self) -> tuple[int, int]:
        """Number of rows, and how many of them failed."""
        return len(self.status), sum(status == "failed" for status in self.status.values())

    def rows(self) -> Iterator[dict[str, Any]]:
        """All rows by the names of `columns`, in the order of the designs."""
        numbers = sorted(self.status)
        empty = dict.fromkeys(self.study.columns)
        for number, row in zip(numbers, self.at(map(self.study.question, numbers)), strict=True):
            yield {
                "number": number,
                **self.study.design(number),
                "status": row["status"],
                "message": row["message"],
                **empty,
                **row["results"],
                "cpu_seconds": row["cpu_seconds"],
                **({"program": row["program"]} if "program" in row else {}),
            }

    def first_measure(self) -> str | None:
        """Return the first of the study's `MEASURES` that a row has; None where none has any."""
        return next(filter(self._has.__contains__, self._measures), None)

    def ranked(self, most: int, *, status: str) -> list[dict[str, Any]]:
        """Rows of one status, the least value of the first measure first, so many at most."""
        first = self.first_measure() or "number"
        rows = (row for row in self.rows() if row["status"] == status)
        # Equal values keep the order of the designs.
        return heapq.nsmallest(most, rows, key=lambda row: (row[first] is None, row[first] or 0.0))


def write_row_csv(results: StudyRows, path: Path, digits: int = 17) -> None:
    """Write all rows as CSV, numbers with so many digits; the header names the units."""
    columns = dict.fromkeys(name for row in results.rows() for name in row)
    heads = [results.study.head(name) for name in columns]
    rows = ([_cell(row.get(name), digits) for name in columns] for row in results.rows())
    write_table(path, heads, rows)


def _cell(value: Any, digits: int) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{digits}g}")
    return json.dumps(value) if isinstance(value, list | dict | bool) else value


def read_csv(path: Path) -> Iterator[dict[str, Any]]:
    """Read rows of a study that `write_row_csv` wrote, by the names of columns without units."""
    for row in csv.DictReader(StringIO(read_text(path, "rows of a study as CSV"))):
        yield {str(head).partition(" [")[0]: _read(value) for head, value in row.items()}


def _read(text: Any) -> Any:
    """Value of a cell: a number, a list or text; nothing: None."""
    try:
        return json.loads(text) if text else None
    except (TypeError, ValueError):
        return text
