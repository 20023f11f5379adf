"""`tubelock clearance`: what the initial gap between the blocks does, the paper's great unknown.

A gap is a clearance along every normal, or comes about by moving the blocks apart: two answers.
The paper spaced its blocks by a small gap "for stabilization" and does not print it. Each gap is a
static solution of the same scene; the factor by which the paper scales its displacement pictures
hints at which gap it used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Console

from fem.static.linear_step.flexibility import FlexibilityStore
from validation.build.problem import fem_section
from validation.case import scene_case
from validation.errors import InputError
from validation.output.console import tabled
from validation.output.pictures.gallery import save_figure, subplots
from validation.output.pictures.scales import BLUE, ORANGE, VERMILION
from validation.run.deformable import deformable_answer, on_its_mesh
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

#: How a gap comes about: ``contact.clearance`` or ``contact.spacing``.
Kind = Literal["clearance", "spacing"]
GAPS = (0.0, 0.003, 0.01, 0.03, 0.1)


def clearance_rows(
    name: str, scene: DeformableScene, gaps: tuple[float, ...], kind: Kind = "clearance"
) -> list[dict[str, Any]]:
    """Solve the scene with every initial gap: lengths in mm, pressures and stresses in MPa."""
    if not gaps or not all(np.isfinite(gaps)) or min(gaps) < 0:
        raise InputError(f"--gap: got {list(gaps)}, expected one or more lengths in mm, 0 or up")
    fem_section(scene, name)
    store, rows = FlexibilityStore(), []
    for gap in gaps:
        spaced = scene.changed({f"contact.{kind}": gap, "fem.method": Method.STATIC})
        case = on_its_mesh(scene_case(spaced, f"{name}, {kind} {gap:g} mm"))
        answer = deformable_answer(case, store=store)
        solution, measured = answer.details, vars(answer.details.contact)
        blocks = solution.deformable.deformable_blocks.tolist()
        row = {
            "kind": kind,
            "gap": gap,
            "max_displacement": solution.largest_displacement,
            **{n: measured[n] for n in ("p_eff", "p_max", "effective_count_percent")},
            "max_principal_stress": max(float(solution.principal(b)[:, 0].max()) for b in blocks),
            "newton_iterations": getattr(solution.static, "newton_iterations", 0),
            "cpu_seconds": answer.report["cpu_seconds"]["total"],
        }
        rows.append(row)
    return rows


def print_rows(name: str, rows: list[dict[str, Any]], console: Console) -> None:
    """Print the study."""
    columns: dict[str, str] = {
        f"{rows[0]['kind']} [mm]": "{gap:g}",
        "|u| max [mm]": "{max_displacement:.4g}",
        "p_eff [MPa]": "{p_eff:.3g}",
        "p_max [MPa]": "{p_max:.3g}",
        "effective elements": "{effective_count_percent:.1f} %",
        "σ₁ max [MPa]": "{max_principal_stress:.3g}",
        "iterations": "{newton_iterations}",
        "CPU s": "{cpu_seconds:.1f}",
    }
    title = f"{name}: static state over the {rows[0]['kind']}"
    console.print(tabled(title, rows, columns, words=0))


def draw_clearance(name: str, rows: list[dict[str, Any]], path: Path) -> None:
    """Draw displacement and pressures over the clearance."""
    kind = rows[0]["kind"]
    figure, (left, right) = subplots(1, 2, size=(10.5, 4.4))
    for axes, key, style, colour, label in (
        (left, "max_displacement", "o-", BLUE, None),
        (right, "p_max", "s-", VERMILION, "mean of the blocks' maxima"),
        (right, "p_eff", "o-", ORANGE, "effective mean"),
    ):
        gaps, values = [row["gap"] for row in rows], [row[key] for row in rows]
        axes.plot(gaps, values, style, color=colour, label=label)
    left.set_ylabel("largest displacement [mm]")
    right.set_ylabel("contact pressure [MPa]")
    right.legend(frameon=False)
    for axes in (left, right):
        axes.set_xlabel(f"{kind} [mm]")
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    figure.suptitle(f"{name}: static state over the {kind}", x=0.02, ha="left")
    save_figure(figure, path)
