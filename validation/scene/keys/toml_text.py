"""Scenes as TOML text, and their keys."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

#: Sections that a reader looks for first.
_FIRST = ("block", "assembly", "mesh", "load")


def toml_value(value: Any) -> str:
    """Value as TOML, on one line."""
    if isinstance(value, Mapping):
        pairs = (f"{toml_key(k)} = {toml_value(v)}" for k, v in value.items() if v is not None)
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if hasattr(value, "tolist"):
        return toml_value(value.tolist())
    return json.dumps(value, ensure_ascii=False, default=str)


def toml_key(key: str) -> str:
    """Key as TOML, quoted where it is not bare."""
    bare = key and all(c.isascii() and (c.isalnum() or c in "-_") for c in key)
    return key if bare else json.dumps(key, ensure_ascii=False)


def toml_text(data: Mapping[str, Any]) -> str:
    """Scene as TOML: values and lists first, then a section for each mapping."""
    order = sorted(data, key=lambda key: _FIRST.index(key) if key in _FIRST else len(_FIRST))
    stated = {key: data[key] for key in order if data[key] is not None}
    plain = [f"{toml_key(k)} = {toml_value(v)}" for k, v in stated.items() if not _section(v)]
    lines = [*plain, ""] if plain else []
    for name, section in stated.items():
        if _section(section):
            pairs = (
                f"{toml_key(k)} = {toml_value(v)}" for k, v in section.items() if v is not None
            )
            lines += [f"[{toml_key(name)}]", *pairs, ""]
    return "\n".join(lines)


def _section(value: Any) -> bool:
    return isinstance(value, Mapping)


def is_range(given: Any) -> bool:
    """Whether a value states a range of values."""
    return isinstance(given, Mapping) and ("from" in given or "to" in given)


def flat(data: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """``section.key`` and value, from quoted keys and from nested tables alike."""
    for key, value in data.items():
        place = (*above, key)
        if isinstance(value, Mapping) and not is_range(value):
            yield from flat(value, place)
        else:
            yield ".".join(place), value
