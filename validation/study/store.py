"""Result files of studies: one row per design in a file of results by content, and exports."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from enum import StrEnum
from itertools import chain
from pathlib import Path
from typing import Any

from validation.errors import InputError
from validation.output import files
from validation.output.provenance import version
from validation.output.store import Layout, Store, content_key
from validation.study.study import COLUMNS, Row, Study, Value

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
        """Open or create the file; without ``older``, rows of other programs are refused.

        Raises
        ------
        InputError
            When it cannot be read, is damaged, no file of results, or belongs to another study.
        """
        self.study = study
        super().__init__(path, study_layout(study))
        self.older = older
        if older is None:
            self._refuse_older()

    def _check_about(self, about: Mapping[str, str]) -> None:
        if about.get("digest") == self.study.digest:
            return
        difference = _first_difference(
            _named(about.get("canonical", "{}")), _named(self.study.canonical)
        )
        raise InputError(
            f"{self.path}: holds the results of another study ({about.get('name')}: {difference}); "
            "give another file with -o, or remove this one"
        )

    def _refuse_older(self) -> None:
        others = self.of_other_programs()
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
        self.put(self.key(row.number), row.parameters | row.results | vars(row))

    def done(self, *, failed_too: bool = True) -> bytearray:
        """Which designs have a row that counts: one byte per design, 1 if so."""
        found = bytearray(self.study.n_designs)
        status = "" if failed_too else " AND status = 'ok'"
        for (number,) in self.ask(f"SELECT number FROM rows WHERE {self._counts}{status}"):
            found[number] = 1
        return found

    def counts(self) -> tuple[int, int]:
        """Number of rows that count, and how many of them failed."""
        numbers = "count(*), coalesce(sum(status = 'failed'), 0)"
        total, failed = self.ask(f"SELECT {numbers} FROM rows WHERE {self._counts}")[0]
        return total, failed

    @property
    def _counts(self) -> str:
        """Condition of rows that count as done."""
        return "program = :program" if self.older is Older.RENEW else "TRUE"

    def rows(self) -> Iterator[dict[str, Any]]:
        """All rows by column name, in the order of the designs."""
        for batch in self.batches("number"):
            for values in batch:
                yield dict(zip(self.columns, values, strict=True))


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
    """Write all rows as CSV."""
    files.write_csv(path, results.columns, chain.from_iterable(results.batches("number")))


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

    types = {"INTEGER": pyarrow.int64(), "REAL": pyarrow.float64(), "TEXT": pyarrow.string()}
    schema = pyarrow.schema(
        [(name, types[kind.split()[0]]) for name, kind in results.columns.items()]
    )

    def write(partial: Path) -> None:
        with pyarrow.parquet.ParquetWriter(partial, schema) as writer:
            for batch in results.batches("number"):
                columns = zip(*batch, strict=True)
                arrays = [
                    pyarrow.array(values, type=field.type)
                    for values, field in zip(columns, schema, strict=True)
                ]
                writer.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))

    files.write_whole(path, write)
