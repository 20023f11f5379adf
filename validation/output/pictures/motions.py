"""Force over way of supports that move."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from validation.output.pictures.gallery import save_figure, subplots
from validation.output.pictures.scales import BLUE, GREEN, ORANGE, VERMILION

if TYPE_CHECKING:
    from fem.assembly.reactions import PushCurve

_COLOURS = (BLUE, VERMILION, GREEN, ORANGE)


def draw_motions(curves: tuple[PushCurve, ...], path: Path, *, title: str) -> None:
    """Plot the force of each support that moves over its way, with the largest one marked."""
    figure, (axes,) = subplots(1, 1, size=(7.0, 4.5))
    for k, curve in enumerate(curves):
        colour = _COLOURS[k % len(_COLOURS)]
        axes.plot(curve.displacements, curve.forces, "o-", ms=3, color=colour, label=curve.name)
        force, way = curve.peak
        axes.plot([way], [force], "o", ms=9, mfc="none", color=colour)
        axes.annotate(
            f"{force:.4g} N", (way, force), textcoords="offset points", xytext=(6, 6), color=colour
        )
    axes.set_xlabel("way of the support [mm]")
    axes.set_ylabel("force on the blocks [N]")
    axes.set_title(f"{title}: force over way", loc="left")
    axes.margins(0.1)
    axes.grid(alpha=0.3)
    if len(curves) > 1:
        axes.legend(frameon=False)
    save_figure(figure, path)
