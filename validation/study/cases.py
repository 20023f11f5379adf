"""Studies of cases: each answered by `validation.solve`, its answer kept as a row."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from validation.case import Case
from validation.study.study import Study, case_content


@dataclass(frozen=True)
class CaseStudy(Study):
    """Cases in the order of the values of one parameter."""

    cases: tuple[Case, ...] = field(kw_only=True)

    def content(self, number: int) -> Any:
        """Return what a case states."""
        return case_content(self.cases[number])

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Return the answer without its fields."""
        from validation.solving import repeatable, solve

        case = replace(self.cases[number])  # what is built for it goes with it
        return {"answer": repeatable(solve(case)).as_dict()}, []
