"""Values with units in scenes: ``density = "2400 kg/m3"`` is read as 2.4e-9 t/mm³.

The unit of a key is the one its docstring gives in brackets. Scenes count in mm, t, s, N, MPa.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction

from validation.scene.keys.docstrings import field_docstrings

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
