"""Sliders for the numbers of a scene, and the scene that a page's values make."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from geometry.loads import CASES
from validation.case import Case
from validation.errors import InputError
from validation.scene.keys.quantities import Number
from validation.scene.keys.toml_text import flat

#: Sections whose numbers have sliders.
_SECTIONS = ("block", "assembly", "load", "loads", "limits")
_FRICTION = "effects.friction.coefficient"
#: Least, largest value and step of keys whose value says nothing of their range.
_RANGES = {
    "block.frequency": (0.5, 4.0, 0.5),
    "block.shift": (0.0, 1.0, 0.125),
    _FRICTION: (0.0, 1.0, 0.05),
    "limits.steepest_joint": (5.0, 90.0, 1.0),
}
#: Steps between the least and the largest value, at least.
_STEPS = 40
#: Facets of a coarse mesh: along a wave or edge, through the wall, in the other direction.
COARSE = (6, 2, 4)


@dataclass(frozen=True)
class Slider:
    """A number of the scene that the page changes."""

    key: str
    """Place in the scene, such as ``block.amplitude``; of a vector with the number of its part."""
    title: str
    unit: str
    low: float
    high: float
    step: float
    value: float
    whole: bool

    def checked(self, value: Any) -> float | int:
        """Return a value of the page as the scene has it."""
        wrong = isinstance(value, bool) or not isinstance(value, int | float)
        if wrong or not math.isfinite(value) or not self.low <= value <= self.high:
            raise InputError(
                f"{self.key}: got {value!r}; expected a number from {self.low:g} to {self.high:g}"
            )
        if not self.whole:
            return float(value)
        if value != round(value):
            raise InputError(f"{self.key}: got {value!r}; expected a whole number")
        return round(value)


@dataclass(frozen=True)
class Controls:
    """What the page can change."""

    sliders: tuple[Slider, ...]
    cases: tuple[str, ...] = ()
    """Load cases to choose from; empty where the scene has none."""
    case: str = ""
    """That of the scene."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def controls(file: Case) -> Controls:
    """Find the sliders of a scene, and its load cases."""
    numbers = file.numbers(*_SECTIONS)
    if (coefficient := file.values.get(_FRICTION)) is not None:
        numbers.append(Number(_FRICTION, "friction", "", coefficient, 0.0))
    sliders = tuple(slider for slider in map(_slider, numbers) if slider is not None)
    case = file.values.get("load.case", "")
    return Controls(sliders, tuple(CASES) if case else (), case)


def _slider(of: Number) -> Slider | None:
    """A slider for a number whose range is known or follows from its size."""
    value, whole = of.value, isinstance(of.value, int)
    if of.key in _RANGES:
        low, high, step = _RANGES[of.key]
        low, high = min(low, value), max(high, value)
    elif whole:
        low, high, step = int(of.least or 0), max(2 * value, value + 4), 1
    elif value:
        size = abs(value)
        step = _round_step(2.0 * size / _STEPS)
        low = 0.0 if of.least == 0 else step * math.ceil(0.25 * size / step)
        high = step * math.ceil(2.0 * size / step)
        if value < 0.0:
            low, high = -high, -low
    else:
        return None
    # The value of the scene is one that the slider can stand at.
    steps = (value - low) / step
    if abs(steps - round(steps)) > 1e-6:
        low = value - math.floor(steps) * step
    return Slider(of.key, of.title, of.unit, low, high, step, value, whole)


def _round_step(most: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not larger."""
    power = 10.0 ** math.floor(math.log10(most))
    return next(float(f"{k * power:.1g}") for k in (5, 2, 1) if k * power <= most * (1 + 1e-9))


def changed(file: Case, known: Controls, values: Mapping[str, Any], *, coarse: bool) -> Case:
    """Return the case with the values of a page, on its own facets or on coarse ones."""
    sliders, stated = {slider.key: slider for slider in known.sliders}, file.values
    changes: dict[str, Any] = {}
    for key, value in values.items():
        if key == "load.case" and value in known.cases:
            changes[key] = value
        elif key in sliders:
            place, parts = _place(key)
            one = sliders[key].checked(value)
            changes[place] = _with(changes.get(place, stated.get(place)), parts, one)
        else:
            names = ", ".join(sliders)
            raise InputError(f"{str(key)[:60]}: got a key without a slider; expected {names}")
    result = file.changed(changes | _facets_of_a_wave(file, changes))
    mesh = result.scene.coarse_mesh(*COARSE) if coarse else {}
    return result.changed(dict(flat({"mesh": mesh})))


def _place(key: str) -> tuple[str, list[str]]:
    """Key of a list and what lies in it; a number has a key of its own."""
    names = key.split(".")
    count = next((k for k, name in enumerate(names) if name.isdecimal()), len(names))
    return ".".join(names[:count]), names[count:]


def _with(data: Any, parts: list[str], value: float) -> Any:
    """Copy of plain data with a value at a place in it."""
    if not parts:
        return value
    first, *others = parts
    if isinstance(data, Mapping):
        return {**data, first: _with(data.get(first), others, value)}
    return [_with(v, others, value) if k == int(first) else v for k, v in enumerate(data)]


def _facets_of_a_wave(file: Case, changes: Mapping[str, Any]) -> dict[str, int]:
    """Keep the facets along a wave where another frequency has more or fewer waves."""
    around, frequency = file.keys.get("mesh", {}).get("around"), file.values.get("block.frequency")
    if around is None or frequency is None:
        return {}
    waves, before = round(2 * changes.get("block.frequency", frequency)), round(2 * frequency)
    return {} if waves == before or around % before else {"mesh.around": waves * around // before}
