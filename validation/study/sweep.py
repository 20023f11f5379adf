"""One sweep: rows that a store lacks are computed; then tables, and the verdict on the designs.

The verdict on rigid designs is whether deformable blocks order them alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from rich.console import Console
from rich.table import Table

from geometry.answer import Measure
from geometry.parts import rows as tables
from validation.errors import InputError
from validation.output.console import LONG, Printed, duration_words, following, tabled
from validation.output.outputs import Outputs
from validation.study.rowfile import StudyRows, write_row_csv
from validation.study.run import Runner, Tally, computed, sweep
from validation.study.study import MEASURES, DesignRow, Study

#: Rows of a table in full, and rows of a longer one: best ones, and failed ones.
_WHOLE, _BEST, _FAILED = 20, 10, 3
#: Columns that say what became of a rigid design without pressures.
_STATES = {"rigid": ("mechanism",), "fem": ()}
#: Expected times that are not told [s], and the change that is told.
_SHORT, _CHANGE = 5.0, 1.5
#: CPU time that must be measured before [s]: the first design also loads machine code.
_MEASURED = 1.0


@contextmanager
def sweep_progress(results: StudyRows, *, retry_failed: bool = False) -> Iterator[Any]:
    """Print designs, failures and remaining time; yields what takes each row.

    The expected CPU time is printed after the first row, and again where it changes much.
    """
    done, failed = results.counts()
    if retry_failed:
        done, failed = done - failed, 0
    total = results.study.n_designs
    expected = Expected(total - done)
    with following(results.study.name) as follow:

        def show(row: DesignRow) -> None:
            nonlocal done, failed
            done += 1
            failed += row.status == "failed"
            words = expected.words(row)
            if words:
                follow.line(words)
            state = f"{done} of {total} designs" + (f", {failed} failed" if failed else "")
            follow(state, done, total)

        yield show


class Expected:
    """Expected CPU time of a sweep, from the designs that are computed so far."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._seconds: list[float] = []
        self._told = 0.0

    def words(self, row: DesignRow) -> str:
        """Words for the expected time; empty where it is short or is told already.

        Designs that fail are quick, and say nothing of the others.
        """
        self._total -= row.status == "failed"
        if row.status == "failed":
            return ""
        self._seconds.append(row.cpu_seconds)
        usual = median(self._seconds)
        expected = usual * self._total
        changed = not self._told / _CHANGE < expected < self._told * _CHANGE
        measured = sum(self._seconds) >= _MEASURED and len(self._seconds) < self._total
        if expected < _SHORT or not changed or not measured:
            return ""
        self._told, count = expected, len(self._seconds)
        words = f"about {duration_words(expected)} of CPU time for {self._total} designs"
        if count == 1:
            words += f", often less: the first one took {duration_words(usual)}"
        else:
            words += f": half of {count} took less than {duration_words(usual)} each"
        if expected > LONG:
            words += "; Ctrl-C stops it and keeps all rows, and the same command continues"
        return words


@contextmanager
def goes_on(results: StudyRows) -> Iterator[None]:
    """Print how to continue where a sweep is interrupted."""
    try:
        yield
    except KeyboardInterrupt as stop:
        total, _ = results.counts()
        stop.args = (
            f"{total} of {results.study.n_designs} designs are in {results.path}; "
            "run the same command to go on",
        )
        raise


def draw(results: StudyRows, axes: tuple[str, str] | None, path: Path, outputs: Outputs) -> None:
    """Draw a measure against a parameter; by default the first ones, where there are some."""
    if axes is None:
        measure, varied = results.first_measure(), results.study.varied
        if measure is None or not varied:
            return
        axes = varied[0], measure
    from validation.output.pictures.gallery import save_figure
    from validation.study.picture import study_figure

    save_figure(study_figure(results.study, results.rows(), *axes), path)
    outputs.say("picture", path)


def export(results: StudyRows, csv: Path, outputs: Outputs, digits: int = 17) -> None:
    """Write all rows as CSV."""
    try:
        write_row_csv(results, csv, digits)
    except OSError as error:
        raise InputError(
            f"{csv}: cannot be written ({error.strerror or error}); all rows are in "
            f"{results.path}: make room and run the same command again"
        ) from None
    outputs.say("CSV", csv)


