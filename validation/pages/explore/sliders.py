"""Sliders for the numbers of a scene, and the scene that a page's values make."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from annotated_types import Ge

from geometry.loads import CASES
from validation.case import Case
from validation.errors import InputError
from validation.scene.families.sine import TubeScene
from validation.scene.family import AssemblyScene
from validation.scene.keys.docstrings import field_docstrings
from validation.scene.keys.quantities import unit_of
from validation.scene.read import check_scene
from validation.scene.sections import Section, TubeLoadSection

#: Sections whose numbers have sliders.
_SECTIONS = ("block", "assembly", "load", "loads", "limits")
#: Least, largest value and step of keys whose value says nothing of their range.
_RANGES = {
    "block.frequency": (0.5, 4.0, 0.5),
    "block.shift": (0.0, 1.0, 0.125),
    "effects.friction.coefficient": (0.0, 1.0, 0.05),
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
    scene = file.scene
    found = []
    for name in _SECTIONS:
        found += list(_sliders(scene.__dict__.get(name), name))
    friction = scene.effects.friction
    if friction is not None:
        key, value = "effects.friction.coefficient", friction.coefficient
        found += list(_slider(key, ("friction", ""), value, 0.0))
    load = scene.__dict__.get("load")
    if isinstance(scene, AssemblyScene) and isinstance(load, TubeLoadSection):
        return Controls(tuple(found), tuple(CASES), load.case)
    return Controls(tuple(found))


def _sliders(section: Any, place: str) -> Iterator[Slider]:
    """Sliders for the numbers of a section or of a list of them, parts of vectors too."""
    if isinstance(section, tuple):
        for k, one in enumerate(section):
            yield from _sliders(one, f"{place}.{k}")
    if not isinstance(section, Section):
        return
    about = field_docstrings(type(section))
    for name, field in type(section).model_fields.items():
        value = section.__dict__[name]
        unit = unit_of(about.get(name, ""))
        words = name.replace("_", " "), "" if unit is None else unit.name
        limits = [part.ge for part in field.metadata if isinstance(part, Ge)]
        least = min(limits, default=None)  # type: ignore[type-var]
        if isinstance(value, tuple) and all(isinstance(v, float) for v in value):
            for k, part in enumerate(value):
                yield from _slider(
                    f"{place}.{name}.{k}", (f"{words[0]} {'xyz'[k % 3]}", words[1]), part, least
                )
        elif isinstance(value, tuple):
            yield from _sliders(value, f"{place}.{name}")
        else:
            yield from _slider(f"{place}.{name}", words, value, least)


def _slider(key: str, words: tuple[str, str], value: Any, least: Any) -> Iterator[Slider]:
    """A slider for a number whose range is known or follows from its size."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return
    whole = isinstance(value, int)
    if key in _RANGES:
        low, high, step = _RANGES[key]
        low, high = min(low, value), max(high, value)
    elif whole:
        low, high, step = int(least or 0), max(2 * value, value + 4), 1
    elif value:
        size = abs(value)
        step = _round_step(2.0 * size / _STEPS)
        low = 0.0 if least == 0 else step * math.ceil(0.25 * size / step)
        high = step * math.ceil(2.0 * size / step)
        if value < 0.0:
            low, high = -high, -low
    else:
        return
    # The value of the scene is one that the slider can stand at.
    steps = (value - low) / step
    if abs(steps - round(steps)) > 1e-6:
        low = value - math.floor(steps) * step
    yield Slider(key, *words, low, high, step, value, whole)


def _round_step(most: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not larger."""
    power = 10.0 ** math.floor(math.log10(most))
    return next(float(f"{k * power:.1g}") for k in (5, 2, 1) if k * power <= most * (1 + 1e-9))


def changed(file: Case, known: Controls, values: Mapping[str, Any], *, coarse: bool) -> Case:
    """Scene with the values of a page, on its own facets or on coarse ones."""
    data = file.keys
    every = file.scene.model_dump(mode="json")
    sliders = {slider.key: slider for slider in known.sliders}
    for key, value in values.items():
        if key == "load.case" and value in known.cases:
            data["load"]["case"] = value
        elif key in sliders:
            _put(data, every, key.split("."), sliders[key].checked(value))
        else:
            names = ", ".join(sliders)
            raise InputError(f"{str(key)[:60]}: got a key without a slider; expected {names}")
    _keep_facets_of_a_wave(file, data)
    scene = check_scene(data, file.name)
    if coarse and (mesh := scene.coarse_mesh(*COARSE)):
        scene = scene.changed({"mesh": mesh})
    return file.stating(scene)


def _put(data: Any, every: Any, keys: list[str], value: float) -> None:
    """Put a value into plain data, which takes lists that it does not state from all data."""
    *places, last = keys
    for key in places:
        every = every[int(key)] if isinstance(every, list) else every[key]
        stated = every if isinstance(every, list) else {}
        data = data[int(key)] if isinstance(data, list) else data.setdefault(key, stated)
    if isinstance(data, list):
        data[int(last)] = value
    else:
        data[last] = value


def _keep_facets_of_a_wave(file: Case, data: dict[str, Any]) -> None:
    """Keep the facets along a wave where another frequency has more or fewer waves."""
    stated = file.scene
    if isinstance(stated, TubeScene) and "around" in data.get("mesh", {}):
        waves, before = round(2 * data["block"]["frequency"]), round(2 * stated.block.frequency)
        if waves != before and stated.mesh.around % before == 0:
            data["mesh"]["around"] = waves * stated.mesh.around // before
