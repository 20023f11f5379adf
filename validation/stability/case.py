"""A robustness case: a function whose docstring is a law, and the verdict that it computes."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, TypeAlias

from validation.statement import Statement

#: A computed number and the bound that the law sets: what it is, with unit, its value, and the most
#: that it may be, or a relation and a bound: ``("steps", n, ">=", 10)``. No bound holds for nan.
Number: TypeAlias = tuple[str, float, float] | tuple[str, float, str, float]

_RELATIONS = {"<=": operator.le, ">=": operator.ge, "==": operator.eq}
_PRINTED = {"<=": "≤ {:.2g}", ">=": "≥ {:.2g}", "==": "= {:.3g}"}

#: All cases, in the order in which their modules are imported.
CASES: list[Statement] = []


@dataclass(frozen=True)
class CaseVerdict:
    """What a case found."""

    kind: Literal["green", "refused", "red"]
    """The law held; the input was rejected, as it must be, with reason and remedy; or neither."""
    proof: str
    """All numbers with their bounds, and the message of what was rejected."""


def case_verdict(*numbers: Number, message: str | None = None) -> CaseVerdict:
    """Verdict of numbers, and of the message where the honest answer is a refusal."""
    parts, holds = [], bool(numbers) or message is not None
    for quantity, value, *bound in numbers:
        relation, limit = ("<=", *bound)[-2:]
        held = _RELATIONS[relation](value, limit)
        violated = "" if held else "VIOLATED: "
        parts.append(f"{violated}{quantity} {value:.3g} {_PRINTED[relation].format(limit)}")
        holds = holds and held
    if message is not None:
        parts.append(f"“{message}”")
    proof = "; ".join(parts)
    if not holds:
        return CaseVerdict("red", proof)
    return CaseVerdict("green" if message is None else "refused", proof)


def rejected(
    call: Callable[[], object], error: type[Exception] | tuple[type[Exception], ...], *words: str
) -> CaseVerdict:
    """Expect ``call`` to reject its input with a message that contains ``words``."""
    try:
        call()
    except error as why:
        missing = [word for word in words if word not in str(why)]
        number = ("words missing from the message", float(len(missing)), 0.0)
        return case_verdict(number, message=str(why))
    return CaseVerdict("red", "VIOLATED: nothing was rejected")


def case(
    name: str = "", law: str = "", *, slow: bool = False
) -> Callable[[Callable[[], CaseVerdict]], Callable[[], CaseVerdict]]:
    """Add a function to the cases of its module.

    Parameters
    ----------
    name, law
        Those of the function and of its docstring, where they are not given.
    slow
        Whether it takes more than three CPU seconds once everything is compiled.
    """

    def register(run: Callable[[], CaseVerdict]) -> Callable[[], CaseVerdict]:
        function: Any = run.func if isinstance(run, partial) else run
        words = " ".join((law or function.__doc__).split()).removesuffix(".")
        text = {"subject": function.__module__.split(".")[2].replace("_", "-"), "law": words}
        CASES.append(Statement(name or function.__name__.replace("_", "-"), text, run, slow=slow))
        return run

    return register
