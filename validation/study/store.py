"""Result files of studies: one row per design in a file of results by content, and exports."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from io import StringIO
from pathlib import Path
from typing import Any

from geometry.system import write_whole
from validation.errors import InputError
from validation.output.files import write_csv as write_table
from validation.output.provenance import version
from validation.output.store import PROVEN, Layout, Store, content_key, quoted
from validation.scene.read import read_text
from validation.study.design import Row
from validation.study.study import COLUMNS, MEASURES, Study, Value

#: Whole numbers that SQLite takes.
_WHOLE = range(-(2**63), 2**63)


class Older(StrEnum):
    """What is done with rows that another version of the program computed."""

    KEEP = "keep"
    """They count as done; each says which program computed it."""
    RENEW = "renew"
    """They are computed again, and replaced."""


def _sql_type(values: tuple[Value, ...]) -> str:
    if all(isinstance(v, int) and not isinstance(v, bool) and v in _WHOLE for v in values):
        return "INTEGER"
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    return "REAL" if numbers else "TEXT"


def study_layout(study: Study) -> Layout:
    """Columns of a study's rows, and what says which study it is."""
    return Layout(
        kind="study",
        columns={
            "number": "INTEGER NOT NULL",
            **{name: _sql_type(values) for name, values in study.parameters},
            "status": "TEXT NOT NULL",
            "message": "TEXT NOT NULL",
            **COLUMNS[study.quantity],
            "cpu_seconds": "REAL NOT NULL",
        },
        about={
            "name": study.name,
            "digest": study.digest,
            "canonical": study.canonical,
            "tubelock": version(),
        },
    )


class ResultFile(Store):
    """Rows of one study in one file of results (use it as a context manager)."""

    def __init__(self, path: Path, study: Study, older: Older | None = None) -> None:
        """Open or create the file; without ``older``, rows of other programs are refused."""
        self.study = study
        self.older = older
        super().__init__(path, study_layout(study))
        self._refuse_older()

    def _check_about(self, about: Mapping[str, str]) -> None:
        if about.get("digest") == self.study.digest:
            return
        shorter = _with_values_of(self.study, about)
        if shorter.digest == about.get("digest"):
            self._refuse_older()
            self._extend(shorter)
            return
        difference = _first_difference(
            _named(about.get("canonical", "{}")), _named(self.study.canonical)
        )
        raise InputError(
            f"{self.path}: holds the results of another study ({about.get('name')}: {difference}); "
            "give another file with -o, or remove this one"
        )

    def _extend(self, shorter: Study) -> None:
        """Number the rows of a study with fewer values anew: they are designs of this one."""

        def renumbered(row: dict[str, Any]) -> dict[str, Any]:
            number = self.study.number(shorter.design(row["number"]))
            return row | {"number": number, "key": self.key(number)} | self.study.design(number)

        with super().alone():
            self._require_study(shorter)
            self.renew(renumbered)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """As `Store.alone`; the rows must still be numbered as those of this study."""
        with super().alone():
            self._require_study(self.study)
            yield

    def _require_study(self, study: Study) -> None:
        if self.about().get("digest") != study.digest:
            raise InputError(
                f"{self.path}: another process has extended its study since this one opened it; "
                "run the same command again"
            )

    def _refuse_older(self) -> None:
        others = self.of_other_programs() if self.older is None else {}
        if others:
            self.close()
            count, names = sum(others.values()), ", ".join(sorted(others))
            raise InputError(
                f"{self.path}: {count} of its rows were computed by another version of tubelock "
                f"({names}); give --older keep to count them as done (each row names its "
                "program), or --older renew to compute them again"
            )

    def key(self, number: int) -> str:
        """Digest of the question that a design asks."""
        return content_key([self.study.digest, self.study.design(number)])

    def add(self, row: Row) -> None:
        """Write one row, in the place of an earlier one of the same design (`put`)."""
        self.put(self.key(row.number), row.flat)

    def take(self, path: Path) -> None:
        """Add the rows of a CSV that `write_csv` wrote; designs that have a row keep it."""
        done = self.done()
        with self.alone(), self._clear_errors(), self._transaction():
            for row in read_csv(path):
                try:
                    number = self.study.number(row)
                    status = {name: name for name in ("ok", "failed")}[row["status"]]
                    own = {"number": number, "key": self.key(number), "status": status}
                    own |= {"message": row["message"] or ""}
                    if not done[number]:
                        self._insert({"program": path.name} | row | own)
                except (KeyError, TypeError, ValueError) as error:
                    raise InputError(
                        f"{path}: no rows of {self.study.name}: {error}; expected what "
                        f"`tubelock sweep {self.study.name} --csv FILE` writes"
                    ) from None

    def done(self, *, failed_too: bool = True) -> bytearray:
        """Which designs have a row that counts: one byte per design, 1 if so."""
        result = bytearray(self.study.n_designs)
        status = "" if failed_too else " AND status = 'ok'"
        for (number,) in self.ask(f"SELECT number FROM rows WHERE {self._counts}{status}"):
            result[number] = 1
        return result

    def counts(self) -> tuple[int, int]:
        """Number of rows that count, and how many of them failed."""
        numbers = "count(*), coalesce(sum(status = 'failed'), 0)"
        total, failed = self.ask(f"SELECT {numbers} FROM rows WHERE {self._counts}")[0]
        return total, failed

    def first_measure(self) -> str | None:
        """Return the first of the study's `MEASURES` that a row has; None where none has any."""
        measures = MEASURES[self.study.quantity]
        result = ", ".join(f"count({quoted(name)})" for name in measures)
        counts = self.ask(f"SELECT {result} FROM rows WHERE {self._counts}")[0]
        return next((name for name, n in zip(measures, counts, strict=True) if n), None)

    def ranked(self, most: int, *, status: str) -> list[dict[str, Any]]:
        """Rows of one status, the least value of the first measure first, so many at most."""
        columns = self.shown
        first = quoted(self.first_measure() or "number")
        shown = ", ".join(quoted(name) for name in columns)
        result = self.ask(
            f"SELECT {shown} FROM rows WHERE {self._counts} AND status = '{status}' "
            f"ORDER BY {first} IS NULL, {first}, number LIMIT {most}"
        )
        return [dict(zip(columns, values, strict=True)) for values in result]

    @property
    def _counts(self) -> str:
        """Condition of rows that count as done."""
        return "program = :program" if self.older is Older.RENEW else "TRUE"

    @property
    def shown(self) -> dict[str, str]:
        """Columns that people read, and their types: no digests.

        The program that computed a row is named where some rows are of another one.
        """
        hidden = {"key", "digest"} if self.of_other_programs() else set(PROVEN)
        return {name: kind for name, kind in self.columns.items() if name not in hidden}

    def rows(self) -> Iterator[dict[str, Any]]:
        """All rows by the names of `shown`, in the order of the designs."""
        columns = self.shown
        for batch in self.batches("number", columns):
            for values in batch:
                yield dict(zip(columns, values, strict=True))


