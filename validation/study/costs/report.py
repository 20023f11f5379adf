"""Work and precision of a scene as tables, orders, words, figure and data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from geometry.answer import title_of
from validation.output.console import listing
from validation.output.pictures.gallery import save_figure, subplots, twos_and_fives
from validation.output.pictures.scales import BLUE, GREEN, ORANGE, VERMILION
from validation.output.provenance import Provenance
from validation.study.costs.measure import SCALARS
from validation.study.costs.plan import QUANTITIES
from validation.study.costs.study import CostRow, CostStudy, answers, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Curves of the figure by method: name and colour; each shows the best settings of its method.
#: Rigid blocks are in the tables: their error does not shrink with the mesh.
_CURVES = {
    "static": ("static, trilinear elements", BLUE),
    "curved": ("static, elements of higher degree", GREEN),
    "explicit": ("explicit", VERMILION),
}


# ---------------------------------------------------------------------------------------------
# Data and text


def study_json(study: CostStudy) -> dict[str, Any]:
    """Return the study as plain data."""
    return {
        "scene": study.name,
        "base_mesh": study.plan.base.at(1),
        "measured": dict(zip(("processor", "date"), study.measured, strict=True)),
        "left_out": dict(study.plan.left_out),
        "reference": {
            "judges": [judge.words for judge in study.plan.judges],
            "cpu_seconds": study.reference_seconds,
            "values": {q: float(study.reference[q].value[0]) for q in SCALARS},
            "relative_errors": study.reference_errors,
            "orders": {q: study.reference[q].order for q in QUANTITIES},
        },
        "settings": [
            {
                "name": row.setting.name,
                "family": row.setting.family,
                "method": row.setting.method,
                "level": row.setting.level,
                "values": row.measured["scalars"],
                "relative_errors": row.errors,
                "cpu_seconds": row.measured["cpu_seconds"],
                **row.measured["details"],
            }
            for row in study.rows
        ],
        "failures": study.failures,
        "pareto": {q: [row.setting.name for row in study.front(q)] for q in QUANTITIES},
        "orders": {
            family: {
                q: study.order(family, q)
                for q in QUANTITIES
                if any(q in row.errors for row in rows)
            }
            for family, rows in study.families().items()
        },
        "answers": answers(study),
    }


def print_study(study: CostStudy, console: Console) -> None:
    """Print reference, Pareto fronts, orders and the answers in words."""
    _print_reference(study, console)
    _print_fronts(study, console)
    _print_orders(study, console)
    for setting, why in study.failures.items():
        console.print(f"no answer from {setting}: {why}")
    console.print("Errors smaller than the error of the reference are not significant.")
    console.print("CPU time to reach an accuracy (errors include the error of the reference):")
    for words in answers(study):
        console.print(f"• {words}")


def _print_reference(study: CostStudy, console: Console) -> None:
    console.print(f"{study.name}: base mesh ×1 is {study.plan.base.words} elements per block")
    console.print(f"measured on {', '.join(study.measured)}")
    for method, why in study.plan.left_out:
        console.print(f"left out: {method}: {why}")
    judges = {q: judge for judge in study.plan.judges for q in judge.quantities}
    for judge in study.plan.judges:
        console.print(f"reference: {judge.words}")
    console.print(f"  {study.reference_seconds:.3g} CPU s")
    for q in QUANTITIES:
        order = study.reference[q].order
        how = "not extrapolated, follows no order" if order is None else f"order {order:.2g}"
        if not judges[q].extrapolated:
            how = "as its error bar says"
        number = float(study.reference[q].value[0])
        value = f"{number:.5g} {title_of(q).unit} " if q in SCALARS else ""
        console.print(
            f"  {title_of(q).words}: {value}± {percent(study.reference_errors[q])} ({how})"
        )


def _print_fronts(study: CostStudy, console: Console) -> None:
    title = "Pareto fronts: no other setting is cheaper and nearer (F in that quantity)"
    table = listing(title, "setting", numbers=("CPU s", *QUANTITIES))
    fronts = {q: {row.setting for row in study.front(q)} for q in QUANTITIES}
    anywhere = set().union(*fronts.values())
    for row in sorted(study.rows, key=lambda r: r.cost):
        if row.setting in anywhere:
            cells = [
                f"{percent(row.errors[q])}{' F' if row.setting in fronts[q] else '  '}"
                if q in row.errors
                else "–  "
                for q in QUANTITIES
            ]
            table.add_row(row.setting.name, f"{row.cost:.3g}", *cells)
    console.print(table)


def _print_orders(study: CostStudy, console: Console) -> None:
    title = "Observed orders in mesh size: against the reference / of three meshes by themselves"
    table = listing(title, "family", numbers=QUANTITIES)
    for family, rows in study.families().items():
        if len(rows) > 2:
            table.add_row(family, *(_order_cell(study, family, q) for q in QUANTITIES))
    if table.row_count:
        console.print(table)
    else:
        console.print("Observed orders in mesh size: none, no method ran on three meshes")


def _order_cell(study: CostStudy, family: str, quantity: str) -> str:
    if not any(quantity in row.errors for row in study.families()[family]):
        return "–"
    parts = study.order(family, quantity).values()
    return " / ".join("–" if value is None else f"{value:.1f}" for value in parts)


# ---------------------------------------------------------------------------------------------
# Figure


def draw_study(study: CostStudy, path: Path, *, title: str = "") -> None:
    """Draw error over CPU time for every quantity: best settings of each method, reference error.

    ``title`` says which scene where its name does not say all.
    """
    figure, panels = subplots(2, 3, size=(15, 9.2), sharex=True)
    axes = list(panels.ravel())
    for panel, quantity in zip(axes, QUANTITIES, strict=False):
        _draw_panel(panel, study, quantity)
    known: dict[str, Any] = {}
    for panel in axes[:-1]:
        handles, words = panel.get_legend_handles_labels()
        known |= dict(zip(words, handles, strict=True))
    axes[-1].set_axis_off()
    axes[-1].legend(known.values(), known.keys(), loc="upper left", frameon=False, fontsize=9)
    for panel in axes[2:5]:
        panel.set_xlabel("CPU time, scene to answer [s]")
        panel.tick_params(which="both", labelbottom=True)
    for panel in (axes[0], axes[3]):
        panel.set_ylabel("relative error [%]")
    left_out = "\n".join(f"left out: {method}: {why}" for method, why in study.plan.left_out)
    figure.text(0.02, 0.01, left_out, fontsize=8, va="bottom")
    figure.suptitle(
        f"{title or study.name}; static and explicit FEM, cost versus accuracy, best settings\n"
        f"numbers at the points: mesh; ×1 has {study.plan.base.words} elements per block",
        x=0.02,
        ha="left",
    )
    save_figure(figure, path, about=", ".join((*study.measured, _software())))


def _software() -> str:
    """Versions of what the answers come from, beside this program's own."""
    result = Provenance().as_json()
    libraries = [f"{name} {version}" for name, version in result["libraries"].items()]
    return ", ".join([f"Python {result['python']}", *libraries])


