"""All of the paper's statements: looked up, judged, printed and as data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from rich.console import Console

from validation.output.console import listing
from validation.paper.claims.claim import NOT_COMPUTED, Claim, Truth, Verdict
from validation.paper.claims.deformable import FEM_CLAIMS
from validation.paper.claims.rigid import RIGID_CLAIMS
from validation.paper.evidence import Evidence
from validation.paper.naming import chosen_by_name


@dataclass(frozen=True)
class JudgedClaim:
    """A claim with its verdict."""

    claim: Claim
    verdict: Verdict


def claims() -> list[Claim]:
    """Return all claims, in the order of the paper."""
    return [*RIGID_CLAIMS, *FEM_CLAIMS]


def judge_claims(evidence: Evidence, names: list[str] | None = None) -> list[JudgedClaim]:
    """Judge all claims, or some by name (`chosen_by_name`)."""
    chosen = chosen_by_name(claims(), names, "claim")
    return [JudgedClaim(claim, _verdict(claim, evidence)) for claim in chosen]


def _verdict(claim: Claim, evidence: Evidence) -> Verdict:
    """Judge one claim; where it holds for one turn of the layers alone, say so."""
    if claim.deformable and not evidence.deformable:
        return NOT_COMPUTED
    verdict = claim.judge(evidence)
    if not claim.of_turn:
        return verdict
    other = claim.judge(evidence.with_half_block())
    values = verdict.values | {"half_block": {"verdict": str(other.truth), **other.values}}
    number = verdict.number
    if other.truth is not verdict.truth:
        number += (
            f". The layers' turn decides: that is for one wave; with half a block {other.truth}: "
            f"{other.number}"
        )
    return replace(verdict, number=number, values=values)


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
    heads = ("claim", "the paper says", "verdict", "number")
    table = listing("The paper's claims", *heads, show_lines=True)
    for item in found:
        table.add_row(
            item.claim.name, item.claim.statement, str(item.verdict.truth), item.verdict.number
        )
    console.print(table)
    counts = [f"{sum(i.verdict.truth is t for i in found)} {t}" for t in Truth]
    console.print(f"{len(found)} claims: {', '.join(counts)}")
