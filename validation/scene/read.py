"""Scenes: short TOML files that say what is built, supported, loaded and asked.

A scene is checked by pydantic at the door. What a scene does not name is off. The type of its
``[block]`` decides which sections it may have.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from geometry.errors import unreadable
from validation.errors import InputError, one_line
from validation.scene.builtin import builtin_names, builtin_text
from validation.scene.deformable import METHODS, keys_of_other
from validation.scene.family import FAMILIES, AssemblyScene
from validation.scene.plausibility import implausible, too_large
from validation.scene.polyhedra import PolyhedralScene

#: A value with a decimal comma, which is no TOML.
_DECIMAL_COMMA = re.compile(r"^\s*\w+\s*=\s*([-+]?\d+,\d+)\s*(?:#.*)?$", re.MULTILINE)

#: All scenes: their blocks can be rigid or deformable.
DeformableScene: TypeAlias = AssemblyScene | PolyhedralScene

#: Scene class by ``[block] type``.
SCENE_TYPES: Mapping[str, type[DeformableScene]] = FAMILIES


# ---------------------------------------------------------------------------------------------
# Reading


def _read(source: str) -> tuple[str, str]:
    """Name and TOML text of a built-in scene or a file."""
    path = Path(source)
    if path.suffix != ".toml" and unreadable(path) == "no such file":
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


def apply_overrides(data: Mapping[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """Apply ``section.key=value`` assignments to a scene's data."""
    result: dict[str, Any] = json.loads(json.dumps(data))
    for override in overrides:
        path, equals, text = override.partition("=")
        keys = [key.strip().strip("'\"") for key in path.split(".")]
        value = _value(text.strip())
        whole_section = len(keys) == 1 and isinstance(value, dict)
        if not equals or not all(keys) or (len(keys) < 2 and not whole_section):
            raise InputError(
                f"--set {override}: expected section.key=value, e.g. --set assembly.layers=4"
            )
        if keys[:2] == ["effects", "friction"] and len(keys) > 2:
            _open_friction(result.get("effects"))
        target = result
        for key in keys[:-1]:
            inner = target.setdefault(key, {})
            if not isinstance(inner, dict):
                raise InputError(f"--set {override}: {key!r} is a value, not a section")
            target = inner
        target[keys[-1]] = value
    _drop_keys_of_replaced_method(data.get("fem"), result.get("fem"))
    return result


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
    slip = implausible(scene, scene.plausibility.accept)
    if slip is not None:
        raise InputError(f"{source}: {slip}")
    size = too_large(scene)
    if size is not None:
        raise InputError(f"{source}: {size}")
    return scene
