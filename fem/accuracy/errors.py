"""Rules for error bars: what the changes between refinements say of the last value.

If the error of a value falls by a factor R from one mesh to another one, that of the second is the
change between them over R - 1. Changes may vanish by chance and coarse meshes need not be in their
asymptotic range: so earlier meshes are asked too, the largest estimate counts, and a factor of
safety comes on top (as in Roache's grid convergence index).

Coarser meshes of a stated one have assumed factors (`error_bar`). Meshes of a ladder have the
factor by which the last two changes fell, within bounds (`falling_bar`): changes that do not fall
give a wide bar, and one small change after a large one is no convergence.

Reference: P. J. Roache, Perspective: a method for uniform reporting of grid refinement studies,
J. Fluids Eng. 116 (1994) 405-413.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

#: Factor of safety; `tests/verification/error_bars.py` measures how often it suffices.
SAFETY = 1.5
#: Factor that errors are taken to fall by at most where changes alternate in sign.
ALTERNATING = 2.0


def error_bar(
    values: Sequence[Any], reductions: Sequence[float], size: Callable[[Any], float] = abs
) -> float:
    """Estimated error of the last of some values.

    Parameters
    ----------
    values
        Of the refinements in any order, the one whose error is asked for last: numbers, or arrays
        of whose changes there is a size.
    reductions
        Factor by which the error of each of the others exceeds that of the last: more than 1 of
        coarser meshes, less of finer ones.
    size
        Size of a change.
    """
    changes = [
        size(values[-1] - value) / abs(reduction - 1.0)
        for value, reduction in zip(values[:-1], reductions, strict=True)
    ]
    return SAFETY * max(changes)


class Falls(NamedTuple):
    """Factors by which an error is taken to fall from one mesh of a ladder to the next."""

    least: float
    """Where changes fall by less, or nothing is known of them."""
    most: float
    """Where changes fall by more."""


def falling_bar(values: Sequence[float], falls: Falls) -> float:
    """Estimated error of the last of some values on finer and finer meshes.

    With R the factor by which the last change is smaller than the one before, within bounds, it is
    the safety times the larger of the last change over R - 1 and of the change over both meshes
    over most² - 1. Changes of alternating sign are no sequence whose limit is known by its factor:
    R is then at most `ALTERNATING`.

    Parameters
    ----------
    values
        From the coarsest to the finest mesh, two or more.
    falls
        Bounds of R, more than 1.
    """
    change = values[-1] - values[-2]
    if len(values) == 2:
        return error_bar(values, [falls.least])
    before = values[-2] - values[-3]
    most = min(falls.most, ALTERNATING) if before * change < 0.0 else falls.most
    seen = abs(before / change) if change else most
    fall = min(max(seen, falls.least), most)
    return error_bar(values[-3:], [falls.most**2, fall])