def _draw_panel(axes: Axes, study: CostStudy, quantity: str) -> None:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axes.set_xscale("log")
    axes.set_yscale("log")
    unsure = study.reference_errors[quantity]
    errors = [row.errors[quantity] for row in study.rows if quantity in row.errors]
    bottom = max(0.4 * min(unsure, *errors), 1e-6)
    axes.axhspan(
        bottom, unsure, color=ORANGE, alpha=0.18, lw=0, label="within the reference's own error"
    )
    for method, (label, colour) in _CURVES.items():
        best = [row for row in study.front(quantity, method) if quantity in row.errors]
        points = [(row.cost, max(row.errors[quantity], bottom)) for row in best]
        if best:
            style: dict[str, Any] = {"color": colour, "label": label, "lw": 1.2, "markersize": 5}
            axes.plot(*zip(*points, strict=True), "o-", **style)
            _name_ends(axes, best, points, colour, above=method == "explicit")
    axes.set_ylim(bottom, 1.6 * max(errors))
    axes.margins(x=0.08)
    axes.set_title(title_of(quantity).words, fontsize=11, loc="left")
    axes.grid(which="major", alpha=0.3)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:g}"))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    # A quick study spans one decade or two, which one label in each would leave bare.
    lowest, highest = axes.get_xlim()
    seconds = twos_and_fives(lambda value: f"{value:g}")
    axes.xaxis.set_minor_formatter(seconds if highest < 1e3 * lowest else NullFormatter())
    axes.yaxis.set_minor_formatter(twos_and_fives(lambda value: f"{100 * value:g}"))


def _name_ends(
    axes: Axes, best: list[CostRow], points: list[tuple[float, float]], colour: str, *, above: bool
) -> None:
    """Write the meshes of the cheapest and the most accurate setting beside their points."""
    options: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8, "color": colour}
    names = [
        row.setting.mesh_words.removeprefix("mesh ").replace(" of degree ", ", ") for row in best
    ]
    axes.annotate(names[0], points[0], (4, 5), **options)
    end: dict[str, Any] = {"va": "bottom" if above else "top", "ha": "right"}
    axes.annotate(names[-1], points[-1], (-5, 4 if above else -3), **options, **end)
