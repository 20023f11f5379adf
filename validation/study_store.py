"""Result files of studies: one SQLite file, one row per design, each row whole or absent.

Every row is its own transaction, so a process killed at any moment loses at most the designs it
was computing. The file says which study it belongs to and takes rows of no other.
"""

from __future__ import annotations

import csv
import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any, Self

from validation.errors import InputError
from validation.files import prepare_file, write_whole
from validation.study import COLUMNS, Row, Study, Value

_MAGIC = b"SQLite format 3\x00"
#: Rows read at a time when exporting, so memory does not grow with the study.
_BATCH = 5_000


def _version() -> str:
    try:
        return metadata.version("tubelock")
    except metadata.PackageNotFoundError:
        return "not installed"


def _quoted(column: str) -> str:
    return '"' + column.replace('"', '""') + '"'


def _sql_type(values: tuple[Value, ...]) -> str:
    if all(isinstance(v, int) and not isinstance(v, bool) for v in values):
        return "INTEGER"
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    return "REAL" if numbers else "TEXT"


def _stored(value: Value) -> Any:
    """Numbers and strings as they are, the rest as JSON text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str | None):
        return json.dumps(value)
    return value


class ResultFile:
    """Rows of one study in one SQLite file (use it as a context manager)."""

    def __init__(self, path: Path, study: Study) -> None:
        """Open or create the file.

        Raises
        ------
        InputError
            When it cannot be written, is no result file, or belongs to another study.
        """
        self.path = path
        self.study = study
        prepare_file(path)
        _check_kind(path)
        self.columns = {
            "number": "INTEGER PRIMARY KEY",
            **{name: _sql_type(values) for name, values in study.parameters},
            "status": "TEXT NOT NULL",
            "message": "TEXT NOT NULL",
            **COLUMNS[study.quantity],
            "cpu_seconds": "REAL NOT NULL",
        }
        """Column names and their SQLite types, in order."""
        with self._clear_errors():
            self._connection = sqlite3.connect(path, timeout=30.0, isolation_level=None)
            # A rollback journal, not WAL: the file alone is the whole result, on any file system.
            self._connection.execute("PRAGMA journal_mode = DELETE")
            self._connection.execute("PRAGMA synchronous = NORMAL")
            self._prepare()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; all rows added are in it."""
        self._connection.close()

    @contextmanager
    def _clear_errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.DatabaseError as error:
            raise InputError(
                f"{self.path}: {error}; the rows written so far are safe: make room or free the "
                "file, then run the same command to go on"
            ) from None

    def _prepare(self) -> None:
        """Create the tables, or check that they are this study's."""
        tables = self._connection.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'"
        ).fetchall()
        if tables:
            if ("study",) not in tables:
                raise InputError(f"{self.path}: is an SQLite file, but not a study's results")
            self._check_study()
            return
        definitions = ", ".join(f"{_quoted(n)} {kind}" for n, kind in self.columns.items())
        self._connection.execute("BEGIN IMMEDIATE")
        self._connection.execute("CREATE TABLE study (key TEXT PRIMARY KEY, value TEXT NOT NULL)")
        self._connection.execute(f"CREATE TABLE rows ({definitions})")
        self._connection.executemany(
            "INSERT INTO study VALUES (?, ?)",
            [
                ("name", self.study.name),
                ("digest", self.study.digest),
                ("canonical", self.study.canonical),
                ("tubelock", _version()),
            ],
        )
        self._connection.execute("COMMIT")

    def _check_study(self) -> None:
        about = dict(self._connection.execute("SELECT key, value FROM study").fetchall())
        if about.get("digest") == self.study.digest:
            return
        difference = _first_difference(
            _named(about.get("canonical", "{}")), _named(self.study.canonical)
        )
        raise InputError(
            f"{self.path}: holds the results of another study ({about.get('name')}: {difference}); "
            "give another file with -o, or remove this one"
        )

    def add(self, row: Row) -> None:
        """Write one row, replacing an earlier one of the same design.

        Raises
        ------
        InputError
            When the disk is full or the file cannot be written; earlier rows stay.
        """
        values = {
            "number": row.number,
            "status": row.status,
            "message": row.message,
            "cpu_seconds": row.cpu_seconds,
            **{name: _stored(value) for name, value in row.parameters.items()},
            **row.results,
        }
        names = ", ".join(_quoted(name) for name in values)
        marks = ", ".join("?" * len(values))
        with self._clear_errors():
            self._connection.execute(
                f"INSERT OR REPLACE INTO rows ({names}) VALUES ({marks})", list(values.values())
            )

    def done(self, *, failed_too: bool = True) -> bytearray:
        """Which designs have a row: one byte per design, 1 if so."""
        found = bytearray(self.study.n_designs)
        where = "" if failed_too else " WHERE status = 'ok'"
        with self._clear_errors():
            for (number,) in self._connection.execute(f"SELECT number FROM rows{where}"):
                found[number] = 1
        return found

    def counts(self) -> tuple[int, int]:
        """Number of rows and how many of them failed."""
        with self._clear_errors():
            total, failed = self._connection.execute(
                "SELECT count(*), coalesce(sum(status = 'failed'), 0) FROM rows"
            ).fetchone()
        return total, failed

    def batches(self) -> Iterator[list[tuple[Any, ...]]]:
        """All rows as tuples in the order of `columns`, by design number, some at a time."""
        names = ", ".join(_quoted(name) for name in self.columns)
        with self._clear_errors():
            cursor = self._connection.execute(f"SELECT {names} FROM rows ORDER BY number")
            while batch := cursor.fetchmany(_BATCH):
                yield batch

    def rows(self) -> Iterator[dict[str, Any]]:
        """All rows by column name, in the order of the designs."""
        for batch in self.batches():
            for values in batch:
                yield dict(zip(self.columns, values, strict=True))


def _check_kind(path: Path) -> None:
    if not path.exists() or path.stat().st_size == 0:
        return
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise InputError(
                f"{path}: exists and is not a result file of a study (SQLite); choose another name"
            )


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


def write_csv(results: ResultFile, path: Path) -> None:
    """Write all rows as CSV (RFC 4180, header line, numbers in full precision)."""

    def write(partial: Path) -> None:
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(results.columns)
            for batch in results.batches():
                writer.writerows(batch)

    write_whole(path, write)


def require_parquet() -> None:
    """Refuse early where Parquet cannot be written.

    Raises
    ------
    InputError
        With the remedy.
    """
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise InputError(
            "--parquet needs the library pyarrow: pip install 'tubelock[parquet]'; "
            "--csv needs nothing"
        ) from None


def write_parquet(results: ResultFile, path: Path) -> None:
    """Write all rows as Parquet, types as in the result file.

    Raises
    ------
    InputError
        Without pyarrow.
    """
    require_parquet()
    import pyarrow
    import pyarrow.parquet

    types = {"INTEGER": pyarrow.int64(), "REAL": pyarrow.float64(), "TEXT": pyarrow.string()}
    schema = pyarrow.schema(
        [(name, types[kind.split()[0]]) for name, kind in results.columns.items()]
    )

    def write(partial: Path) -> None:
        with pyarrow.parquet.ParquetWriter(partial, schema) as writer:
            for batch in results.batches():
                columns = zip(*batch, strict=True)
                arrays = [
                    pyarrow.array(values, type=field.type)
                    for values, field in zip(columns, schema, strict=True)
                ]
                writer.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))

    write_whole(path, write)
