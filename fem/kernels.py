"""The compiled loops of the explicit solver.

Arrays are [row][component][copy] (`fem.layout`), copies are SIMD lanes. Every kernel has a
plain twin of the same name in `fem.reference`, with which the tests compare it.

An argument that is None removes its branch when the kernel is compiled: an effect that is off
is not in the machine code. Rows are worked in fixed chunks and each chunk writes its own rows
and its own partial sums, so one and two threads give the same bits.

Each loop over chunks exists twice, serial and with ``prange``, as two functions of the module:
numba's cache does not tell the two apart when one factory makes both.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange

from fem.lanes import (
    add,
    entry,
    lane_operations,
    minimum,
    multiply_add,
    scale,
    store,
    subtract,
)

_OPTIONS = {"error_model": "numpy", "nogil": True}


def _row_product(width: int) -> Callable[..., Any]:
    """Make the product of one block row with ``width`` copies from lane ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**_OPTIONS)
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

    @njit(**_OPTIONS)
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


@njit(**_OPTIONS)
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


@njit(**_OPTIONS)
def _single_rows(begin, end, pointer, column, blocks, u, force, torque, chunk):
    for row in range(begin, end):
        _single_row(pointer[row], pointer[row + 1], column, blocks, u, force, row)
        if torque is not None:
            k = 3 * row
            torque[3 * chunk] += u[k + 1] * force[k + 2] - u[k + 2] * force[k + 1]
            torque[3 * chunk + 1] += u[k + 2] * force[k] - u[k] * force[k + 2]
            torque[3 * chunk + 2] += u[k] * force[k + 1] - u[k + 1] * force[k]


@njit(**_OPTIONS)
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


@njit(**_OPTIONS)
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


@njit(cache=True, **_OPTIONS)
def stiffness_product(chunks, pointer, column, blocks, displacement, force, torque, lanes):
    """Internal force K u of every copy; overwrites ``force``.

    Parameters
    ----------
    chunks, pointer, column, blocks
        The packed stiffness (`fem.layout.BlockRows`).
    displacement, force
        Flat views of (n_rows, 3, lanes).
    torque
        None, or flat (n_chunks, 3, lanes): partial sums of u × K u.
    lanes
        Padded number of copies.
    """
    for c in range(len(chunks) - 1):
        _product_chunk(c, chunks, pointer, column, blocks, displacement, force, torque, lanes)


