# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Loads and supports: work on the few entries of a flat array that they touch.

The entries are sorted by position and given as runs of neighbours
(`fem.explicit.kernels.layout.Runs`): neighbouring copies of a loaded node lie side by side, so a
run is worked with vectors, and memory is read in the order in which it lies.
"""

from __future__ import annotations

from fem.explicit.kernels.forms import OPTIONS
from fem.explicit.kernels.lanes import add_to, entry, lane_operations, multiply_add
from geometry.compilation import njit

#: Entries that are worked together.
_WIDTH = 8

_load, _ = lane_operations(_WIDTH)
_load_4, _zero_4 = lane_operations(4)


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
def dot_rows(a, row_a, b, row_b, size):
    """Sum of products of rows of ``size`` entries of two flat arrays."""
    sums = _zero_4()
    total = 0.0
    for n in range(len(row_a)):
        at_a, at_b = row_a[n] * size, row_b[n] * size
        whole = size // 4 * 4
        for k in range(0, whole, 4):
            sums = multiply_add(_load_4(a, at_a + k), _load_4(b, at_b + k), sums)
        for k in range(whole, size):
            total += a[at_a + k] * b[at_b + k]
    return total + entry(sums, 0) + entry(sums, 1) + entry(sums, 2) + entry(sums, 3)


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
