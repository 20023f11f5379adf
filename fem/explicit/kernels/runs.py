# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Loads and supports: work on the few entries of a flat array that they touch.

The entries are sorted by position and given as runs of neighbours
(`fem.explicit.kernels.layout.Runs`): neighbouring copies of a loaded node lie side by side, so a
run is worked with vectors, and memory is read in the order in which it lies.
"""

from __future__ import annotations

from fem.explicit.kernels.lanes import add_to, entry, lane_operations, multiply_add
from fem.explicit.kernels.options import OPTIONS
from geometry.compilation import njit

#: Entries that are worked together: a fixed number, whatever the vectors of the processor hold,
#: since `dot_at` has as many partial sums.
_WIDTH = 8

_load, _zero = lane_operations(_WIDTH)


@njit(cache=True, **OPTIONS)
def add_at(target, start, pointer, values, factor):
    """``target[start[r] + k] += factor · values[pointer[r] + k]`` along every run r.

    Parameters
    ----------
    target
        Flat array.
    start, pointer
        Of the runs; an entry that occurs twice is in two runs and adds up.
    values
        (n,), run after run.
    factor
        Scalar.
    """
    for r in range(len(start)):
        at, first, stop = start[r], pointer[r], pointer[r + 1]
        while first + _WIDTH <= stop:
            add_to(target, at, factor * _load(values, first))
            first += _WIDTH
            at += _WIDTH
        for k in range(stop - first):
            target[at + k] += factor * values[first + k]


@njit(cache=True, **OPTIONS)
def dot_at(array, start, pointer, values):
    """Sum of ``array[start[r] + k] · values[pointer[r] + k]`` over all runs."""
    sums = _zero()
    total = 0.0
    for r in range(len(start)):
        at, first, stop = start[r], pointer[r], pointer[r + 1]
        while first + _WIDTH <= stop:
            sums = multiply_add(_load(array, at), _load(values, first), sums)
            first += _WIDTH
            at += _WIDTH
        for k in range(stop - first):
            total += array[at + k] * values[first + k]
    for k in range(_WIDTH):
        total += entry(sums, k)
    return total


@njit(cache=True, **OPTIONS)
def hold(start, pointer, mass, loss, displacement, velocity):
    """Put held components back to zero after an `update`.

    Parameters
    ----------
    start, pointer
        Runs of held components.
    mass
        Of their nodes, (n,) [t].
    loss
        α Δt / 2 of the mass-proportional damping, or None.
    displacement, velocity
        Flat arrays.

    Returns
    -------
    float
        What to add to the dissipation of the mass damping, which `update` took with the
        velocity before this correction.
    """
    lost = 0.0
    for r in range(len(start)):
        at, first = start[r], pointer[r]
        length = pointer[r + 1] - first
        if loss is not None:
            for k in range(length):
                lost -= 0.5 * loss * mass[first + k] * velocity[at + k] ** 2
        displacement[at : at + length] = 0.0
        velocity[at : at + length] = 0.0
    return lost
