"""The paper's statements, each computed and judged true, false or not decidable, with the number.

Quantitative words that the paper leaves open ("consistently", "minor", "approximately") are
given a number here, and the number is part of the verdict.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from rich.console import Console
from rich.table import Table

from validation.paper.evidence import Evidence
from validation.paper.naming import chosen_by_name


class Truth(StrEnum):
    """What a claim turned out to be."""

    TRUE = "true"
    FALSE = "false"
    UNDECIDABLE = "not decidable"


@dataclass(frozen=True)
class Verdict:
    """What was computed for a claim."""

    truth: Truth
    number: str
    """The number that decides, in words."""
    values: dict[str, Any]
    """The same as data."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and how it is judged."""

    name: str
    """Short, for the command line."""
    statement: str
    """What the paper says."""
    place: str
    """Label of the section, table or figure."""
    judge: Callable[[Evidence], Verdict]
    """Computes and judges."""
    deformable: bool = False
    """Whether the deformable runs are needed."""


@dataclass(frozen=True)
class JudgedClaim:
    """A claim with its verdict."""

    claim: Claim
    verdict: Verdict


NEEDS_FEM = Verdict(Truth.UNDECIDABLE, "needs the deformable run: add --fem", {})


def judged(holds: bool, number: str, **values: Any) -> Verdict:
    """Return the verdict of a computed claim."""
    return Verdict(Truth.TRUE if holds else Truth.FALSE, number, values)


def claims() -> list[Claim]:
    """Return all claims, in the order of the paper."""
    from validation.paper.claims_fem import FEM_CLAIMS
    from validation.paper.claims_rigid import RIGID_CLAIMS

    return [*RIGID_CLAIMS, *FEM_CLAIMS]


def check_claims(names: list[str] | None = None) -> list[Claim]:
    """Return the claims of some names, or all, after refusing names that none has.

    Raises
    ------
    InputError
        With the known names.
    """
    return chosen_by_name(claims(), names, "claim")


def judge_claims(evidence: Evidence, names: list[str] | None = None) -> list[JudgedClaim]:
    """Judge all claims, or some by name.

    Raises
    ------
    InputError
        For a name that no claim has.
    """
    return [
        JudgedClaim(
            claim,
            NEEDS_FEM if claim.deformable and not evidence.deformable else claim.judge(evidence),
        )
        for claim in check_claims(names)
    ]


def claims_json(found: list[JudgedClaim]) -> list[dict[str, Any]]:
    """Judged claims as plain data."""
    return [
        {
            "name": item.claim.name,
            "statement": item.claim.statement,
            "place": item.claim.place,
            "verdict": str(item.verdict.truth),
            "number": item.verdict.number,
            "values": item.verdict.values,
        }
        for item in found
    ]


def print_claims(found: list[JudgedClaim], console: Console) -> None:
    """Print one row per claim and a count."""
    table = Table(title="The paper's claims", title_justify="left", show_lines=True)
    for head in ("claim", "the paper says", "verdict", "number"):
        table.add_column(head)
    for item in found:
        table.add_row(
            item.claim.name, item.claim.statement, str(item.verdict.truth), item.verdict.number
        )
    console.print(table)
    counts = [f"{sum(i.verdict.truth is t for i in found)} {t}" for t in Truth]
    console.print(f"{len(found)} claims: {', '.join(counts)}")
