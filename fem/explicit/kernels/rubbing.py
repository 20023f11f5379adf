"""Friction constants of all points, or of each: decided where a kernel is compiled."""

# mypy: disable-error-code="untyped-decorator,no-untyped-def"

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.extending import overload


def rubs_of(friction: Any, which: int) -> Any:
    """Coefficient and stick stiffness, from those of all, (2,), or of each, (n, 2).

    Two numbers: an array would count references in the loops.
    """
    own = friction if friction.ndim == 1 else friction[which]
    return own[0], own[1]


@overload(rubs_of, inline="always")
def _rubs_of(friction, which) -> Callable[..., Any]:  # noqa: ARG001 - types, not values
    if friction.ndim == 1:
        return lambda friction, which: (friction[0], friction[1])  # noqa: ARG005
    return lambda friction, which: (friction[which, 0], friction[which, 1])
