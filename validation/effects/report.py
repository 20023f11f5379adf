"""What was decided of effects, and what each changes and costs: tables, figure and data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from validation.effects.auto import EffectsDecision, decide_effects
from validation.effects.costs import EffectCost, EffectReport
from validation.effects.probe import Change
from validation.errors import InputError
from validation.output.console import listing, status
from validation.scene.deformable import parse_share
from validation.scene.read import DeformableScene

#: Name of the figure.
PICTURE = "effects.png"

#: Change beyond which an effect matters, where nothing else is said.
TOLERANCE = 0.01


def decided(
    scene: DeformableScene, name: str, console: Console
) -> tuple[DeformableScene, EffectsDecision]:
    """Scene with the effects that matter, and the decision that it asks for; printed.

    Raises
    ------
    InputError
        A probe that has no solution.
    """
    with status(console, f"{name}: which effects matter") as tell:
        scene, decision = decide_effects(scene, name, told=lambda what: tell(f"{name}: {what}"))
    console.print(decision.words)
    return scene, decision


def bound(scene: DeformableScene, tolerance: str | None) -> float:
    """Change beyond which an effect matters: as asked, as ``effects.auto`` says, or 1 %.

    Raises
    ------
    InputError
        For a tolerance that is no share.
    """
    if tolerance is None:
        return TOLERANCE if scene.effects.auto is None else scene.effects.auto.tolerance
    share = parse_share(tolerance)
    if share is None:
        raise InputError(
            f"--tolerance {tolerance}: expected a share between 0 and 100 %, such as 1%"
        )
    return share


def _percents(found: Change | None) -> Iterable[str]:
    if found is None:
        return ("–",) * 3
    return ("0" if abs(value) < 5e-6 else f"{100 * value:+.3g} %" for value in found.values)


def _absent(cost: EffectCost) -> str:
    if cost.off_compiles or not cost.same_bits:
        return f"CHANGED: {cost.off_compiles} new forms, bitwise equal: {cost.same_bits}"
    return f"unchanged ({cost.new_forms})"


def effects_table(report: EffectReport, tolerance: float = TOLERANCE) -> Table:
    """Return one row for each effect; it matters where it changes more than the tolerance."""
    answer = ""
    if report.answer is not None:
        p_max, p_eff, u = report.answer.values
        answer = f"p_max {p_max:.4g} MPa, p_eff {p_eff:.4g} MPa, u {u:.4g} mm, "
    matters = f"> {100 * tolerance:.3g} %"
    names = (
        "effect",
        "on",
        "p_max",
        "p_eff",
        "u",
        matters,
        "CPU time",
        "memory",
        "Δt",
        "switched off",
    )
    table = listing(
        f"{report.scene}: one effect at a time added to the reference run\n"
        f"without: {answer}{1e6 * report.seconds_per_step:.1f} CPU µs per step, "
        f"{report.bytes / 2**20:.2f} MiB",
        *names,
        caption=f"{matters}: changes one of p_max, p_eff, u by more. CPU time: factor per step. "
        "Switched off: the reference run is bitwise unchanged and compiles nothing new "
        "(in brackets: compiled forms of the effect).",
        caption_justify="left",
    )
    for column in (0, 2, 3, 4):
        table.columns[column].no_wrap = True
    for cost in report.costs:
        table.add_row(
            cost.effect.name,
            cost.effect.setting,
            *_percents(cost.change),
            {True: "yes", False: "no", None: "–"}[cost.matters(tolerance)],
            *(f"× {v:.2f}" for v in (cost.step, cost.memory, cost.time_step)),
            _absent(cost),
        )
    return table


def effects_json(report: EffectReport, tolerance: float = TOLERANCE) -> dict[str, Any]:
    """Return the report as plain data."""
    data = asdict(report) | {"tolerance": tolerance}
    data |= data.pop("answer") or {}
    for cost, found in zip(data["costs"], report.costs, strict=True):
        cost |= {key: 100.0 * value for key, value in (cost.pop("change") or {}).items()}
        cost["matters"] = found.matters(tolerance)
        effect = cost.pop("effect")
        cost |= {key: effect[key] for key in ("name", "setting", "note")}
    return data


def draw_effects(report: EffectReport, path: Path) -> None:
    """Draw changes and costs, one group of bars for each effect."""
    from matplotlib.ticker import FuncFormatter

    from validation.output.pictures.gallery import save_figure, subplots, twos_and_fives
    from validation.output.pictures.scales import BLUE, ORANGE, SKY, VERMILION

    costs = report.costs
    figure, (left, right) = subplots(1, 2, size=(10, 4.6), sharey=True)
    rows = range(len(costs))
    columns = (
        (
            left,
            0.0,
            [100.0 * np.array(c.change.values if c.change else (0.0, 0.0, 0.0)) for c in costs],
            (("p_max", BLUE), ("p_eff", SKY), ("largest u", VERMILION)),
        ),
        (
            right,
            1.0,
            [np.array((c.step, c.memory)) for c in costs],
            (("CPU time of a step", BLUE), ("memory", ORANGE)),
        ),
    )
    for axes, start, values, series in columns:
        height = 0.8 / len(series)
        for k, (label, colour) in enumerate(series):
            places = [row + (k - 0.5 * (len(series) - 1)) * height for row in rows]
            widths = [of[k] - start for of in values]
            axes.barh(places, widths, left=start, height=height, label=label, color=colour)
        axes.legend(fontsize=8)
        axes.grid(axis="x", alpha=0.3)
    left.set_xscale("symlog", linthresh=0.01)
    left.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    left.set_xlabel("change of the static answer [%] (linear within ±0.01 %)")
    left.axvline(0.0, color="black", linewidth=0.8)
    left.set_yticks(list(rows), [f"{cost.effect.name}\n{cost.effect.setting}" for cost in costs])
    left.tick_params(axis="both", labelsize=8)
    left.invert_yaxis()
    right.set_xscale("log")
    right.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"× {value:g}"))
    right.xaxis.set_minor_formatter(twos_and_fives(lambda value: f"× {value:g}"))
    right.set_xlabel("over the run without effects [–]")
    right.axvline(1.0, color="black", linewidth=0.8)
    figure.suptitle(f"{report.scene}: one effect at a time added to the reference run")
    save_figure(figure, path)
