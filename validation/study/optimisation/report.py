"""What a search found: table, picture, plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from geometry.answer import Measure
from validation.output.console import listing
from validation.output.pictures.gallery import save_figure, subplots
from validation.output.pictures.scales import BLUE, VERMILION
from validation.study.optimisation.search import Point, Search
from validation.study.study import Study

#: Rows of the table of a search.
_SHOWN = 10


def print_search(search: Search, final: list[Point], console: Console) -> None:
    """Print the best designs of the search, then those that were judged again."""
    stated = search.stated
    best = search.best if len(stated.measures) == 2 else search.feasible
    kind = "Pareto front" if len(stated.measures) == 2 else "best designs of the search"
    console.print(_table(search, best[:_SHOWN], f"{stated.study.name}: {kind}", stated.study))
    failed = sum(p.failed for p in search.points.values())
    console.print(
        f"{len(search.points)} designs computed, {len(search.feasible)} within the limits, "
        f"{failed} failed"
    )
    if stated.judge is not None and final:
        words = f"{stated.study.name}: judged again ({stated.judge.quantity})"
        console.print(_table(search, final, words, stated.judge))
        console.print(verdict(search, final))


def _table(search: Search, points: list[Point], title: str, study: Study) -> Table:
    stated = search.stated
    shown = [*stated.measures, *(n for n in _limit_columns(search) if n in points[0].row)]
    heads = [path for path, _ in stated.variables]
    table = listing(title, numbers=[study.head(n).replace(" [", "\n[") for n in (*heads, *shown)])
    for point in points:
        values = stated.values(point.places)
        cells = [f"{v:g}" if isinstance(v, float) else str(v) for v in values.values()]
        table.add_row(*cells, *(_words(point, name) for name in shown))
    return table


def _limit_columns(search: Search) -> list[str]:
    names = [
        "mechanism" if limit.name == "locked" else limit.name for limit in search.stated.limits
    ]
    return [n for n in dict.fromkeys(names) if n not in search.stated.measures]


def _words(point: Point, name: str) -> str:
    value, error = point.row.get(name), point.row.get(f"{name}_error")
    if isinstance(value, float):
        return Measure(value, "", error).value_words.rstrip()
    return (point.row["message"] or "–") if value is None else str(value)


def verdict(search: Search, final: list[Point]) -> str:
    """Say which judged design is best, and whether its error bar tells it from the next."""
    name = search.stated.measures[0]
    answered = [p for p in final if p.row.get(name) is not None]
    if not answered:
        return f"none of the judged designs has {name}"
    best = answered[0]
    at = ", ".join(f"{k} = {_value(v)}" for k, v in search.stated.values(best.places).items())
    words = f"best: {at}; {name} {_words(best, name)}"
    close = [p for p in answered[1:] if _overlap(best, p, name)]
    if close:
        words += f"; error bars do not tell it from {len(close)} of the others"
    return words


def _overlap(one: Point, other: Point, name: str) -> bool:
    bars = sum(p.row.get(f"{name}_error") or 0.0 for p in (one, other))
    return bool(other.row[name] - one.row[name] <= bars)


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def search_json(search: Search, final: list[Point]) -> dict[str, Any]:
    """Everything as plain data."""
    stated = search.stated

    def data(point: Point) -> dict[str, Any]:
        row = {k: v for k, v in point.row.items() if k not in ("number", "worker", "unused")}
        return {
            "variables": stated.values(point.places),
            "feasible": point.feasible,
            "row": {k: v for k, v in row.items() if _plain(v)},
        }

    return {
        "minimise": list(stated.measures),
        "limits": [limit.words for limit in stated.limits],
        "evaluations": len(search.points),
        "best": [data(p) for p in search.best],
        "designs": [data(p) for p in search.points.values()],
        "judged": [data(p) for p in final],
    }


def _plain(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float | bool | Mapping)


def draw_search(search: Search, final: list[Point], path: Path) -> None:
    """Draw the course of a search, or the two measures with their front."""
    figure, axes = subplots(1, 1, size=(8.0, 4.8))
    stated = search.stated
    two = len(stated.measures) == 2
    (_draw_front if two else _draw_course)(search, axes)
    if not two and stated.judge is not None:
        _draw_judged(search, final, axes)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    axes.set_title(f"{stated.study.name}: {len(search.points)} designs", loc="left")
    save_figure(figure, path)


def _draw_front(search: Search, axes: Any) -> None:
    stated = search.stated
    scores = [p.scores(stated.measures) for p in search.feasible]
    best = sorted(p.scores(stated.measures) or () for p in search.best)
    axes.scatter(
        *zip(*[s for s in scores if s], strict=True), s=18, color=BLUE, label="within the limits"
    )
    axes.plot(*zip(*best, strict=True), "o-", color=VERMILION, label="Pareto front")
    for name, label in zip(stated.measures, (axes.set_xlabel, axes.set_ylabel), strict=True):
        label(stated.study.head(name))


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
    axes.set_ylabel(search.stated.study.head(name))


def _draw_judged(search: Search, final: list[Point], axes: Any) -> None:
    name, order = search.stated.measures[0], list(search.points)
    of = [p for p in final if p.row.get(name) is not None]
    if of:
        axes.errorbar(
            [order.index(p.places) + 1 for p in of],
            [p.row[name] for p in of],
            yerr=[p.row.get(f"{name}_error") or 0.0 for p in of],
            fmt="s",
            capsize=3,
            color="black",
            label="judged again",
        )
