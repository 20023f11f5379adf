"""What judging a statement of the paper gives: true, false or neither, with the number.

Quantitative words that the paper leaves open ("consistently", "minor", "approximately") are
given a number by those who judge, and the number is part of the verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeAlias

from validation.paper.evidence import PaperEvidence
from validation.paper.reference import statements
from validation.statement import Statement


class Truth(StrEnum):
    """What a claim turned out to be."""

    TRUE = "true"
    FALSE = "false"
    UNDECIDABLE = "not decidable"
    """What the paper says leaves open what decides."""
    NOT_COMPUTED = "not computed here"
    """What decides was not run by this call."""


@dataclass(frozen=True)
class ClaimVerdict:
    """What was computed for a claim."""

    truth: Truth
    number: str
    """The number that decides, in words."""
    values: dict[str, Any]
    """The same as data."""


Judge: TypeAlias = Callable[[PaperEvidence], ClaimVerdict]


class Statements(list[Statement]):
    """Statements in the order in which their judges stand."""

    def __init__(self, kind: str) -> None:
        """Start a list of the section ``claim`` or ``erratum`` of ``statements.toml``."""
        self._stated = statements()[kind]

    def add(self, judge: Judge, name: str = "") -> Judge:
        """List the statement that a function judges, which names it: ``_one_wave``, one-wave."""
        name = name or judge.__name__.strip("_").replace("_", "-")
        text = dict(self._stated[name])
        flags = {key: text.pop(key) for key in ("deformable", "of_turn") if key in text}
        self.append(Statement(name, text, judge, **flags))
        return judge


NOT_COMPUTED = ClaimVerdict(Truth.NOT_COMPUTED, "needs the deformable run: add --fem", {})


def listed(values: Mapping[str, float], form: str = "{:.2f}", between: str = ", ") -> str:
    """Say values by name: 0.12 (TSB1), 0.34 (TSB2)."""
    return between.join(f"{form.format(value)} ({name})" for name, value in values.items())


def claim_verdict(holds: bool, number: str, **values: Any) -> ClaimVerdict:
    """Return the verdict of a computed claim."""
    return ClaimVerdict(Truth.TRUE if holds else Truth.FALSE, number, values)
