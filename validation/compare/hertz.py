"""Hertz and Cattaneo–Mindlin by deformable blocks: ``python -m validation.compare.hertz``.

Meshes of the two bodies differ by a quarter, so that no facet faces one of its own; contact is the
search of static runs with a linear law. Each problem is solved on three meshes and, on the middle
one, with half the stiffness of the law: what the law itself changes. Closed forms and measures:
`validation.compare.hertz_problems`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from fem.contact.friction import CoulombFriction
from validation.compare.hertz_problems import (
    Bodies,
    Pressed,
    Slipped,
    balls,
    effective_modulus,
    pressed_balls,
    pressed_roller,
    pressed_together,
    pushed_aside,
    roller,
    slipped_roller,
)
from validation.errors import run_command
from validation.output.console import listing, measuring
from validation.output.files import write_json


@dataclass(frozen=True)
class Row:
    """One mesh of one problem beside its closed form."""

    cells: float
    """Elements over the radius of the contact."""
    nodes: int
    found: Pressed | Slipped
    cpu_seconds: float

    def as_json(self) -> dict[str, Any]:
        """Numbers, the field but for its error left out."""
        numbers = {k: v for k, v in vars(self.found).items() if isinstance(v, float)}
        return vars(self) | {"found": numbers | {"field_error": self.found.field_error}}


#: Stiffness of the law times the edge over E*: it grows as meshes do, so that what the law gives
#: way (a share of h / 3a of the approach) and what chords that cross press by fall with the edge.
_LAW = 3.0
#: Elements over the meant contact radius: the edge of the contact lies on edges of both meshes.
_CELLS = 25.0 / 6.0
BALL_MESHES = (_CELLS, 1.5 * _CELLS, 2.0 * _CELLS)
ROLLER_MESHES = (_CELLS, 2.0 * _CELLS, 4.0 * _CELLS)
#: Contact radius of the rollers [mm], way of its centre [mm] with block and roller of two
#: materials and of one, and way aside [mm].
_ROLLER, _APART, _APART_ALIKE, _ASIDE = 2.0, 0.205, 0.198, 0.045
_STEEL, _ALUMINIUM = 210e3, 70e3
_FRICTION = 0.2


def law_stiffness(young: tuple[float, float], cell: float, share: float = 1.0) -> float:
    """Stiffness of the contact law on a mesh [MPa/mm]."""
    return share * _LAW * effective_modulus(young) / cell


def ball_case(cells: float, approach: float, share: float = 1.0) -> tuple[Bodies, Pressed]:
    """Two equal balls, R = 50 mm, E = 20 000 MPa; ``share`` of the law's stiffness."""
    young, cell = 20e3, math.sqrt(25.0 * approach) / cells
    law = law_stiffness((young, young), cell, share)
    bodies = balls(cell, approach=approach, young=young, stiffness=law)
    return bodies, pressed_balls(bodies, pressed_together(bodies))


def roller_case(cells: float, share: float = 1.0) -> tuple[Bodies, Pressed]:
    """A roller of steel on a block of aluminium."""
    young, cell = (_ALUMINIUM, _STEEL), _ROLLER / cells
    law = law_stiffness(young, cell, share)
    bodies = roller(cell, contact=_ROLLER, apart=_APART, young=young, stiffness=law)
    return bodies, pressed_roller(bodies, pressed_together(bodies))


def slip_case(cells: float, share: float = 1.0) -> tuple[Bodies, Slipped]:
    """A roller of steel on a block of steel, pressed, then pushed aside with friction."""
    young, cell = (_STEEL, _STEEL), _ROLLER / cells
    law = law_stiffness(young, cell, share)
    bodies = roller(cell, contact=_ROLLER, apart=_APART_ALIKE, young=young, stiffness=law)
    friction = CoulombFriction(_FRICTION, law)
    normal = pressed_together(bodies)
    state = pushed_aside(bodies, normal, _ASIDE, friction)
    return bodies, slipped_roller(bodies, normal, state, friction)


Case = Callable[..., tuple[Bodies, Pressed] | tuple[Bodies, Slipped]]


def rows(case: Case, meshes: tuple[float, ...], *arguments: float) -> list[Row]:
    """A problem on several meshes."""
    found = []
    for cells in meshes:
        start = time.process_time()
        bodies, answer = case(cells, *arguments)
        seconds = time.process_time() - start
        found.append(Row(cells, bodies.deformable.model.n_nodes, answer, seconds))
    return found


def observed_order(table: list[Row]) -> float:
    """Slope of the error of the field over the edge, both logarithmic."""
    cells = np.log([row.cells for row in table])
    errors = np.log([row.found.field_error for row in table])
    return -float(np.polyfit(cells, errors, 1)[0])