def print_table(results: StudyRows, console: Console) -> None:
    """Print designs and measures, the least first measure first, then failed designs."""
    study, (total, failed) = results.study, results.counts()
    whole = total <= _WHOLE
    shown = results.ranked(_WHOLE if whole else _BEST, status="ok")
    shown += results.ranked(_WHOLE if whole else _FAILED, status="failed")
    columns = {"design": cell("number")}
    columns |= {lines_of_head(study, path): cell(path) for path in study.varied}
    for name in _STATES[study.quantity] + MEASURES[study.quantity]:
        if any(row[name] is not None for row in shown):
            columns[lines_of_head(study, name)] = cell(name)
    if shown and shown[-1]["status"] == "failed":
        columns["message"] = lambda row: row["message"] if row["status"] == "failed" else ""
    console.print(tabled(_table_title(results, len(shown)), shown, columns))
    if not whole:
        console.print(f"all {total} rows, of which {failed} failed: --csv FILE")


def _table_title(results: StudyRows, n_shown: int) -> str:
    first, total = results.first_measure(), results.counts()[0]
    order = "" if first is None else f", least {first} first"
    count = f"{n_shown} of {total}" if n_shown < total else str(total)
    return f"{results.study.name}: {count} designs{order}"


def lines_of_head(study: Study, column: str) -> str:
    """Name of a column, its section above and its unit below."""
    return study.head(column).replace(" [", "\n[").replace(".", ".\n")


def cell(name: str) -> Callable[[Mapping[str, Any]], str]:
    """Return what makes the words of a column: value and error bar; the unit is in the head."""

    def words(row: Mapping[str, Any]) -> str:
        value, error = row.get(name), row.get(f"{name}_error")
        if isinstance(value, float):
            return " ".join(Measure(value, "", error).value_words.split())
        return "–" if value is None else str(value)

    return words


def overlap(one: Mapping[str, Any], other: Mapping[str, Any], name: str) -> bool:
    """Whether the error bars of a measure do not tell two rows apart."""
    bars = sum(row.get(f"{name}_error") or 0.0 for row in (one, other))
    return bool(abs(other[name] - one[name]) <= bars)


def summary(results: StudyRows, tally: Tally, wall_seconds: float) -> dict[str, Any]:
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
        "unused_keys": results.study.idle_parameters(),
        "this_run": {
            "computed": tally.computed,
            "workers": tally.workers,
            "wall_seconds": wall_seconds,
            "design_cpu_seconds": tally.design_cpu_seconds,
            "worker_cpu_seconds": tally.worker_cpu_seconds,
            "parent_cpu_seconds": parent,
        },
    }


def print_summary(results: StudyRows, did: dict[str, Any], console: Console) -> None:
    """Print what a sweep did."""
    study = results.study
    run = did["this_run"]
    varied = (f"{path} ({len(values)})" for path, values in study.parameters)
    seconds = (
        f"designs {run['design_cpu_seconds']:.1f}, their processes {run['worker_cpu_seconds']:.1f} "
        f"({run['workers']}), this process {run['parent_cpu_seconds']:.1f}"
    )
    rows = {
        "parameters": ", ".join(varied),
        "designs": f"{study.n_designs}, of which {run['computed']} computed now",
        "failed": _failure_words(results, did["n_failed"]),
        "CPU seconds": seconds,
        "wall seconds": f"{run['wall_seconds']:.1f}",
    }
    shown = [tables.Row(*row) for row in rows.items() if row[1]]
    console.print(tables.RowTable(f"{study.name}: how it was computed", shown))
    if did["unused_keys"]:
        words = ", ".join(did["unused_keys"])
        console.print(f"{'ignored':9} {words} (not used by this method)")
    console.print(f"{'results':9} {results.path}{_left_out(results)}")


def _left_out(results: StudyRows) -> str:
    """Words for what a file has beside the rows of this program."""
    words, others = "", results.of_other_programs
    if results.damaged:
        words += f"; {results.damaged} damaged lines are not used"
    if others:
        names = ", ".join(sorted(others))
        words += f"; {sum(others.values())} rows of other versions are not used ({names}): "
        words += "a new file takes them with --rows"
    return words


