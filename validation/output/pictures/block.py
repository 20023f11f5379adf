"""One Sine Block with its measures h, a, f, s, n, r_i and t where they are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geometry.assembly import Assembly
from geometry.families.sine_block import SineBlock
from geometry.mesh import FloatArray
from validation.output.pictures.bodies import (
    colours_of_blocks,
    outlines,
    surfaces,
    turned,
    turns,
)
from validation.output.pictures.canvas import View
from validation.output.pictures.gallery import Panel, gallery
from validation.output.pictures.scales import GREY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: From the outer face, a little from above.
_EYE = (0.75, -0.35, 0.4)
_POINTS = 241
#: The blue of blocks, pale enough to write on.
_PALE = "#A6CBE3"


def draw_block(assembly: Assembly, block: SineBlock, path: Path, *, title: str) -> None:
    """Draw the first free block of a tube of such: in space, from above, and its faces unrolled."""
    first = int(np.flatnonzero(~assembly.fixed)[0])
    colours = colours_of_blocks(assembly.fixed, turns(assembly))
    middle = np.arctan2(*assembly.centroids[first, 1::-1])
    body = surfaces(assembly, [first], colours.__getitem__)
    view = View([body, outlines(assembly, [first])], turned(_EYE, float(middle)))
    gallery(
        [
            [Panel("the block", view)],
            [
                Panel("from above", plot=lambda axes: _plan(axes, block), shape=1.5, bare=True),
                Panel(
                    "outer face unrolled; dashed: inner face",
                    plot=lambda axes: _elevation(axes, block),
                    shape=1.5,
                    bare=True,
                ),
            ],
        ],
        title,
        path,
        height=7.5,
    )


# ---------------------------------------------------------------------------------------------
# Drawings


def _plan(axes: Axes, block: SineBlock) -> None:
    """Annulus of one layer seen along the axis; the block filled."""
    inner, outer = block.inner_radius, block.outer_radius
    ring_angle = np.linspace(-0.35, np.pi + 0.35, _POINTS)
    for radius in (inner, outer):
        axes.plot(*(radius * _unit(ring_angle)).T, color=GREY, lw=0.6, ls=":")
    start = 0.5 * (np.pi - block.block_angle)
    own = start + np.linspace(0.0, block.block_angle, _POINTS)
    ring = np.concatenate([inner * _unit(own), outer * _unit(own[::-1])])
    axes.fill(*ring.T, facecolor=_PALE, edgecolor="black", lw=1.0)
    _dimension(axes, np.zeros(2), inner * _unit(own[:1])[0], f"rᵢ = {block.inner_radius:g} mm")
    end = own[-1:]
    side = 0.06 * outer * _unit(end + np.pi / 2)[0]
    _dimension(
        axes,
        inner * _unit(end)[0] + side,
        outer * _unit(end)[0] + side,
        f"t = {block.thickness:g} mm",
        away=side,
    )
    axes.plot(*(0.35 * inner * _unit(own)).T, color=VERMILION, lw=0.9)
    for angle in (own[:1], end):
        axes.plot(*np.stack([np.zeros(2), inner * _unit(angle)[0]]).T, color=GREY, lw=0.6)
    words = f"2π/n, n = {block.blocks_per_layer}"
    axes.text(0.0, -0.1 * outer, words, ha="center", va="top", color=VERMILION, fontsize="medium")
    _frame(axes, (-1.5 * outer, 1.5 * outer), (-0.35 * outer, 1.15 * outer))


def _elevation(axes: Axes, block: SineBlock) -> None:
    """Outline of the outer and inner face over the place u across the block."""
    u = np.linspace(0.0, 1.0, _POINTS)
    width = block.outer_radius * block.block_angle
    wave = block.amplitude * np.sin(2 * np.pi * block.waves_per_block * u + np.pi * block.shift)
    x, h = width * u, block.height
    low = np.stack([x, wave], axis=1)
    outline = np.concatenate([low, low[::-1] + np.array([0.0, h])])
    axes.fill(*outline.T, facecolor=_PALE, edgecolor="black", lw=1.0)
    for level in (0.0, h):
        axes.plot([0.0, width], [level, level], color=GREY, lw=0.9, ls="--")
    gap = 0.07 * width
    right = np.array([width + gap, 0.0])
    _dimension(axes, right, right + np.array([0.0, h]), f"h = {h:g} mm", away=np.array([gap, 0.0]))
    peak = int(np.argmax(wave))
    if block.amplitude > 0:
        top = np.array([x[peak], h])
        crest = np.array([x[peak], h + block.amplitude])
        _dimension(axes, top, crest, f"a = {block.amplitude:g} mm", above=True)
    below = -block.amplitude - 0.08 * h
    half = np.array([0.5 * width, below])
    words = f"half a block: f = {block.frequency:g} wave{'s' if block.frequency != 1 else ''}"
    _dimension(axes, np.array([0.0, below]), half, words, below=True)
    axes.plot(x[0], wave[0], "o", color=VERMILION, ms=5)
    axes.annotate(
        f"phase πs, s = {block.shift:g}",
        (x[0], wave[0]),
        xytext=(-0.05 * width, 0.35 * h),
        color=VERMILION,
        fontsize="medium",
        ha="right",
        arrowprops={"arrowstyle": "-", "color": VERMILION, "lw": 0.8},
    )
    reach = block.amplitude + 0.28 * h
    _frame(axes, (-0.35 * width, 1.35 * width), (-reach, h + reach))


def _unit(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _frame(axes: Axes, across: tuple[float, float], up: tuple[float, float]) -> None:
    axes.set_aspect("equal")
    # Limits stay those of the data: a panel of another shape widens them without a warning.
    axes.update_datalim(list(zip(across, up, strict=True)))
    axes.margins(0.0)
    axes.axis("off")


def _dimension(
    axes: Axes,
    start: FloatArray,
    end: FloatArray,
    words: str,
    *,
    away: FloatArray | None = None,
    above: bool = False,
    below: bool = False,
) -> None:
    """Dimension line with arrows at both ends; words to that side of its middle."""
    axes.annotate(
        "",
        xy=tuple(end),
        xytext=tuple(start),
        arrowprops={"arrowstyle": "<->", "color": VERMILION, "lw": 1.0, "shrinkA": 0, "shrinkB": 0},
    )
    middle = 0.5 * (start + end) + (0.35 * away if away is not None else 0.0)
    across, up = "left", "center"
    if above:
        middle, across, up = end, "center", "bottom"
    if below:
        middle, across, up = (
            middle - np.array([0.0, 0.08 * np.abs(end - start).max()]),
            "center",
            "top",
        )
    if away is not None and away[0] < 0:
        across = "right"
    axes.text(
        middle[0], middle[1], f"  {words}  ", color=VERMILION, fontsize="medium", ha=across, va=up
    )
