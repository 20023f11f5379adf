"""Results kept by content: one SQLite file, one row per result, each row whole or absent.

A row's key is the digest of what was asked, so equal questions have one row whoever asks. A row
says which program answered, and carries a digest of itself: a flipped byte is found when the file
is opened, and no damaged row is ever taken for a result. Every row is its own transaction, so a
process killed at any moment loses at most the results it was computing.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from filelock import FileLock, Timeout

from geometry.errors import unreadable
from geometry.system import release, write_whole
from validation.errors import InputError
from validation.output.files import prepare_file
from validation.output.provenance import program

MAGIC = b"SQLite format 3\x00"
#: Marks our files among SQLite's: "tubl".
APPLICATION = 0x7475626C
#: Raised when tables or digests change their meaning.
FORMAT = 2
#: Errors that say nothing about what the file holds: others use it, or there is no room.
_PASSING = (
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_CANTOPEN,
)
#: A row takes more bytes than this: digests alone do.
_SMALLEST_ROW = 128
#: Rows read at a time, so memory does not grow with the file.
_BATCH = 5_000

#: What a file belongs to, as JSON; twice, for without it nobody knows what the rows mean.
_ABOUT = "CREATE TABLE about (content TEXT NOT NULL, digest TEXT NOT NULL)"


@dataclass(frozen=True)
class Layout:
    """Columns of a file of results, and the study that it belongs to."""

    kind: str
    """``study``, ``cost``."""
    columns: Mapping[str, str]
    """SQLite type (INTEGER, REAL, TEXT) of each column besides `PROVEN`, in order."""
    about: Mapping[str, str] = field(default_factory=dict)
    """Description of the file."""

    @property
    def all_columns(self) -> dict[str, str]:
        """Columns of the table."""
        return {**self.columns, **PROVEN}

    @property
    def table(self) -> str:
        """Statement that makes the table."""
        columns = ", ".join(f"{quoted(name)} {kind}" for name, kind in self.all_columns.items())
        return f"CREATE TABLE rows ({columns})"


#: Columns that every row has: which program answered, what was asked, that nothing was changed.
PROVEN = {"program": "TEXT", "key": "TEXT PRIMARY KEY NOT NULL", "digest": "TEXT"}


def quoted(column: str) -> str:
    """Name of a column as SQL takes it."""
    return '"' + column.replace('"', '""') + '"'


def content_key(content: Any) -> str:
    """Digest of what was asked, as plain data."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def row_digest(values: Sequence[Any]) -> str:
    """Digest of a row without its digest, in the order of the columns."""
    return hashlib.sha256(json.dumps(values, default=str).encode()).hexdigest()


def is_whole(row: Sequence[Any]) -> bool:
    """Whether a row is what was written: its last value is the digest of the others."""
    return row_digest(row[:-1]) == str(row[-1])


