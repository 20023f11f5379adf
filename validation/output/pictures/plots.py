"""Plots of a run: force against displacement of supports that move, energies over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fem.answer.forces import push_curves_of
from geometry.parts.rows import number
from validation.output.pictures.gallery import subplots, wrapped
from validation.output.pictures.scales import BLUE, GREEN, GREY, ORANGE, SKY, VERMILION

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


def draw_energies(answer: Answer) -> Figure:
    """Plot the energies of a run over time, and the error of their balance."""
    history = answer.details.run.history
    time = 1e3 * history.column("time")
    dissipation = sum(
        history.column(name)
        for name in (
            "mass_damping_dissipation",
            "stiffness_damping_dissipation",
            "bulk_viscosity_dissipation",
        )
    )
    curves = [
        ("external work", history.column("external_work"), "black", "-"),
        ("strain", history.column("strain_energy"), BLUE, "-"),
        ("kinetic", history.column("kinetic_energy"), VERMILION, "-"),
        ("contact", history.column("contact_energy"), SKY, "-"),
        ("viscous dissipation", dissipation, GREEN, "--"),
        ("frictional dissipation", history.column("frictional_dissipation"), ORANGE, "--"),
        ("hourglass (part of strain)", history.column("hourglass_energy"), GREY, ":"),
    ]
    size = (8.0, 6.5)
    figure, (upper, lower) = subplots(2, 1, size=size, sharex=True, height_ratios=[3, 1])
    for label, values, colour, style in curves:
        if np.any(values != 0.0):
            upper.plot(time, values, color=colour, linestyle=style, label=label)
    upper.set_ylabel("energy [N mm]")
    upper.set_title(wrapped(f"{answer.title}: energies", size[0]), loc="left", fontsize="medium")
    upper.legend(frameon=False, ncols=2)
    upper.grid(alpha=0.3)
    lower.plot(time, history.column("energy_balance"), color="black")
    lower.set_ylabel("balance error [–]")
    lower.set_xlabel("time [ms]")
    lower.grid(alpha=0.3)
    return figure
