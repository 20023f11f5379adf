# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Internal force of all copies: one sparse stiffness times many displacements.

Every row is stored whole, or only the half of it from the diagonal on: then a block K_ij is used
for f_i and, transposed, for f_j, and is loaded once. Both give the same bits, since either way
the sums of a row run over its neighbours in ascending order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import OPTIONS, over_lanes, serial_and_parallel
from fem.explicit.kernels.lanes import (
    REGISTER_DOUBLES,
    entry,
    filled,
    lane_operations,
    multiply_add,
    store,
)
from fem.explicit.kernels.triples import INLINED, cross, plus, store_triple, triple_operations
from geometry.compilation import njit

_load_1, _ = lane_operations(1)


@njit(**INLINED)
def _three(array, at):
    """Three neighbours in a flat array."""
    return (
        entry(_load_1(array, at), 0),
        entry(_load_1(array, at + 1), 0),
        entry(_load_1(array, at + 2), 0),
    )


@njit(**INLINED)
def _grown(f, column, u):
    """F + u times a column of a block."""
    return (
        multiply_add(column[0], u, f[0]),
        multiply_add(column[1], u, f[1]),
        multiply_add(column[2], u, f[2]),
    )


def _sum_of(width: int) -> Callable[..., Any]:
    """Make f + Σ K_ij u_j over some blocks of a row, for ``width`` copies."""
    load, _ = lane_operations(width)

    @njit(**INLINED)
    def grown_by(f, first, lanes, start, stop, column, blocks, displacement):
        for k in range(start, stop):
            node = np.int64(column[k]) * 3 * lanes + first
            f = _grown(f, _three(blocks, 9 * k), load(displacement, node))
            f = _grown(f, _three(blocks, 9 * k + 3), load(displacement, node + lanes))
            f = _grown(f, _three(blocks, 9 * k + 6), load(displacement, node + 2 * lanes))
        return f

    return grown_by


def _whole_lanes(width: int) -> Callable[..., Any]:
    """Make the product of one whole row with ``width`` copies from lane ``first`` on."""
    _, zero = lane_operations(width)
    grown_by = _sum_of(width)

    @njit(**OPTIONS)
    def run(first, lanes, row, start, stop, column, blocks, displacement, force):
        none = zero()
        f = grown_by((none, none, none), first, lanes, start, stop, column, blocks, displacement)
        store_triple(force, row * 3 * lanes + first, lanes, f)

    return run


def _half_lanes(width: int) -> Callable[..., Any]:
    """Make the product of a chunk of half rows with ``width`` copies from lane ``first`` on."""
    load, zero = lane_operations(width)
    load_triple = triple_operations(width).load
    grown_by = _sum_of(width)

    @njit(**INLINED)
    def both_ways(f, u, column, at, displacement, force):
        """Column of a block for the row, and as a row for its neighbour."""
        f = _grown(f, column, load(displacement, at))
        back = multiply_add(column[0], u[0], load(force, at))
        back = multiply_add(column[1], u[1], back)
        store(force, at, multiply_add(column[2], u[2], back))
        return f

    @njit(**OPTIONS)
    def run(first, lanes, begin, end, pointer, shared, column, blocks, displacement, force):
        none = zero()
        for row in range(begin, end):
            # Neighbours of earlier chunks come first, from their side alone.
            start, stop = pointer[row], shared[row, 0]
            f = grown_by(
                (none, none, none), first, lanes, start, stop, column, blocks, displacement
            )
            store_triple(force, row * 3 * lanes + first, lanes, f)
        for row in range(begin, end):
            at = row * 3 * lanes + first
            u = load_triple(displacement, at, lanes)
            diagonal, after = shared[row, 0], shared[row, 1]
            f = load_triple(force, at, lanes)
            f = _grown(f, _three(blocks, 9 * diagonal), u[0])
            f = _grown(f, _three(blocks, 9 * diagonal + 3), u[1])
            f = _grown(f, _three(blocks, 9 * diagonal + 6), u[2])
            for k in range(diagonal + 1, after):
                node = np.int64(column[k]) * 3 * lanes + first
                f = both_ways(f, u, _three(blocks, 9 * k), node, displacement, force)
                f = both_ways(f, u, _three(blocks, 9 * k + 3), node + lanes, displacement, force)
                f = both_ways(
                    f, u, _three(blocks, 9 * k + 6), node + 2 * lanes, displacement, force
                )
            f = grown_by(f, first, lanes, after, pointer[row + 1], column, blocks, displacement)
            store_triple(force, at, lanes, f)

    return run


def _torque_lanes(width: int) -> Callable[..., Any]:
    """Make the growth of a sum of u × f by some rows, for ``width`` copies from ``first`` on."""
    load_triple = triple_operations(width).load

    @njit(**OPTIONS)
    def run(first, lanes, c, begin, end, displacement, force, torque):
        here = c * 3 * lanes + first
        total = load_triple(torque, here, lanes)
        for row in range(begin, end):
            at = row * 3 * lanes + first
            u, f = load_triple(displacement, at, lanes), load_triple(force, at, lanes)
            total = plus(total, cross(u, f))
        store_triple(torque, here, lanes, total)

    return run


# Three sums of four registers, or three sums and three displacements of two, and what is loaded
# beside them: as much as the processor has.
_whole_rows = over_lanes(_whole_lanes, 4 * REGISTER_DOUBLES)
_half_rows = over_lanes(_half_lanes, 2 * REGISTER_DOUBLES)
#: Rows whose displacements and forces are still in the nearest cache when their torque is taken.
_STRIP = 8

