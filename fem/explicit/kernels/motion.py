# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Central difference update, moving supports and sums."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import OPTIONS, serial_and_parallel
from fem.explicit.kernels.frame import placed_force
from fem.explicit.kernels.lanes import add_to
from fem.explicit.kernels.layout import LaneArray
from fem.explicit.kernels.triples import (
    INLINED,
    dot,
    minus,
    plus,
    store_triple,
    times,
    triple_operations,
)
from geometry.compilation import njit


class MovingRows(NamedTuple):
    """What moves."""

    mass: LaneArray
    """Lumped mass of the rows, (n_rows,) [t]."""
    internal_force: LaneArray
    """Flat (n_rows, 3, lanes), as all that follow, in the block frames where there are any [N]."""
    displacement: LaneArray
    """[mm]"""
    velocity: LaneArray
    """[mm/s]"""
    time_step: float
    """[s]"""
    gain: float
    """Velocity by acceleration: Δt, with mass-proportional damping Δt/(1 + a) [s]."""


class Drag(NamedTuple):
    """Mass-proportional damping α, taken at the mean of the two half-step velocities."""

    keep: float
    """(1 - a)/(1 + a) with a = α Δt / 2."""
    loss: float
    """a."""
    work: LaneArray
    """Flat (n_chunks, 2, ≥ lanes). With the impulse p = α Δt m (v₋ + v₊)/4: [:, 0] grows by
    p · (v₋ + v₊), the dissipation of the step; [:, 1] is overwritten with p · v₊, the half of it
    after the time of the force."""


class Damper(NamedTuple):
    """Stiffness-proportional damping β.

    With v = (u - u_old)/Δt the force is β K v = (β/Δt) (K u - K u_old): no second product, and no
    pass of its own.
    """

    ratio: float
    """β/Δt."""
    before: LaneArray
    """Internal force of the step before."""
    work: LaneArray
    """Flat (n_chunks, 2, ≥ lanes): [:, 0] grows by half the product of the damping force with
    v₋ + v₊, [:, 1] is overwritten with the half of that which comes after the time of the force."""


class Placing(NamedTuple):
    """What turns forces to the placement axes (`fem.explicit.kernels.frame.place_force`)."""

    placing: LaneArray
    """Flat (4, 3, lanes)."""
    reference: LaneArray
    """X of the rows, (n_rows, 3)."""


class Applied(NamedTuple):
    """Loads and contact."""

    row: LaneArray
    """Row of ``force`` that acts on each row of the block, (n_rows,); -1: none."""
    force: LaneArray
    """Flat (n_applied, 3, lanes) [N]."""


class Loads(NamedTuple):
    """Loads among what is applied, for their work."""

    force: LaneArray
    """Flat (n_applied, 3, lanes) [N]."""
    work: LaneArray
    """Flat (n_chunks, 2, ≥ lanes) [N mm]: [:, 0] grows by the work ½ Δt f · (v₋ + v₊), [:, 1] is
    overwritten with ½ Δt f · v₊, the half of it after the time of the force."""


def _update_lanes(width: int) -> Callable[..., None]:
    """Make the motion of a chunk of rows, ``width`` copies at a time."""
    load_triple = triple_operations(width).load
    placed = placed_force(width)

    @njit(**INLINED)
    def add_work(sums, at, lanes, half, before, after):
        """Work of an impulse, of which half is given, and the later half of the work."""
        add_to(sums, at, dot(half, plus(before, after)))
        add_to(sums, at + lanes, dot(half, after))

    @njit(**OPTIONS)
    def run(c, lanes, chunks, motion, kinetic, drag, damper, placing, applied, loads, gravity):
        mass, internal_force, displacement, velocity, time_step, gain = motion
        if kinetic is not None:
            kinetic[c * lanes : (c + 1) * lanes] = 0.0
        if drag is not None:
            keep, loss, dissipated = drag
            lost_lanes = len(dissipated) // (2 * len(chunks) - 2)
            dissipated[(2 * c + 1) * lost_lanes : (2 * c + 2) * lost_lanes] = 0.0
        if damper is not None:
            ratio, elastic_before, viscous_work = damper
            work_lanes = len(viscous_work) // (2 * len(chunks) - 2)
            viscous_work[(2 * c + 1) * work_lanes : (2 * c + 2) * work_lanes] = 0.0
        if applied is not None:
            applied_row, applied_force = applied
        if loads is not None:
            load, load_work = loads
            load_lanes = len(load_work) // (2 * len(chunks) - 2)
            load_work[(2 * c + 1) * load_lanes : (2 * c + 2) * load_lanes] = 0.0
        if placing is not None:
            frame, reference = placing
        for i in range(chunks[c], chunks[c + 1]):
            impulse = gain / mass[i]
            pushed = np.int64(-1)
            if applied is not None:
                pushed = np.int64(applied_row[i])
            for first in range(0, lanes, width):
                at = 3 * i * lanes + first
                before = load_triple(velocity, at, lanes)
                force = load_triple(internal_force, at, lanes)
                if placing is not None:
                    force = placed(internal_force, frame, reference, mass, i, at, first, lanes)
                if damper is not None:
                    change = minus(force, load_triple(elastic_before, at, lanes))
                    force = plus(force, times(ratio, change))
                after = before
                if drag is not None:
                    after = times(keep, before)
                if applied is not None:
                    if pushed >= 0:
                        push = load_triple(applied_force, 3 * pushed * lanes + first, lanes)
                        force = minus(force, push)
                after = minus(after, times(impulse, force))
                if gravity is not None:
                    after = plus(after, times(gain, load_triple(gravity, first, lanes)))
                if kinetic is not None:
                    old = load_triple(velocity, at, lanes)
                if damper is not None:
                    earlier = load_triple(velocity, at, lanes)
                if drag is not None:
                    slower = load_triple(velocity, at, lanes)
                if loads is not None:
                    unpushed = load_triple(velocity, at, lanes)
                store_triple(velocity, at, lanes, after)
                moved = plus(load_triple(displacement, at, lanes), times(time_step, after))
                store_triple(displacement, at, lanes, moved)
                if kinetic is not None:
                    twice = dot(old, load_triple(velocity, at, lanes))
                    add_to(kinetic, c * lanes + first, 0.5 * mass[i] * twice)
                if damper is not None:
                    elastic = load_triple(internal_force, at, lanes)
                    change = minus(elastic, load_triple(elastic_before, at, lanes))
                    half = times(0.5 * ratio, change)
                    later = load_triple(velocity, at, lanes)
                    here = 2 * c * work_lanes + first
                    add_work(viscous_work, here, work_lanes, half, earlier, later)
                if drag is not None:
                    later = load_triple(velocity, at, lanes)
                    half = times(0.5 * loss * mass[i], plus(slower, later))
                    here = 2 * c * lost_lanes + first
                    add_work(dissipated, here, lost_lanes, half, slower, later)
                if loads is not None:
                    if pushed >= 0:
                        push = load_triple(load, 3 * pushed * lanes + first, lanes)
                        later = load_triple(velocity, at, lanes)
                        here = 2 * c * load_lanes + first
                        half = times(0.5 * time_step, push)
                        add_work(load_work, here, load_lanes, half, unpushed, later)

    return run


