"""Answers of several solvers to one problem beside each other, measure by measure and per facet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from geometry.answer import TITLES, Answer, Array
from geometry.mesh import IntArray
from validation.comparison.answers import PressureAgreement, agreement
from validation.errors import InputError


@dataclass(frozen=True, repr=False)
class AnswerComparison:
    """Answers to one problem; the repr is its table and its conclusion."""

    answers: tuple[Answer, ...]
    """In the order in which they were given."""
    reference: int
    """Which of them the others are compared with: the static one, else the last."""
    agreements: dict[str, tuple[PressureAgreement, ...]]
    """Of the pressures of each other answer with those of the reference, on the facets that both
    have: on all, and above and below the middle layer."""

    @property
    def names(self) -> tuple[str, ...]:
        """Method of each answer, numbered where two have the same."""
        methods = [answer.method for answer in self.answers]
        return tuple(
            m if methods.count(m) == 1 else f"{m} {methods[: k + 1].count(m)}"
            for k, m in enumerate(methods)
        )

    @property
    def rows(self) -> dict[str, dict[str, float | None]]:
        """Value of each measure in each answer; None where an answer does not have it."""
        known = [name for name in TITLES if any(name in a.measures for a in self.answers)]
        return {
            name: {
                method: answer[name].value if name in answer.measures else None
                for method, answer in zip(self.names, self.answers, strict=True)
            }
            for name in known
        }

    @property
    def conclusion(self) -> str:
        """How alike the pressures are, a line for each other answer."""
        lines = []
        for name, found in self.agreements.items():
            whole = found[0]
            lines.append(
                f"{name} against {self.names[self.reference]}: correlation of the pressures "
                f"{whole.correlation:.3f}, effective areas overlap {100 * whole.overlap:.0f} %, "
                f"peaks located {100 * whole.peaks_found:.0f} %, contact force "
                f"{100 * (whole.force_ratio - 1):+.1f} %"
            )
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        agreements = {n: [asdict(a) for a in found] for n, found in self.agreements.items()}
        return {"measures": self.rows, "agreement": agreements}

    def __repr__(self) -> str:
        """Return table and conclusion as text."""
        width = max(len(name) for name in (*self.rows, ""))
        lines = [" " * width + "".join(f"  {name:>12}" for name in self.names)]
        for name, values in self.rows.items():
            shown = ("-" if v is None else f"{v:.5g}" for v in values.values())
            lines.append(f"{name:{width}}" + "".join(f"  {text:>12}" for text in shown))
        return "\n".join([*lines, self.conclusion])


def compare_answers(answers: Sequence[Answer]) -> AnswerComparison:
    """Compare answers to one problem on the contact facets that they share.

    Raises
    ------
    InputError
        Fewer than two answers, or answers whose contact facets are others.
    """
    if len(answers) < 2:
        raise InputError(f"compare: got {len(answers)} answers; expected two or more")
    methods = [answer.method for answer in answers]
    reference = methods.index("static") if "static" in methods else len(answers) - 1
    found = AnswerComparison(tuple(answers), reference, {})
    for k, name in enumerate(found.names):
        if k != reference:
            found.agreements[name] = _agreements(answers[reference], answers[k])
    return found


def _agreements(reference: Answer, other: Answer) -> tuple[PressureAgreement, ...]:
    ours, theirs = _shared(reference, other)
    first = {name: values[ours] for name, values in reference.contacts.items()}
    pressures = other.contacts["pressure"][theirs]
    layers = first["layer"]
    middle = (int(layers.max()) - 1) // 2 + 1  # of the free layers between two frames
    sets = {"all": np.arange(len(ours))}
    if layers.max() > 1:
        sets["top"] = np.flatnonzero((layers == [middle, middle + 1]).all(axis=1))
        sets["bottom"] = np.flatnonzero((layers == [middle - 1, middle]).all(axis=1))
    owner = np.where(layers[:, 0] == middle, first["blocks"][:, 0], first["blocks"][:, 1])
    return tuple(
        agreement(
            faces,
            first["pressure"][rows],
            pressures[rows],
            centroids=first["centroid"][rows],
            areas=first["area"][rows],
            block=first["blocks"][rows, 0] if faces == "all" else owner[rows],
        )
        for faces, rows in sets.items()
        if len(rows)
    )


def _shared(reference: Answer, other: Answer) -> tuple[IntArray, IntArray]:
    """Positions of the facets that both answers have, by their blocks and centroids."""
    keys = []
    for answer in (reference, other):
        if not {"blocks", "centroid", "layer"} <= set(answer.contacts):
            raise InputError(f"compare: {answer.title}: has no contact facets to compare")
        keys.append(_keys(answer.contacts["blocks"], answer.contacts["centroid"]))
    places = {key: k for k, key in enumerate(keys[1])}
    pairs = [(k, places[key]) for k, key in enumerate(keys[0]) if key in places]
    if not pairs:
        raise InputError(
            f"compare: {reference.title} and {other.title} share no contact facet; expected "
            "answers to one problem on one mesh"
        )
    both = np.array(pairs, dtype=np.int64)
    return both[:, 0], both[:, 1]


def _keys(blocks: Array, centroids: Array) -> list[tuple[int, ...]]:
    """What names a facet: its blocks, and its centroid to a thousandth of a millimetre."""
    rounded = np.rint(1e3 * centroids).astype(np.int64)
    return [tuple(row) for row in np.column_stack([blocks, rounded]).tolist()]
