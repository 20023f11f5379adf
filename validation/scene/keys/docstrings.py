"""Words about the keys of sections: docstrings below the fields of a class, or descriptions."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel


@cache
def field_docstrings(section: type) -> dict[str, str]:
    """Literals below the fields of a class and of its bases, in one line each.

    Keys that are fields of dataclasses (`Section.documented_by`) have the words of these.
    """
    result: dict[str, str] = {}
    for base in reversed(section.__mro__):
        for key, (kind, field) in vars(base).get("documented_by", {}).items():
            words = field_docstrings(kind)
            if field in words:
                result[key] = words[field]
        result |= _own_docstrings(base)
    return result


@cache
def _own_docstrings(base: type) -> dict[str, str]:
    """Literals below the fields of a class itself."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
    except (OSError, TypeError):
        return {}
    return _docstrings(tree.body[0])


def words_of_fields(file: str, name: str) -> dict[str, str]:
    """Docstrings of the fields of a class in a file of the program, which is not imported."""
    path = Path(__file__).parents[3] / file
    every = ast.parse(path.read_text("utf-8")).body
    stated = next(one for one in every if isinstance(one, ast.ClassDef) and one.name == name)
    return {key: words.replace("``", "") for key, words in _docstrings(stated).items()}


def _docstrings(stated: ast.stmt) -> dict[str, str]:
    """Literals below the fields of a class, in one line each."""
    body = stated.body if isinstance(stated, ast.ClassDef) else []
    return {
        field.target.id: " ".join(str(text.value.value).split())
        for field, text in itertools.pairwise(body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    }


@dataclass(frozen=True)
class Range:
    """Plausible range of a quantity."""

    low: float
    high: float
    """Smallest and largest size that is plausible; zero always is."""
    unit: str
    compared: float
    """A value that everyone knows …"""
    word: str
    """… and whose it is."""
    slips: tuple[tuple[str, float], ...] = ()
    """Units that are written by mistake, and what they are in the unit of the key."""
    vector: bool = False
    """Whether the length of the vector counts, not each number."""
    only_slips: bool = False
    """Whether values out of the range pass where no slip leads to a usual one."""


_LENGTHS = (("m", 1e3), ("cm", 10.0), ("µm", 1e-3))
_STRESSES = (("Pa", 1e-6), ("kPa", 1e-3), ("GPa", 1e3))
ACCELERATION = Range(
    50.0, 1e8, "mm/s²", 9810.0, "gravity", (("m/s²", 1e3), ("g", 9810.0)), vector=True
)
FRICTION = Range(1e-4, 3.0, "", 0.6, "concrete on concrete", (("an angle in degrees", 0.0),))
CLEARANCE = Range(1e-4, 20.0, "mm", 0.01, "a fine joint", _LENGTHS)
SIZE = Range(0.5, 1e5, "mm", 200.0, "a block of the paper", _LENGTHS)
_DENSITIES = (("kg/m³", 1e-12), ("g/cm³ or t/m³", 1e-9), ("kg/mm³", 1e-3))
DENSITY = Range(1e-11, 3e-8, "t/mm³", 2.4e-9, "concrete", _DENSITIES)
YOUNG_MODULUS = Range(0.1, 1.3e6, "MPa", 33000.0, "concrete", _STRESSES)
PRESSURE = Range(
    0.0, 1e3, "MPa", 0.01, "the paper's load", (("Pa", 1e-6), ("kPa", 1e-3)), only_slips=True
)
END_TIME = Range(1e-7, 1e3, "s", 0.05, "an explicit run", (("ms", 1e-3), ("µs", 1e-6)))
#: Of constants of contact laws, by their key.
OF_LAWS = {
    "clearance_at_zero_pressure": Range(1e-5, 10.0, "mm", 1e-3, "the paper's law", _LENGTHS),
    "pressure_at_zero_clearance": Range(1e-9, 1e2, "MPa", 1e-4, "the paper's law", _STRESSES),
}


def leaves(annotation: Any) -> set[Any]:
    """Return the types that an annotation is made of: {float, None} for ``float | None``."""
    inner = get_args(annotation)
    return set().union(*(leaves(part) for part in inner)) if inner else {annotation}


@cache
def ranges(section: type[BaseModel]) -> dict[str, Range]:
    """Ranges of the keys of a section that have one; numbers in lists are judged one by one."""
    found: dict[str, Range] = {}
    for name, field in section.model_fields.items():
        found.update((name, kind) for kind in field.metadata if isinstance(kind, Range))
        for part in leaves(field.annotation):
            if isinstance(part, type) and issubclass(part, BaseModel):
                found |= {f"{name}.{key}": kind for key, kind in ranges(part).items()}
    return found