_torques = over_lanes(_torque_lanes, REGISTER_DOUBLES)
_load_4, _zero_4 = lane_operations(4)


@njit(**INLINED)
def _lines(blocks, k):
    """Block k as three rows; the fourth lane is not used, here and below."""
    return _load_4(blocks, 9 * k), _load_4(blocks, 9 * k + 3), _load_4(blocks, 9 * k + 6)


@njit(**INLINED)
def _products(sums, lines, u):
    """Entry by entry, one sum for each row of the block."""
    return (
        multiply_add(lines[0], u, sums[0]),
        multiply_add(lines[1], u, sums[1]),
        multiply_add(lines[2], u, sums[2]),
    )


@njit(**INLINED)
def _total(lanes):
    return entry(lanes, 0) + entry(lanes, 1) + entry(lanes, 2)


@njit(**OPTIONS)
def _single_half(c, begin, end, pointer, ring, column, blocks, displacement, force):
    """Product of a chunk of half rows with one copy: lanes are components, not copies.

    What a row sends to later ones waits in a ring until their row comes, or the chunk has ended.
    """
    none = _zero_4()
    size = ring.shape[1]
    base = c * size
    for row in range(begin, end):
        diagonal = pointer[row]
        u = _load_4(displacement, 3 * row)
        x, y, z = filled(u, entry(u, 0)), filled(u, entry(u, 1)), filled(u, entry(u, 2))
        slot = base + (4 * row & size - 1)
        sent = _load_4(ring, slot)
        store(ring, slot, none)
        sums = _products((none, none, none), _lines(blocks, diagonal), u)
        for k in range(diagonal + 1, pointer[row + 1]):
            node = np.int64(column[k])
            lines = _lines(blocks, k)
            sums = _products(sums, lines, _load_4(displacement, 3 * node))
            there = base + (4 * node & size - 1)
            old = multiply_add(lines[2], z, _load_4(ring, there))
            store(ring, there, multiply_add(lines[0], x, multiply_add(lines[1], y, old)))
        force[3 * row] = _total(sums[0]) + entry(sent, 0)
        force[3 * row + 1] = _total(sums[1]) + entry(sent, 1)
        force[3 * row + 2] = _total(sums[2]) + entry(sent, 2)


@njit(**OPTIONS)
def _single_sent(chunks, ring, reach, displacement, force, torque):
    """Add what the rows of a chunk of one copy send to rows of later ones."""
    size = ring.shape[1]
    for c in range(len(chunks) - 2):
        end = chunks[c + 1]
        for row in range(end, min(end + reach, chunks[-1])):
            slot, at = 4 * row & size - 1, 3 * row
            sent = ring[c, slot], ring[c, slot + 1], ring[c, slot + 2]
            for j in range(3):
                force[at + j] += sent[j]
            if torque is not None:
                u = displacement[at], displacement[at + 1], displacement[at + 2]
                moment = cross(u, sent)
                for j in range(3):
                    torque[3 * c + j] += moment[j]


@njit(**OPTIONS)
def _product_chunk(
    c, chunks, pointer, whole, shared, ring, column, blocks, displacement, force, torque, lanes
):
    """Only one of whole, shared and ring is not None: the loops of the others are not compiled."""
    begin, end = chunks[c], chunks[c + 1]
    if torque is not None:
        torque[3 * c * lanes : 3 * (c + 1) * lanes] = 0.0
    strip = end - begin
    if whole is not None:
        # Torques of some rows while they are near, not row by row: registers are too few for both.
        strip = _STRIP
    first = begin
    while first < end:
        after = min(first + strip, end)
        if whole is not None:
            for row in range(first, after):
                start, stop = pointer[row], pointer[row + 1]
                _whole_rows(0, lanes, row, start, stop, column, blocks, displacement, force)
        if ring is not None:
            _single_half(c, first, after, pointer, ring, column, blocks, displacement, force)
        if shared is not None:
            _half_rows(0, lanes, first, after, pointer, shared, column, blocks, displacement, force)
        if torque is not None:
            _torques(0, lanes, c, first, after, displacement, force, torque)
        first = after


@serial_and_parallel
def stiffness_product(
    chunks, pointer, whole, shared, reach, column, blocks, displacement, force, torque, lanes
):
    """Internal force K u of every copy; overwrites ``force``.

    Parameters
    ----------
    chunks, pointer, whole, shared, reach, column, blocks
        The packed stiffness (`fem.explicit.kernels.layout.BlockRows`).
    displacement, force
        Flat views of (n_rows, 3, lanes).
    torque
        None, or flat (n_chunks, 3, lanes): partial sums of u × K u.
    lanes
        Padded number of copies.
    """
    rest = (column, blocks, displacement, force, torque, lanes)
    if reach is None:
        for c in prange(len(chunks) - 1):
            _product_chunk(np.int64(c), chunks, pointer, whole, shared, None, *rest)
    else:
        size = 16
        while size < 4 * (reach + 1):
            size *= 2
        ring = np.zeros((len(chunks) - 1, size), displacement.dtype)
        for c in prange(len(chunks) - 1):
            _product_chunk(np.int64(c), chunks, pointer, None, None, ring, *rest)
        _single_sent(chunks, ring, reach, displacement, force, torque)
