"""What was decided of effects, and what each changes and costs: tables, figure and data."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from validation.effects.auto import EffectsDecision, decide_effects, decision_table
from validation.effects.cell import offer_words, offered_cell
from validation.effects.costs import EffectCost, EffectReport
from validation.effects.proof import BareProof
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
    console.print(decision_table(name, decision))
    offer = offered_cell(scene, name)
    if offer is not None:
        console.print(offer_words(offer))
    return scene, decision


def proof_table(found: BareProof) -> Table:
    """Return one row for each kernel of the loop."""
    bits = "the same bits" if found.same_bits else "NOT the same bits"
    title = "the loop with all effects off, beside one built without them: "
    heads = ("kernel", "instructions, off", "instructions, built without", "")
    table = listing(f"{title}{bits} after {found.steps} steps", *heads)
    for count in found.kernels:
        verdict = "the same" if count.same else "NOT the same"
        table.add_row(count.kernel, str(count.off), str(count.without), verdict)
    return table


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


def _verdict(cost: EffectCost, tolerance: float) -> str:
    matters = cost.matters(tolerance)
    return "–" if matters is None else ("yes" if matters else "no")


def _percent(value: float | None) -> str:
    if value is None:
        return "–"
    return "0" if abs(value) < 5e-4 else f"{value:+.3g} %"


def _factor(value: float | None) -> str:
    return "–" if value is None else f"× {value:.2f}"


def _proof(cost: EffectCost) -> str:
    if cost.off_compiles or not cost.same_bits:
        return f"NOT ABSENT: {cost.off_compiles} forms, same bits {cost.same_bits}"
    return f"yes ({cost.new_forms})"


def effects_table(report: EffectReport, tolerance: float = TOLERANCE) -> Table:
    """Return one row for each effect; it matters where it changes more than the tolerance."""
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
    matters = f"> {100 * tolerance:.3g} %"
    names = ("effect", "on", "p_max", "p_eff", "u", matters, "step", "memory", "Δt", "absent off")
    for heading in names:
        table.add_column(heading, no_wrap=heading in ("effect", "p_max", "p_eff", "u"))
    table.caption = (
        f"{matters}: it changes one of the three by more. Absent off: the base compiles nothing "
        "new and gives the same bits after it (own compiled forms when on)."
    )
    table.caption_justify = "left"
    for cost in report.costs:
        words = _proof(cost)
        table.add_row(
            cost.effect.name,
            cost.effect.setting,
            *(_percent(v) for v in (cost.p_max, cost.p_eff, cost.displacement)),
            _verdict(cost, tolerance),
            *(_factor(v) for v in (cost.step, cost.memory, cost.time_step)),
            words,
        )
    return table


def effects_json(report: EffectReport, tolerance: float = TOLERANCE) -> dict[str, Any]:
    """Return the report as plain data."""
    data = asdict(report) | {"tolerance": tolerance}
    for cost, found in zip(data["costs"], report.costs, strict=True):
        # Readers of earlier files ask for "available"; now every effect is.
        cost |= {"matters": found.matters(tolerance), "available": True}
        effect = cost.pop("effect")
        cost |= {key: effect[key] for key in ("name", "setting", "note")}
    return data


def draw_effects(report: EffectReport, path: Path) -> None:
    """Draw changes and costs, one group of bars for each effect."""
    from matplotlib.ticker import FuncFormatter

    from validation.output.pictures.gallery import (
        BLUE,
        ORANGE,
        SKY,
        VERMILION,
        save_figure,
        subplots,
        twos_and_fives,
    )

    costs = report.costs
    figure, (left, right) = subplots(1, 2, size=(10, 4.6), sharey=True)
    rows = range(len(costs))
    columns = (
        (
            left,
            [
                ("p_max", "p_max", BLUE),
                ("p_eff", "p_eff", SKY),
                ("displacement", "largest u", VERMILION),
            ],
        ),
        (right, [("step", "CPU time of a step", BLUE), ("memory", "memory", ORANGE)]),
    )
    for axes, series in columns:
        height = 0.8 / len(series)
        for k, (key, label, colour) in enumerate(series):
            places = [row + (k - 0.5 * (len(series) - 1)) * height for row in rows]
            values = [getattr(cost, key) or 0.0 for cost in costs]
            start = 0.0 if axes is left else 1.0
            widths = [value - start for value in values]
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
    figure.suptitle(f"{report.scene}: effects, each added to none")
    save_figure(figure, path)