@njit(cache=True, parallel=True, **_OPTIONS)
def stiffness_product_parallel(chunks, pointer, column, blocks, displacement, force, torque, lanes):
    """`stiffness_product` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _product_chunk(c, chunks, pointer, column, blocks, displacement, force, torque, lanes)


@njit(**_OPTIONS)
def _update_chunk(
    c,
    chunks,
    time_step,
    gain,
    keep,
    mass,
    internal_force,
    applied_row,
    applied_force,
    acceleration,
    displacement,
    velocity,
    kinetic,
    loss,
    dissipated,
):
    lanes = velocity.shape[2]
    if kinetic is not None:
        kinetic[c] = 0.0
    if dissipated is not None:
        dissipated[c, 1] = 0.0
    for i in range(chunks[c], chunks[c + 1]):
        impulse = gain / mass[i]
        applied = -1
        if applied_force is not None:
            applied = applied_row[i]
        for j in range(3):
            for k in range(lanes):
                before = velocity[i, j, k]
                force = -internal_force[i, j, k]
                if applied_force is not None:
                    if applied >= 0:
                        force += applied_force[applied, j, k]
                if keep is not None:
                    after = keep * before + impulse * force
                else:
                    after = before + impulse * force
                if acceleration is not None:
                    after += gain * acceleration[j, k]
                velocity[i, j, k] = after
                displacement[i, j, k] += time_step * after
                if kinetic is not None:
                    kinetic[c, k] += 0.5 * np.float64(mass[i]) * before * after
                if dissipated is not None:
                    mean = 0.5 * loss * mass[i] * (before + after)
                    dissipated[c, 0, k] += mean * (before + after)
                    dissipated[c, 1, k] += mean * after


@njit(cache=True, **_OPTIONS)
def update(
    chunks,
    time_step,
    gain,
    keep,
    mass,
    internal_force,
    applied_row,
    applied_force,
    acceleration,
    displacement,
    velocity,
    kinetic,
    loss,
    dissipated,
):
    """Advance velocity to the next half step and displacement to the next step, in place.

    v ← keep · v + gain (f_applied - f_internal) / m + gain · g,   u ← u + Δt v,

    with keep = (1 - a)/(1 + a), gain = Δt/(1 + a), a = α Δt / 2 for mass-proportional damping
    taken at the mean of the two half-step velocities; without damping keep is None, gain Δt.

    Parameters
    ----------
    chunks
        Row boundaries.
    time_step, gain, keep
        Scalars of the precision of the arrays; keep may be None.
    mass
        Lumped mass of the rows, (n_rows,) [t].
    internal_force, displacement, velocity
        (n_rows, 3, lanes).
    applied_row, applied_force
        None, or the row of ``applied_force`` (n_applied, 3, lanes) that acts on each row of
        the block (n_rows,), -1 where nothing is applied.
    acceleration
        None, or a uniform acceleration (3, lanes).
    kinetic
        None, or (n_chunks, lanes): partial sums of ½ m v₋ · v₊, overwritten.
    loss, dissipated
        None, or α Δt / 2 in float64 and (n_chunks, 2, lanes). With the damping impulse
        p = α Δt m (v₋ + v₊)/4: [:, 0] grows by p · (v₋ + v₊), the dissipation of the step;
        [:, 1] is overwritten with p · v₊, the half of it that comes after the time of the force.
    """
    for c in range(len(chunks) - 1):
        _update_chunk(
            c,
            chunks,
            time_step,
            gain,
            keep,
            mass,
            internal_force,
            applied_row,
            applied_force,
            acceleration,
            displacement,
            velocity,
            kinetic,
            loss,
            dissipated,
        )


@njit(cache=True, parallel=True, **_OPTIONS)
def update_parallel(
    chunks,
    time_step,
    gain,
    keep,
    mass,
    internal_force,
    applied_row,
    applied_force,
    acceleration,
    displacement,
    velocity,
    kinetic,
    loss,
    dissipated,
):
    """`update` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _update_chunk(
            c,
            chunks,
            time_step,
            gain,
            keep,
            mass,
            internal_force,
            applied_row,
            applied_force,
            acceleration,
            displacement,
            velocity,
            kinetic,
            loss,
            dissipated,
        )


@njit(cache=True, **_OPTIONS)
def add_at(target, index, values, factor):
    """``target[index] += factor · values`` on a flat array, repeated indices adding up."""
    for k in range(len(index)):
        target[index[k]] += factor * values[k]


@njit(cache=True, **_OPTIONS)
def dot_at(array, index, values):
    """Sum of ``array[index] · values`` on a flat array, in float64."""
    total = 0.0
    for k in range(len(index)):
        total += np.float64(array[index[k]]) * values[k]
    return total


@njit(cache=True, **_OPTIONS)
def dot_lanes(a, b, total):
    """Write a · b of every copy to ``total`` (lanes,), in float64; a, b (n_rows, 3, lanes)."""
    total[:] = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(a.shape[2]):
                total[k] += np.float64(a[i, j, k]) * b[i, j, k]


