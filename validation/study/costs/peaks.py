"""`tubelock peaks`: observed orders of curved elements, and what a cap on the contact law changes.

Two layers of TSB1 pipe. Orders: each degree on meshes with one, two and more times as many
elements along every edge, graded alike; errors against values of much finer meshes (`references`).
Where an error is no larger than the reference's own, no order is told. Cap: one mesh, the law of
the text and the same law with a maximum stiffness, which is another law above a pressure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rich.console import Console

from fem.accuracy.converge import Solved, climbed
from fem.accuracy.ladder import LADDER, Rung
from fem.problem import Problem
from validation.build.problem import scene_problem
from validation.case import load_case
from validation.output.console import listing, tabled
from validation.scene.read import DeformableScene
from validation.study.costs.references import Reference, references
from validation.study.study import UNITS

NAME = "tsb1-pipe"
SETTINGS = ("assembly.layers=2",)
#: Of the references.
KEY = "tsb1-pipe, assembly.layers = 2"
#: Elements around, across and along, and into how many each edge is cut, by degree.
COARSEST, CUTS = (12, 1, 4), {1: (1, 2, 4), 2: (1, 2, 3), 3: (1, 2)}
#: Elements in the middle over those at the upper and lower faces.
GRADING = 20.0
#: Quantities, as they are written above columns.
HEADS = {
    "max_displacement": "u",
    "p_eff": "p_eff",
    "p_max_point": "p_max point",
    "sigma_1_max": "σ₁",
    "sigma_1_averaged": "σ₁ averaged",
}
#: Maximum stiffness of the comparison [MPa/mm]: what earlier versions set in silence.
CAP = 1000.0


def order(elements: Sequence[Sequence[int]], errors: Sequence[float], known_to: float) -> Any:
    """Slope of the error over the size of the elements between the two finest meshes.

    Meshes are elements around, across and along. None where an error lies within what the
    reference is known to, changes its sign or grows.
    """
    coarse, fine = errors[-2:]
    if not abs(coarse) > abs(fine) > known_to or coarse * fine <= 0.0:
        return None
    return float(np.log(coarse / fine) / np.log(elements[-1][0] / elements[-2][0]))


def tube(*settings: str) -> Problem:
    """Two layers of TSB1 pipe."""
    scene = load_case(NAME, (*SETTINGS, *settings)).scene
    assert isinstance(scene, DeformableScene)
    return scene_problem(scene, NAME)


def judges() -> dict[str, Reference]:
    """What errors are measured against."""
    known = references()[KEY]
    return {quantity: known[quantity] for quantity in HEADS}


def refined(degree: int) -> dict[str, Any]:
    """Solve the meshes of one degree, from coarse to fine: relative errors with their sign."""
    around, radial, axial = COARSEST
    elements = [(cut * around, cut * radial, cut * axial) for cut in CUTS[degree]]
    solved = list(climbed(tube(), (Rung(degree, *counts, 1.0, GRADING) for counts in elements)))
    errors = {q: [r.error(s.measures[q].value) for s in solved] for q, r in judges().items()}
    return {
        "degree": degree,
        "elements": elements,
        "unknowns": [s.numbers.beside["unknowns"] for s in solved],
        "cpu_seconds": [s.numbers.beside["cpu_seconds"] for s in solved],
        "errors": errors,
        "order": {q: order(elements, errors[q], r.known_to) for q, r in judges().items()},
    }


def cap_comparison(rungs: tuple[Rung, ...] = LADDER[2:4]) -> dict[str, Any]:
    """Solve with both laws on the last of some meshes, and say where the cap acts."""

    def finest(*settings: str) -> Solved:
        *_, last = climbed(tube(*settings), rungs)
        return last

    without, capped = finest(), finest(f"contact.maximum_stiffness={CAP}")
    action = capped.solution.cap
    assert action is not None
    return {
        "maximum_stiffness": action.maximum_stiffness,
        "acts_above": action.pressure,
        "force_share": action.force_share,
        "without": {q: m.value for q, m in without.measures.items()},
        "capped": {q: m.value for q, m in capped.measures.items()},
    }


def peaks() -> dict[str, Any]:
    """All degrees, and the cap."""
    return {"scene": KEY, "orders": list(map(refined, CUTS)), "cap": cap_comparison()}


def error_words(error: float, known_to: float) -> str:
    """A relative error in per cent; within what the reference is known to, that."""
    if abs(error) <= known_to:
        return f"≤ {100 * known_to:.1g} %"
    return f"{100 * error:+.2g} %"


def print_peaks(found: dict[str, Any], console: Console) -> None:
    """Print both tables."""
    judged = judges()
    heads = ("degree", "elements", "unknowns", "CPU s", *HEADS.values())
    table = listing(f"{KEY}: relative errors and observed orders", numbers=heads)
    for row in found["orders"]:
        for k, counts in enumerate(row["elements"]):
            errors = (error_words(row["errors"][q][k], r.known_to) for q, r in judged.items())
            size, spent = str(row["unknowns"][k]), f"{row['cpu_seconds'][k]:.2g}"
            table.add_row(str(row["degree"]), " × ".join(map(str, counts)), size, spent, *errors)
        words = ("–" if slope is None else f"{slope:.1f}" for slope in row["order"].values())
        table.add_row("", "order", "", "", *words, end_section=True)
    known = (f"± {100 * reference.known_to:.1g} %" for reference in judged.values())
    table.add_row("", "reference", "", "", *known)
    console.print(table)
    cap = found["cap"]
    title = (
        f"a cap of {cap['maximum_stiffness']:g} MPa/mm: another law above {cap['acts_above']:.3g} "
        f"MPa, where {100 * cap['force_share']:.2g} % of the contact force is"
    )
    columns: dict[str, Callable[[str], str]] = {
        "measure": str,
        "law without a cap": lambda q: f"{cap['without'][q]:.4g} {UNITS[q]}",
        "with it": lambda q: f"{cap['capped'][q]:.4g} {UNITS[q]}",
        "change": lambda q: f"{100 * (cap['capped'][q] / cap['without'][q] - 1):+.2g} %",
    }
    console.print(tabled(title, cap["without"], columns))
