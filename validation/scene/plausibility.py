"""Scenes that can hardly be meant, or that no machine at hand can hold.

Keys have ranges of what their values are like, and the slips that lead out of them: numbers in
another unit than the scene's mm, t, s, N, MPa. What is meant all the same is named in
``[plausibility] accept``.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from fem.element.material import FASTEST_SOUND, SLOWEST_SOUND
from geometry.machine.work import beyond_memory
from geometry.parts.placed import AnyBlocks, AssemblyError, check_size
from validation.scene.family import FamilyScene
from validation.scene.keys.docstrings import YOUNG_MODULUS, Range, ranges

#: Sizes of numbers whose products with a few others are still floats.
SMALLEST, LARGEST = 1e-50, 1e50
_SOUND = "material.sound_speed"
#: The key that says that blocks of another size than 1 mm to 100 m are meant, whatever makes them.
_BLOCK_SIZE = "block.size"

#: Least memory of what is built, whatever the method: nodes and corners of an element, an outer
#: facet of each block with its contact, a triangulated block with its contacts [bytes]. Measured
#: with tubes and planar walls of 56 to 484 blocks and with layers, arches and walls of 400 to 1000.
_ELEMENT, _FACET, _BLOCK = 100.0, 100.0, 70e3
#: Least memory of deformable blocks: each element's state in an explicit run; of a static one, the
#: forces between each two outer facets of one block, which its solver keeps [bytes]. Measured with
#: tubes of 960 and 4032 elements a block: 0.09 and 0.48 GB.
_STATE, _FACET_PAIR = 200.0, 72.0
#: Least memory of the factor of one static body: for each element, so much times the cube root of
#: their number (nested dissection), in slender bodies for each element across [bytes]. Measured
#: with 3840 and 12960 elements: 0.22 and 1.14 GB.
_FACTOR, _BAND = 2000.0, 72.0


def implausible(scene: BaseModel, accept: tuple[str, ...]) -> str | None:
    """One line on the first value of a scene that looks like a slip; None where none does.

    Its types are checked; ``accept`` are keys of values that are meant.
    """
    table = dict(ranges(type(scene)))
    known = list(dict.fromkeys([*table, _SOUND, _BLOCK_SIZE]))
    for key in accept:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            return f"plausibility.accept: got {key!r}" + (
                f", did you mean {near[0]!r}?" if near else f"; expected keys of {', '.join(known)}"
            )
    data = scene.model_dump(exclude_none=True, exclude={"plausibility", "pictures"})
    values = dict(_numbers(data, "", table))
    for place, size in values.items():
        if size and not SMALLEST <= abs(size) <= LARGEST:
            return (
                f"{place}: got {size:g}; expected 0 or a size from {SMALLEST:g} to {LARGEST:g}: "
                "other numbers overflow or underflow"
            )
        key = re.sub(r"\.\d+(?=\.|$)", "", re.sub(r"^materials\.[^.]+", "materials", place))
        pulls = key == "load.pressure" and size < 0.0 and _case(scene) == "tunnel"
        if pulls and key not in accept:
            return (
                f"{place}: got {size:g} MPa; a positive pressure presses a tunnel from outside; "
                f'expected one, or load.case = "pipe" for pressure from inside{_if_meant(key)}'
            )
        expected = table.get(key)
        if expected is not None and key not in accept:
            words = _out_of_range(abs(size), expected)
            if words:
                return f"{place}: got {words}{_if_meant(key)}"
    if _SOUND in accept:
        return None
    places = ("material", *(f"materials.{name}" for name in data.get("materials", {})))
    return next((words for place in places if (words := _sound_speed(values, place))), None)


def _case(scene: Any) -> str | None:
    """Load case of a scene, where it has one."""
    case: str | None = getattr(getattr(scene, "load", None), "case", None)
    return case


def check_block_size(scene: FamilyScene, assembly: AnyBlocks) -> None:
    """Reject blocks that cannot be measured in millimetres, unless the scene says they are."""
    if _BLOCK_SIZE in scene.plausibility.accept:
        return
    try:
        check_size(assembly)
    except AssemblyError as error:
        raise AssemblyError(f"{error}{_if_meant(_BLOCK_SIZE)}") from None


def _numbers(data: Any, place: str, table: dict[str, Range]) -> Iterator[tuple[str, float]]:
    """Numbers of a scene by their place; of a vector that counts as one, its length."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, f"{place}.{key}" if place else str(key), table)
    elif isinstance(data, list | tuple):
        expected = table.get(place)
        if expected is not None and expected.vector:
            yield place, math.hypot(*data)
        else:
            for number, value in enumerate(data):
                yield from _numbers(value, f"{place}.{number}", table)
    elif isinstance(data, float):  # what is counted has no unit
        yield place, data


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


