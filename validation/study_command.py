"""`tubelock sweep`: checks, progress and text around a study."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from validation.errors import InputError
from validation.files import prepare_file, prepare_json, write_json
from validation.study import Row, Study, load_study
from validation.study_run import DaskRunner, LocalRunner, Runner, Tally, sweep
from validation.study_store import ResultFile, require_parquet, write_csv, write_parquet


@contextmanager
def sweep_progress(results: ResultFile, *, retry_failed: bool = False) -> Iterator[Any]:
    """Live bar with failures and remaining time on a terminal; yields what takes each row."""
    done, failed = results.counts()
    if retry_failed:
        done, failed = done - failed, 0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]}"),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(
            results.study.name, total=results.study.n_designs, completed=done, failed=""
        )

        def show(row: Row) -> None:
            nonlocal failed
            failed += row.status == "failed"
            bar.update(task, advance=1, failed=f"{failed} failed" if failed else "")

        yield show


def run_sweep(
    source: str,
    *,
    settings: Iterable[str] = (),
    scheduler: str | None = None,
    workers: int | None = None,
    output: Path | None = None,
    csv: Path | None = None,
    parquet: Path | None = None,
    json: str | None = None,
    retry_failed: bool = False,
    console: Console,
) -> None:
    """Run or resume a study and write what the command promises.

    Raises
    ------
    InputError
        Bad input, or a run that had to stop (with how to go on).
    """
    study = load_study(source, settings)
    path = Path("out") / f"{study.name}.sqlite" if output is None else output
    for target in (csv, parquet):
        if target is not None:
            prepare_file(target)
    prepare_json(json)
    if parquet is not None:
        require_parquet()
    # A lost scheduler is told in one line of ours, not in a page of its client's.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    runner: Runner = (
        LocalRunner(study, workers) if scheduler is None else DaskRunner(study, scheduler)
    )
    with ResultFile(path, study) as results:
        start = time.perf_counter()
        try:
            with sweep_progress(results, retry_failed=retry_failed) as show:
                tally = sweep(results, runner, retry_failed=retry_failed, on_row=show)
        except KeyboardInterrupt:
            total, _ = results.counts()
            Console(stderr=True, soft_wrap=True).print(
                f"{total} of {study.n_designs} designs are in {path}: run the same command to go on"
            )
            raise
        summary = _summary(results, tally, time.perf_counter() - start)
        _print(results, summary, console)
        _export(results, csv, parquet, console)
        if json is not None:
            write_json(json, summary | {"rows": list(results.rows())})
        if summary["n_failed"] == study.n_designs:
            first = next(iter(results.rows()))["message"]
            raise InputError(
                f"{study.name}: every design failed; the first: {first}. All rows are in {path}; "
                "mend the study or the scene, and give -o another file"
            )


def _export(results: ResultFile, csv: Path | None, parquet: Path | None, console: Console) -> None:
    writers: list[tuple[str, Path | None, Callable[[ResultFile, Path], None]]] = [
        ("CSV", csv, write_csv),
        ("Parquet", parquet, write_parquet),
    ]
    for words, target, write in writers:
        if target is None:
            continue
        try:
            write(results, target)
        except OSError as error:
            raise InputError(
                f"{target}: cannot be written ({error.strerror or error}); all rows are in "
                f"{results.path}: make room and run the same command again"
            ) from None
        console.print(f"{words:9} {target}")


def _summary(results: ResultFile, tally: Tally, wall_seconds: float) -> dict[str, Any]:
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
        "this_run": {
            "computed": tally.computed,
            "workers": tally.workers,
            "wall_seconds": wall_seconds,
            "design_cpu_seconds": tally.design_cpu_seconds,
            "worker_cpu_seconds": tally.worker_cpu_seconds,
            "parent_cpu_seconds": parent,
        },
    }


def _print(results: ResultFile, summary: dict[str, Any], console: Console) -> None:
    study = results.study
    run = summary["this_run"]
    table = Table(title=f"{study.name}: {study.quantity}", show_header=False, title_justify="left")
    table.add_column()
    table.add_column()
    table.add_row("parameters", _parameter_words(study))
    table.add_row("designs", f"{study.n_designs}, of which {run['computed']} computed now")
    table.add_row("failed", _failure_words(results, summary["n_failed"]))
    table.add_row(
        "CPU seconds",
        f"designs {run['design_cpu_seconds']:.1f}, their processes {run['worker_cpu_seconds']:.1f} "
        f"({run['workers']}), this process {run['parent_cpu_seconds']:.1f}",
    )
    table.add_row("wall seconds", f"{run['wall_seconds']:.1f}")
    console.print(table)
    console.print(f"{'results':9} {results.path}")


def _parameter_words(study: Study) -> str:
    return ", ".join(f"{path} ({len(values)})" for path, values in study.parameters)


def _failure_words(results: ResultFile, failed: int) -> str:
    if not failed:
        return "none"
    row = next(row for row in results.rows() if row["status"] == "failed")
    return f"{failed}; the first, design {row['number']}: {row['message']}"
