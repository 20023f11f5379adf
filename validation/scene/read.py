"""Scenes: short TOML files that say what is built, supported, loaded and requested.

A scene is checked by pydantic when it is read. What a scene does not name is off. The type of its
``[block]`` decides which sections it may have. Keys have ranges of what their values are like, and
the slips that lead out of them: numbers in another unit than the scene's mm, t, s, N, MPa. What is
meant all the same is named in ``[plausibility] accept``.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import BaseModel, ValidationError

from fem.element.material import FASTEST_SOUND, SLOWEST_SOUND
from geometry.errors import unreadable
from geometry.machine.work import beyond_memory
from geometry.parts.placed import AnyBlocks, AssemblyError, check_size
from validation.errors import InputError, one_line
from validation.scene.builtin import builtin_names, builtin_text, stands_for_builtin
from validation.scene.deformable import METHODS, keys_of_other
from validation.scene.family import FAMILIES, AssemblyScene, FamilyScene
from validation.scene.keys.quantities import YOUNG_MODULUS, Range, ranges
from validation.scene.polyhedra import PolyhedralScene

#: A value with a decimal comma, which is no TOML.
_DECIMAL_COMMA = re.compile(r"^\s*\w+\s*=\s*([-+]?\d+,\d+)\s*(?:#.*)?$", re.MULTILINE)

#: All scenes: their blocks can be rigid or deformable.
DeformableScene: TypeAlias = AssemblyScene | PolyhedralScene

#: Values by key, such as ``{"assembly.layers": 2}``, or words such as ``assembly.layers=2``.
Settings: TypeAlias = Mapping[str, Any] | Sequence[str]

#: Scene class by ``[block] type``.
SCENE_TYPES: Mapping[str, type[DeformableScene]] = FAMILIES


# ---------------------------------------------------------------------------------------------
# Reading


def _read(source: str) -> tuple[str, str]:
    """Name and TOML text of a built-in scene or a file."""
    path = Path(source)
    if stands_for_builtin(path):
        beside = path.with_name(f"{path.name}.toml") if path.name else path
        if source not in builtin_names() and unreadable(beside) is None:
            raise InputError(f"{source}: no such file or built-in scene; did you mean {beside}?")
        return source, builtin_text(source)
    return path.stem, read_text(path, "a scene in TOML, or a name from `tubelock scenes`")


def read_text(path: Path, expected: str) -> str:
    """Text of a file that people wrote."""
    why = unreadable(path)
    if why is not None:
        raise InputError(f"{path}: {why}; expected {expected}")
    try:
        return path.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is no UTF-8 text; expected {expected}"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected {expected}") from None


def _value(text: str) -> Any:
    """Value of an override: TOML if it parses, else a plain string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # no TOML, too long a number, or lists in lists
        return text


def assignments(settings: Settings) -> list[tuple[str, Any]]:
    """Return ``section.key`` and value of each setting, as plain data."""
    if isinstance(settings, Mapping):
        plain = json.loads(json.dumps(list(settings.items()), default=_plain))
        return [(str(place), value) for place, value in plain]
    parts = [word.partition("=") for word in settings]
    for path, equals, text in parts:
        if not equals or not path.strip():
            raise InputError(
                f"--set {path}{equals}{text}: expected section.key=value, e.g. "
                "--set assembly.layers=4"
            )
    return [(path, _value(text.strip())) for path, _, text in parts]


