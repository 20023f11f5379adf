"""`tubelock effects`: what each effect changes and costs, as table, figure and data."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from rich.console import Console
from rich.table import Table

from validation.effect_costs import EffectCost, EffectReport, effect_costs
from validation.errors import InputError
from validation.files import output_folder, prepare_json, write_json, write_whole
from validation.scene import DeformableScene, SceneFile


def run_effects(
    file: SceneFile, *, folder: Path | None, json: str | None, console: Console
) -> EffectReport:
    """Measure, print and write the effects of a scene.

    Raises
    ------
    InputError
        For a scene without deformable blocks in contact, or one that cannot be run.
    """
    if not isinstance(file.scene, get_args(DeformableScene)):
        raise InputError(
            f"{file.name}: has no deformable blocks in contact; expected a tube such as tsb1-pipe"
        )
    prepare_json(json)
    with output_folder(folder):
        report = effect_costs(
            file.scene,
            file.name,
            told=lambda name: console.print(f"… {name}") if console.is_terminal else None,
        )
        console.print(effects_table(report))
        if folder is not None:
            picture = folder / "effects.png"
            write_whole(picture, lambda path: draw_effects(report, path))
            console.print(f"picture   {picture}")
        write_json(json, effects_json(report))
    return report


def _percent(value: float | None) -> str:
    if value is None:
        return "–"
    return "0" if abs(value) < 5e-4 else f"{value:+.3g} %"


def _factor(value: float | None) -> str:
    return "–" if value is None else f"× {value:.2f}"


def _proof(cost: EffectCost) -> str:
    if cost.off_compiles or not cost.same_bits:
        return f"NOT ABSENT: {cost.off_compiles} forms, same bits {cost.same_bits}"
    return f"{cost.new_forms} own compiled forms; off: none, same bits"


def effects_table(report: EffectReport) -> Table:
    """Return one row for each effect."""
    answer = ""
    if report.p_max is not None:
        answer = f"p_max {report.p_max:.4g} MPa, p_eff {report.p_eff:.4g} MPa, "
        answer += f"u {report.displacement:.4g} mm, "
    table = Table(
        title=(
            f"{report.scene}: effects, each added to none\n"
            f"without: {answer}{1e6 * report.seconds_per_step:.1f} CPU µs per step, "
            f"{report.bytes / 2**20:.2f} MiB"
        ),
        title_justify="left",
    )
    for heading in ("effect", "on", "p_max", "p_eff", "u", "step", "memory", "Δt", "proof"):
        table.add_column(heading)
    for cost in report.costs:
        words = _proof(cost) if cost.available else cost.effect.note
        table.add_row(
            cost.effect.name,
            cost.effect.setting,
            *(_percent(v) for v in (cost.p_max, cost.p_eff, cost.displacement)),
            *(_factor(v) for v in (cost.step, cost.memory, cost.time_step)),
            words,
        )
    return table


def effects_json(report: EffectReport) -> dict[str, Any]:
    """Return the report as plain data."""
    data = asdict(report)
    for cost in data["costs"]:
        effect = cost.pop("effect")
        cost |= {key: effect[key] for key in ("name", "setting", "note")}
    return data


def draw_effects(report: EffectReport, path: Path) -> None:
    """Draw changes and costs, one group of bars for each effect."""
    from matplotlib.figure import Figure

    costs = [cost for cost in report.costs if cost.available]
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    rows = range(len(costs))
    columns = (
        (left, [("p_max", "p_max"), ("p_eff", "p_eff"), ("displacement", "largest u")]),
        (right, [("step", "CPU time of a step"), ("memory", "memory")]),
    )
    for axes, series in columns:
        height = 0.8 / len(series)
        for k, (key, label) in enumerate(series):
            places = [row + (k - 0.5 * (len(series) - 1)) * height for row in rows]
            values = [getattr(cost, key) or 0.0 for cost in costs]
            axes.barh(places, values, height=height, label=label)
        axes.legend(fontsize=8)
        axes.grid(axis="x", alpha=0.3)
    left.set_xscale("symlog", linthresh=0.01)
    left.set_xlabel("change of the static answer [%] (linear within ±0.01 %)")
    left.axvline(0.0, color="black", linewidth=0.8)
    left.set_yticks(list(rows), [f"{cost.effect.name}\n{cost.effect.setting}" for cost in costs])
    left.tick_params(axis="both", labelsize=8)
    left.invert_yaxis()
    right.set_xlabel("over the run without effects [–]")
    right.axvline(1.0, color="black", linewidth=0.8)
    figure.suptitle(f"{report.scene}: effects, each added to none")
    figure.savefig(path, dpi=150, format="png")
