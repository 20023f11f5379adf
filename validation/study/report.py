"""Progress and outcome of a study as text, exports and data."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from validation.errors import InputError
from validation.output.console import Forecast, error_console, progress, two_columns
from validation.output.outputs import Outputs
from validation.scene.usage import unused_words
from validation.study.run import Tally
from validation.study.store import ResultFile, write_csv, write_parquet
from validation.study.study import Row, Study


@contextmanager
def sweep_progress(results: ResultFile, *, retry_failed: bool = False) -> Iterator[Any]:
    """Live bar with failures and remaining time on a terminal; yields what takes each row.

    A sweep that will take long says so as soon as rows come, in a log file too.
    """
    done, failed = results.counts()
    if retry_failed:
        done, failed = done - failed, 0
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]}"),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    forecast, total = Forecast(window=4.0), results.study.n_designs
    with progress(*columns) as bar:
        task = bar.add_task(results.study.name, total=total, completed=done, failed="")

        def show(row: Row) -> None:
            nonlocal done, failed
            done += 1
            failed += row.status == "failed"
            left = forecast.left(done, total)
            if left is not None:
                error_console().print(
                    f"long: about {left} for {total - done} more designs; Ctrl-C ends it, all rows "
                    "so far are kept, and the same command goes on"
                )
            bar.update(task, advance=1, failed=f"{failed} failed" if failed else "")

        yield show


@contextmanager
def goes_on(results: ResultFile) -> Iterator[None]:
    """Say how to go on where a sweep is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        total, _ = results.counts()
        print(
            f"{total} of {results.study.n_designs} designs are in {results.path}: "
            "run the same command to go on",
            file=sys.stderr,
        )
        raise


def export(results: ResultFile, csv: Path | None, parquet: Path | None, outputs: Outputs) -> None:
    """Write all rows to the files asked for.

    Raises
    ------
    InputError
        Where one cannot be written; all rows stay in the result file.
    """
    for words, target, write in (("CSV", csv, write_csv), ("Parquet", parquet, write_parquet)):
        if target is None:
            continue
        try:
            write(results, target)
        except OSError as error:
            raise InputError(
                f"{target}: cannot be written ({error.strerror or error}); all rows are in "
                f"{results.path}: make room and run the same command again"
            ) from None
        outputs.say(words, target)


def summary(results: ResultFile, tally: Tally, wall_seconds: float) -> dict[str, Any]:
    """Return what a sweep did as plain data."""
    total, failed = results.counts()
    parent = time.process_time()
    return {
        "study": results.study.name,
        "digest": results.study.digest,
        "quantity": results.study.quantity,
        "result_file": str(results.path),
        "n_designs": results.study.n_designs,
        "n_rows": total,
        "n_failed": failed,
        "unused_keys": list(tally.unused or ()),
        "this_run": {
            "computed": tally.computed,
            "workers": tally.workers,
            "wall_seconds": wall_seconds,
            "design_cpu_seconds": tally.design_cpu_seconds,
            "worker_cpu_seconds": tally.worker_cpu_seconds,
            "parent_cpu_seconds": parent,
        },
    }


def print_summary(results: ResultFile, found: dict[str, Any], console: Console) -> None:
    """Print what a sweep did."""
    study = results.study
    run = found["this_run"]
    table = two_columns(f"{study.name}: {study.quantity}")
    table.add_row("parameters", _parameter_words(study))
    table.add_row("designs", f"{study.n_designs}, of which {run['computed']} computed now")
    table.add_row("failed", _failure_words(results, found["n_failed"]))
    table.add_row(
        "CPU seconds",
        f"designs {run['design_cpu_seconds']:.1f}, their processes {run['worker_cpu_seconds']:.1f} "
        f"({run['workers']}), this process {run['parent_cpu_seconds']:.1f}",
    )
    table.add_row("wall seconds", f"{run['wall_seconds']:.1f}")
    console.print(table)
    if found["unused_keys"]:
        words = unused_words(tuple(found["unused_keys"]), study.scene_file(0).scene)
        console.print(f"{'unused':9} {words} (no part of these answers)")
    console.print(f"{'results':9} {results.path}")


def _parameter_words(study: Study) -> str:
    return ", ".join(f"{path} ({len(values)})" for path, values in study.parameters)


def _failure_words(results: ResultFile, failed: int) -> str:
    if not failed:
        return "none"
    row = next(row for row in results.rows() if row["status"] == "failed")
    return f"{failed}; the first, design {row['number']}: {row['message']}"
