"""`tubelock clearance`: what the initial gap between the blocks does, the paper's great unknown.

A gap is a clearance along every normal, or comes about by moving the blocks apart: two answers.
The paper spaced its blocks by a small gap "for stabilization" and does not print it. Each gap is a
static solution of the same scene; the factor by which the paper scales its displacement pictures
hints at which gap it used.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from rich.console import Console

from fem.static.linear_step.condensed import FlexibilityStore
from validation.build.deformable import fem_section
from validation.errors import InputError
from validation.output.console import tabled
from validation.output.pictures.gallery import save_figure, subplots
from validation.output.pictures.scales import BLUE, ORANGE, VERMILION
from validation.run.solve import run_static
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

#: How a gap comes about: ``contact.clearance`` or ``contact.spacing``.
Kind = Literal["clearance", "spacing"]
GAPS = (0.0, 0.003, 0.01, 0.03, 0.1)


@dataclass(frozen=True)
class ClearanceRow:
    """The static state with one initial gap."""

    kind: Kind
    gap: float
    """[mm]"""
    max_displacement: float
    """[mm]"""
    p_eff: float
    """[MPa]"""
    p_max: float
    """Mean of the block maxima [MPa]."""
    effective_count_percent: float
    """[%]"""
    max_principal_stress: float
    """Largest σ₁ [MPa]."""
    newton_iterations: int
    cpu_seconds: float


def clearance_rows(
    name: str, scene: DeformableScene, gaps: tuple[float, ...], kind: Kind = "clearance"
) -> list[ClearanceRow]:
    """Solve the scene with every initial gap.

    Raises
    ------
    InputError
        For gaps that are none, or a scene that cannot be solved.
    """
    if not gaps or not all(np.isfinite(gaps)) or min(gaps) < 0:
        raise InputError(f"--gap: got {list(gaps)}, expected one or more lengths in mm, 0 or up")
    fem_section(scene, name)
    store, rows = FlexibilityStore(), []
    for gap in gaps:
        spaced = scene.changed({f"contact.{kind}": gap, "fem.method": Method.STATIC})
        run = run_static(f"{name}, {kind} {gap:g} mm", spaced, store=store)
        blocks = run.solution.deformable.deformable_blocks.tolist()
        rows.append(
            ClearanceRow(
                kind=kind,
                gap=gap,
                max_displacement=run.solution.largest_displacement,
                p_eff=run.solution.contact.p_eff,
                p_max=run.solution.contact.p_max,
                effective_count_percent=run.solution.contact.effective_count_percent,
                max_principal_stress=max(
                    float(run.solution.principal(b)[:, 0].max()) for b in blocks
                ),
                newton_iterations=0
                if run.solution.static is None
                else run.solution.static.newton_iterations,
                cpu_seconds=run.cpu_seconds["total"],
            )
        )
    return rows


def print_rows(name: str, rows: list[ClearanceRow], console: Console) -> None:
    """Print the study."""
    columns: dict[str, Callable[[ClearanceRow], str]] = {
        f"{rows[0].kind} [mm]": lambda row: f"{row.gap:g}",
        "|u| max [mm]": lambda row: f"{row.max_displacement:.4g}",
        "p_eff [MPa]": lambda row: f"{row.p_eff:.3g}",
        "p_max [MPa]": lambda row: f"{row.p_max:.3g}",
        "effective elements": lambda row: f"{row.effective_count_percent:.1f} %",
        "σ₁ max [MPa]": lambda row: f"{row.max_principal_stress:.3g}",
        "iterations": lambda row: f"{row.newton_iterations}",
        "CPU s": lambda row: f"{row.cpu_seconds:.1f}",
    }
    title = f"{name}: static state over the {rows[0].kind}"
    console.print(tabled(title, rows, columns, words=0))


def draw_clearance(name: str, rows: list[ClearanceRow], path: Path) -> None:
    """Draw displacement and pressures over the clearance."""
    gap = [row.gap for row in rows]
    figure, (left, right) = subplots(1, 2, size=(10.5, 4.4))
    left.plot(gap, [row.max_displacement for row in rows], "o-", color=BLUE)
    left.set_ylabel("largest displacement [mm]")
    right.plot(
        gap, [row.p_max for row in rows], "s-", color=VERMILION, label="mean of block maxima"
    )
    right.plot(gap, [row.p_eff for row in rows], "o-", color=ORANGE, label="effective mean")
    right.set_ylabel("contact pressure [MPa]")
    right.legend(frameon=False)
    for axes in (left, right):
        axes.set_xlabel(f"{rows[0].kind} [mm]")
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    figure.suptitle(f"{name}: static state over the {rows[0].kind}", x=0.02, ha="left")
    save_figure(figure, path)
