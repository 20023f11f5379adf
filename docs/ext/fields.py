"""What the sections of scenes say about themselves: keys, types, ranges, defaults, docstrings.

Sections are pydantic models or dataclasses; the docstring below a field is its description.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import re
import types
import typing
from collections.abc import Iterator
from functools import cache
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from validation.scene.keys.quantities import field_docstrings

#: A unit in brackets; a section in backticks is none.
_UNIT = re.compile(r"\s*(?<!`)\[([^\]\[]{1,12})\](?!`)")
_BOUNDS = (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))


@dataclasses.dataclass(frozen=True)
class Key:
    """One key of a section."""

    name: str
    section: type | None
    """Class of the section below it, where it is one."""
    many: bool
    """Whether it is a list of sections: ``[[name]]``."""
    type: str
    """Type and range in words."""
    default: str
    """As TOML; ``required`` or ``absent``."""
    unit: str
    about: str


def is_section(annotation: Any) -> bool:
    """Whether a type is a section with keys of its own."""
    return inspect.isclass(annotation) and (
        issubclass(annotation, BaseModel) or dataclasses.is_dataclass(annotation)
    )


@cache
def keys(section: type) -> tuple[Key, ...]:
    """Return the keys of a section in the order in which they are stated."""
    return tuple(_keys(section))


def _keys(section: type) -> Iterator[Key]:
    hints = typing.get_type_hints(section, include_extras=True)
    about = field_docstrings(section)
    for name, default in _defaults(section):
        inner, many = _section_of(hints[name])
        words = about.get(name, "")
        unit = _UNIT.findall(words)
        yield Key(
            name=name,
            section=inner,
            many=many,
            type="section" if inner else " or ".join(dict.fromkeys(_words(hints[name]))),
            default=_toml(default),
            unit=unit[-1].replace("-", "–") if unit else "",
            about=_prose(words),
        )


def _defaults(section: type) -> Iterator[tuple[str, Any]]:
    """Names of the fields and their defaults; PydanticUndefined where there is none."""
    if issubclass(section, BaseModel):
        for name, field in section.model_fields.items():
            made = field.default_factory_takes_validated_data  # from what other sections say
            yield name, None if made else field.get_default(call_default_factory=True)
        return
    for plain in dataclasses.fields(section):
        if plain.name.startswith("_") or not plain.init:
            continue
        if plain.default_factory is not dataclasses.MISSING:
            yield plain.name, plain.default_factory()
        else:
            missing = plain.default is dataclasses.MISSING
            yield plain.name, PydanticUndefined if missing else plain.default


def _section_of(annotation: Any) -> tuple[type | None, bool]:
    """Section that a key holds, and whether it holds many."""
    if is_section(annotation):
        return annotation, False
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _section_of(inner[0])
    if origin in (tuple, list):
        result, _ = _section_of(inner[0]) if inner else (None, False)
        return result, result is not None
    if origin is dict:
        return _section_of(inner[1])[0], False
    if origin in (typing.Union, types.UnionType):
        sections = [_section_of(part) for part in inner]
        return next(((s, many) for s, many in sections if s), (None, False))
    return None, False


def _words(annotation: Any, bounds: str = "") -> list[str]:  # noqa: PLR0911 - one per kind
    """Types in words, alternatives one by one."""
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _words(inner[0], _range(inner[1:]))
    if origin is typing.Literal:
        return [f"`{_toml(value)}`" for value in inner]
    if origin in (typing.Union, types.UnionType):
        return [word for part in inner if part is not type(None) for word in _words(part, bounds)]
    if origin in (tuple, list):
        return [_list_words(inner)]
    if origin is dict:
        return [f"table of {' or '.join(_words(inner[1]))}"]
    if inspect.isclass(annotation) and issubclass(annotation, enum.Enum):
        return [f"`{_toml(member.value)}`" for member in annotation]
    plain = {float: "number", int: "whole number", str: "text", bool: "true or false"}
    return [(plain.get(annotation, getattr(annotation, "__name__", str(annotation))) + bounds)]


def _list_words(inner: tuple[Any, ...]) -> str:
    if inner[-1:] == (Ellipsis,) or len(inner) == 1:
        return f"list of {' or '.join(_words(inner[0]))}"
    return f"{len(inner)} × {' or '.join(_words(inner[0]))}"


def _range(metadata: tuple[Any, ...]) -> str:
    """Bounds in words: `` > 0``."""
    parts: list[str] = []
    for entry in metadata:
        for item in entry.metadata if isinstance(entry, FieldInfo) else (entry,):
            for name, sign in _BOUNDS:
                value = getattr(item, name, None)
                if value is not None:
                    parts.append(f"{sign} {value:g}")
    return " " + ", ".join(dict.fromkeys(parts)) if parts else ""


def _toml(value: Any) -> str:  # noqa: PLR0911 - one per kind
    """Write a default as a scene would."""
    if value is PydanticUndefined:
        return "required"
    if value is None or value in ((), {}):
        return "absent"
    if isinstance(value, enum.Enum):
        value = value.value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(v) for v in value)}]"
    if isinstance(value, float | int):
        return f"{value:g}" if isinstance(value, int) else repr(value)
    return "as its keys"


def _prose(words: str) -> str:
    """Docstring markup as Markdown, in one line, safe in a table."""
    return _UNIT.sub("", words).replace(" .", ".").replace(" ;", ";").replace("``", "`").replace(
        "|", "\\|"
    ).strip(" .") + ("." if len(words.split()) > 3 else "")