@njit(cache=True, **_OPTIONS)
def hold(index, mass, loss, displacement, velocity):
    """Put held components back to zero after an `update`.

    Parameters
    ----------
    index, mass
        Flat positions (n,) and masses (n,) [t].
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
    for k in range(len(index)):
        at = index[k]
        if loss is not None:
            lost -= 0.5 * loss * mass[k] * np.float64(velocity[at]) ** 2
        displacement[at] = 0.0
        velocity[at] = 0.0
    return lost


@njit(cache=True, **_OPTIONS)
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


def _pressure_lanes(width: int) -> Callable[..., Any]:
    """Make the viscous stress of a range of elements for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**_OPTIONS)
    def run(
        c,
        begin,
        end,
        element_rows,
        gradient,
        linear,
        quadratic,
        per_step,
        displacement,
        strain,
        stress,
        dissipated,
        first,
        lanes,
    ):
        none = zero(stress)
        lost = none
        for e in range(begin, end):
            fresh = none
            for a in range(8):
                g = 24 * e + 3 * a
                node = np.int64(element_rows[8 * e + a]) * 3 * lanes + first
                fresh = multiply_add(gradient[g], load(displacement, node), fresh)
                fresh = multiply_add(gradient[g + 1], load(displacement, node + lanes), fresh)
                fresh = multiply_add(gradient[g + 2], load(displacement, node + 2 * lanes), fresh)
            at = e * lanes + first
            change = subtract(fresh, load(strain, at))
            rate = scale(per_step, change)
            closing = minimum(rate, none)
            q = scale(linear[e], rate)
            q = subtract(q, scale(quadratic[e], scale(closing, closing)))
            lost = multiply_add(add(load(stress, at), q), change, lost)
            store(strain, at, fresh)
            store(stress, at, q)
        for k in range(width):
            dissipated[c * lanes + first + k] += 0.5 * np.float64(entry(lost, k))

    made: Callable[..., Any] = run
    return made


_pressure_8 = _pressure_lanes(8)
_pressure_4 = _pressure_lanes(4)
_pressure_2 = _pressure_lanes(2)
_pressure_1 = _pressure_lanes(1)


@njit(**_OPTIONS)
def _pressure_chunk(
    c,
    chunks,
    element_rows,
    gradient,
    linear,
    quadratic,
    per_step,
    displacement,
    strain,
    stress,
    dissipated,
    lanes,
):
    if lanes >= 8:
        for first in range(0, lanes, 8):
            _pressure_8(
                c,
                chunks[c],
                chunks[c + 1],
                element_rows,
                gradient,
                linear,
                quadratic,
                per_step,
                displacement,
                strain,
                stress,
                dissipated,
                first,
                lanes,
            )
    elif lanes == 4:
        _pressure_4(
            c,
            chunks[c],
            chunks[c + 1],
            element_rows,
            gradient,
            linear,
            quadratic,
            per_step,
            displacement,
            strain,
            stress,
            dissipated,
            0,
            lanes,
        )
    elif lanes == 2:
        _pressure_2(
            c,
            chunks[c],
            chunks[c + 1],
            element_rows,
            gradient,
            linear,
            quadratic,
            per_step,
            displacement,
            strain,
            stress,
            dissipated,
            0,
            lanes,
        )
    else:
        _pressure_1(
            c,
            chunks[c],
            chunks[c + 1],
            element_rows,
            gradient,
            linear,
            quadratic,
            per_step,
            displacement,
            strain,
            stress,
            dissipated,
            0,
            lanes,
        )


@njit(cache=True, **_OPTIONS)
def viscous_pressure(
    chunks,
    element_rows,
    gradient,
    linear,
    quadratic,
    per_step,
    displacement,
    strain,
    stress,
    dissipated,
    lanes,
):
    """Bulk viscosity stress of every element and copy (formula in `fem.viscosity`).

    Parameters
    ----------
    chunks
        Element boundaries.
    element_rows, gradient, linear, quadratic
        See `fem.viscosity.ElementViscosity`; flat.
    per_step
        1/Δt [1/s], in the precision of the arrays.
    displacement
        In the block frame, flat (n_rows, 3, lanes).
    strain, stress
        Volumetric strain and volume times viscous stress, flat (n_elements, lanes), updated.
    dissipated
        Grows by the work of the mean of old and new stress on the strain increment, flat
        (n_chunks, lanes), float64 [N mm].
    lanes
        Padded number of copies.
    """
    for c in range(len(chunks) - 1):
        _pressure_chunk(
            c,
            chunks,
            element_rows,
            gradient,
            linear,
            quadratic,
            per_step,
            displacement,
            strain,
            stress,
            dissipated,
            lanes,
        )


