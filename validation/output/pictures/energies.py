"""The energies of a run over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from validation.output.pictures.gallery import subplots, wrapped
from validation.output.pictures.scales import BLUE, GREEN, GREY, ORANGE, SKY, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from geometry.answer import Answer


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
