"""Studies: numbered designs, each a case that `validation.solve` answers, its answer a row."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fem.method import Static
from geometry.answer import EVERY_TITLE, title_of
from validation.case import Case, Method
from validation.study.design import COLUMNS, Quantity, fem_results, rigid_results

if TYPE_CHECKING:
    from fem.problem import Problem

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
        from validation.case import repeatable, solve

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