@njit(cache=True, parallel=True, **_OPTIONS)
def viscous_pressure_parallel(
    chunks,
    element_rows,
    gradient,
    linear,
    quadratic,
    per_step,
    displacement,
    strain,
    stress,
    dissipated,
    lanes,
):
    """`viscous_pressure` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _pressure_chunk(
            c,
            chunks,
            element_rows,
            gradient,
            linear,
            quadratic,
            per_step,
            displacement,
            strain,
            stress,
            dissipated,
            lanes,
        )


@njit(**_OPTIONS)
def _add_torque(torque, c, displacement, i, k, fx, fy, fz):
    ux, uy, uz = displacement[i, 0, k], displacement[i, 1, k], displacement[i, 2, k]
    torque[c, 0, k] += uy * fz - uz * fy
    torque[c, 1, k] += uz * fx - ux * fz
    torque[c, 2, k] += ux * fy - uy * fx


def _viscous_lanes(width: int) -> Callable[..., Any]:
    """Make the viscous nodal force of a range of rows for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**_OPTIONS)
    def run(
        c, begin, end, pointer, corner, gradient, stress, displacement, force, torque, first, lanes
    ):
        none = zero(stress)
        for i in range(begin, end):
            fx, fy, fz = none, none, none
            for n in range(pointer[i], pointer[i + 1]):
                k = np.int64(corner[n])
                q = load(stress, (k >> 3) * lanes + first)
                fx = multiply_add(gradient[3 * k], q, fx)
                fy = multiply_add(gradient[3 * k + 1], q, fy)
                fz = multiply_add(gradient[3 * k + 2], q, fz)
            x = i * 3 * lanes + first
            y, z = x + lanes, x + 2 * lanes
            store(force, x, add(load(force, x), fx))
            store(force, y, add(load(force, y), fy))
            store(force, z, add(load(force, z), fz))
            if torque is not None:
                t = c * 3 * lanes + first
                ux, uy, uz = load(displacement, x), load(displacement, y), load(displacement, z)
                cx = subtract(scale(uy, fz), scale(uz, fy))
                cy = subtract(scale(uz, fx), scale(ux, fz))
                cz = subtract(scale(ux, fy), scale(uy, fx))
                store(torque, t, add(load(torque, t), cx))
                store(torque, t + lanes, add(load(torque, t + lanes), cy))
                store(torque, t + 2 * lanes, add(load(torque, t + 2 * lanes), cz))

    made: Callable[..., Any] = run
    return made


_viscous_8 = _viscous_lanes(8)
_viscous_4 = _viscous_lanes(4)
_viscous_2 = _viscous_lanes(2)
_viscous_1 = _viscous_lanes(1)


@njit(**_OPTIONS)
def _viscous_chunk(
    c, chunks, pointer, corner, gradient, stress, displacement, force, torque, lanes
):
    if lanes >= 8:
        for first in range(0, lanes, 8):
            _viscous_8(
                c,
                chunks[c],
                chunks[c + 1],
                pointer,
                corner,
                gradient,
                stress,
                displacement,
                force,
                torque,
                first,
                lanes,
            )
    elif lanes == 4:
        _viscous_4(
            c,
            chunks[c],
            chunks[c + 1],
            pointer,
            corner,
            gradient,
            stress,
            displacement,
            force,
            torque,
            0,
            lanes,
        )
    elif lanes == 2:
        _viscous_2(
            c,
            chunks[c],
            chunks[c + 1],
            pointer,
            corner,
            gradient,
            stress,
            displacement,
            force,
            torque,
            0,
            lanes,
        )
    else:
        _viscous_1(
            c,
            chunks[c],
            chunks[c + 1],
            pointer,
            corner,
            gradient,
            stress,
            displacement,
            force,
            torque,
            0,
            lanes,
        )


@njit(cache=True, **_OPTIONS)
def add_viscous_force(
    chunks, pointer, corner, gradient, stress, displacement, force, torque, lanes
):
    """Add the nodal forces of the bulk viscosity, row by row.

    Parameters
    ----------
    chunks
        Row boundaries.
    pointer, corner, gradient
        See `fem.viscosity.ElementViscosity`; flat.
    stress
        Volume times viscous stress, flat (n_elements, lanes).
    displacement
        In the block frame, flat (n_rows, 3, lanes).
    force
        Flat (n_rows, 3, lanes), updated.
    torque
        None, or flat (n_chunks, 3, lanes) that grows by u × f.
    lanes
        Padded number of copies.
    """
    for c in range(len(chunks) - 1):
        _viscous_chunk(
            c, chunks, pointer, corner, gradient, stress, displacement, force, torque, lanes
        )


