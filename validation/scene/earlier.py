"""Scenes of earlier versions, as this one has them: keys that moved, keys that say nothing now."""

from __future__ import annotations

import copy
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from validation.scene.deformable import METHODS, keys_of_other
from validation.scene.keys.toml_text import toml_text
from validation.scene.read import check_scene, read_text, scene_data

#: Where keys of earlier versions are now.
MOVED = {
    "load.gravity": "effects.gravity",
    "load.density": "material.density",
    "rigid.friction": "effects.friction",
}
#: Keys without a meaning now.
GONE = (
    "fem.formulation",
    "fem.precision",
    "load.temperature",
    "effects.temperature",
    "material.expansion",
)


@dataclass(frozen=True)
class CheckedScene:
    """A scene that this version reads."""

    text: str
    """Of the file, or of the new one."""
    data: dict[str, Any]
    changes: tuple[str, ...]
    """What is new in it; none: the file is read as it is."""


def check_earlier(path: Path) -> CheckedScene:
    """Read a scene of this version or of an earlier one.

    Raises
    ------
    InputError
        What this version does not have, and no other key says.
    """
    _, data = scene_data(str(path))
    text = read_text(path, "a scene in TOML")
    new, lines = copy.deepcopy(data), text
    changes = []
    for old, to in _changes(data):
        value = _taken(new, old)
        if to is None:
            changes.append(f"{old} is left out")
        else:
            section, key = to.split(".")
            new.setdefault(section, {}).setdefault(key, value)
            changes.append(f"{old} is {to}")
        known = to is None or to.split(".")[1] not in data.get(to.split(".")[0], {})
        lines = _changed_lines(lines, old, to if known else None)
    check_scene(new, str(path))
    if changes and not _says(lines, new):  # values over several lines, sections in braces
        lines = toml_text(new)
    return CheckedScene(lines, new, tuple(changes))


def _changes(data: dict[str, Any]) -> list[tuple[str, str | None]]:
    """Keys that a scene has in an old place, with the new one; None: they are left out."""
    found: list[tuple[str, str | None]] = []
    for old in (*MOVED, *GONE):
        section, key = old.split(".")
        if not isinstance(data.get(section), dict) or key not in data[section]:
            continue
        to = MOVED.get(old)
        place, name = ("", "") if to is None else to.split(".")
        stated = data.get(place, {}).get(name) if place else None
        same = stated in (None, data[section][key], {"coefficient": data[section][key]})
        if same:  # two values of one thing: reading it says so
            found.append((old, to))
    fem = data.get("fem")
    method = fem.get("method", "static") if isinstance(fem, dict) else None
    if isinstance(fem, dict) and method in METHODS:
        found += [(f"fem.{key}", None) for key in fem if key in keys_of_other(str(method))]
    return found


def _taken(data: dict[str, Any], key: str) -> Any:
    section, name = key.split(".")
    return data[section].pop(name)


def _changed_lines(text: str, old: str, to: str | None) -> str:
    """Text with the line of a key in its new place, or without it: comments stay."""
    section, key = old.split(".")
    header = rf"^\[{re.escape(section)}\][^\n]*\n"
    found = re.search(
        rf"{header}(?:(?!\[)[^\n]*\n)*?([ \t]*{re.escape(key)}[ \t]*=[^\n]*\n?)", text, re.M
    )
    if found is None:
        return text
    line = found[1] if found[1].endswith("\n") else f"{found[1]}\n"
    text = text[: found.start(1)] + text[found.end(1) :]
    if to is None:
        return text
    place, name = to.split(".")
    line = re.sub(rf"^([ \t]*){re.escape(key)}", rf"\g<1>{name}", line)
    there = re.search(rf"^\[{re.escape(place)}\][^\n]*\n", text, re.M)
    if there is None:
        return f"{text.rstrip()}\n\n[{place}]\n{line}"
    return text[: there.end()] + line + text[there.end() :]


def _says(text: str, data: dict[str, Any]) -> bool:
    try:
        return tomllib.loads(text) == data
    except ValueError:
        return False