def at_approach(found: Pressed, approach: float) -> str:
    """What Hertz has at the approach itself, half-spaces held at infinity, and what was found."""
    a = math.sqrt(25.0 * approach)
    modulus = effective_modulus((20e3, 20e3))
    force, p0 = 4.0 / 3.0 * modulus * a * approach, 2.0 * modulus * a / (math.pi * 25.0)
    pairs = {
        "F": (found.force, force, "N"),
        "p0": (found.found_p0, p0, "MPa"),
        "a": (found.found_a, a, "mm"),
    }
    words = [f"{k} {v:.6g} {u} ({100 * (f / v - 1):+.1f} %)" for k, (f, v, u) in pairs.items()]
    return f"at the approach of {approach:g} mm Hertz has " + ", ".join(words)


def _print(console: Console, title: str, table: list[Row], law: Pressed | Slipped) -> None:
    heads = ("a / h", "nodes", "force", "a", "p0", "Q/μP", "c", "rms of field", "CPU s")
    sheet = listing(title, numbers=heads)
    for row in table:
        sheet.add_row(
            f"{row.cells:.2f}", str(row.nodes), *_words(row.found), f"{row.cpu_seconds:.0f}"
        )
    sheet.add_row("law / 2", "", *_words(law), "")
    console.print(sheet)
    console.print(f"observed order of the field: {observed_order(table):.2f}\n")


def _words(found: Pressed | Slipped) -> list[str]:
    """Cells of force, a, p0, Q/μP, c and the error of the field."""
    field = f"{100.0 * found.field_error:.1f} %"
    if isinstance(found, Slipped):
        c = f"{found.c:.3f} {100.0 * (found.found_c / found.c - 1.0):+.2f} %"
        return ["", f"{found.a:.3f}", "", f"{found.ratio:.3f}", c, field]
    a = f"{found.a:.3f} {100.0 * (found.found_a / found.a - 1.0):+.2f} %"
    p0 = f"{found.peak:.1f} {100.0 * (found.found_p0 / found.peak - 1.0):+.2f} %"
    return [f"{found.force:.0f}", a, p0, "", "", field]


def draw(path: Path, problems: dict[str, list[Row]]) -> None:
    """Pressures and tractions of every mesh beside the closed forms."""
    import matplotlib.pyplot as plt

    from validation.output.pictures.gallery import save_figure

    figure, axes = plt.subplots(1, len(problems), figsize=(4.4 * len(problems), 3.6))
    for axis, (title, table) in zip(np.atleast_1d(axes), problems.items(), strict=True):
        share = np.linspace(0.0, 1.0, 400)
        for row in table:
            found = row.found
            where, value = found.radius / found.a, found.values / found.peak
            axis.plot(where, value, ".", ms=3, label=f"a/h = {row.cells:.1f}")
        axis.plot(share, found.closed(share), "k-", lw=1, label="closed form")
        axis.set(title=title, xlabel="r / a", xlim=(0.0, 1.3), ylabel=found.label)
        axis.legend(frameon=False, fontsize=8)
    figure.tight_layout(rect=(0.0, 0.03, 1.0, 1.0))
    save_figure(figure, path)
    plt.close(figure)


def main() -> None:
    """Print every problem on its meshes beside the closed form."""
    asked, console = measuring(__doc__, 130, picture="picture of fields")
    cases: list[tuple[str, Case, tuple[float, ...], tuple[float, ...]]] = [
        ("two balls R 50 mm, E 20 GPa, approach 4 mm", ball_case, BALL_MESHES, (4.0,)),
        ("two balls, approach 0.16 mm", ball_case, BALL_MESHES, (0.16,)),
        ("roller R 50 mm of 210 GPa on 70 GPa", roller_case, ROLLER_MESHES, ()),
        ("Cattaneo–Mindlin: roller on its like, μ = 0.2", slip_case, ROLLER_MESHES, ()),
    ]
    problems = {}
    for title, case, meshes, arguments in cases:
        problems[title] = rows(case, meshes, *arguments)
        _, softer = case(meshes[1], *arguments, 0.5)
        _print(console, title, problems[title], softer)
        last = problems[title][-1].found
        if arguments and isinstance(last, Pressed):
            console.print(f"{at_approach(last, arguments[0])}\n")
    numbers = {title: [row.as_json() for row in table] for title, table in problems.items()}
    write_json(asked.json, numbers)
    if asked.output is not None:
        draw(asked.output, problems)
        console.print(f"picture   {asked.output}")


if __name__ == "__main__":
    run_command(main)