@njit(cache=True, parallel=True, **_OPTIONS)
def add_viscous_force_parallel(
    chunks, pointer, corner, gradient, stress, displacement, force, torque, lanes
):
    """`add_viscous_force` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _viscous_chunk(
            c, chunks, pointer, corner, gradient, stress, displacement, force, torque, lanes
        )


@njit(**_OPTIONS)
def _stiffness_damping_chunk(
    c, chunks, ratio, displacement, increment, factor, elastic, viscous, force, torque, dissipated
):
    lanes = force.shape[2]
    for i in range(chunks[c], chunks[c + 1]):
        for j in range(3):
            for k in range(lanes):
                fresh = force[i, j, k]
                new = ratio * (fresh - elastic[i, j, k])
                mean = 0.5 * (np.float64(viscous[i, j, k]) + new)
                dissipated[c, k] += mean * factor * increment[i, j, k]
                elastic[i, j, k] = fresh
                viscous[i, j, k] = new
                force[i, j, k] = fresh + new
        if torque is not None:
            for k in range(lanes):
                fx, fy, fz = viscous[i, 0, k], viscous[i, 1, k], viscous[i, 2, k]
                _add_torque(torque, c, displacement, i, k, fx, fy, fz)


@njit(cache=True, **_OPTIONS)
def add_stiffness_damping(
    chunks, ratio, displacement, increment, factor, elastic, viscous, force, torque, dissipated
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
        In the block frame, for the torque.
    increment, factor
        ``factor · increment`` is the displacement increment since the last step.
    elastic, viscous
        Elastic and damping force of the last step, (n_rows, 3, lanes), updated.
    force
        In: K u of this step; out: with the damping force.
    torque
        None, or (n_chunks, 3, lanes) that grows by u × damping force.
    dissipated
        Grows by the work of the mean of old and new damping force, (n_chunks, lanes) [N mm].
    """
    for c in range(len(chunks) - 1):
        _stiffness_damping_chunk(
            c,
            chunks,
            ratio,
            displacement,
            increment,
            factor,
            elastic,
            viscous,
            force,
            torque,
            dissipated,
        )


@njit(cache=True, parallel=True, **_OPTIONS)
def add_stiffness_damping_parallel(
    chunks, ratio, displacement, increment, factor, elastic, viscous, force, torque, dissipated
):
    """`add_stiffness_damping` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _stiffness_damping_chunk(
            c,
            chunks,
            ratio,
            displacement,
            increment,
            factor,
            elastic,
            viscous,
            force,
            torque,
            dissipated,
        )


def _moment_lanes(width: int) -> Callable[..., Any]:
    """Make the moments of a range of rows for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**_OPTIONS)
    def run(c, begin, end, mass, reference, displacement, moment, first, lanes):
        xx = zero(displacement)
        xy = zero(displacement)
        xz = zero(displacement)
        xm = zero(displacement)
        yx = zero(displacement)
        yy = zero(displacement)
        yz = zero(displacement)
        ym = zero(displacement)
        zx = zero(displacement)
        zy = zero(displacement)
        zz = zero(displacement)
        zm = zero(displacement)
        for i in range(begin, end):
            m = mass[i]
            rx, ry, rz = m * reference[i, 0], m * reference[i, 1], m * reference[i, 2]
            base = i * 3 * lanes + first
            u = load(displacement, base)
            xx = multiply_add(rx, u, xx)
            xy = multiply_add(ry, u, xy)
            xz = multiply_add(rz, u, xz)
            xm = multiply_add(m, u, xm)
            u = load(displacement, base + lanes)
            yx = multiply_add(rx, u, yx)
            yy = multiply_add(ry, u, yy)
            yz = multiply_add(rz, u, yz)
            ym = multiply_add(m, u, ym)
            u = load(displacement, base + 2 * lanes)
            zx = multiply_add(rx, u, zx)
            zy = multiply_add(ry, u, zy)
            zz = multiply_add(rz, u, zz)
            zm = multiply_add(m, u, zm)
        at = c * 12 * lanes + first
        store(moment, at + 0 * lanes, xx)
        store(moment, at + 1 * lanes, xy)
        store(moment, at + 2 * lanes, xz)
        store(moment, at + 3 * lanes, xm)
        store(moment, at + 4 * lanes, yx)
        store(moment, at + 5 * lanes, yy)
        store(moment, at + 6 * lanes, yz)
        store(moment, at + 7 * lanes, ym)
        store(moment, at + 8 * lanes, zx)
        store(moment, at + 9 * lanes, zy)
        store(moment, at + 10 * lanes, zz)
        store(moment, at + 11 * lanes, zm)

    made: Callable[..., Any] = run
    return made


