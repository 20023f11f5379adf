"""Options of a method as frozen dataclasses: the ranges of their fields are checked in one place.

A field says its range and unit in its annotation (`annotated_types`): Python, scenes and
``dataclasses.replace`` are checked by the same model, which pydantic makes of the dataclass.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from enum import Enum
from functools import cache
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from annotated_types import Ge, Gt

from geometry.errors import RefusedError

#: A positive length [mm].
Length = Annotated[float, Gt(0)]
#: Zero or more.
NonNegative = Annotated[float, Ge(0)]
#: Edges along x, y, z [mm].
Size = tuple[Length, Length, Length]
#: A number of things, at least one.
Count = Annotated[int, Ge(1)]
#: Elements along x, y, z.
Divisions = tuple[Count, Count, Count]


class OptionError(RefusedError):
    """One line: which option, what was got, what is expected."""


@cache
def option_fields(kind: type) -> dict[str, tuple[Any, Any]]:
    """Annotation and default of each field of a dataclass, as ``pydantic.create_model`` takes."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        field.name: (
            _by_name(hints[field.name]),
            ... if field.default is MISSING else field.default,
        )
        for field in fields(kind)
    }


def _by_name(hint: Any) -> Any:
    """Annotation in which a name stands for its option."""
    from pydantic import Field

    if get_origin(hint) in (Union, UnionType):
        return Union[tuple(map(_by_name, get_args(hint)))]  # noqa: UP007 - made of a tuple
    named = isinstance(hint, type) and issubclass(hint, Enum)
    return Annotated[hint, Field(strict=False)] if named else hint


@cache
def _model(kind: type) -> Any:
    """Model of a dataclass; pydantic is imported when the first one is made."""
    from pydantic import ConfigDict, create_model

    config = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )
    keys: Any = option_fields(kind)
    return create_model(kind.__name__, __config__=config, **keys)


def check(options: Any) -> None:
    """Check a dataclass by the ranges of its fields: what its ``__post_init__`` calls.

    Numbers of numpy become Python's, lists and arrays tuples, names options.

    Raises
    ------
    OptionError
        Naming the field, what was got and what is expected.
    """
    kind: Any = type(options)
    given = vars(options)
    if all(given[field.name] is field.default for field in fields(kind)):
        return
    from pydantic import ValidationError

    model: Any = _model(kind)
    try:
        values = model.model_validate({name: _plain(value) for name, value in given.items()})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name, text = str(first["loc"][0]), str(first["msg"])
        text = text.removeprefix("Input should be ").removeprefix("Value error, ")
        text = text.replace("a valid integer", "a whole number").replace("a valid ", "a ")
        raise OptionError(f"{name}: got {given[name]!r}; expected {text}") from None
    for name in given:
        object.__setattr__(options, name, getattr(values, name))


def _plain(value: Any) -> Any:
    """Value without lists and arrays."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    return tuple(map(_plain, value)) if isinstance(value, list | tuple) else value


@dataclass(frozen=True)
class Options:
    """Base of dataclasses that check their fields."""

    def __post_init__(self) -> None:
        check(self)
