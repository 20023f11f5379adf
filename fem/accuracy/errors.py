"""Rules for error bars: what the changes between refinements say of the last value.

If the error of a value falls by a factor R from one mesh to another one, that of the second is the
change between them over R - 1. Changes may vanish by chance and coarse meshes need not be in their
asymptotic range: so earlier meshes are asked too, the largest estimate counts, and a factor of
safety comes on top (as in Roache's grid convergence index).

Factors are those of the meshes: a power of the size of their elements, over the square of the
degree in a sequence of growing degree (`sequence_bar`). Errors at edges fall so: the h-p-version
converges by h over p² where a solution is not smooth.

References: P. J. Roache, Perspective: a method for uniform reporting of grid refinement studies,
J. Fluids Eng. 116 (1994) 405-413; I. Babuška, M. Suri, The h-p version of the finite element method
with quasiuniform meshes, ESAIM: M2AN 21 (1987) 199-238.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

#: Factor of safety, and that of a sequence of meshes, as Roache's for three of them;
#: `tests/verification/error_bars.py` measures how often they suffice.
SAFETY, OF_SEQUENCES = 1.5, 1.25
#: Meshes whose fineness differs by a smaller share are as fine.
_SAME = 1e-6


def error_bar(
    values: Sequence[Any],
    reductions: Sequence[float],
    size: Callable[[Any], float] = abs,
    safety: float = SAFETY,
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
    safety
        Factor of safety.
    """
    changes = [
        size(values[-1] - value) / abs(reduction - 1.0)
        for value, reduction in zip(values[:-1], reductions, strict=True)
    ]
    return safety * max(changes)


def sequence_bar(values: Sequence[float], fineness: Sequence[float], rate: float) -> float:
    """Estimated error of the last of some values on finer and finer meshes.

    Both meshes before it are compared, so that one agreement by chance is no convergence. One that
    is as fine says nothing.

    Parameters
    ----------
    values
        From the coarsest to the finest mesh, two or more.
    fineness
        Of each mesh: squared degree over the length of the shortest elements.
    rate
        Power of the fineness by which the error falls.
    """
    before = [
        (value, (fineness[-1] / of) ** rate)
        for value, of in zip(values[-3:-1], fineness[-3:-1], strict=True)
        if fineness[-1] > (1.0 + _SAME) * of
    ]
    if not before:
        return 0.0
    compared = [value for value, _ in before]
    reductions = [reduction for _, reduction in before]
    return error_bar([*compared, values[-1]], reductions, safety=OF_SEQUENCES)