_moments_8 = _moment_lanes(8)
_moments_4 = _moment_lanes(4)
_moments_2 = _moment_lanes(2)
_moments_1 = _moment_lanes(1)


@njit(**_OPTIONS)
def _moment_chunk(c, chunks, mass, reference, displacement, moment, lanes):
    if lanes >= 8:
        for first in range(0, lanes, 8):
            _moments_8(
                c, chunks[c], chunks[c + 1], mass, reference, displacement, moment, first, lanes
            )
    elif lanes == 4:
        _moments_4(c, chunks[c], chunks[c + 1], mass, reference, displacement, moment, 0, lanes)
    elif lanes == 2:
        _moments_2(c, chunks[c], chunks[c + 1], mass, reference, displacement, moment, 0, lanes)
    else:
        _moments_1(c, chunks[c], chunks[c + 1], mass, reference, displacement, moment, 0, lanes)


@njit(cache=True, **_OPTIONS)
def displacement_moments(chunks, mass, reference, displacement, moment, lanes):
    """Partial sums of m u_j (X_x, X_y, X_z, 1), j = x, y, z, of every copy.

    Parameters
    ----------
    chunks
        Row boundaries.
    mass, reference
        (n_rows,) and X (n_rows, 3), in the precision of the arrays.
    displacement, moment
        Flat (n_rows, 3, lanes) and, out, flat (n_chunks, 12, lanes).
    lanes
        Padded number of copies.
    """
    for c in range(len(chunks) - 1):
        _moment_chunk(c, chunks, mass, reference, displacement, moment, lanes)


@njit(cache=True, parallel=True, **_OPTIONS)
def displacement_moments_parallel(chunks, mass, reference, displacement, moment, lanes):
    """`displacement_moments` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _moment_chunk(c, chunks, mass, reference, displacement, moment, lanes)


@njit(**_OPTIONS)
def _turn(q, turn):
    """Rotation minus identity of a unit quaternion (w, x, y, z), without cancellation."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    turn[0, 0] = -2.0 * (y * y + z * z)
    turn[1, 1] = -2.0 * (z * z + x * x)
    turn[2, 2] = -2.0 * (x * x + y * y)
    turn[0, 1] = 2.0 * (x * y - w * z)
    turn[1, 0] = 2.0 * (x * y + w * z)
    turn[0, 2] = 2.0 * (x * z + w * y)
    turn[2, 0] = 2.0 * (x * z - w * y)
    turn[1, 2] = 2.0 * (y * z - w * x)
    turn[2, 1] = 2.0 * (y * z + w * x)


@njit(**_OPTIONS)
def _inverse_3(a, inverse):
    inverse[0, 0] = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    inverse[0, 1] = a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]
    inverse[0, 2] = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    inverse[1, 0] = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    inverse[1, 1] = a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]
    inverse[1, 2] = a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]
    inverse[2, 0] = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    inverse[2, 1] = a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]
    inverse[2, 2] = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[1, 0] + a[0, 2] * inverse[2, 0]
    for i in range(3):
        for j in range(3):
            inverse[i, j] /= determinant


