"""Studies: numbered designs, each a case that `validation.solve` answers, its answer a row.

First the columns of rows, and an answer in them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from fem.method import Static
from geometry.answer import EVERY_TITLE, FACTORS, TITLES, title_of
from mbd.options import Rigid
from validation.case import Case, Method, repeatable, solve

if TYPE_CHECKING:
    from fem.problem import Problem

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
        absent = (k for k, v in self.results.items() if isinstance(v, float) and math.isnan(v))
        results = self.results | dict.fromkeys(absent)
        return {name: getattr(self, name) for name in names} | {"results": results}


#: What ``[rigid]`` can ask and no column shows.
NO_COLUMN = ("collapse", "sliding", "ranges", "margin")


def rigid_results(case: Case) -> dict[str, Any]:
    """Results of rigid blocks by the names of `COLUMNS`, and nothing that no column has."""
    method = case.method if isinstance(case.method, Rigid) else case.with_method("rigid").method
    idle: dict[str, Any] = dict.fromkeys(NO_COLUMN, False)
    answer = repeatable(solve(replace(case, method=replace(method, **idle))))
    result = answer.details
    # With friction the forces and the verdict are those with it: a load that is carried if joints
    # were pressed beforehand is not in equilibrium by itself, as far as is known.
    row: dict[str, Any] = {
        "mechanism": str(result.mechanism),
        "equilibrium": int(result.of_load),
        "residual": result.deciding.residual,
        "n_blocks": result.n_blocks,
        "n_contacts": result.n_contacts,
        "iterations": result.equilibrium.iterations,
        **_built(answer.report["dimensions"]),
    }
    if "crushing_factor" in answer.measures:
        row["crushing_factor"] = answer["crushing_factor"].value
    measures = result.measures
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
    from fem.accuracy.errors import AT_AN_EDGE, Accuracy
    from fem.answer.forces import energy_balance

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
        "n_elements": answer.details.whole.n_elements,
        **_built(answer.report["dimensions"]),
    }
    remarks = [f"{', '.join(names)}: {remark}" for remark, names in named.items()]
    return result, [*missed, *remarks]


Value = Any
"""A value of a scene: number, string, boolean or a list of them."""


@dataclass(frozen=True)
class Study:
    """Numbered designs, of each a row: what is asked, and how it is answered.

    The base of all studies. `validation.study.run` computes rows and keeps them; tables, pictures,
    searches, derivatives and costs read them. A kind of study states `case`, and `content` or
    `results` where they are others than those of its cases.
    """

    name: str
    """Name of the built-in study, stem of the file, or name of the scene."""
    quantity: Quantity
    """``rigid`` or ``fem``."""
    parameters: tuple[tuple[str, tuple[Value, ...]], ...]
    """Names and values; designs are all combinations, the last one varies fastest."""

    def case(self, number: int) -> Case:
        """Case of a design."""
        raise NotImplementedError

    def content(self, number: int) -> Any:
        """What a design asks, as plain data: designs of equal content have one row."""
        return case_content(self.case(number))

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Answer a design: its results by name, and remarks.

        Raises
        ------
        RefusedError
            A design that cannot be answered.
        """
        case = self.case(number)
        return (rigid_results(case), []) if self.quantity == "rigid" else fem_results(case)

    def question(self, number: int) -> str:
        """Digest of what a design asks, whatever its number is."""
        return data_digest([self.digest, self.content(number)])

    @cached_property
    def digest(self) -> str:
        """Digest of what its designs share."""
        return data_digest([type(self).__name__, self.quantity])

    @property
    def title(self) -> str:
        """Name and method."""
        return f"{self.name}, {'rigid' if self.quantity == 'rigid' else 'deformable'} blocks"

    @property
    def columns(self) -> dict[str, str]:
        """Results that every row has, be they None, and the kind of each: see `COLUMNS`."""
        return COLUMNS[self.quantity]

    @property
    def n_designs(self) -> int:
        """Number of designs: the product of the numbers of values."""
        return math.prod(len(values) for _, values in self.parameters)

    def design(self, number: int) -> dict[str, Value]:
        """Parameter values of a design, counted from 0; the last parameter varies fastest."""
        chosen: dict[str, Value] = {}
        for path, values in reversed(self.parameters):
            number, place = divmod(number, len(values))
            chosen[path] = values[place]
        return {path: chosen[path] for path, _ in self.parameters}

    def number(self, design: Mapping[str, Value]) -> int:
        """Return the number of a design: the inverse of `design`."""
        result = 0
        for path, values in self.parameters:
            result = result * len(values) + self._positions[path][value_text(design[path])]
        return result

    @cached_property
    def _positions(self) -> dict[str, dict[str, int]]:
        """Position of each value in its list, by parameter and text of the value."""
        return {
            path: {value_text(value): place for place, value in enumerate(values)}
            for path, values in self.parameters
        }

    def head(self, column: str) -> str:
        """Name of a column with its unit."""
        return self._with_unit(column, column)

    def label(self, column: str) -> str:
        """Words for a measure with its unit, as on the axis of a picture."""
        words = title_of(column).words if column in EVERY_TITLE else column.replace("_", " ")
        return self._with_unit(words, column)

    def _with_unit(self, words: str, column: str) -> str:
        unit = self.unit_of(column)
        return f"{words} [{unit}]" if unit else words

    def unit_of(self, column: str) -> str:
        """Unit of a column; empty where it has none."""
        return "s" if column == "cpu_seconds" else title_of(column.removesuffix("_error")).unit

    @property
    def varied(self) -> list[str]:
        """Parameters of more than one value, the one that varies slowest first."""
        return [path for path, values in self.parameters if len(values) > 1]

    def idle_parameters(self) -> list[str]:
        """Parameters on which no answer of its method depends."""
        return []

    def deformable(self) -> Study:
        """Return the same designs with deformable blocks."""
        return replace(self, quantity="fem")


@dataclass(frozen=True)
class AnswerStudy(Study):
    """Cases, and the whole answer to each."""

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Return the answer without its fields."""
        return {"answer": repeatable(solve(self.case(number))).as_dict()}, []


@dataclass(frozen=True)
class CaseStudy(AnswerStudy):
    """Cases in the order of the values of one parameter."""

    cases: tuple[Case, ...] = field(kw_only=True)

    def case(self, number: int) -> Case:
        """Case of a design; what is built for it goes with it."""
        return replace(self.cases[number])


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

    def case(self, number: int) -> Case:
        """Make a problem of the values of a design."""
        stated = self.make(**self.design(number))
        return Case(stated, self.method, f"{self.name}[{number}]")


def case_content(case: Case) -> list[Any]:
    """What a case of a scene states: method, keys, and the files of its blocks."""
    return [case.method.name, case.keys, digests(p for p in case.reads if p != case.file)]


def digests(files: Iterable[Path]) -> dict[str, str]:
    """Digests of the content of files that can be read, by their path."""
    read = (path for path in files if path.is_file())
    return {str(path): sha256(path.read_bytes()).hexdigest() for path in read}


#: Equal data has equal text.
_CANONICAL = json.JSONEncoder(sort_keys=True, default=str)


def data_digest(content: Any) -> str:
    """Digest of what was asked, as plain data."""
    return sha256(_CANONICAL.encode(content).encode()).hexdigest()[:32]


def value_text(value: Value) -> str:
    """Text that is the same for equal values: 10 and 10.0 are one value."""
    whole = type(value) is int and abs(value) < 2**53
    return json.dumps(float(value) if whole else value, default=str)
