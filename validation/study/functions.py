"""A study of the problems that a function makes of its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from fem.method import Static
from mbd.options import Rigid
from validation.case import Case, Method
from validation.study.design import fem_results, rigid_results
from validation.study.study import Study

if TYPE_CHECKING:
    from fem.problem import Problem


@dataclass(frozen=True)
class FunctionStudy(Study):
    """Answers to ``make(**values)`` by one method.

    A problem has no keys by which rows could be kept: the file of its rows is of one call.
    """

    make: Callable[..., Problem] = field(kw_only=True)
    method: Method = field(kw_only=True)

    def deformable(self) -> Study:
        """Return the same problems in their static state."""
        return replace(self, quantity="fem", method=Static())

    def content(self, number: int) -> Any:
        """Return the values of a design."""
        return self.design(number)

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Make a problem and answer it."""
        stated = self.make(**self.design(number))
        case = Case(name=f"{self.name}[{number}]", stated=stated, method=self.method)
        if isinstance(self.method, Rigid):
            return rigid_results(case), []
        return fem_results(case)
