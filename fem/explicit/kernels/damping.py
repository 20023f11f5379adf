# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Stiffness-proportional damping."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import prange

from fem.explicit.kernels.forms import OPTIONS, over_lanes, serial_and_parallel
from fem.explicit.kernels.lanes import entry, lane_operations, multiply_add, store
from fem.explicit.kernels.triples import INLINED, cross, triple_operations
from geometry.compilation import njit


def _damping_lanes(width: int) -> Callable[..., Any]:
    """Make the stiffness damping of a chunk of rows for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)
    load_triple, add_triple = triple_operations(width)

    @njit(**INLINED)
    def component(at, ratio, increment, elastic, viscous, force, lost):
        fresh = load(force, at)
        new = ratio * (fresh - load(elastic, at))
        mean = load(viscous, at) + new
        store(elastic, at, fresh)
        store(viscous, at, new)
        store(force, at, fresh + new)
        return new, multiply_add(mean, load(increment, at), lost)

    @njit(**OPTIONS)
    def run(
        first,
        lanes,
        c,
        chunks,
        ratio,
        displacement,
        increment,
        elastic,
        viscous,
        force,
        torque,
        dissipated,
    ):
        lost = zero()
        for i in range(chunks[c], chunks[c + 1]):
            x = i * 3 * lanes + first
            y, z = x + lanes, x + 2 * lanes
            fx, lost = component(x, ratio, increment, elastic, viscous, force, lost)
            fy, lost = component(y, ratio, increment, elastic, viscous, force, lost)
            fz, lost = component(z, ratio, increment, elastic, viscous, force, lost)
            if torque is not None:
                moment = cross(load_triple(displacement, x, lanes), (fx, fy, fz))
                add_triple(torque, c * 3 * lanes + first, lanes, moment)
        for k in range(width):
            dissipated[c * lanes + first + k] += 0.5 * entry(lost, k)

    return run


_damping_rows = over_lanes(_damping_lanes, 8)


@serial_and_parallel
def add_stiffness_damping(lanes, chunks, *rows):
    """Stiffness-proportional damping β K v from two successive elastic forces.

    With v = (u - u_old)/Δt, β K v = (β/Δt) (K u - K u_old): no second product.

    Parameters
    ----------
    lanes
        Padded number of copies.
    chunks
        Row boundaries.
    rows
        A scalar and flat arrays:

        - ratio: β/Δt.
        - displacement: in the block frame, for the torque; (n_rows, 3, lanes), as all that follow.
        - increment: displacement increment since the last step, or a multiple of it (the velocity).
        - elastic, viscous: elastic and damping force of the last step, updated.
        - force: in: K u of this step; out: with the damping force.
        - torque: None, or (n_chunks, 3, lanes) that grows by u × damping force.
        - dissipated: grows by the product of ``increment`` and the mean of old and new damping
          force, (n_chunks, lanes).
    """
    for c in prange(len(chunks) - 1):
        _damping_rows(0, lanes, c, chunks, *rows)
