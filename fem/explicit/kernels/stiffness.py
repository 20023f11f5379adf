# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Internal force of all copies: one sparse stiffness times many displacements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import over_lanes, serial_and_parallel
from fem.explicit.kernels.lanes import entry, lane_operations, multiply_add
from fem.explicit.kernels.options import OPTIONS
from fem.explicit.kernels.triples import cross, store_triple, triple_operations
from geometry.compilation import njit


def _product_lanes(width: int) -> Callable[..., Any]:
    """Make the product of one block row with ``width`` copies from lane ``first`` on."""
    load, zero = lane_operations(width)
    load_triple, add_triple = triple_operations(width)

    @njit(**OPTIONS)
    def run(first, lanes, row, start, stop, column, blocks, displacement, force, torque, chunk):
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
        at = row * 3 * lanes + first
        store_triple(force, at, lanes, (fx, fy, fz))
        if torque is not None:
            moment = cross(load_triple(displacement, at, lanes), (fx, fy, fz))
            add_triple(torque, chunk * 3 * lanes + first, lanes, moment)

    return run


_row_product = over_lanes(_product_lanes, 32)
_load_4, _zero_4 = lane_operations(4)


@njit(**OPTIONS)
def _single_row(row, start, stop, column, blocks, displacement, force, torque, chunk):
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
    total = by_x + by_y + by_z
    at = 3 * row
    f = entry(total, 0), entry(total, 1), entry(total, 2)
    force[at], force[at + 1], force[at + 2] = f
    if torque is not None:
        moment = cross((displacement[at], displacement[at + 1], displacement[at + 2]), f)
        for j in range(3):
            torque[3 * chunk + j] += moment[j]


@njit(**OPTIONS)
def _product_chunk(c, chunks, pointer, column, blocks, displacement, force, torque, lanes):
    if torque is not None:
        torque[3 * c * lanes : 3 * (c + 1) * lanes] = 0.0
    for row in range(chunks[c], chunks[c + 1]):
        start, stop = pointer[row], pointer[row + 1]
        if lanes == 1:
            _single_row(row, start, stop, column, blocks, displacement, force, torque, c)
        else:
            _row_product(0, lanes, row, start, stop, column, blocks, displacement, force, torque, c)


@serial_and_parallel
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
    for c in prange(len(chunks) - 1):
        _product_chunk(c, chunks, pointer, column, blocks, displacement, force, torque, lanes)
