"""One design of a study: the columns of its row, and its answer in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isnan
from typing import Any, Literal

from geometry.answer import FACTORS, TITLES
from mbd.options import Rigid
from validation.case import Case

Quantity = Literal["rigid", "fem"]

#: What is built, of every design.
BUILT = ("volume", "least_wall", "steepest_joint")
#: Columns of each kind of answer: text, whole or real numbers.
COLUMNS: dict[Quantity, dict[str, str]] = {
    "rigid": {
        "mechanism": "TEXT",
        "equilibrium": "INTEGER",
        "residual": "REAL",
        "effective_count_percent": "REAL",
        "effective_area_percent": "REAL",
        "p_eff": "REAL",
        "p_eff_pooled": "REAL",
        "p_max": "REAL",
        "crushing_factor": "REAL",
        **dict.fromkeys(BUILT, "REAL"),
        "n_blocks": "INTEGER",
        "n_contacts": "INTEGER",
        "iterations": "INTEGER",
    },
    "fem": {
        **{name: "REAL" for of in (*TITLES, *FACTORS) for name in (of, f"{of}_error")},
        **dict.fromkeys(BUILT, "REAL"),
        "residual": "REAL",
        "energy_balance": "REAL",
        "n_elements": "INTEGER",
    },
}
#: Numbers by which designs are ranked and drawn, the first one first: less is better.
MEASURES: dict[Quantity, tuple[str, ...]] = {
    "rigid": ("p_max", "p_eff", "effective_area_percent"),
    "fem": ("p_max_point", "sigma_1_averaged", "max_displacement", "p_eff"),
}
#: Relative error bars of deformable designs where the study states none [-]: enough to rank them.
RANKING = 0.1


@dataclass(frozen=True)
class DesignRow:
    """One design of a study and what came out."""

    number: int
    status: Literal["ok", "failed"]
    """``failed``: nothing could be computed, `message` says why. A tube that carries no load is
    ``ok``: that is an answer."""
    message: str
    """Why it failed; of an answer, error bars that are wider than requested, values that are not
    to be used, and parameters on which it does not depend."""
    parameters: dict[str, Any]
    results: dict[str, Any]
    """By the names in `COLUMNS`; empty if failed."""
    cpu_seconds: float
    """CPU time of the design [s]."""
    worker: tuple[int, float] = (0, 0.0)
    """Process that computed it and the CPU time it had used by then [s]."""

    @property
    def flat(self) -> dict[str, Any]:
        """Parameters, results and what became of it, by the columns of a study."""
        own = ("number", "status", "message", "cpu_seconds")
        return self.parameters | self.results | {name: getattr(self, name) for name in own}

    def as_json(self) -> dict[str, Any]:
        """All that holds wherever the design stands in a study; what is no number is absent."""
        names = ("parameters", "status", "message", "cpu_seconds")
        absent = {k: None for k, v in self.results.items() if isinstance(v, float) and isnan(v)}
        return {name: getattr(self, name) for name in names} | {"results": self.results | absent}


#: What ``[rigid]`` can ask and no column shows.
NO_COLUMN = ("collapse", "sliding", "ranges", "margin")


def rigid_results(case: Case) -> dict[str, Any]:
    """Results of rigid blocks by the names of `COLUMNS`, and nothing that no column has."""
    from validation.case import repeatable, solve

    method = case.method if isinstance(case.method, Rigid) else case.with_method("rigid").method
    idle: dict[str, Any] = dict.fromkeys(NO_COLUMN, False)
    answer = repeatable(solve(replace(case, method=replace(method, **idle))))
    result, friction = answer.details, answer.details.friction
    # With friction the forces and the verdict are those with it: a load that is carried if joints
    # were pressed beforehand is not in equilibrium by itself, as far as is known.
    row: dict[str, Any] = {
        "mechanism": str(result.mechanism),
        "equilibrium": int(result.of_load),
        "residual": (result if friction is None else friction).equilibrium.residual,
        "n_blocks": result.n_blocks,
        "n_contacts": result.n_contacts,
        "iterations": result.equilibrium.iterations,
        **_built(answer.report["dimensions"]),
    }
    if "crushing_factor" in answer.measures:
        row["crushing_factor"] = answer["crushing_factor"].value
    measures = result.shown_measures
    names = ("effective_count_percent", "effective_area_percent", "p_eff", "p_eff_pooled", "p_max")
    for name in names:
        row[name] = None if measures is None else getattr(measures, name)
    return row


def _built(report: Mapping[str, Any]) -> dict[str, Any]:
    """What is built, from the dimensions of an answer."""
    return {name: report.get(name) for name in BUILT}


def fem_results(case: Case) -> tuple[dict[str, Any], list[str]]:
    """Value and error bar of each measure, and what is to be known of them.

    Solved as `tubelock fem` does: on finer and finer meshes, or on its own. A value that its mesh
    does not resolve, or that grows with every refinement, is absent.
    """
    from fem.accuracy.converge import TARGETS
    from fem.accuracy.errors import AT_AN_EDGE
    from fem.accuracy.parts import Accuracy
    from fem.answer.energies import energy_balance
    from validation.case import repeatable, solve

    answer = repeatable(solve(case, otherwise=dict.fromkeys(TARGETS, RANKING)))
    measures, result = answer.measures, dict[str, Any]()
    named: dict[str, list[str]] = {}
    for name, measure in measures.items():
        if name not in COLUMNS["fem"]:
            continue
        if measure.remark not in ("", AT_AN_EDGE):  # that is said of every design by default
            named.setdefault(measure.remark, []).append(name)
        usable = measure.resolved and not measure.remark
        result[name] = measure.value if usable else None
        result[f"{name}_error"] = measure.error if usable else None
    reached, missed = answer.parts.get("accuracy"), []
    if isinstance(reached, Accuracy):
        missed = reached.request_rows(reached.not_reached)
    result |= {
        "residual": answer.details.residual,
        "energy_balance": energy_balance(answer.details),
        "n_elements": answer.details.deformable.n_elements,
        **_built(answer.report["dimensions"]),
    }
    remarks = [f"{', '.join(names)}: {remark}" for remark, names in named.items()]
    return result, [*missed, *remarks]
