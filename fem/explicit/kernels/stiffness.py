# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Internal force of all copies: one sparse stiffness times many displacements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange

from fem.explicit.kernels.lanes import add, entry, lane_operations, multiply_add, store, subtract
from fem.explicit.kernels.options import OPTIONS
from geometry.compilation import njit


def _row_product(width: int) -> Callable[..., Any]:
    """Make the product of one block row with ``width`` copies from lane ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**OPTIONS)
    def cross_add(total, chunk, a, b, base, first, lanes):
        """Add a × b, (3,) each from ``base`` on, to ``total[chunk]``."""
        ax, bx = load(a, base), load(b, base)
        ay, by = load(a, base + lanes), load(b, base + lanes)
        az, bz = load(a, base + 2 * lanes), load(b, base + 2 * lanes)
        none = zero(a)
        where = chunk * 3 * lanes + first
        cx = subtract(multiply_add(ay, bz, none), multiply_add(az, by, none))
        cy = subtract(multiply_add(az, bx, none), multiply_add(ax, bz, none))
        cz = subtract(multiply_add(ax, by, none), multiply_add(ay, bx, none))
        store(total, where, add(load(total, where), cx))
        store(total, where + lanes, add(load(total, where + lanes), cy))
        store(total, where + 2 * lanes, add(load(total, where + 2 * lanes), cz))

    @njit(**OPTIONS)
    def row_product(
        start, stop, column, blocks, displacement, force, torque, chunk, row, first, lanes
    ):
        fx = zero(displacement)
        fy = zero(displacement)
        fz = zero(displacement)
        for k in range(start, stop):
            node = np.int64(column[k]) * 3 * lanes + first
            u = load(displacement, node)
            fx = multiply_add(blocks[9 * k], u, fx)
            fy = multiply_add(blocks[9 * k + 1], u, fy)
            fz = multiply_add(blocks[9 * k + 2], u, fz)
            u = load(displacement, node + lanes)
            fx = multiply_add(blocks[9 * k + 3], u, fx)
            fy = multiply_add(blocks[9 * k + 4], u, fy)
            fz = multiply_add(blocks[9 * k + 5], u, fz)
            u = load(displacement, node + 2 * lanes)
            fx = multiply_add(blocks[9 * k + 6], u, fx)
            fy = multiply_add(blocks[9 * k + 7], u, fy)
            fz = multiply_add(blocks[9 * k + 8], u, fz)
        base = row * 3 * lanes + first
        store(force, base, fx)
        store(force, base + lanes, fy)
        store(force, base + 2 * lanes, fz)
        if torque is not None:
            cross_add(torque, chunk, displacement, force, base, first, lanes)

    made: Callable[..., Any] = row_product
    return made


_row_product_32 = _row_product(32)
_row_product_16 = _row_product(16)
_row_product_8 = _row_product(8)
_row_product_4 = _row_product(4)
_row_product_2 = _row_product(2)
_load_4, _zero_4 = lane_operations(4)


@njit(**OPTIONS)
def _single_row(start, stop, column, blocks, displacement, force, row):
    """One copy: the lanes are the components of the force, the fourth one is not used.

    Three sums, one per column of the blocks, hide the latency of the additions.
    """
    by_x = _zero_4(displacement)
    by_y = _zero_4(displacement)
    by_z = _zero_4(displacement)
    for k in range(start, stop):
        node = 3 * np.int64(column[k])
        by_x = multiply_add(displacement[node], _load_4(blocks, 9 * k), by_x)
        by_y = multiply_add(displacement[node + 1], _load_4(blocks, 9 * k + 3), by_y)
        by_z = multiply_add(displacement[node + 2], _load_4(blocks, 9 * k + 6), by_z)
    total = add(add(by_x, by_y), by_z)
    force[3 * row] = entry(total, 0)
    force[3 * row + 1] = entry(total, 1)
    force[3 * row + 2] = entry(total, 2)


@njit(**OPTIONS)
def _single_rows(begin, end, pointer, column, blocks, u, force, torque, chunk):
    for row in range(begin, end):
        _single_row(pointer[row], pointer[row + 1], column, blocks, u, force, row)
        if torque is not None:
            k = 3 * row
            torque[3 * chunk] += u[k + 1] * force[k + 2] - u[k + 2] * force[k + 1]
            torque[3 * chunk + 1] += u[k + 2] * force[k] - u[k] * force[k + 2]
            torque[3 * chunk + 2] += u[k] * force[k + 1] - u[k + 1] * force[k]


@njit(**OPTIONS)
def _product_rows(begin, end, pointer, column, blocks, displacement, force, torque, chunk, lanes):
    for row in range(begin, end):
        start, stop = pointer[row], pointer[row + 1]
        at = 0
        while at + 32 <= lanes:
            _row_product_32(
                start, stop, column, blocks, displacement, force, torque, chunk, row, at, lanes
            )
            at += 32
        while at + 16 <= lanes:
            _row_product_16(
                start, stop, column, blocks, displacement, force, torque, chunk, row, at, lanes
            )
            at += 16
        if at + 8 <= lanes:
            _row_product_8(
                start, stop, column, blocks, displacement, force, torque, chunk, row, at, lanes
            )
            at += 8
        if at + 4 <= lanes:
            _row_product_4(
                start, stop, column, blocks, displacement, force, torque, chunk, row, at, lanes
            )
            at += 4
        if at + 2 <= lanes:
            _row_product_2(
                start, stop, column, blocks, displacement, force, torque, chunk, row, at, lanes
            )


@njit(**OPTIONS)
def _product_chunk(c, chunks, pointer, column, blocks, displacement, force, torque, lanes):
    if torque is not None:
        torque[3 * c * lanes : 3 * (c + 1) * lanes] = 0.0
    if lanes == 1:
        _single_rows(
            chunks[c], chunks[c + 1], pointer, column, blocks, displacement, force, torque, c
        )
    else:
        _product_rows(
            chunks[c], chunks[c + 1], pointer, column, blocks, displacement, force, torque, c, lanes
        )


@njit(cache=True, **OPTIONS)
def stiffness_product(chunks, pointer, column, blocks, displacement, force, torque, lanes):
    """Internal force K u of every copy; overwrites ``force``.

    Parameters
    ----------
    chunks, pointer, column, blocks
        The packed stiffness (`fem.explicit.kernels.layout.BlockRows`).
    displacement, force
        Flat views of (n_rows, 3, lanes).
    torque
        None, or flat (n_chunks, 3, lanes): partial sums of u × K u.
    lanes
        Padded number of copies.
    """
    for c in range(len(chunks) - 1):
        _product_chunk(c, chunks, pointer, column, blocks, displacement, force, torque, lanes)


@njit(cache=True, parallel=True, **OPTIONS)
def stiffness_product_parallel(chunks, pointer, column, blocks, displacement, force, torque, lanes):
    """`stiffness_product` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _product_chunk(c, chunks, pointer, column, blocks, displacement, force, torque, lanes)
