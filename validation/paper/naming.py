"""Things with names, and those among them that a person asked for."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, TypeVar

from validation.errors import InputError


class Named(Protocol):
    """A claim or an erratum."""

    @property
    def name(self) -> str:
        """By which it is asked for."""


T = TypeVar("T", bound=Named)


def chosen_by_name(items: Iterable[T], names: list[str] | None, kind: str) -> list[T]:
    """Return the items of some names, in that order, or all of them."""
    known = {item.name: item for item in items}
    for name in names or ():
        if name not in known:
            raise InputError(f"{kind} {name!r}: expected one of {', '.join(known)}")
    return [known[name] for name in names or known]