@njit(cache=True, **_OPTIONS)
def fit_frames(moment, second, total_mass, n_copies, quaternion, turn, mean, compliance):
    """Rotate every block frame to the mass-weighted best fit (polar decomposition).

    Q maximises tr(Qᵀ A), A = Σ m (X + u - ū) Xᵀ. Newton from the frame of the last step:
    with B = Qᵀ A and S its symmetric part, (tr S · 1 - S) ω = axial(B - Bᵀ), Q ← Q exp(ω).

    Parameters
    ----------
    moment
        Partial sums of `displacement_moments`, (n_chunks, 12, lanes).
    second
        Σ m X Xᵀ, (3, 3) [t mm²].
    total_mass
        [t]
    n_copies
        Copies that exist.
    quaternion
        Frames of the last step, (lanes, 4), updated.
    turn
        Out: Q - 1, (3, 3, lanes).
    mean
        Out: mean displacement ū, (3, lanes) [mm].
    compliance
        Out: (tr S · 1 - S)⁻¹, (3, 3, lanes) [1/(t mm²)].
    """
    a = np.empty((3, 3))
    b = np.empty((3, 3))
    stiff = np.empty((3, 3))
    inverse = np.empty((3, 3))
    small = np.empty((3, 3))
    for k in range(n_copies):
        for i in range(3):
            total = 0.0
            for c in range(moment.shape[0]):
                total += np.float64(moment[c, 4 * i + 3, k])
            mean[i, k] = total / total_mass
            for j in range(3):
                total = 0.0
                for c in range(moment.shape[0]):
                    total += np.float64(moment[c, 4 * i + j, k])
                a[i, j] = second[i, j] + total
        q = quaternion[k]
        for _ in range(50):
            _turn(q, small)
            for i in range(3):
                for j in range(3):
                    b[i, j] = (
                        a[i, j]
                        + small[0, i] * a[0, j]
                        + small[1, i] * a[1, j]
                        + small[2, i] * a[2, j]
                    )
            trace = b[0, 0] + b[1, 1] + b[2, 2]
            for i in range(3):
                for j in range(3):
                    stiff[i, j] = -0.5 * (b[i, j] + b[j, i])
                stiff[i, i] += trace
            _inverse_3(stiff, inverse)
            rx, ry, rz = b[2, 1] - b[1, 2], b[0, 2] - b[2, 0], b[1, 0] - b[0, 1]
            # Half of the rotation vector: the vector part of the increment's quaternion.
            hx = 0.5 * (inverse[0, 0] * rx + inverse[0, 1] * ry + inverse[0, 2] * rz)
            hy = 0.5 * (inverse[1, 0] * rx + inverse[1, 1] * ry + inverse[1, 2] * rz)
            hz = 0.5 * (inverse[2, 0] * rx + inverse[2, 1] * ry + inverse[2, 2] * rz)
            size = hx * hx + hy * hy + hz * hz
            w, x, y, z = q[0], q[1], q[2], q[3]
            q[0] = w - x * hx - y * hy - z * hz
            q[1] = x + w * hx + y * hz - z * hy
            q[2] = y + w * hy + z * hx - x * hz
            q[3] = z + w * hz + x * hy - y * hx
            norm = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
            for i in range(4):
                q[i] /= norm
            if not size > 1e-20:
                break
        _turn(q, small)
        for i in range(3):
            for j in range(3):
                turn[i, j, k] = small[i, j]
                compliance[i, j, k] = inverse[i, j]


@njit(**_OPTIONS)
def _block_frame_chunk(c, chunks, turn, mean, reference, displacement, local, increment):
    lanes = displacement.shape[2]
    for i in range(chunks[c], chunks[c + 1]):
        x, y, z = reference[i, 0], reference[i, 1], reference[i, 2]
        for k in range(lanes):
            wx = displacement[i, 0, k] - mean[0, k]
            wy = displacement[i, 1, k] - mean[1, k]
            wz = displacement[i, 2, k] - mean[2, k]
            px, py, pz = x + wx, y + wy, z + wz
            lx = wx + turn[0, 0, k] * px + turn[1, 0, k] * py + turn[2, 0, k] * pz
            ly = wy + turn[0, 1, k] * px + turn[1, 1, k] * py + turn[2, 1, k] * pz
            lz = wz + turn[0, 2, k] * px + turn[1, 2, k] * py + turn[2, 2, k] * pz
            if increment is not None:
                increment[i, 0, k] = lx - local[i, 0, k]
                increment[i, 1, k] = ly - local[i, 1, k]
                increment[i, 2, k] = lz - local[i, 2, k]
            local[i, 0, k] = lx
            local[i, 1, k] = ly
            local[i, 2, k] = lz


