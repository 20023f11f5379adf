"""The reading of the paper that gives its tables: ingredients, each of which can be left out.

The text leaves open, or says otherwise than the numbers show, on which mesh, with which mean, with
which wave and with which loads the tables were made. What follows was found by trying; leaving out
an ingredient shows how many of the printed numbers then still come out to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeAlias

import numpy as np

from geometry import Answer, LoadCase, PressureLoad, TractionLoad
from mbd import analyse
from validation import load_case, solve
from validation.paper.reference import reference

#: Quantities of a table's row, and the decimals that are printed.
DECIMALS = {"effective": 1, "p_eff": 3, "p_max": 3}
#: Elements of a block on which the tables were made: 84 round, 24 through the wall, 20 high; 40 on
#: each edge of the hexagon.
MESH_OF_TABLES = {
    "TSB": ("mesh.around=84", "mesh.radial=24", "mesh.axial=20"),
    "THB": ("mesh.edge=40", "mesh.radial=24"),
}
#: Those of the built-in scenes, a third of the elements through the wall.
_SCENE_MESH = {"TSB": ("mesh.radial=8",), "THB": ("mesh.edge=28", "mesh.radial=8")}

#: Numbers that differ by less, relatively, are the same one.
_ROUND_OFF = 1e-6

Values = dict[str, float | None]
"""Effective elements [%], p_eff and p_max [MPa] of one row; None without equilibrium."""


class Solve(Protocol):
    """Computes a built-in scene with overrides, by rigid blocks."""

    def __call__(self, scene: str, *settings: str) -> Answer:
        """Scene and ``section.key=value`` overrides, the later ones winning."""


def table_settings(block: str) -> tuple[str, ...]:
    """Overrides that make a scene the one of the tables: mesh and loads."""
    return (*MESH_OF_TABLES[block[:3]], "load.as_printed=true")


class SharedTubes:
    """Tubes built so far, by the sections of their scenes that state blocks."""

    def __init__(self) -> None:
        """Begin without a tube."""
        self._built: dict[str, Any] = {}

    def solve(self, scene: str, *settings: str) -> Answer:
        """Answer a scene by rigid blocks, which scenes with the same keys of blocks share."""
        case = load_case(scene, settings, method="rigid")
        sections = repr([case.keys.get(name) for name in ("block", "assembly", "mesh")])
        built = self._built.get(sections)
        answer = solve(case if built is None else case.on(built))
        self._built.setdefault(sections, answer.details.blocks)
        return answer


def solve_row(solve: Solve, block: str, case: str, *settings: str) -> Answer:
    """Rigid-block result of a row of the tables, with changes."""
    return solve(f"{block.lower()}-{case}", *table_settings(block), *settings)


def as_read(measures: Any | None) -> Values:
    """Return the numbers of a row as the tables take them: elements counted, p_eff pooled."""
    if measures is None:
        return dict.fromkeys(DECIMALS)
    return {
        "effective": measures.participation_percent,
        "p_eff": measures.p_eff_pooled,
        "p_max": measures.p_max,
    }


def to_the_digit(quantity: str, printed: float, value: float | None) -> bool:
    """Whether a value rounds to what is printed."""
    decimals = DECIMALS[quantity]
    return value is not None and f"{value:.{decimals}f}" == f"{printed:.{decimals}f}"


#: Numbers of a row (block, case) without an ingredient; None: the row does not depend on it.
Without: TypeAlias = Callable[[Solve, str, str], Values | None]


def _measured_by(quantity: str, measure: str) -> Without:
    """Rows in which a quantity is another of the measures."""

    def without(solve: Solve, block: str, case: str) -> Values | None:
        measures = solve_row(solve, block, case).details.measures
        if measures is None:
            return None
        return as_read(measures) | {quantity: getattr(measures, measure)}

    return without


def _with_setting(setting: str, only: str) -> Without:
    """Rows of one block or load case with a setting changed."""

    def without(solve: Solve, block: str, case: str) -> Values | None:
        if only not in (block, case):
            return None
        return as_read(solve_row(solve, block, case, setting).details.measures)

    return without


def _other_mesh(solve: Solve, block: str, case: str) -> Values | None:
    return as_read(solve_row(solve, block, case, *_SCENE_MESH[block[:3]]).details.measures)


def _one_direction(load: LoadCase) -> LoadCase:
    """Load of one constant direction, inward through the middle of the loaded face."""
    inward = -load.area_vectors.sum(axis=0)
    inward /= np.linalg.norm(inward)
    acts = tuple(
        TractionLoad(face.blocks, face.face, face.pressure * inward)
        for face in load.faces
        if isinstance(face, PressureLoad)
    )
    return replace(load, faces=acts)


def _with_load(change: Callable[[Answer], LoadCase], only: str) -> Without:
    """Rows of one load case with another load on the same blocks."""

    def without(solve: Solve, block: str, case: str) -> Values | None:
        if case != only:
            return None
        run = solve_row(solve, block, case)
        changed = analyse(run.details.blocks, run.case.method, load=change(run))
        return as_read(changed.details.measures)

    return without


def _at_mass_centroid(run: Answer) -> LoadCase:
    forces = np.zeros((run.details.blocks.n_blocks, 6))
    np.add.at(forces[:, :3], run.details.load.block, run.details.load.facet_forces)
    return replace(run.details.load, faces=(), body_wrenches=forces)


#: What becomes of a row without an ingredient of the reading, by the name of its erratum.
INGREDIENTS: Mapping[str, Without] = {
    "pooled-p-eff": _measured_by("p_eff", "p_eff"),
    "counted-elements": _measured_by("effective", "effective_area_percent"),
    "not-rounded-down": _measured_by("effective", "effective_count_percent"),
    "mesh-of-the-tables": _other_mesh,
    "tsb2-wave": _with_setting("block.shift=0.5", "TSB2"),
    "beam-pressure": _with_load(lambda run: _one_direction(run.details.load), "beam"),
    "shaft-force": _with_setting("load.as_printed=false", "shaft"),
    "shaft-point": _with_load(_at_mass_centroid, "shaft"),
}


@dataclass(frozen=True)
class ReadingVariant:
    """The tables without one ingredient of the reading."""

    ingredient: str
    """Its name; ``all of them`` for the reading as it is."""
    to_the_digit: int
    """Numbers that round to what is printed."""
    of: int
    """Numbers."""
    values: dict[str, float | None]
    """Ours by ``block case quantity``; None without equilibrium."""
    differences: dict[str, float]
    """(ours - printed) / printed, the error vector; not a number without equilibrium."""

    @property
    def count(self) -> str:
        """How many numbers round to what is printed, of how many."""
        return f"{self.to_the_digit} of {self.of}"

    @property
    def without(self) -> str:
        """What is left out, in words."""
        return f"without {self.ingredient}"

    def moved(self, whole: ReadingVariant) -> dict[str, float]:
        """Return the errors of the numbers that are not those of another reading."""
        return {
            place: error
            for place, error in self.differences.items()
            if not abs(error - whole.differences[place]) <= _ROUND_OFF
        }


def reading_variants(solve: Solve, chosen: Iterable[str] = INGREDIENTS) -> list[ReadingVariant]:
    """Leave out one ingredient after the other, by default of all; first, the reading as it is."""
    rows = [
        (block, case, {q: row[q] for q in DECIMALS})
        for block, cases in reference()["table"].items()
        for case, row in cases.items()
        if "p_max" in row
    ]
    whole = [as_read(solve_row(solve, block, case).details.measures) for block, case, _ in rows]
    entries = [_entry("all of them", rows, whole)]
    for name in chosen:
        changed = [INGREDIENTS[name](solve, block, case) for block, case, _ in rows]
        values = [c if c is not None else w for c, w in zip(changed, whole, strict=True)]
        entries.append(_entry(name, rows, values))
    return entries


def _entry(
    name: str, rows: list[tuple[str, str, dict[str, float]]], values: list[Values]
) -> ReadingVariant:
    values_by_place, differences, met = {}, {}, 0
    for (block, case, printed), ours in zip(rows, values, strict=True):
        for quantity, number in printed.items():
            value = ours[quantity]
            met += to_the_digit(quantity, number, value)
            place = f"{block} {case} {quantity}"
            values_by_place[place] = value
            differences[place] = float("nan") if value is None else value / number - 1
    return ReadingVariant(name, met, len(values_by_place), values_by_place, differences)
