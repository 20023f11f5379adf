"""All of the paper's statements: looked up, judged, as data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from validation.paper.claims.deformable import FEM_CLAIMS
from validation.paper.claims.rigid import RIGID_CLAIMS
from validation.paper.evidence import PaperEvidence
from validation.paper.verdict import NOT_COMPUTED, ClaimVerdict
from validation.statement import Statement, chosen_by_name


def claims() -> list[Statement]:
    """Return all claims, in the order of the paper."""
    return [*RIGID_CLAIMS, *FEM_CLAIMS]


def judge_claims(evidence: PaperEvidence, names: list[str] | None = None) -> list[dict[str, Any]]:
    """Judge all claims, or some by name (`chosen_by_name`): claim, verdict, number and values."""
    rows = []
    for claim in chosen_by_name(claims(), names, "claim"):
        verdict = _verdict(claim, evidence)
        judged = {"verdict": str(verdict.truth), "number": verdict.number}
        rows.append({**claim.as_json(), **judged, "values": verdict.values})
    return rows


def _verdict(claim: Statement, evidence: PaperEvidence) -> ClaimVerdict:
    """Judge one claim; where it holds for one turn of the layers alone, say so."""
    if claim.deformable and not evidence.deformable:
        return NOT_COMPUTED
    verdict: ClaimVerdict = claim.judge(evidence)
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
