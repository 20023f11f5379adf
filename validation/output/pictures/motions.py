"""Force against displacement of supports that move."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fem.answer.forces import push_curves_of
from geometry.parts.rows import number
from validation.output.pictures.gallery import subplots, wrapped
from validation.output.pictures.scales import BLUE, GREEN, ORANGE, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from geometry.answer import Answer

#: Forces from here on are drawn in kN [N].
_KILO = 1e4
_COLOURS = (BLUE, VERMILION, GREEN, ORANGE)


def draw_motions(answer: Answer) -> Figure:
    """Plot force against displacement of each support that moves, the largest force marked."""
    curves = push_curves_of(answer.details)
    figure, axes = subplots(1, 1, size=(7.0, 4.5))
    most = max(abs(curve.forces).max() for curve in curves)
    unit, name = (1e-3, "kN") if most >= _KILO else (1.0, "N")
    for k, curve in enumerate(curves):
        colour = _COLOURS[k % len(_COLOURS)]
        axes.plot(
            curve.displacements, unit * curve.forces, "o-", ms=3, color=colour, label=curve.name
        )
        force, way = curve.peak
        axes.plot([way], [unit * force], "o", ms=9, mfc="none", color=colour)
        axes.annotate(
            f"{number(unit * force)} {name}",
            (way, unit * force),
            textcoords="offset points",
            xytext=(-8, 4),
            ha="right",
            color=colour,
        )
    axes.set_xlabel("displacement of the support [mm]")
    axes.set_ylabel(f"force on the blocks [{name}]")
    words = wrapped(f"{answer.title}: force against displacement", 7.0)
    axes.set_title(words, loc="left", fontsize="medium")
    axes.margins(0.1)
    axes.grid(alpha=0.3)
    if len(curves) > 1:
        axes.legend(frameon=False)
    return figure
