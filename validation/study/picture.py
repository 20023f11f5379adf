"""A measure of a study against one of its parameters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from validation.errors import InputError
from validation.output.pictures.gallery import subplots, wrapped
from validation.output.pictures.scales import OF_LINES
from validation.study.study import Study, value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Curves that a legend names one by one; of more only the first other parameter is named.
_MOST_NAMED = 12
#: Dashes and markers, after as many curves as there are colours.
_STYLES, _MARKERS = ("-", "--", ":"), "os^Dv"


def check_axes(study: Study, parameter: str, measure: str) -> None:
    """Reject what a study cannot draw."""
    if parameter not in study.varied:
        raise InputError(
            f"--plot {parameter} {measure}: {parameter} does not vary in {study.name}; expected "
            f"one of {', '.join(study.varied) or 'none'}, then a measure"
        )
    numbers = [name for name, kind in study.columns.items() if kind != "TEXT"]
    if measure not in numbers:
        raise InputError(
            f"--plot {parameter} {measure}: got {measure}, expected one of {', '.join(numbers)}"
        )


def study_figure(
    study: Study, rows: Iterable[Mapping[str, Any]], parameter: str, measure: str
) -> Figure:
    """Draw a measure against a parameter, one curve for each combination of the others.

    Rows have the names of `StudyRows.rows`. Designs without the measure leave gaps.
    """
    check_axes(study, parameter, measure)
    result = {row["number"]: row for row in rows}
    others = [path for path in study.varied if path != parameter]
    values = dict(study.parameters)
    curves = list(itertools.product(*(values[path] for path in others)))
    figure, axes = subplots(1, 1, size=(8.0, 5.2))
    base = {path: given[0] for path, given in study.parameters}
    for place, chosen in enumerate(curves):
        design = base | dict(zip(others, chosen, strict=True))
        numbers = [study.number(design | {parameter: value}) for value in values[parameter]]
        points = [result.get(number, {}) for number in numbers]
        _draw_curve(axes, values[parameter], points, measure, _look(study, others, chosen, place))
    axes.set_xlabel(study.head(parameter))
    axes.set_ylabel(study.label(measure))
    title = wrapped(_title(study, others, len(curves)), 7.0)
    axes.set_title(title, loc="left", fontsize="medium")
    axes.grid(alpha=0.3)
    if others:
        axes.legend(frameon=False, fontsize="small", title=_legend_title(study, others, curves))
    return figure


def _look(study: Study, others: Sequence[str], chosen: Sequence[Any], place: int) -> dict[str, Any]:
    """Colour, dashes, marker and label of a curve."""
    values = dict(study.parameters)
    named = math.prod(len(values[path]) for path in others) <= _MOST_NAMED
    if not named:
        place = values[others[0]].index(chosen[0])
    shown = chosen if named else chosen[:1]
    colours = len(OF_LINES)
    label = ", ".join(_value_words(value) for value in shown)
    first = named or all(
        value == values[path][0] for path, value in zip(others[1:], chosen[1:], strict=True)
    )
    return {
        "color": OF_LINES[place % colours],
        "linestyle": _STYLES[place // colours % len(_STYLES)],
        "marker": _MARKERS[place % len(_MARKERS)],
        "markersize": 4,
        "alpha": 1.0 if named else 0.5,
        "label": label if first and others else None,
    }


def _draw_curve(
    axes: Axes,
    values: Sequence[Any],
    points: Sequence[Mapping[str, Any]],
    measure: str,
    look: Mapping[str, Any],
) -> None:
    """Draw one curve in the order of its numbers, with error bars where rows have them."""
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    order = sorted(range(len(values)), key=lambda k: values[k] if numbers else k)
    x = [values[k] if numbers else _value_words(values[k]) for k in order]
    y = [_number(points[k].get(measure)) for k in order]
    bars = [_number(points[k].get(f"{measure}_error")) for k in order]
    has_bars = any(math.isfinite(bar) for bar in bars)
    axes.errorbar(x, y, yerr=bars if has_bars else None, capsize=3, **look)


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _value_words(value: Any) -> str:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{value:g}" if number else value_text(value).strip('"')


def _title(study: Study, others: Sequence[str], n_curves: int) -> str:
    if len(others) < 2 or n_curves <= _MOST_NAMED:
        return study.title
    return f"{study.title}; {n_curves} curves, one for each combination of the other parameters"


def _legend_title(study: Study, others: Sequence[str], curves: Sequence[Any]) -> str:
    shown = others if len(curves) <= _MOST_NAMED else others[:1]
    return ", ".join(study.head(path) for path in shown)
