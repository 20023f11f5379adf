"""What is stated and judged: claims and errata of the paper, laws of robustness."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from validation.errors import InputError


@dataclass(frozen=True)
class Statement:
    """A statement and how it is judged."""

    name: str
    """Short, for the command line."""
    text: Mapping[str, str]
    """Of a claim ``statement`` and ``place``, of an erratum what is ``printed`` and ``meant``, of a
    robustness case its ``subject`` and its ``law``."""
    judge: Callable[..., Any]
    """Computes and judges; those of the paper take what was computed for it."""
    deformable: bool = False
    """Whether the deformable runs are needed."""
    of_turn: bool = False
    """Whether the layers' turn may decide: judged with the half-block turn too."""
    slow: bool = False
    """Whether it takes more than three CPU seconds once everything is compiled."""

    def as_json(self) -> dict[str, Any]:
        """Return name and text as plain data."""
        return {"name": self.name, **self.text}


def chosen_by_name(
    items: Iterable[Statement], names: Sequence[str] | None, place: str, more: str = ""
) -> list[Statement]:
    """Return statements of some names or subjects, in the order of these, or all of them.

    An unknown one is rejected by the name of its ``place``; ``more`` ends that line.
    """
    every = list(items)
    if not names:
        return every
    by_name: dict[str, list[Statement]] = {}
    for item in every:
        for name in (item.name, item.text.get("subject", item.name)):
            by_name.setdefault(name, []).append(item)
    for name in names:
        if name not in by_name:
            subjects = sorted({i.text["subject"] for i in every if "subject" in i.text})
            known = ", ".join(subjects or by_name)
            kinds = "a case or one of the subjects" if subjects else "one of"
            raise InputError(f"{place}: got {name!r}; expected {kinds} {known}{more}")
    return list({item.name: item for name in names for item in by_name[name]}.values())
