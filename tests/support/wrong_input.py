"""Wrong values by the type of a key."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from functools import cache

import pydantic

from validation import builtin_names, load_case


def keys(model: type[pydantic.BaseModel], start: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every key of a kind of scene, sections too."""
    for name, field in model.model_fields.items():
        yield (*start, name)
        for part in (field.annotation, *typing.get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, pydantic.BaseModel):
                yield from keys(part, (*start, name))


@cache
def kind_of(name: str) -> type[pydantic.BaseModel]:
    return type(load_case(name).scene)


PLACES = [(name, path) for name in builtin_names() for path in keys(kind_of(name))]
