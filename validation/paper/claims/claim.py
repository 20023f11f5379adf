"""A statement of the paper, and what judging it gives: true, false or neither, with the number.

Quantitative words that the paper leaves open ("consistently", "minor", "approximately") are
given a number by those who judge, and the number is part of the verdict.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeAlias

from validation.paper.evidence import Evidence
from validation.paper.reference import statements


class Truth(StrEnum):
    """What a claim turned out to be."""

    TRUE = "true"
    FALSE = "false"
    UNDECIDABLE = "not decidable"
    """What the paper says leaves open what decides."""
    NOT_COMPUTED = "not computed here"
    """What decides was not run by this call."""


@dataclass(frozen=True)
class Verdict:
    """What was computed for a claim."""

    truth: Truth
    number: str
    """The number that decides, in words."""
    values: dict[str, Any]
    """The same as data."""


Judge: TypeAlias = Callable[[Evidence], Verdict]


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and how it is judged."""

    name: str
    """Short, for the command line."""
    statement: str
    """What the paper says."""
    place: str
    """Label of the section, table or figure."""
    judge: Judge
    """Computes and judges."""
    deformable: bool = False
    """Whether the deformable runs are needed."""
    of_turn: bool = False
    """Whether the layers' turn may decide: judged with the half-block turn too."""


class Claims(list[Claim]):
    """Claims in the order in which their judges stand."""

    def add(self, judge: Judge, name: str = "") -> Judge:
        """List the claim of ``statements.toml`` that a function judges, which names it."""
        name = name or judge.__name__.strip("_").replace("_", "-")
        self.append(Claim(name, judge=judge, **statements()["claim"][name]))
        return judge


NOT_COMPUTED = Verdict(Truth.NOT_COMPUTED, "needs the deformable run: add --fem", {})


def judged(holds: bool, number: str, **values: Any) -> Verdict:
    """Return the verdict of a computed claim."""
    return Verdict(Truth.TRUE if holds else Truth.FALSE, number, values)
