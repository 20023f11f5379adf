"""Figures of the parameter study with deformable blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from validation.output.pictures.gallery import save_figure, subplots
from validation.output.pictures.scales import OF_LINES
from validation.paper.deformable_study import JUDGED, Compared, rank_correlations
from validation.paper.shown.figures import draw_parameter_study


def draw_deformable_study(compared: Compared) -> Iterator[tuple[str, Callable[[Path], object]]]:
    """Names of the figures and what draws them."""
    for shift, name in ((0.0, "sine"), (0.5, "cosine")):
        if shift in compared.axes[0]:
            tables = compared.table("p_max_fem"), compared.table("p_max")
            draw = partial(draw_parameter_study, tables[0], shift, dashed=tables[1])
            yield f"deformable-study-{name}.png", draw
    yield "deformable-study-ranks.png", partial(draw_ranks, compared)


def draw_ranks(compared: Compared, path: Path) -> None:
    """Draw deformable against rigid p_max, and the averaged tension against both."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure, axes = subplots(1, 3, size=(13, 4.4))
    panels = (
        ("p_max", "p_max_fem"),
        ("p_max", "sigma_1_averaged_fem"),
        ("p_max_fem", "sigma_1_averaged_fem"),
    )
    ranks = {row["measure"]: row for row in rank_correlations(compared)}
    frequencies = [key[1] for key in compared.rows]
    for panel, (x, y) in zip(axes, panels, strict=True):
        titles = JUDGED[x][0], JUDGED[y][0]
        for colour, mark, f in zip(OF_LINES, "os^Dv", compared.axes[1], strict=False):
            places = [k for k, frequency in enumerate(frequencies) if frequency == f]
            bars = [
                list(compared.rows.values())[k][f"{y.removesuffix('_fem')}_error_fem"]
                for k in places
            ]
            panel.errorbar(
                compared.values(x)[places],
                compared.values(y)[places],
                yerr=bars,
                fmt=mark,
                markersize=3.5,
                elinewidth=0.8,
                color=colour,
                label=f"f = {f:g}",
            )
        if y == "p_max_fem":
            ends = compared.values(x).min(), compared.values(x).max()
            panel.plot(ends, ends, color="#999999", linewidth=0.8, label="equal")
        panel.set_xscale("log")
        panel.set_yscale("log")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            axis.set_minor_formatter(NullFormatter())
        panel.set_xlabel(f"{titles[0]} [MPa]")
        panel.set_ylabel(f"{titles[1]} [MPa]")
        panel.set_title(f"rank correlation {ranks[titles[0]][titles[1]]:.2f}", loc="left")
        panel.grid(alpha=0.3)
    axes[0].legend(frameon=False)
    figure.suptitle(f"{len(compared.rows)} designs under internal pressure", x=0.02, ha="left")
    save_figure(figure, path)