def _failure_words(results: StudyRows, failed: int) -> str:
    if not failed:
        return "none"
    row = next(row for row in results.rows() if row["status"] == "failed")
    return f"{failed}; the first, design {row['number']}: {row['message']}"


#: Factor by which values of rigid blocks must differ before deformable ones tell the same order: √2
#: standard deviations of the ratio of both, of 16 random Sine tubes of two layers, half of them
#: under internal and half under external pressure.
TOLD = {"p_max": 1.45, "p_eff": 1.22}


def ends(rows: StudyRows) -> tuple[str, dict[str, Any], dict[str, Any]] | None:
    """Measure that rigid blocks rank designs by, the best and the worst row; None without two."""
    name = rows.first_measure()
    if rows.study.quantity != "rigid" or name not in TOLD:
        return None
    known = [row for row in rows.rows() if row["status"] == "ok" and row[name] is not None]
    best, worst = (end(known, key=lambda row: row[name]) for end in (min, max))
    return (name, best, worst) if best["number"] != worst["number"] else None


def doubt(rows: StudyRows) -> str:
    """Say where values differ by less than rigid blocks can tell; empty otherwise."""
    by_rigid = ends(rows)
    if by_rigid is None:
        return ""
    name, best, worst = by_rigid
    if worst[name] >= TOLD[name] * best[name] > 0.0:
        return ""
    factor = worst[name] / best[name] if best[name] > 0.0 else 1.0
    return (
        f"{name} of these designs differs by a factor of {factor:.3g} at most: rigid blocks tell "
        f"no order below about {TOLD[name]:g}; --judge solves the best and the worst with "
        "deformable blocks"
    )


@dataclass(frozen=True)
class Judgement:
    """Best and worst design of rigid blocks, solved with deformable ones."""

    rows: tuple[dict[str, Any], ...]
    """Of deformable blocks: best and worst design by rigid ones."""
    table: Table
    verdict: str
    """Whether both kinds of blocks order them alike; empty where one has no answer."""

    def print(self, console: Console) -> None:
        """Print table and verdict."""
        console.print(self.table)
        if self.verdict:
            console.print(f"deformable blocks: {self.verdict}")


def judge(rows: StudyRows, runner: Callable[[Study], Runner]) -> Judgement:
    """Solve the best and the worst design with deformable blocks; rows are kept in the same file.

    Raises
    ------
    InputError
        Rows that are not of rigid blocks, or fewer than two designs with pressures.
    """
    by_rigid = ends(rows)
    if by_rigid is None:
        raise InputError(
            f"{rows.study.name}: --judge: got {len(rows.status)} rows of a study with quantity = "
            f'"{rows.study.quantity}"; expected two designs or more of rigid blocks with p_max'
        )
    name, *chosen = by_rigid
    study = rows.study.deformable()
    of_rigid = {row["number"]: row[name] for row in chosen}
    best, worst = judged = computed(StudyRows(rows.path, study), runner(study), list(of_rigid))
    columns: dict[str, Any] = {"design": cell("number")}
    columns |= {lines_of_head(study, path): cell(path) for path in study.varied}
    columns[f"{lines_of_head(study, name)}\nrigid"] = lambda row: f"{of_rigid[row['number']]:.5g}"
    columns[f"{lines_of_head(study, name)}\ndeformable"] = cell(name)
    if any(row["status"] == "failed" for row in judged):
        columns["message"] = cell("message")
    title = f"{study.name}: best and worst design of rigid blocks, solved with deformable ones"
    return Judgement(tuple(judged), tabled(title, judged, columns), _order(best, worst, name))


def _order(best: Mapping[str, Any], worst: Mapping[str, Any], name: str) -> str:
    """Whether the best of two designs is so by a measure; empty where one has no value."""
    if best[name] is None or worst[name] is None:
        return ""
    if overlap(best, worst, name):
        return "their error bars overlap: the order of the two is open"
    if best[name] < worst[name]:
        return "the same order"
    return "the other order: choose no design by this study"


@dataclass(frozen=True, repr=False)
class Swept(Printed):
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
