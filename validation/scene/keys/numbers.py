"""Numbers that a section has, with unit and bound."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from annotated_types import Ge
from pydantic import BaseModel

from validation.scene.keys.docstrings import field_docstrings
from validation.scene.keys.quantities import unit_of


@dataclass(frozen=True)
class Number:
    """A number of a scene."""

    key: str
    """Place in the scene, such as ``block.amplitude``; of a vector with the number of its part."""
    title: str
    unit: str
    """Empty where it has none."""
    value: float
    least: float | None
    """Least value; None: there is no bound."""


def numbers_in(section: Any, place: str) -> Iterator[Number]:
    """Numbers of a section or of a list of them, parts of vectors too."""
    if isinstance(section, tuple):
        for k, one in enumerate(section):
            yield from numbers_in(one, f"{place}.{k}")
    if not isinstance(section, BaseModel):
        return
    about = field_docstrings(type(section))
    for name, field in type(section).model_fields.items():
        value, unit = section.__dict__[name], unit_of(about.get(name, ""))
        bounds = [float(part.ge) for part in field.metadata if isinstance(part, Ge)]  # type: ignore[arg-type]
        title, least = name.replace("_", " "), min(bounds, default=None)
        vector = isinstance(value, tuple) and all(isinstance(v, float) for v in value)
        if isinstance(value, tuple) and not vector:
            yield from numbers_in(value, f"{place}.{name}")
        for k, part in enumerate(value if vector else (value,)):
            key = f"{place}.{name}.{k}" if vector else f"{place}.{name}"
            words = f"{title} {'xyz'[k % 3]}" if vector else title
            if isinstance(part, int | float) and not isinstance(part, bool):
                yield Number(key, words, "" if unit is None else unit.name, part, least)