_update_4, _update_1 = _update_lanes(4), _update_lanes(1)


@serial_and_parallel
def update(
    lanes, fours, ones, chunks, motion, kinetic, drag, damper, placing, applied, loads, gravity
):
    """Advance velocity to the next half step and displacement to the next step, in place.

    v ← keep · v + gain (f_applied - f_internal) / m + gain · g,   u ← u + Δt v.

    Parameters
    ----------
    lanes
        Padded number of copies.
    fours, ones
        One of the two is None: copies are worked four at a time, or one by one (`widths`).
    chunks
        Row boundaries.
    motion
        `MovingRows`.
    kinetic
        None, or flat (n_chunks, lanes): partial sums of ½ m v₋ · v₊, overwritten.
    drag, damper, placing, applied, loads
        None, or `Drag`, `Damper`, `Placing`, `Applied` and `Loads`.
    gravity
        None, or a uniform acceleration, flat (3, lanes) [mm/s²].
    """
    for c in prange(len(chunks) - 1):
        k = np.int64(c)
        if fours is not None:
            _update_4(
                k, lanes, chunks, motion, kinetic, drag, damper, placing, applied, loads, gravity
            )
        if ones is not None:
            _update_1(
                k, lanes, chunks, motion, kinetic, drag, damper, placing, applied, loads, gravity
            )


@njit(cache=True, **OPTIONS)
def viscous_power(index, ratio, elastic, elastic_before, velocity):
    """Power of the damping force of `update` on some entries of flat arrays."""
    total = 0.0
    for k in range(len(index)):
        at = index[k]
        force = ratio * (elastic[at] - elastic_before[at])
        total += force * velocity[at]
    return total


@njit(cache=True, **OPTIONS)
def dot_lanes(a, b, total):
    """Write a · b of every copy to ``total`` (lanes,); a, b (n_rows, 3, lanes)."""
    total[:] = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(a.shape[2]):
                total[k] += a[i, j, k] * b[i, j, k]


@njit(cache=True, **OPTIONS)
def enforce(
    base, stride, direction, target, rate, previous_rate, mass, loss, displacement, velocity
):
    """Put prescribed displacement components in place after an `update`.

    u ← u + n (ū - n · u),  v ← v + n (ū' - n · v). The impulse of the support is m Δ(n · v).

    Parameters
    ----------
    base, stride
        Flat index of the first component of each supported node (n,), and the distance to the
        next component.
    direction
        Unit vectors n in the frame of the arrays, (n, 3); several of one node are orthonormal.
    target, rate, previous_rate
        Prescribed displacement, its mean rate over the step that ends there, and the rate over
        the step before; (n,).
    mass
        Lumped mass of the nodes, (n,) [t].
    loss
        α Δt / 2 of the mass-proportional damping.
    displacement, velocity
        Flat arrays.

    Returns
    -------
    tuple[float, float, float, float]
        Work of the supports, split in the halves before and after the time of the force, and
        what to add to the dissipation of the mass damping, which `update` took with the
        velocity before this correction, in the same halves.
    """
    before = 0.0
    after = 0.0
    lost_before = 0.0
    lost_after = 0.0
    for k in range(len(base)):
        x = base[k]
        y = x + stride
        z = y + stride
        nx, ny, nz = direction[k, 0], direction[k, 1], direction[k, 2]
        slip = target[k] - (nx * displacement[x] + ny * displacement[y] + nz * displacement[z])
        displacement[x] += nx * slip
        displacement[y] += ny * slip
        displacement[z] += nz * slip
        change = rate[k] - (nx * velocity[x] + ny * velocity[y] + nz * velocity[z])
        velocity[x] += nx * change
        velocity[y] += ny * change
        velocity[z] += nz * change
        impulse = mass[k] * (1.0 + loss) * change
        before += 0.5 * impulse * previous_rate[k]
        after += 0.5 * impulse * rate[k]
        p = 0.5 * loss * mass[k] * (previous_rate[k] + rate[k])
        wrong = p - 0.5 * loss * mass[k] * change
        lost_before += (p - wrong) * previous_rate[k]
        lost_after += p * rate[k] - wrong * (rate[k] - change)
    return before, after, lost_before, lost_after
