"""What a search found: rows, table, picture, plain data."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from geometry.answer import Measure
from validation.output.console import Printed, tabled
from validation.output.pictures.gallery import save_figure, subplots, wrapped
from validation.output.pictures.scales import BLUE, VERMILION
from validation.study.optimisation.search import Point, Search, judged_finalists, run_search
from validation.study.optimisation.statement import Optimisation
from validation.study.rowfile import StudyRows
from validation.study.run import Runner
from validation.study.study import Study
from validation.study.sweep import cell, lines_of_head, overlap

#: Rows of the table of a search.
_SHOWN = 10


def optimise(
    stated: Optimisation,
    path: Path,
    runner: Callable[[Study], Runner],
    progress: Callable[[str], None] | None = None,
) -> SearchResult:
    """Search, and judge the last few designs again; all rows are kept in one file."""
    search = Search(stated)

    def tell() -> None:
        if progress is not None:
            best = search.feasible[:1]
            scores = best[0].scores(stated.measures) if best else None
            least = "none within the limits yet" if scores is None else f"best {scores[0]:.4g}"
            progress(f"{len(search.points)} of {stated.evaluations} designs, {least}")

    run_search(search, StudyRows(path, stated.study), runner(stated.study), tell)
    if stated.judge is None:
        return SearchResult(search, [])
    rows = StudyRows(path, stated.judge)
    return SearchResult(search, judged_finalists(search, rows, runner(stated.judge)))


@dataclass(frozen=True, repr=False)
class SearchResult(Printed):
    """Designs of a search; rows are those of a study, of several cases with the worst of each."""

    search: Search
    """What was requested and every design that was computed."""
    final: list[Point]
    """Designs that were judged again, the best first."""

    @property
    def rows(self) -> tuple[dict[str, Any], ...]:
        """One for each design computed: variables, measures, ``status``, ``message``, `feasible`.

        ``pandas.DataFrame(result.rows)`` is a table.
        """
        return self._rows(self.search.points.values())

    @property
    def best(self) -> tuple[dict[str, Any], ...]:
        """Rows of the least value, or of the Pareto front."""
        return self._rows(self.search.best)

    @property
    def judged(self) -> tuple[dict[str, Any], ...]:
        """Rows with the answer that decides, the best first."""
        return self._rows(self.final)

    def _rows(self, points: Iterable[Point]) -> tuple[dict[str, Any], ...]:
        of = self.search.stated.values
        return tuple(p.row | of(p.places) | {"feasible": p.feasible} for p in points)

    def print(self, console: Console) -> None:
        """Print the best designs of the search, then those that were judged again."""
        stated, name = self.search.stated, self.search.stated.study.name
        two = len(stated.measures) == 2
        best = self.best if two else self._rows(self.search.feasible[:_SHOWN])
        kind = "Pareto front" if two else "best designs of the search"
        console.print(self._table(best[:_SHOWN], f"{name}: {kind}", stated.study))
        failed = sum(p.failed for p in self.search.points.values())
        console.print(
            f"{len(self.search.points)} designs computed, {len(self.search.feasible)} within the "
            f"limits, {failed} failed"
        )
        ends = ", ".join(f"{path} = {value:.6g}" for path, value in self.search.at_bounds.items())
        if ends and not two:
            console.print(f"at the bound: {ends}; better designs may lie beyond")
        if stated.judge is not None and self.final:
            words = f"{name}: judged again ({stated.judge.quantity})"
            console.print(self._table(self.judged, words, stated.judge))
            console.print(self.verdict)
        elif stated.study.quantity == "rigid":
            names = " and ".join(stated.measures)
            console.print(f"not judged by deformable blocks: these have no {names}")

    def _table(self, rows: Sequence[dict[str, Any]], title: str, study: Study) -> Table:
        stated = self.search.stated
        limited = ("mechanism" if x.name == "locked" else x.name for x in stated.limits)
        shown = dict.fromkeys((*stated.measures, *(n for n in limited if n in rows[0])))
        names = [*(path for path, _ in stated.variables), *shown]
        columns = {lines_of_head(study, name): cell(name) for name in names}
        if any(row.get(stated.measures[0]) is None for row in rows):
            columns["message"] = cell("message")
        return tabled(title, rows, columns, words=0)

    @property
    def verdict(self) -> str:
        """The best design of those judged, and how many others its error bars do not exclude."""
        stated = self.search.stated
        name = stated.measures[0]
        answered = [row for row in self.judged if row.get(name) is not None]
        if not answered:
            return f"none of the judged designs has {name}"
        best = answered[0]
        at = ", ".join(f"{path} = {cell(path)(best)}" for path, _ in stated.variables)
        words = f"best of those judged: {at}; {name} {cell(name)(best)}"
        close = [row for row in answered[1:] if overlap(best, row, name)]
        if close:
            words += f"; error bars do not distinguish it from {len(close)} of the others"
        return f"{words}\n{self._order}" if len(self.final) > 1 else words

    @property
    def _order(self) -> str:
        """Where the first and the last design of the search stand among those judged."""
        places = [point.places for point in self.final]
        mine = sorted(places, key=[p.places for p in self.search.feasible].index)
        first, last = (1 + places.index(mine[k]) for k in (0, -1))
        return (
            f"order: the best design of the search is number {first} of {len(places)} judged, the "
            f"worst of these number {last}"
        )

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "minimise": list(self.search.stated.measures),
            "limits": [limit.words for limit in self.search.stated.limits],
            "evaluations": len(self.search.points),
            "best": list(self.best),
            "designs": list(self.rows),
            "judged": list(self.judged),
        }

    def draw(self, path: str | Path) -> None:
        """Draw the course of a search, or the two measures with their front."""
        figure, axes = subplots(1, 1, size=(8.0, 4.8))
        stated = self.search.stated
        two = len(stated.measures) == 2
        (_draw_front if two else _draw_course)(self.search, axes)
        if not two and stated.judge is not None:
            _draw_judged(self.search, self.final, axes)
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
        title = wrapped(f"{stated.study.title}; {len(self.search.points)} designs", 7.0)
        axes.set_title(title, loc="left", fontsize="medium")
        save_figure(figure, Path(path))


def _draw_front(search: Search, axes: Any) -> None:
    stated = search.stated
    scores = [p.scores(stated.measures) for p in search.feasible]
    best = sorted(p.scores(stated.measures) or () for p in search.best)
    axes.scatter(
        *zip(*[s for s in scores if s], strict=True), s=18, color=BLUE, label="within the limits"
    )
    axes.plot(*zip(*best, strict=True), "o-", color=VERMILION, label="Pareto front")
    for name, label in zip(stated.measures, (axes.set_xlabel, axes.set_ylabel), strict=True):
        label(stated.study.label(name))


def _draw_course(search: Search, axes: Any) -> None:
    name = search.stated.measures[0]
    points = list(search.points.values())
    course: list[float] = []
    least = math.inf
    for point in points:
        value = point.row.get(name)
        if point.feasible and value is not None:
            least = min(least, value)
        course.append(least if least < math.inf else math.nan)
    numbers = range(1, len(points) + 1)
    for feasible, colour, words in (
        (True, BLUE, "within the limits"),
        (False, "#999999", "outside"),
    ):
        of = [
            (k, p.row[name])
            for k, p in zip(numbers, points, strict=True)
            if p.feasible is feasible and p.row.get(name) is not None
        ]
        if of:
            axes.plot(*zip(*of, strict=True), ".", color=colour, label=words)
    axes.step(numbers, course, where="post", color=VERMILION, label="best so far")
    axes.set_xlabel("design computed")
    axes.set_ylabel(search.stated.study.label(name))


def _draw_judged(search: Search, final: list[Point], axes: Any) -> None:
    """Draw the answers that decide; one that its mesh does not resolve has no bar to draw."""
    name, order, judge = search.stated.measures[0], list(search.points), search.stated.judge
    who = "deformable blocks" if judge is not None and judge.quantity == "fem" else "judged again"
    values = [(p, p.row[name], p.row.get(f"{name}_error")) for p in final if p.row.get(name)]
    numbers = {p.places: Measure(value, "", error).is_number for p, value, error in values}
    for resolved, fill, words in (
        (True, "black", who),
        (False, "none", f"{who}, not resolved"),
    ):
        of = [one for one in values if numbers[one[0].places] is resolved]
        if of:
            axes.errorbar(
                [order.index(p.places) + 1 for p, *_ in of],
                [value for _, value, _ in of],
                yerr=[error or 0.0 for *_, error in of] if resolved else None,
                fmt="s",
                capsize=3,
                color="black",
                markerfacecolor=fill,
                label=words,
            )
