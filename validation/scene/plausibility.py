"""Values that can hardly be meant: numbers in another unit than the scene's mm, t, s, N, MPa.

A table of what values of this field are like, and the slips that lead out of it. What is meant all
the same is named in ``[plausibility] accept``.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import BaseModel

from fem.element.material import FASTEST_SOUND, SLOWEST_SOUND
from geometry.assembly import AnyBlocks, AssemblyError, check_size
from validation.scene.pictures import PicturesSection
from validation.scene.sections import Section


@dataclass(frozen=True)
class Range:
    """What a quantity is like."""

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
_ACCELERATION = Range(
    50.0, 1e8, "mm/s²", 9810.0, "gravity", (("m/s²", 1e3), ("g", 9810.0)), vector=True
)
_FRICTION = Range(1e-4, 3.0, "", 0.6, "concrete on concrete", (("an angle in degrees", 0.0),))
_CLEARANCE = Range(1e-4, 20.0, "mm", 0.01, "a fine joint", _LENGTHS)
_SIZE = Range(0.5, 1e5, "mm", 200.0, "a block of the paper", _LENGTHS)
_DENSITIES = (("kg/m³", 1e-12), ("g/cm³ or t/m³", 1e-9), ("kg/mm³", 1e-3))
_DENSITY = Range(1e-11, 3e-8, "t/mm³", 2.4e-9, "concrete", _DENSITIES)

#: By key; a star stands for any one name. Numbers in lists are judged one by one.
TABLE: dict[str, Range] = {
    "material.density": _DENSITY,
    "load.density": _DENSITY,
    "material.young_modulus": Range(0.1, 1.3e6, "MPa", 33000.0, "concrete", _STRESSES),
    "contact.clearance_at_zero_pressure": Range(
        1e-5, 10.0, "mm", 1e-3, "the paper's law", _LENGTHS
    ),
    "contact.pressure_at_zero_clearance": Range(
        1e-9, 1e2, "MPa", 1e-4, "the paper's law", _STRESSES
    ),
    "load.pressure": Range(
        0.0, 1e3, "MPa", 0.01, "the paper's load", (("Pa", 1e-6), ("kPa", 1e-3)), only_slips=True
    ),
    "contact.clearance": _CLEARANCE,
    "contact.spacing": _CLEARANCE,
    "effects.gravity": _ACCELERATION,
    "load.gravity": _ACCELERATION,
    "load.acceleration": _ACCELERATION,
    "rigid.friction": _FRICTION,
    "effects.friction.coefficient": _FRICTION,
    # Other sizes of blocks are judged by their volumes, when the blocks are there.
    "block.size": _SIZE,
    "block.boxes.size": _SIZE,
    "fem.end_time": Range(1e-7, 1e3, "s", 0.05, "an explicit run", (("ms", 1e-3), ("µs", 1e-6))),
}

_SOUND = "material.sound_speed"
#: The key that says that blocks of another size than 1 mm to 100 m are meant, whatever makes them.
_BLOCK_SIZE = "block.size"


class PlausibilitySection(Section):
    """``[plausibility]``: values that are meant although they look like a slip of units."""

    read_at_the_door: ClassVar[bool] = True

    accept: tuple[str, ...] = ()
    """Their keys, such as "material.density"."""


class WholeScene(Section):
    """What every scene may have."""

    plausibility: PlausibilitySection = PlausibilitySection()
    pictures: PicturesSection = PicturesSection()


def implausible(scene: BaseModel, accept: tuple[str, ...]) -> str | None:
    """One line on the first value of a scene that looks like a slip; None where none does.

    Parameters
    ----------
    scene
        A scene whose types are checked.
    accept
        Keys of values that are meant.
    """
    known = [*TABLE, _SOUND]
    for key in accept:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            return f"plausibility.accept: got {key!r}" + (
                f", did you mean {near[0]!r}?" if near else f"; expected keys of {', '.join(known)}"
            )
    values = dict(
        _numbers(scene.model_dump(exclude_none=True, exclude={"plausibility", "pictures"}), "")
    )
    for place, size in values.items():
        key = re.sub(r"\.\d+(?=\.|$)", "", place)
        expected = TABLE.get(key)
        if expected is not None and key not in accept:
            words = _out_of_range(size, expected)
            if words:
                return f"{place}: got {words}{_if_meant(key)}"
    return None if _SOUND in accept else _sound_speed(values)


def check_block_size(scene: WholeScene, assembly: AnyBlocks) -> None:
    """Refuse blocks that cannot be measured in millimetres, unless the scene says they are.

    Raises
    ------
    AssemblyError
        With what to do.
    """
    if _BLOCK_SIZE in scene.plausibility.accept:
        return
    try:
        check_size(assembly)
    except AssemblyError as error:
        raise AssemblyError(f"{error}{_if_meant(_BLOCK_SIZE)}") from None


def _numbers(data: Any, place: str) -> Iterator[tuple[str, float]]:
    """Numbers of a scene by their place; of a vector that counts as one, its length."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, f"{place}.{key}" if place else str(key))
    elif isinstance(data, list | tuple):
        expected = TABLE.get(place)
        if expected is not None and expected.vector:
            yield place, math.hypot(*data)
        else:
            for number, value in enumerate(data):
                yield from _numbers(value, f"{place}.{number}")
    elif isinstance(data, float):  # what is counted has no unit
        yield place, abs(data)


def _out_of_range(size: float, expected: Range) -> str | None:
    if size == 0.0 or expected.low <= size <= expected.high:
        return None
    unit = f" {expected.unit}" if expected.unit else ""
    factor = size / expected.compared
    words = f"{size:g}{unit}, {factor:.1g} times {expected.word}"
    for name, scale in expected.slips:
        value = math.tan(math.radians(size)) if name.endswith("degrees") else size * scale
        if _like(value, expected):
            return f"{words}: {name}? write {value:.6g}"
    if expected.only_slips:
        return None
    return f"{words}; expected {expected.low:g} to {expected.high:g}{unit}"


def _like(value: float, expected: Range) -> bool:
    """Whether a value is near what is usual: within the range and a factor of 300 of the known."""
    near = 1.0 / 300.0 <= value / expected.compared <= 300.0
    return near and expected.low <= value <= expected.high


def _sound_speed(values: dict[str, float]) -> str | None:
    density, modulus = values.get("material.density"), values.get("material.young_modulus")
    if not density or not modulus:
        return None
    speed = math.sqrt(modulus / density)
    if SLOWEST_SOUND <= speed <= FASTEST_SOUND:
        return None
    stiff = TABLE["material.young_modulus"]
    slip = next(
        (
            f": material.young_modulus in {name}? write {modulus * scale:.6g}"
            for name, scale in stiff.slips
            if _like(modulus * scale, stiff)
            and SLOWEST_SOUND <= math.sqrt(modulus * scale / density) <= FASTEST_SOUND
        ),
        "",
    )
    return (
        f"material: sound would travel at √(E/ρ) = {speed / 1e3:.3g} m/s; expected "
        f"{SLOWEST_SOUND / 1e3:g} to {FASTEST_SOUND / 1e3:g} m/s{slip}{_if_meant(_SOUND)}"
    )


def _if_meant(key: str) -> str:
    return f' (if it is meant: [plausibility] accept = ["{key}"])'
