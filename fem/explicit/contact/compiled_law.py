"""Contact laws for compiled functions: constants of one law, or a row for each point."""

# mypy: disable-error-code="untyped-decorator,no-untyped-def"

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from fem.contact.friction import Coulomb
from fem.contact.law import LawConstants
from fem.contact.pair_laws import LawOfPoints
from geometry.mesh import FloatArray


def law_at(law: Any, which: int) -> LawConstants:
    """Constants of one facet or point, from those of all or from a table (n, 9)."""
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
            law[which, 7],
            law[which, 8],
        )
    return lambda law, which: law  # noqa: ARG005


def compiled_law(law: Coulomb, clearance: float) -> LawConstants | FloatArray:
    """Constants for kernels, in terms of overclosure plus clearance: a gap n · d of zero is open.

    Of one law `LawConstants`, of several or of several coefficients of friction a row for each
    facet or point, (n, 9).
    """
    normal, coefficient = law.normal, np.ravel(law.coefficient)
    several = isinstance(normal, LawOfPoints)
    rows = normal.table if isinstance(normal, LawOfPoints) else np.array([normal.constants])
    rows = rows.copy() if several else np.repeat(rows, len(coefficient), axis=0)
    rows[:, [LawConstants._fields.index(name) for name in ("start", "linear_start")]] += clearance
    rows[:, -2], rows[:, -1] = coefficient, law.stick
    return rows if several or np.ndim(law.coefficient) else LawConstants(*rows[0].tolist())