def _stored(value: Any, kind: str) -> Any:
    """Return a value as its column gives it back; what is no number is absent, the rest is JSON."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    if kind.startswith("REAL"):
        return float(value)
    if kind.startswith("INTEGER"):
        return int(value)
    return value if isinstance(value, str) else json.dumps(value)


class Store:
    """Rows of one layout in one SQLite file (use it as a context manager)."""

    def __init__(self, path: Path, layout: Layout) -> None:
        """Open or create the file, and check all of it.

        A file on a disk that cannot be written is read.
        """
        self.path = path
        self.layout = layout
        self.columns = dict(layout.all_columns)
        """Names of the columns and their SQLite types, in order."""
        refuse_others(path)
        self.writable = _writable(path)
        if self.writable:
            prepare_file(path)
        with self._clear_errors():
            self._connection = connect(path, writable=self.writable)
            try:
                self._prepare()
            except BaseException:
                self._connection.close()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; all rows added are in it."""
        self._connection.close()

    # -----------------------------------------------------------------------------------------
    # Opening

    def _prepare(self) -> None:
        """Make the tables, or check that they are these, and whole."""
        if not self._tables():
            with self._transaction():
                # Another process may have made them since.
                if not self._tables():
                    self._make_tables()
        self._check_format()
        self._check_whole()
        self._check_layout()

    def _make_tables(self) -> None:
        about = {"kind": self.layout.kind, **self.layout.about}
        make_tables(self._connection, self.layout.table, json.dumps(about))

    def _check_format(self) -> None:
        ours = self._connection.execute("PRAGMA application_id").fetchone()[0] == APPLICATION
        result = self._connection.execute("PRAGMA user_version").fetchone()[0]
        if not ours:
            raise InputError(
                f"{self.path}: is an SQLite file, but not a file of results; choose another name"
            )
        if result != FORMAT:
            age = "an older" if result < FORMAT else "a newer"
            raise InputError(
                f"{self.path}: was written by {age} tubelock (format {result}, this one reads "
                f"{FORMAT}); use that version for it, or give another file"
            )

    def _tables(self) -> list[tuple[str]]:
        statement = "SELECT name FROM sqlite_master WHERE type = 'table'"
        return self._connection.execute(statement).fetchall()

    def _check_whole(self) -> None:
        """Reject a file with a damaged page or row."""
        said = self._connection.execute("PRAGMA integrity_check(1)").fetchone()[0]
        if said != "ok":
            raise self._damaged(" ".join(str(said).split()))
        if not (_rows_statement(self._connection) or "").startswith("CREATE TABLE rows ("):
            raise self._damaged("its table of rows is missing")
        for table, words in (("rows", "a row"), ("about", "what it belongs to")):
            if not all(map(is_whole, self._connection.execute(f"SELECT * FROM {table}"))):
                raise self._damaged(f"{words} is not what was written")

    def _damaged(self, why: str) -> InputError:
        return InputError(
            f"{self.path}: is damaged ({why}); nothing in it is used: `tubelock rescue "
            f"{self.path} -o NEW.sqlite` copies the intact rows; continue with NEW.sqlite"
        )

    def _check_layout(self) -> None:
        about = self.about()
        if about.get("kind") != self.layout.kind:
            raise InputError(
                f"{self.path}: holds results of another kind ({about.get('kind')}; this is "
                f"{self.layout.kind}); give another file"
            )
        self._check_about(about)
        if _rows_statement(self._connection) != self.layout.table:
            raise InputError(
                f"{self.path}: its columns are not those of this version of tubelock: it was "
                "written by another one, or is damaged; give another file, or use the version "
                "that wrote it"
            )

    def about(self) -> dict[str, str]:
        """Read what the file belongs to."""
        statement = "SELECT content FROM about"
        result: dict[str, str] = json.loads(self._connection.execute(statement).fetchone()[0])
        return result

    def _check_about(self, about: Mapping[str, str]) -> None:
        """Reject a file that belongs to something else; nothing by default."""

    # -----------------------------------------------------------------------------------------
    # Errors

    @contextmanager
    def _clear_errors(self) -> Iterator[None]:
        """Describe the state of the file after an error of SQLite."""
        try:
            yield
        except UnicodeDecodeError as error:  # a byte of a column's name
            raise self._damaged(f"a name in it is no text: {error}") from None
        except sqlite3.DatabaseError as error:
            if error.sqlite_errorcode & 0xFF not in _PASSING:
                raise self._damaged(str(error)) from None
            raise InputError(
                f"{self.path}: {error}; rows already in it are kept: make room or free the file, "
                "then run the same command to go on"
            ) from None

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Be the only one that computes for this file."""
        if not self.writable:
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
            yield
        finally:
            release(lock)

    # -----------------------------------------------------------------------------------------
    # Rows

    def put(self, key: str, values: Mapping[str, Any]) -> None:
        """Write one row, in the place of an earlier one with the same key."""
        with self._clear_errors():
            self._insert({**values, "program": program(), "key": key})

    def _insert(self, values: Mapping[str, Any]) -> None:
        row = [
            _stored(values.get(name), kind)
            for name, kind in self.columns.items()
            if name != "digest"
        ]
        marks = ", ".join("?" * len(self.columns))
        self._connection.execute(
            f"INSERT OR REPLACE INTO rows VALUES ({marks})", [*row, row_digest(row)]
        )

    def renew(self, change: Callable[[dict[str, Any]], Mapping[str, Any]]) -> None:
        """Make the tables anew for this layout, each row changed: all of it is done, or nothing."""
        with self._clear_errors(), self._transaction():
            cursor = self._connection.execute("SELECT * FROM rows")
            names = [column[0] for column in cursor.description]
            rows = [dict(zip(names, values, strict=True)) for values in cursor.fetchall()]
            self._connection.execute("DROP TABLE rows")
            self._connection.execute("DROP TABLE about")
            self._make_tables()
            for row in rows:
                self._insert(change(row))

    def get(self, key: str) -> dict[str, Any] | None:
        """Return the row that this program wrote under a key; None where there is none."""
        with self._clear_errors():
            result = self._connection.execute(
                "SELECT * FROM rows WHERE key = ? AND program = ?", (key, program())
            ).fetchone()
        return None if result is None else dict(zip(self.columns, result, strict=True))

    def ask(self, statement: str) -> list[tuple[Any, ...]]:
        """Answer a question in SQL; ``:program`` stands for this program."""
        with self._clear_errors():
            return self._connection.execute(statement, {"program": program()}).fetchall()

    def of_other_programs(self) -> dict[str, int]:
        """Numbers of rows that other versions of the program wrote."""
        statement = "SELECT program, count(*) FROM rows WHERE program != :program GROUP BY program"
        return dict(self.ask(statement))

    def batches(self, order: str, columns: Iterable[str]) -> Iterator[list[tuple[Any, ...]]]:
        """Some columns of all rows as tuples, in the order of one column, some rows at a time."""
        shown = ", ".join(quoted(name) for name in columns)
        with self._clear_errors():
            cursor = self._connection.execute(f"SELECT {shown} FROM rows ORDER BY {quoted(order)}")
            while batch := cursor.fetchmany(_BATCH):
                yield batch


# ---------------------------------------------------------------------------------------------
# Files


def refuse_others(path: Path) -> None:
    """Reject a folder or a file that is no SQLite file; it is left alone."""
    why = unreadable(path)
    if why not in (None, "no such file"):
        raise InputError(f"{path}: {why}; expected a file of results, such as x.sqlite")
    if why is not None or path.stat().st_size == 0:
        return
    try:
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    if head != MAGIC:
        raise InputError(f"{path}: exists and is not a file of results (SQLite); choose another")


def _writable(path: Path) -> bool:
    """Whether a file, or one in its place, can be written; its journal lies beside it."""
    if not path.exists():
        return True
    return os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)


def _rows_statement(connection: sqlite3.Connection) -> str | None:
    """Statement that made the rows; None without any."""
    statement = "SELECT sql FROM sqlite_master WHERE name = 'rows'"
    result = connection.execute(statement).fetchone()
    return None if result is None else str(result[0])


def make_tables(connection: sqlite3.Connection, table: str, about: str) -> None:
    """Make the tables of an empty file, within a transaction."""
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {FORMAT}")
    connection.execute(_ABOUT)
    connection.execute(table)
    twice = [(about, row_digest([about]))] * 2
    connection.executemany("INSERT INTO about VALUES (?, ?)", twice)


def connect(path: Path, *, writable: bool) -> sqlite3.Connection:
    """Open an SQLite file."""
    address = f"{path.absolute().as_uri()}?mode={'rwc' if writable else 'ro'}"
    connection = sqlite3.connect(address, uri=True, timeout=30.0, isolation_level=None)
    # A flipped byte may leave no text: what is read then has another digest.
    connection.text_factory = lambda raw: raw.decode("utf-8", "surrogateescape")
    if writable:
        # A rollback journal, not WAL: the file alone is the whole result, on any file system.
        connection.execute("PRAGMA journal_mode = DELETE")
    return connection


def rescue(path: Path, new: Path) -> tuple[int, int]:
    """Copy the rows of a damaged file that are whole into a new one.

    Parameters
    ----------
    path
        Read, and left as it is.
    new
        Created; it goes on where the other was damaged.

    Returns
    -------
    tuple[int, int]
        Rows copied, and rows found but damaged; of a lost page nobody knows how many it held.
    """
    refuse_others(path)
    why = unreadable(path)
    if why is not None:
        raise InputError(f"{path}: {why}; expected a damaged file of results")
    if new.exists():
        raise InputError(f"{new}: exists; the rescued rows need a new file")
    prepare_file(new)
    old = connect(path, writable=False)
    # Read on where the file ends before its header says so.
    old.execute("PRAGMA writable_schema = ON")
    try:
        table, about = _meaning(old)
        counts: list[tuple[int, int]] = []
        size = path.stat().st_size
        write_whole(new, lambda made: counts.append(_copy_rows(old, size, made, table, about)))
        return counts[0]
    except (sqlite3.DatabaseError, UnicodeDecodeError, LookupError) as error:
        raise InputError(
            f"{path}: nothing can be rescued: what its rows mean is damaged too ({error})"
        ) from None
    finally:
        old.close()


def _meaning(old: sqlite3.Connection) -> tuple[str, str]:
    """Statement that made the rows, and what they belong to."""
    table = _rows_statement(old)
    about = next((row[0] for row in _readable(old, "about", 2) if row and is_whole(row)), None)
    if table is None or about is None:
        raise LookupError("no table of rows" if table is None else "both copies")
    return table, str(about)


def _copy_rows(
    old: sqlite3.Connection, size: int, new: Path, table: str, about: str
) -> tuple[int, int]:
    """Copy what is whole; numbers of rows copied, and of rows that are not."""
    try:
        last = int(old.execute("SELECT max(rowid) FROM rows").fetchone()[0] or 0)
    except sqlite3.DatabaseError:
        last = size // _SMALLEST_ROW
    copy = connect(new, writable=True)
    whole = lost = 0
    try:
        copy.execute("BEGIN")
        make_tables(copy, table, about)
        for row in _readable(old, "rows", last):
            if row is not None and is_whole(row):
                marks = ", ".join("?" * len(row))
                copy.execute(f"INSERT OR REPLACE INTO rows VALUES ({marks})", row)
                whole += 1
            else:
                lost += 1
        copy.execute("COMMIT")
    finally:
        copy.close()
    return whole, lost


def _readable(old: sqlite3.Connection, table: str, last: int) -> Iterator[tuple[Any, ...] | None]:
    """Rows of a damaged table one by one; None for one that cannot be read."""
    for number in range(1, last + 1):
        try:
            row = old.execute(f"SELECT * FROM {table} WHERE rowid = ?", (number,)).fetchone()
        except (sqlite3.DatabaseError, UnicodeDecodeError):
            yield None
            continue
        if row is not None:
            yield row
