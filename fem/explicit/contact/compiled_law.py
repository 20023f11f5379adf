"""Contact laws for compiled functions: constants of one law, or a row for each point."""

# mypy: disable-error-code="untyped-decorator,no-untyped-def"

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from fem.contact.law import ContactLaw, LawConstants
from fem.contact.pair_laws import LawOfPoints
from geometry.mesh import FloatArray


def law_at(law: Any, which: int) -> LawConstants:
    """Constants of one facet or point, from those of all or from a table (n, 7)."""
    return law if isinstance(law, LawConstants) else LawConstants(*law[which])


@overload(law_at, inline="always")
def _law_at(law, which) -> Callable[..., Any]:  # noqa: ARG001 - types, not values
    if isinstance(law, types.Array):
        return lambda law, which: LawConstants(
            law[which, 0],
            law[which, 1],
            law[which, 2],
            law[which, 3],
            law[which, 4],
            law[which, 5],
            law[which, 6],
        )
    return lambda law, which: law  # noqa: ARG005


def compiled_law(law: ContactLaw, clearance: float) -> LawConstants | FloatArray:
    """Constants for kernels, in terms of overclosure plus clearance: a gap n · d of zero is open.

    Of one law `LawConstants`, of `LawOfPoints` a row for each facet or point, (n, 7).
    """
    if isinstance(law, LawOfPoints):
        moved = np.zeros(len(LawConstants._fields))
        moved[[LawConstants._fields.index(name) for name in ("start", "linear_start")]] = clearance
        return law.table + moved
    constants = law.constants
    return constants._replace(
        start=constants.start + clearance, linear_start=constants.linear_start + clearance
    )
