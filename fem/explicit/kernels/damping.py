# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Stiffness-proportional damping."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import over_lanes, serial_and_parallel
from fem.explicit.kernels.lanes import lane_operations, multiply_add, store
from fem.explicit.kernels.options import OPTIONS
from fem.explicit.kernels.triples import cross, triple_operations
from geometry.compilation import njit


def _damping_lanes(width: int) -> Callable[..., Any]:
    """Make the stiffness damping of one row for ``width`` copies from ``first`` on."""
    load, _ = lane_operations(width)
    load_triple, add_triple = triple_operations(width)

    @njit(**OPTIONS)
    def component(at, ratio, increment, elastic, viscous, force, lost, here):
        fresh = load(force, at)
        new = ratio * (fresh - load(elastic, at))
        mean = load(viscous, at) + new
        store(lost, here, multiply_add(mean, load(increment, at), load(lost, here)))
        store(elastic, at, fresh)
        store(viscous, at, new)
        store(force, at, fresh + new)
        return new

    @njit(**OPTIONS)
    def run(
        first, lanes, c, i, ratio, displacement, increment, elastic, viscous, force, torque, lost
    ):
        here = c * lanes + first
        x = i * 3 * lanes + first
        y, z = x + lanes, x + 2 * lanes
        f = (
            component(x, ratio, increment, elastic, viscous, force, lost, here),
            component(y, ratio, increment, elastic, viscous, force, lost, here),
            component(z, ratio, increment, elastic, viscous, force, lost, here),
        )
        if torque is not None:
            moment = cross(load_triple(displacement, x, lanes), f)
            add_triple(torque, c * 3 * lanes + first, lanes, moment)

    return run


_damping_row = over_lanes(_damping_lanes, 8)


@njit(**OPTIONS)
def _stiffness_damping_chunk(
    c,
    chunks,
    ratio,
    displacement,
    increment,
    elastic,
    viscous,
    force,
    torque,
    lost,
    dissipated,
    lanes,
):
    lost[c * lanes : (c + 1) * lanes] = 0.0
    for i in range(chunks[c], chunks[c + 1]):
        _damping_row(
            0, lanes, c, i, ratio, displacement, increment, elastic, viscous, force, torque, lost
        )
    for k in range(c * lanes, (c + 1) * lanes):
        dissipated[k] += 0.5 * np.float64(lost[k])


@serial_and_parallel
def add_stiffness_damping(
    chunks, ratio, displacement, increment, elastic, viscous, force, torque, lost, dissipated, lanes
):
    """Stiffness-proportional damping β K v from two successive elastic forces.

    With v = (u - u_old)/Δt, β K v = (β/Δt) (K u - K u_old): no second product.

    Parameters
    ----------
    chunks
        Row boundaries.
    ratio
        β/Δt, in the precision of the arrays.
    displacement
        In the block frame, for the torque; flat (n_rows, 3, lanes), as all that follow.
    increment
        Displacement increment since the last step, or a multiple of it (the velocity).
    elastic, viscous
        Elastic and damping force of the last step, updated.
    force
        In: K u of this step; out: with the damping force.
    torque
        None, or flat (n_chunks, 3, lanes) that grows by u × damping force.
    lost
        Work array, flat (n_chunks, lanes).
    dissipated
        Grows by the product of ``increment`` and the mean of old and new damping force, flat
        (n_chunks, lanes), float64.
    lanes
        Padded number of copies.
    """
    for c in prange(len(chunks) - 1):
        _stiffness_damping_chunk(
            c,
            chunks,
            ratio,
            displacement,
            increment,
            elastic,
            viscous,
            force,
            torque,
            lost,
            dissipated,
            lanes,
        )
