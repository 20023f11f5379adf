"""What was decided of effects, and what each changes and costs: tables, figure and data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from validation.case import Case
from validation.output.console import tabled
from validation.scene.deformable import stated_share
from validation.study.effects.costs import TOLERANCE
from validation.study.effects.switches import KeyChange

#: Name of the figure.
PICTURE = "effects.png"


def bound(case: Case, tolerance: str | None) -> float:
    """Change beyond which an effect matters: as asked, as ``effects.auto`` says, or 1 %."""
    return case.auto or TOLERANCE if tolerance is None else stated_share("--tolerance", tolerance)


#: Quantities whose changes are shown, by their names in rows.
_CHANGES = {"p_max": "p_max", "p_eff": "p_eff", "displacement": "u"}


def _change(key: str) -> Callable[[Mapping[str, Any]], str]:
    """Words for the change of a quantity."""

    def words(cost: Mapping[str, Any]) -> str:
        value = cost.get(key)
        return "–" if value is None else "0" if abs(value) < 5e-4 else f"{value:+.3g} %"

    return words


def _keys(changes: Sequence[Mapping[str, Any]]) -> str:
    """Changed keys: key, from, to."""
    return ", ".join(KeyChange(c["key"], c["from"], c["to"]).words for c in changes)


def effects_table(measured: Mapping[str, Any]) -> Table:
    """Return one row for each effect of `effect_costs`."""
    answer = ""
    if "p_max" in measured:
        answer = "p_max {p_max:.4g} MPa, p_eff {p_eff:.4g} MPa, u {displacement:.4g} mm, ".format(
            **measured
        )
    matters = f"> {100 * measured['tolerance']:.3g} %"
    columns: dict[str, str | Callable[[Mapping[str, Any]], str]] = {
        "without": "{name}",
        **{head: _change(key) for key, head in _CHANGES.items()},
        matters: lambda cost: {True: "yes", False: "no", None: "–"}[cost["matters"]],
        "CPU time": "× {step:.2f}",
        "memory": "× {memory:.2f}",
        "Δt": "× {time_step:.2f}",
    }
    off = "\n".join(f"without {c['name']}: {_keys(c['changes'])}" for c in measured["costs"])
    table = tabled(
        f"{measured['scene']}: its effects switched off one at a time\n"
        f"reference run ({_keys(measured['changes']) or 'the scene'}): "
        f"{answer}{1e6 * measured['seconds_per_step']:.1f} CPU µs per step, "
        f"{measured['bytes'] / 2**20:.2f} MiB",
        measured["costs"],
        columns,
        words=len(columns),
        caption=f"{matters}: without it, one of p_max, p_eff, u changes by more. CPU time of a "
        f"step, memory, Δt: with the effect over without it.\n{off}",
        caption_justify="left",
    )
    for column in (0, 1, 2, 3):
        table.columns[column].no_wrap = True
    return table


def draw_effects(measured: Mapping[str, Any], path: Path) -> None:
    """Draw changes and costs, one group of bars for each effect."""
    from matplotlib.ticker import FuncFormatter

    from validation.output.pictures.gallery import save_figure, subplots
    from validation.output.pictures.scales import BLUE, ORANGE, SKY, VERMILION

    costs = measured["costs"]
    figure, (left, right) = subplots(1, 2, size=(10, 4.6), sharey=True)
    rows = range(len(costs))
    columns = (
        (
            left,
            0.0,
            [[cost.get(key, 0.0) for key in _CHANGES] for cost in costs],
            (("p_max", BLUE), ("p_eff", SKY), ("largest u", VERMILION)),
        ),
        (
            right,
            1.0,
            [(cost["step"], cost["memory"]) for cost in costs],
            (("CPU time of a step", BLUE), ("memory", ORANGE)),
        ),
    )
    for axes, start, values, series in columns:
        height = 0.8 / len(series)
        for k, (label, colour) in enumerate(series):
            places = [row + (k - 0.5 * (len(series) - 1)) * height for row in rows]
            widths = [of[k] - start for of in values]
            axes.barh(places, widths, left=start, height=height, label=label, color=colour)
        axes.legend(
            fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False
        )
        axes.tick_params(axis="both", labelsize=8)
        axes.grid(axis="x", alpha=0.3)
    left.set_xscale("symlog", linthresh=0.01)
    left.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    left.set_xlabel("change without the effect [%] (linear within ±0.01 %)")
    left.axvline(0.0, color="black", linewidth=0.8)
    left.set_yticks(list(rows), [f"without {cost['name']}" for cost in costs])
    left.invert_yaxis()
    right.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"× {value:g}"))
    right.set_xlabel("with the effect over without it [–]")
    right.axvline(1.0, color="black", linewidth=0.8)
    title = f"{measured['scene']}: {measured['load']}; explicit FEM"
    figure.suptitle(
        f"{title}, effects switched off one at a time", x=0.02, ha="left", fontsize="medium"
    )
    save_figure(figure, path)
