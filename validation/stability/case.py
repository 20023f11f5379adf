"""How the verdict of a robustness case follows from numbers that were computed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any

from validation.statement import Statement


class Verdict(StrEnum):
    """Outcome of a case."""

    GREEN = "green"
    """The law held."""
    REFUSED = "refused"
    """The input was rejected, as it must be, with the reason and the remedy."""
    RED = "red"
    """The law did not hold, or the program failed in another way."""


@dataclass(frozen=True)
class Check:
    """One computed number and the bounds that the law sets."""

    quantity: str
    """What it is, with unit."""
    value: float
    """As computed."""
    most: float = float("inf")
    """Upper bound, included."""
    least: float = float("-inf")
    """Lower bound, included."""

    @property
    def holds(self) -> bool:
        """Whether the value lies within the bounds; never for nan."""
        return self.least <= self.value <= self.most

    @property
    def words(self) -> str:
        """The number and its bounds."""
        parts = [f"{self.quantity} {self.value:.3g}"]
        if self.most == self.least:
            parts.append(f"= {self.most:.3g}")
        else:
            if self.most < float("inf"):
                parts.append(f"≤ {self.most:.2g}")
            if self.least > float("-inf"):
                parts.append(f"≥ {self.least:.2g}")
        text = " ".join(parts)
        return text if self.holds else f"VIOLATED: {text}"


class Finding:
    """What a case found."""

    def __init__(self, *checks: Check, refusal: str | None = None) -> None:
        self.checks = checks
        """Numbers that prove the law."""
        self.refusal = refusal
        """The message, where the honest answer is a refusal."""

    @property
    def verdict(self) -> Verdict:
        """What follows from the numbers."""
        if not all(check.holds for check in self.checks):
            return Verdict.RED
        if self.refusal is not None:
            return Verdict.REFUSED
        return Verdict.GREEN if self.checks else Verdict.RED

    @property
    def proof(self) -> str:
        """All numbers, and the message of a refusal."""
        parts = [check.words for check in self.checks]
        if self.refusal is not None:
            parts.append(f"“{self.refusal}”")
        return "; ".join(parts)


def run_case(case: Statement) -> dict[str, Any]:
    """Run one case; an exception fails the case, never the suite: verdict, proof, CPU time."""
    start = time.process_time()
    try:
        finding = case.judge()
        verdict, proof = finding.verdict, finding.proof
    except Exception as error:
        verdict, proof = Verdict.RED, f"{type(error).__name__}: {error}"
    seconds = time.process_time() - start
    return case.as_json() | {"verdict": str(verdict), "proof": proof, "cpu_seconds": seconds}


def refusal(
    call: Callable[[], object], error: type[Exception] | tuple[type[Exception], ...], *words: str
) -> Finding:
    """Expect ``call`` to refuse its input with a message that contains ``words``."""
    try:
        call()
    except error as refused:
        text = str(refused)
        missing = [word for word in words if word not in text]
        return Finding(Check("words missing from the message", len(missing), most=0), refusal=text)
    return Finding(Check("refusals", 0, least=1))


class Cases(list[Statement]):
    """Cases of one subject, collected by a decorator."""

    def __init__(self, subject: str) -> None:
        """Begin with none."""
        self.subject = subject

    def add(
        self, name: str, law: str, *, slow: bool = False
    ) -> Callable[[Callable[[], Finding]], Callable[[], Finding]]:
        """Add the decorated function as a case."""

        def register(run: Callable[[], Finding]) -> Callable[[], Finding]:
            self.append(Statement(name, {"subject": self.subject, "law": law}, run, slow=slow))
            return run

        return register

    def case(self, name: str, law: str, run: Callable[..., Finding], *given: Any) -> None:
        """Add a case that asks what others do, of other things."""
        self.add(name, law)(partial(run, *given))
