# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Bulk viscosity: stress of the elements, forces of the nodes.

All copies of an element or a row before the next: so memory is read in the order in which it lies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import OPTIONS, over_lanes, serial_and_parallel
from fem.explicit.kernels.lanes import (
    add_to,
    lane_operations,
    multiply_add,
    smaller,
    store,
)
from fem.explicit.kernels.triples import cross, triple_operations
from geometry.compilation import njit


def _pressure_lanes(width: int) -> Callable[..., Any]:
    """Make the viscous stress of an element for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**OPTIONS)
    def run(
        first,
        lanes,
        at_sums,
        e,
        element_rows,
        gradient,
        linear,
        quadratic,
        per_step,
        displacement,
        strain,
        stress,
        dissipated,
    ):
        none = zero()
        # Three sums, one of each component, hide the latency of the additions.
        by_x, by_y, by_z = none, none, none
        for a in range(8):
            g = 24 * e + 3 * a
            node = np.int64(element_rows[8 * e + a]) * 3 * lanes + first
            by_x = multiply_add(gradient[g], load(displacement, node), by_x)
            by_y = multiply_add(gradient[g + 1], load(displacement, node + lanes), by_y)
            by_z = multiply_add(gradient[g + 2], load(displacement, node + 2 * lanes), by_z)
        fresh = by_x + by_y + by_z
        at = e * lanes + first
        change = fresh - load(strain, at)
        rate = per_step * change
        closing = smaller(rate, none)
        q = linear[e] * rate - quadratic[e] * (closing * closing)
        add_to(dissipated, at_sums + first, 0.5 * ((load(stress, at) + q) * change))
        store(strain, at, fresh)
        store(stress, at, q)

    return run


_pressures = over_lanes(_pressure_lanes, 16)


@serial_and_parallel
def viscous_pressure(lanes, chunks, *elements):
    """Bulk viscosity stress of every element and copy (formula in `fem.explicit.body`).

    Parameters
    ----------
    lanes
        Padded number of copies.
    chunks
        Element boundaries.
    elements
        Flat arrays and scalars:

        - element_rows, gradient, linear, quadratic: see
          `fem.explicit.body.ElementViscosity`.
        - per_step: 1/Δt [1/s].
        - displacement: in the block frame, (n_rows, 3, lanes).
        - strain, stress: volumetric strain and volume times viscous stress, (n_elements, lanes),
          updated.
        - dissipated: grows by the work of the mean of old and new stress on the strain increment,
          (n_chunks, ≥ lanes) [N mm].
    """
    own = len(elements[-1]) // (len(chunks) - 1)
    for c in prange(len(chunks) - 1):
        for e in range(chunks[c], chunks[c + 1]):
            _pressures(0, lanes, np.int64(c * own), e, *elements)


def _viscous_lanes(width: int) -> Callable[..., Any]:
    """Make the viscous nodal force of a row for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)
    load_triple, add_triple = triple_operations(width)

    @njit(**OPTIONS)
    def run(first, lanes, c, i, displacement, force, torque, pointer, corner, gradient, stress):
        none = zero()
        fx, fy, fz = none, none, none
        for n in range(pointer[i], pointer[i + 1]):
            k = np.int64(corner[n])
            q = load(stress, (k >> 3) * lanes + first)
            fx = multiply_add(gradient[3 * k], q, fx)
            fy = multiply_add(gradient[3 * k + 1], q, fy)
            fz = multiply_add(gradient[3 * k + 2], q, fz)
        at = i * 3 * lanes + first
        add_triple(force, at, lanes, (fx, fy, fz))
        if torque is not None:
            moment = cross(load_triple(displacement, at, lanes), (fx, fy, fz))
            add_triple(torque, c * 3 * lanes + first, lanes, moment)

    return run


_viscous = over_lanes(_viscous_lanes, 16)


@serial_and_parallel
def add_viscous_force(lanes, chunks, *rows):
    """Add the nodal forces of the bulk viscosity, row by row.

    Parameters
    ----------
    lanes
        Padded number of copies.
    chunks
        Row boundaries.
    rows
        Flat arrays:

        - displacement, force: in the block frame, (n_rows, 3, lanes); the force is updated.
        - torque: None, or (n_chunks, 3, lanes) that grows by u × f.
        - pointer, corner, gradient: see `fem.explicit.body.ElementViscosity`.
        - stress: volume times viscous stress, (n_elements, lanes).
    """
    for c in prange(len(chunks) - 1):
        for i in range(chunks[c], chunks[c + 1]):
            _viscous(0, lanes, np.int64(c), i, *rows)
