"""What stands beside an answer: the set of answers with friction, the scale of pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fem.solution import Solution
from geometry.answer import Measure


@dataclass(frozen=True)
class FrictionSet:
    """Where an answer with friction lies among those that the laws admit."""

    member: str
    """How the load was applied."""
    change: dict[str, float]
    """Of each measure when half as many load steps are taken, in its unit; empty where only one
    number of them was solved."""
    width: dict[str, float]
    """Of each measure after the way past the load and back, relative to that straight up, less
    one [-]; empty where that way has no end."""
    remark: str
    """Why there is no width, or where it was found."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "member": self.member,
            "change_by_load_steps": self.change,
            "past_and_back": self.width,
            "remark": self.remark,
        }


@dataclass(frozen=True)
class StaticReference:
    """The converged static state of the problem of an explicit run, or why there is none."""

    measures: Mapping[str, Measure] = field(default_factory=dict)
    """Its numbers with their error bars."""
    refinement: Mapping[str, Any] = field(default_factory=dict)
    """Meshes that were solved for it, as plain data."""
    cpu_seconds: Mapping[str, float] = field(default_factory=dict)
    """CPU time of each stage [s]."""
    why_not: str = ""
    """Why there is none; empty where there is one."""

    def errors(self, measures: Mapping[str, Measure]) -> dict[str, float]:
        """Discretisation error of each measure of a run, in its unit: its value less this one's.

        Values that no mesh resolves have none.
        """
        known = {n: m.value for n, m in self.measures.items() if m.resolved and not m.remark}
        return {name: m.value - known[name] for name, m in measures.items() if name in known}

    def bars(self, measures: Mapping[str, Measure]) -> dict[str, float]:
        """Error bars of a run: its discretisation errors, and the error bars of this state."""
        result = self.errors(measures).items()
        return {name: abs(error) + (self.measures[name].error or 0.0) for name, error in result}

    def as_json(self, measures: Mapping[str, Measure]) -> dict[str, Any]:
        """Return plain data, beside the measures of a run."""
        if self.why_not:
            return {"why_not": self.why_not}
        return {
            "measures": {name: m.as_json() for name, m in self.measures.items()},
            "discretisation_error": self.errors(measures),
            "cpu_seconds": dict(self.cpu_seconds),
            **self.refinement,
        }


def drawing_scale(solution: Solution) -> float:
    """Power of ten that makes displacements visible in a picture; at least one."""
    largest = solution.largest_displacement
    size = solution.deformable.assembly.characteristic_length
    if largest == 0.0:
        return 1.0
    return float(max(10.0 ** np.floor(np.log10(0.15 * size / largest)), 1.0))
