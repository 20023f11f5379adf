"""What is known of the keys of sections: words, plausible ranges, units, numbers.

Words are docstrings below the fields of a class. The unit of a key is the one that they give in
brackets: ``density = "2400 kg/m3"`` is read as 2.4e-9 t/mm³. Scenes count in mm, t, s, N, MPa.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import math
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, get_args

from annotated_types import Ge
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


# ---------------------------------------------------------------------------------------------
# Plausible ranges


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


# ---------------------------------------------------------------------------------------------
# Values with units

#: Exponents of length, mass, time and angle.
_Dimension = tuple[int, int, int, int]

_LENGTH, _MASS, _TIME = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0)
_ANGLE, _FORCE, _PRESSURE = (0, 0, 0, 1), (1, 1, -2, 0), (-1, 1, -2, 0)

#: Size in mm, t, s, rad and what it measures, by name.
_NAMED: dict[str, tuple[Fraction, _Dimension]] = {
    "mm": (Fraction("1.0"), _LENGTH),
    "µm": (Fraction("1e-3"), _LENGTH),
    "um": (Fraction("1e-3"), _LENGTH),
    "cm": (Fraction("10.0"), _LENGTH),
    "m": (Fraction("1e3"), _LENGTH),
    "in": (Fraction("25.4"), _LENGTH),
    "inch": (Fraction("25.4"), _LENGTH),
    "ft": (Fraction("304.8"), _LENGTH),
    "g": (Fraction("1e-6"), _MASS),
    "kg": (Fraction("1e-3"), _MASS),
    "t": (Fraction("1.0"), _MASS),
    "s": (Fraction("1.0"), _TIME),
    "ms": (Fraction("1e-3"), _TIME),
    "µs": (Fraction("1e-6"), _TIME),
    "us": (Fraction("1e-6"), _TIME),
    "min": (Fraction("60.0"), _TIME),
    "Hz": (Fraction("1.0"), (0, 0, -1, 0)),
    "N": (Fraction("1.0"), _FORCE),
    "kN": (Fraction("1e3"), _FORCE),
    "MN": (Fraction("1e6"), _FORCE),
    "Pa": (Fraction("1e-6"), _PRESSURE),
    "kPa": (Fraction("1e-3"), _PRESSURE),
    "MPa": (Fraction("1.0"), _PRESSURE),
    "GPa": (Fraction("1e3"), _PRESSURE),
    "bar": (Fraction("0.1"), _PRESSURE),
    "psi": (Fraction("0.45359237") * Fraction("9.80665") / Fraction("25.4") ** 2, _PRESSURE),
    "rad": (Fraction("1.0"), _ANGLE),
    "deg": (Fraction(math.pi / 180.0), _ANGLE),
    "°": (Fraction(math.pi / 180.0), _ANGLE),
    "1": (Fraction("1.0"), (0, 0, 0, 0)),
}

_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴", "-01234")
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.].*?)\s*")
_FACTOR = re.compile(r"(1|[A-Za-zµ°]+)(?:\*\*|\^)?(-?[1-4])?")
_IN_BRACKETS = re.compile(r"\[([^\]]+)\]")


@dataclass(frozen=True)
class Unit:
    """Quantity and size of a unit."""

    name: str
    size: Fraction
    """In mm, t, s, rad; exact, so that 2400 kg/m3 is the number 2.4e-9 to the last bit."""
    dimension: _Dimension


def parse_unit(text: str) -> Unit | None:
    """Unit such as ``kg/m3``, ``MPa/mm``, ``N mm``, ``m·s^-2``; None for what is none."""
    size, dimension = Fraction(1), [0, 0, 0, 0]
    words = text.translate(_SUPERSCRIPTS).replace("µ", "µ").split("/")
    if len(words) > 2:
        return None
    for sign, part in zip((1, -1), words, strict=False):
        factors = re.split(r"[\s·]+|(?<!\*)\*(?!\*)", part.strip().strip("()"))
        for factor in factors:
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in _NAMED:
                return None
            power = sign * int(match[2] or 1)
            one, exponents = _NAMED[match[1]]
            size *= one**power
            dimension = [d + power * e for d, e in zip(dimension, exponents, strict=True)]
    return Unit(text, size, (dimension[0], dimension[1], dimension[2], dimension[3]))


def unit_of(docstring: str) -> Unit | None:
    """Unit that a docstring gives in brackets; None where it gives none."""
    result = (parse_unit(text) for text in _IN_BRACKETS.findall(docstring) if text != "1")
    return next((unit for unit in result if unit is not None), None)


def unit_of_key(scene: object, path: str) -> Unit | None:
    """Unit of ``section.key`` of a scene; None where it has none, or no section."""
    *sections, key = path.split(".")
    for name in sections:
        scene = getattr(scene, name, None)
    kind: type = type(scene)
    return unit_of(field_docstrings(kind).get(key, "")) if sections else None


def converted(text: str, unit: Unit) -> float | None:
    """Number of a text with a unit, in the unit of its key; None where the text has no unit."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        return None
    given = parse_unit(match[2])
    if given is None:
        raise ValueError(f"the unit {match[2]!r} is unknown; expected one such as {unit.name}")
    if given.dimension != unit.dimension:
        raise ValueError(f"{match[2]} does not measure the same as {unit.name}")
    try:
        return float(Fraction(match[1]) * given.size / unit.size)
    except OverflowError:
        raise ValueError("expected a number that double precision can hold") from None


# ---------------------------------------------------------------------------------------------
# Numbers of a scene


@dataclass(frozen=True)
class Number:
    """A number of a scene."""

    key: str
    """Place in the scene, such as ``block.amplitude``; of a vector with the number of its part."""
    title: str
    unit: str
    """Empty where it has none."""
    value: float
    least: float | None
    """Least value; None: there is no bound."""


def numbers_in(section: Any, place: str) -> Iterator[Number]:
    """Numbers of a section or of a list of them, parts of vectors too."""
    if isinstance(section, tuple):
        for k, one in enumerate(section):
            yield from numbers_in(one, f"{place}.{k}")
    if not isinstance(section, BaseModel):
        return
    about = field_docstrings(type(section))
    for name, field in type(section).model_fields.items():
        value, unit = section.__dict__[name], unit_of(about.get(name, ""))
        bounds = [float(part.ge) for part in field.metadata if isinstance(part, Ge)]  # type: ignore[arg-type]
        title, least = name.replace("_", " "), min(bounds, default=None)
        vector = isinstance(value, tuple) and all(isinstance(v, float) for v in value)
        if isinstance(value, tuple) and not vector:
            yield from numbers_in(value, f"{place}.{name}")
        for k, part in enumerate(value if vector else (value,)):
            key = f"{place}.{name}.{k}" if vector else f"{place}.{name}"
            words = f"{title} {'xyz'[k % 3]}" if vector else title
            if isinstance(part, int | float) and not isinstance(part, bool):
                yield Number(key, words, "" if unit is None else unit.name, part, least)