def _plain(value: Any) -> Any:
    """Arrays and numbers of numpy as lists and numbers, all else as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def apply_overrides(data: Mapping[str, Any], settings: Settings) -> dict[str, Any]:
    """Return a scene's data with other values by ``section.key``; None leaves a key out."""
    result: dict[str, Any] = json.loads(json.dumps(data))
    for place, value in assignments(settings):
        keys = [key.strip().strip("'\"") for key in place.split(".")]
        if keys[:2] == ["effects", "friction"] and len(keys) > 2:
            _open_friction(result.get("effects"))
        if value is None:
            _leave_out(result, keys)
            continue
        target = result
        for key in keys[:-1]:
            inner = target.setdefault(key, {})
            if not isinstance(inner, dict):
                kind = "list, which is set as a whole" if isinstance(inner, list) else "value"
                raise InputError(f"{place}: {key!r} is a {kind}, not a section")
            target = inner
        target[keys[-1]] = value
    _drop_keys_of_replaced_method(data.get("fem"), result.get("fem"))
    return result


def _leave_out(data: dict[str, Any], keys: list[str]) -> None:
    """Remove a key of a scene's data, where it is stated."""
    section: Any = data
    for key in keys[:-1]:
        section = section.get(key) if isinstance(section, dict) else None
    if isinstance(section, dict):
        section.pop(keys[-1], None)


def _open_friction(effects: Any) -> None:
    """Write ``friction = 0.4`` as a section, a part of which can be set."""
    stated = effects.get("friction") if isinstance(effects, dict) else None
    if isinstance(stated, int | float | str):
        effects["friction"] = {"coefficient": stated}


def _drop_keys_of_replaced_method(before: Any, after: Any) -> None:
    """Another method takes the place of the one that was stated, with the keys of that alone."""
    if not isinstance(before, Mapping) or not isinstance(after, dict):
        return
    old, new = (str(fem.get("method", "static")) for fem in (before, after))
    if old == new or not {old, new} <= METHODS.keys():
        return
    for key in keys_of_other(new):
        if key in before and after.get(key) == before[key]:
            after.pop(key, None)


def scene_data(source: str) -> tuple[str, dict[str, Any]]:
    """Name and unchecked data of a built-in scene or a TOML file."""
    name, text = _read(source)
    try:
        return name, tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        comma = _DECIMAL_COMMA.search(text)
        hint = "" if comma is None else f" (in {comma[1]}: numbers have a point, no comma)"
        raise InputError(f"{source}: TOML syntax error: {error}{hint}") from None


def _example(kind: str) -> dict[str, Any]:
    """Data of a built-in scene with a type of block; empty where there is none."""
    every = (tomllib.loads(builtin_text(name)) for name in builtin_names())
    return next((data for data in every if data["block"]["type"] == kind), {})


def check_scene(data: Mapping[str, Any], source: str = "scene") -> DeformableScene:
    """Check a scene's data."""
    block = data.get("block")
    kind = block.get("type") if isinstance(block, dict) else None
    if not isinstance(kind, str) or kind not in SCENE_TYPES:
        known = ", ".join(f'"{k}"' for k in SCENE_TYPES)
        got = "no [block] section" if not isinstance(block, dict) else f"got {kind!r}"
        near = difflib.get_close_matches("block", [k for k in data if k != "block"], cutoff=0.6)
        if near and not isinstance(block, dict):
            raise InputError(f"{source}: unknown section [{near[0]}]: did you mean [block]?")
        raise InputError(f"{source}: block.type: {got}, expected one of {known}")
    model = SCENE_TYPES[kind]
    try:
        scene = model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{source}: {one_line(error, model, _example(kind))}") from None
    require_plausible(scene, source)
    return scene


def require_plausible(scene: DeformableScene, source: str) -> None:
    """Reject values that are a slip of the pen, and what no computer has room for."""
    why = implausible(scene, scene.plausibility.accept) or too_large(scene)
    if why is not None:
        raise InputError(f"{source}: {why}")


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
    table = ranges(type(scene))
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
        degree, need = scene.fem.degree, facets * facets * _FACET_PAIR
        if degree > 1 and elements:  # a flexibility between the points of all but two sides
            beside = facets - 2.0 * elements / (degree * min(map(_float, scene.divisions)))
            need = 8.0 * (beside * (1.0 + 2.0 / degree) ** 2) ** 2
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