def _with_values_of(study: Study, about: Mapping[str, str]) -> Study:
    """Return a study with the lists of values of a file, where they are parts of its own lists."""
    listed = json.loads(about.get("canonical", "{}")).get("parameters", [])
    if not study.extends(listed):
        return study
    return replace(study, parameters=tuple((path, tuple(values)) for path, values in listed))


def _named(canonical: str) -> dict[str, Any]:
    """Content of a study with its parameters by name."""
    content: dict[str, Any] = json.loads(canonical)
    return content | {"parameters": dict(content.get("parameters", []))}


def _first_difference(old: Any, new: Any, place: str = "") -> str:
    """Name the first place where two studies differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(set(old) | set(new)):
            if old.get(key) != new.get(key):
                inner = f"{place}.{key}" if place else str(key)
                return _first_difference(old.get(key), new.get(key), inner)
    if old == new:
        return "the parameters come in another order"
    return f"{place} is {_short(old)} there, {_short(new)} here"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "…"


# ---------------------------------------------------------------------------------------------
# Exports


def write_csv(results: ResultFile, path: Path, digits: int = 17) -> None:
    """Write all rows as CSV, numbers with so many digits; the header names the units."""
    columns = results.shown
    heads = [results.study.head(name) for name in columns]
    rows = (row for batch in results.batches("number", columns) for row in batch)
    write_table(path, heads, ([_rounded(value, digits) for value in row] for row in rows))


def _rounded(value: Any, digits: int) -> Any:
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value


def read_csv(path: Path) -> Iterator[dict[str, Any]]:
    """Read rows of a study from what `write_csv` wrote, by the names of columns without units."""
    for row in csv.DictReader(StringIO(read_text(path, "rows of a study as CSV"))):
        yield {str(head).partition(" [")[0]: _read(value) for head, value in row.items()}


def _read(text: Any) -> Any:
    """Value of a cell: a number, a list or text as `Store` keeps it; nothing: None."""
    try:
        return json.loads(text) if text else None
    except (TypeError, ValueError):
        return text


def require_parquet() -> None:
    """Refuse early where Parquet cannot be written, with the remedy."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise InputError(
            "--parquet needs the library pyarrow: pip install 'tubelock[parquet]'; "
            "--csv needs nothing"
        ) from None


def write_parquet(results: ResultFile, path: Path) -> None:
    """Write all rows as Parquet, types as in the result file; refused without pyarrow."""
    require_parquet()
    import pyarrow
    import pyarrow.parquet

    columns = results.shown
    types = {"INTEGER": pyarrow.int64(), "REAL": pyarrow.float64(), "TEXT": pyarrow.string()}
    schema = pyarrow.schema([(name, types[kind.split()[0]]) for name, kind in columns.items()])

    def write(partial: Path) -> None:
        with pyarrow.parquet.ParquetWriter(partial, schema) as writer:
            for batch in results.batches("number", columns):
                arrays = [
                    pyarrow.array(values, type=field.type)
                    for values, field in zip(zip(*batch, strict=True), schema, strict=True)
                ]
                writer.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))

    write_whole(path, write)