def _sound_speed(values: dict[str, float], place: str) -> str | None:
    """One line on a speed of sound that no solid has; ``place`` is a section."""
    density, modulus = values.get(f"{place}.density"), values.get(f"{place}.young_modulus")
    if not density or not modulus:
        return None
    speed = math.sqrt(modulus / density)
    if SLOWEST_SOUND <= speed <= FASTEST_SOUND:
        return None
    slip = next(
        (
            f": {place}.young_modulus in {name}? write {modulus * scale:.6g}"
            for name, scale in YOUNG_MODULUS.slips
            if _like(modulus * scale, YOUNG_MODULUS)
            and SLOWEST_SOUND <= math.sqrt(modulus * scale / density) <= FASTEST_SOUND
        ),
        "",
    )
    return (
        f"{place}: implausible wave speed √(E/ρ) = {speed / 1e3:.3g} m/s; expected "
        f"{SLOWEST_SOUND / 1e3:g} to {FASTEST_SOUND / 1e3:g} m/s{slip}{_if_meant(_SOUND)}"
    )


def _if_meant(key: str) -> str:
    return f' (to override: [plausibility] accept = ["{key}"])'


# ---------------------------------------------------------------------------------------------
# What no machine at hand can hold: by a count, before anything is built


def too_large(scene: FamilyScene) -> str | None:
    """One line on a scene that does not fit the memory of this machine; None where it may.

    What is counted is a lower bound: a scene that passes may still be too much for a method.
    """
    blocks, elements, facets = _counts(scene)
    if scene.solid:  # meshed for deformable answers alone
        elements = facets = 0.0
    counts = blocks, elements, facets
    each = facets * _FACET if facets else _BLOCK
    return _refused(counts, elements * _ELEMENT + blocks * each)


def too_large_to_deform(scene: FamilyScene, *, static: bool) -> str | None:
    """As `too_large`, of a scene whose blocks deform: in a static run, or in an explicit one."""
    counts = blocks, elements, facets = _counts(scene)
    need = blocks * elements * _STATE
    if static and blocks > 1.0:
        need = facets * facets * _FACET_PAIR
    elif static and elements:
        across = elements / max(map(_float, scene.divisions))
        need = elements * min(_FACTOR * elements ** (1.0 / 3.0), _BAND * across)
    return _refused(counts, need)


def _refused(counts: tuple[float, float, float], need: float) -> str | None:
    """One line on a scene that needs so many bytes, where the machine has fewer."""
    blocks, elements, facets = counts
    what = f"{_short(blocks)} blocks"
    remedy = "fewer of them (assembly)"
    if facets:
        what += f" with {_short(elements)} elements and {_short(facets)} outer facets each"
        remedy = "fewer elements (mesh)" if facets > blocks else "fewer blocks (assembly)"
    return beyond_memory(what, need, remedy)


def _short(number: float) -> str:
    return f"{number:.0f}" if number < 1e6 else f"{number:.2g}"


def _counts(scene: FamilyScene) -> tuple[float, float, float]:
    """Blocks, elements and outer facets of a block."""
    around = [_float(n * scene.fem.degree) for n in scene.divisions]
    elements = math.prod(around) if around else 0.0
    blocks = math.prod(map(_float, scene.block_counts))
    return blocks, elements, 2.0 * sum(elements / n for n in around)


def _float(count: int) -> float:
    """A count of any size; beyond double precision it is infinite."""
    try:
        return float(count)
    except OverflowError:
        return math.inf
