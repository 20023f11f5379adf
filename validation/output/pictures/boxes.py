"""Pictures of single boxes, and the energies of any run over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fem.explicit.output.history import History
from geometry.mesh import FloatArray, IntArray
from validation.output.pictures.bodies import block_edges
from validation.output.pictures.canvas import Direction, Lines, Part, Surface, View
from validation.output.pictures.gallery import (
    BLUE,
    GREEN,
    GREY,
    MOTION_MAP,
    ORANGE,
    SKY,
    STRESS_MAP,
    VERMILION,
    Panel,
    Scale,
    gallery,
    save_figure,
    scale_from_zero,
    subplots,
)
from validation.run.words import load_words

if TYPE_CHECKING:
    from validation.run.box import BoxRun

_EYE: Direction = (1.4, -2.2, 1.1)


def draw_energies(history: History, path: Path, *, title: str) -> None:
    """Plot the energies of a run over time, and the error of their balance."""
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
    figure, (upper, lower) = subplots(2, 1, size=(8, 6.5), sharex=True, height_ratios=[3, 1])
    for label, values, colour, style in curves:
        if np.any(values != 0.0):
            upper.plot(time, values, color=colour, linestyle=style, label=label)
    upper.set_ylabel("energy [N mm]")
    upper.set_title(f"{title}: energies", loc="left")
    upper.legend(frameon=False, ncols=2)
    upper.grid(alpha=0.3)
    lower.plot(time, history.column("energy_balance"), color="black")
    lower.set_ylabel("balance error [–]")
    lower.set_xlabel("time [ms]")
    lower.grid(alpha=0.3)
    save_figure(figure, path)


def draw_box(run: BoxRun, path: Path) -> None:
    """Draw the deformed boxes coloured by displacement, σ₁ and σ₃, and the undeformed outline."""
    group = run.box.model.groups[0]
    finite = run.scene.effects.finite_rotation
    positions, moved = group.reference_positions(), run.displacements
    magnitude = np.linalg.norm(moved, axis=2)
    extent = float(np.ptp(positions.reshape(-1, 3), axis=0).max())
    largest = float(magnitude.max())
    # A displacement that a reader could not see is drawn larger, by a round factor.
    factor = 1.0 if finite or largest == 0.0 else 10.0 ** np.floor(np.log10(0.2 * extent / largest))
    factor = max(factor, 1.0)
    principal = run.recovered.principal
    stress = max(float(np.abs(principal).max()), 1e-300)
    reached = (float(principal.min()), float(principal.max()))
    columns = []
    for label, values, scale in (
        ("|u| [mm]", magnitude, scale_from_zero("|u| [mm]", MOTION_MAP, [magnitude])),
        (
            "σ₁ (largest principal stress) [MPa]",
            principal[..., 0],
            Scale("σ₁ [MPa]", STRESS_MAP, -stress, stress, reached),
        ),
        (
            "σ₃ (smallest principal stress) [MPa]",
            principal[..., 2],
            Scale("σ₃ [MPa]", STRESS_MAP, -stress, stress, reached),
        ),
    ):
        parts = _parts(run, positions + factor * moved, positions, values, scale)
        columns.append(Panel(label, View(parts, _EYE), scale=scale))
    moment = "" if run.explicit is None else f", t = {1e3 * run.explicit.time:.4g} ms"
    title = f"{run.name}: {load_words(run.scene)}{moment}: displacements drawn × {factor:g}"
    gallery([columns], title, path, height=9.5)


def _parts(
    run: BoxRun, moved: FloatArray, start: FloatArray, values: FloatArray, scale: Scale
) -> list[Part]:
    """Deformed surfaces with their elements, and the edges of the undeformed boxes."""
    quads = np.concatenate(list(run.box.block.faces.values()))
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)
    mesh = np.unique(np.sort(ends, axis=1), axis=0)
    edges = block_edges(run.box.block)
    copies, nodes = start.shape[:2]

    def every(cells: IntArray) -> IntArray:
        return np.concatenate([cells + nodes * copy for copy in range(copies)])

    shown, held = moved.reshape(-1, 3), start.reshape(-1, 3)
    return [
        Surface(shown, every(quads), scale.of(values.ravel()), lit=False),
        Lines(shown, every(mesh), opacity=0.25, width=1.4),
        Lines(held, every(edges), "#606060", width=2.4),
    ]
