"""`tubelock peaks`: observed orders of curved elements, and what a cap on the contact law changes.

Two layers of TSB1 pipe. Orders: each degree on meshes with one, two and more times as many
elements along every edge, graded alike; errors against values of much finer meshes
(`validation.costs.references`). Where an error is no larger than the reference's own, no order is
told. Cap: one mesh, the law of the text and the same law with a maximum stiffness, which is another
law above a pressure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from fem.accuracy.converge import Solved, climbed
from fem.accuracy.ladder import LADDER, Rung
from fem.assembly.contact_state import CapAction
from fem.assembly.statement import Problem
from geometry.answer import Measure
from validation.build.deformable import scene_problem
from validation.costs.references import Reference, references
from validation.output.console import listing
from validation.scene.read import DeformableScene, load_scene

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


@dataclass(frozen=True)
class Refined:
    """One degree along a refinement."""

    degree: int
    elements: tuple[tuple[int, int, int], ...]
    """Around, across and along, from coarse to fine."""
    unknowns: tuple[int, ...]
    cpu_seconds: tuple[float, ...]
    errors: dict[str, tuple[float, ...]]
    """Relative, with their sign, by quantity [-]."""

    def order(self, quantity: str, known_to: float) -> float | None:
        """Slope of the error over the size of the elements between the two finest meshes.

        None where an error lies within what the reference is known to, changes its sign or grows.
        """
        coarse, fine = self.errors[quantity][-2:]
        if not abs(coarse) > abs(fine) > known_to or coarse * fine <= 0.0:
            return None
        ratio = self.elements[-1][0] / self.elements[-2][0]
        return float(np.log(coarse / fine) / np.log(ratio))


def tube(*settings: str) -> Problem:
    """Two layers of TSB1 pipe."""
    scene = load_scene(NAME, (*SETTINGS, *settings)).scene
    assert isinstance(scene, DeformableScene)
    return scene_problem(scene, NAME)


def judges() -> dict[str, Reference]:
    """What errors are measured against."""
    known = references()[KEY]
    return {quantity: known[quantity] for quantity in HEADS}


def refined(degree: int, judged: dict[str, Reference]) -> Refined:
    """Solve the meshes of one degree."""
    around, radial, axial = COARSEST
    elements = tuple((cut * around, cut * radial, cut * axial) for cut in CUTS[degree])
    solved = list(climbed(tube(), (Rung(degree, *counts, 1.0, GRADING) for counts in elements)))
    return Refined(
        degree,
        elements,
        tuple(s.unknowns for s in solved),
        tuple(s.seconds for s in solved),
        {
            quantity: tuple(reference.error(s.measures[quantity].value) for s in solved)
            for quantity, reference in judged.items()
        },
    )


@dataclass(frozen=True)
class CapComparison:
    """The same tube with and without a cap on its contact law."""

    without: Mapping[str, Measure]
    capped: Mapping[str, Measure]
    action: CapAction
    """Where the cap acted."""

    def change(self, quantity: str) -> float:
        """What the cap changes, over the value without it [-]."""
        return self.capped[quantity].value / self.without[quantity].value - 1.0


def cap_comparison(rungs: tuple[Rung, ...] = LADDER.rungs[2:4]) -> CapComparison:
    """Solve with both laws on the last of some meshes."""

    def finest(*settings: str) -> Solved:
        *_, last = climbed(tube(*settings), rungs)
        return last

    without, capped = finest(), finest(f"contact.maximum_stiffness={CAP}")
    action = capped.solution.cap
    assert action is not None
    return CapComparison(without.measures, capped.measures, action)


def peaks() -> tuple[list[Refined], CapComparison]:
    """All degrees, and the cap."""
    judged = judges()
    return [refined(degree, judged) for degree in CUTS], cap_comparison()


def peaks_json(orders: list[Refined], cap: CapComparison) -> dict[str, Any]:
    """Return plain data."""
    judged = judges()
    return {
        "scene": KEY,
        "orders": [
            {
                "degree": row.degree,
                "elements": row.elements,
                "unknowns": row.unknowns,
                "cpu_seconds": row.cpu_seconds,
                "errors": row.errors,
                "order": {q: row.order(q, r.known_to) for q, r in judged.items()},
            }
            for row in orders
        ],
        "cap": {
            "maximum_stiffness": cap.action.maximum_stiffness,
            "acts_above": cap.action.pressure,
            "force_share": cap.action.force_share,
            "without": {q: m.value for q, m in cap.without.items()},
            "capped": {q: m.value for q, m in cap.capped.items()},
        },
    }


def error_words(error: float, known_to: float) -> str:
    """A relative error in per cent; within what the reference is known to, that."""
    if abs(error) <= known_to:
        return f"≤ {100 * known_to:.1g} %"
    return f"{100 * error:+.2g} %"


def print_peaks(orders: list[Refined], cap: CapComparison, console: Console) -> None:
    """Print both tables."""
    judged = judges()
    heads = ("degree", "elements", "unknowns", "CPU s", *HEADS.values())
    table = listing(f"{KEY}: relative errors and observed orders", numbers=heads)
    for row in orders:
        for k, (a, r, z) in enumerate(row.elements):
            errors = (error_words(row.errors[q][k], r.known_to) for q, r in judged.items())
            size, spent = str(row.unknowns[k]), f"{row.cpu_seconds[k]:.2g}"
            table.add_row(str(row.degree), f"{a} × {r} × {z}", size, spent, *errors)
        found = (row.order(q, reference.known_to) for q, reference in judged.items())
        words = ("–" if order is None else f"{order:.1f}" for order in found)
        table.add_row("", "order", "", "", *words, end_section=True)
    known = (f"± {100 * reference.known_to:.1g} %" for reference in judged.values())
    table.add_row("", "reference", "", "", *known)
    console.print(table)
    action = cap.action
    title = (
        f"a cap of {action.maximum_stiffness:g} MPa/mm: another law above {action.pressure:.3g} "
        f"MPa, where {100 * action.force_share:.2g} % of the contact force is"
    )
    second = listing(title, "measure", numbers=("law without a cap", "with it", "change"))
    for quantity, measure in cap.without.items():
        values = (f"{m.value:.4g} {m.unit}" for m in (measure, cap.capped[quantity]))
        second.add_row(quantity, *values, f"{100 * cap.change(quantity):+.2g} %")
    console.print(second)