@njit(cache=True, **_OPTIONS)
def block_frame_displacement(chunks, turn, mean, reference, displacement, local, increment):
    """Displacement seen from the block frame, Qᵀ(X + u - ū) - X.

    Parameters
    ----------
    chunks
        Row boundaries.
    turn, mean
        Q - 1 (3, 3, lanes) and ū (3, lanes) of `fit_frames`.
    reference
        X, (n_rows, 3) [mm].
    displacement, local
        u and the result, (n_rows, 3, lanes).
    increment
        None, or out: the change of ``local``.
    """
    for c in range(len(chunks) - 1):
        _block_frame_chunk(c, chunks, turn, mean, reference, displacement, local, increment)


@njit(cache=True, parallel=True, **_OPTIONS)
def block_frame_displacement_parallel(
    chunks, turn, mean, reference, displacement, local, increment
):
    """`block_frame_displacement` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _block_frame_chunk(c, chunks, turn, mean, reference, displacement, local, increment)


@njit(**_OPTIONS)
def _placement_chunk(c, chunks, turn, spin, mass, reference, force):
    lanes = force.shape[2]
    for i in range(chunks[c], chunks[c + 1]):
        m = mass[i]
        x, y, z = m * reference[i, 0], m * reference[i, 1], m * reference[i, 2]
        for k in range(lanes):
            fx = force[i, 0, k] - (spin[1, k] * z - spin[2, k] * y)
            fy = force[i, 1, k] - (spin[2, k] * x - spin[0, k] * z)
            fz = force[i, 2, k] - (spin[0, k] * y - spin[1, k] * x)
            force[i, 0, k] = fx + turn[0, 0, k] * fx + turn[0, 1, k] * fy + turn[0, 2, k] * fz
            force[i, 1, k] = fy + turn[1, 0, k] * fx + turn[1, 1, k] * fy + turn[1, 2, k] * fz
            force[i, 2, k] = fz + turn[2, 0, k] * fx + turn[2, 1, k] * fy + turn[2, 2, k] * fz


@njit(cache=True, **_OPTIONS)
def placement_frame_force(chunks, turn, spin, mass, reference, force):
    """Make block-frame forces torque-free and turn them back, in place: f ← Q (f - m ψ × X).

    Parameters
    ----------
    chunks
        Row boundaries.
    turn
        Q - 1, (3, 3, lanes).
    spin
        ψ, (3, lanes) [mm/s² per mm].
    mass, reference
        (n_rows,) and X (n_rows, 3).
    force
        (n_rows, 3, lanes).
    """
    for c in range(len(chunks) - 1):
        _placement_chunk(c, chunks, turn, spin, mass, reference, force)


@njit(cache=True, parallel=True, **_OPTIONS)
def placement_frame_force_parallel(chunks, turn, spin, mass, reference, force):
    """`placement_frame_force` with chunks shared among threads."""
    for c in prange(len(chunks) - 1):
        _placement_chunk(c, chunks, turn, spin, mass, reference, force)


@dataclass(frozen=True)
class KernelSet:
    """The kernels that share rows among threads, in one of their two forms."""

    stiffness_product: Callable[..., None]
    update: Callable[..., None]
    viscous_pressure: Callable[..., None]
    add_viscous_force: Callable[..., None]
    add_stiffness_damping: Callable[..., None]
    displacement_moments: Callable[..., None]
    block_frame_displacement: Callable[..., None]
    placement_frame_force: Callable[..., None]


SERIAL = KernelSet(
    stiffness_product=stiffness_product,
    update=update,
    viscous_pressure=viscous_pressure,
    add_viscous_force=add_viscous_force,
    add_stiffness_damping=add_stiffness_damping,
    displacement_moments=displacement_moments,
    block_frame_displacement=block_frame_displacement,
    placement_frame_force=placement_frame_force,
)
PARALLEL = KernelSet(
    stiffness_product=stiffness_product_parallel,
    update=update_parallel,
    viscous_pressure=viscous_pressure_parallel,
    add_viscous_force=add_viscous_force_parallel,
    add_stiffness_damping=add_stiffness_damping_parallel,
    displacement_moments=displacement_moments_parallel,
    block_frame_displacement=block_frame_displacement_parallel,
    placement_frame_force=placement_frame_force_parallel,
)
