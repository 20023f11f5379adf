# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Vectors of space, (x, y, z), whose components are scalars or lanes.

Tuples stay in registers, where small arrays would go through memory.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from fem.explicit.kernels.forms import OPTIONS
from fem.explicit.kernels.lanes import lane_operations, multiply_add, store
from geometry.compilation import njit

#: For what a loop does to every node or facet: vectors then stay in registers.
INLINED = {**OPTIONS, "forceinline": True}


@njit(**INLINED)
def plus(a, b):
    """Sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(**INLINED)
def minus(a, b):
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**INLINED)
def times(factor, a):
    """Multiple of a."""
    return factor * a[0], factor * a[1], factor * a[2]


@njit(**INLINED)
def cross(a, b):
    """Vector product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**INLINED)
def dot(a, b):
    """Scalar product a · b, of lanes."""
    return multiply_add(a[0], b[0], multiply_add(a[1], b[1], a[2] * b[2]))


@njit(**INLINED)
def turned(m, a):
    """Product M a with m[i, j] scalars, of lanes."""
    return (
        multiply_add(m[0, 0], a[0], multiply_add(m[0, 1], a[1], m[0, 2] * a[2])),
        multiply_add(m[1, 0], a[0], multiply_add(m[1, 1], a[1], m[1, 2] * a[2])),
        multiply_add(m[2, 0], a[0], multiply_add(m[2, 1], a[1], m[2, 2] * a[2])),
    )


@njit(**INLINED)
def turned_back(m, a):
    """Product Mᵀ a with m[i, j] scalars, of lanes."""
    return (
        multiply_add(m[0, 0], a[0], multiply_add(m[1, 0], a[1], m[2, 0] * a[2])),
        multiply_add(m[0, 1], a[0], multiply_add(m[1, 1], a[1], m[2, 1] * a[2])),
        multiply_add(m[0, 2], a[0], multiply_add(m[1, 2], a[1], m[2, 2] * a[2])),
    )


@njit(**INLINED)
def triple_of(array, row):
    """Row of an array (n, 3), scalars."""
    return array[row, 0], array[row, 1], array[row, 2]


@njit(**INLINED)
def store_triple(array, at, stride, a):
    """Write lanes from ``at`` on, components ``stride`` apart."""
    store(array, at, a[0])
    store(array, at + stride, a[1])
    store(array, at + 2 * stride, a[2])


class TripleOperations(NamedTuple):
    """What depends on the width of the lanes; ``at`` and ``stride`` count scalars."""

    load: Callable[..., Any]
    """``load(array, at, stride)``: components from ``at`` on, ``stride`` apart."""
    add: Callable[..., Any]
    """``add(array, at, stride, a)``: add lanes to an array."""


def triple_operations(width: int) -> TripleOperations:
    """Operations on arrays of triples of ``width`` lanes."""
    load, _ = lane_operations(width)

    @njit(**INLINED)
    def load_triple(array, at, stride):
        return load(array, at), load(array, at + stride), load(array, at + 2 * stride)

    @njit(**INLINED)
    def add_triple(array, at, stride, a):
        store_triple(array, at, stride, plus(load_triple(array, at, stride), a))

    return TripleOperations(load_triple, add_triple)
