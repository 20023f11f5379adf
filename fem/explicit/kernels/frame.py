# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Block frames: their fit, the view from them, and the way back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import OPTIONS, over_lanes, serial_and_parallel
from fem.explicit.kernels.lanes import REGISTER_DOUBLES, lane_operations, multiply_add, store
from fem.explicit.kernels.triples import (
    INLINED,
    minus,
    plus,
    store_triple,
    triple_of,
    triple_operations,
)
from geometry.compilation import njit


@njit(**INLINED)
def _grown(sums, weights, value):
    """Four sums, each grown by its weight times a value."""
    return (
        multiply_add(weights[0], value, sums[0]),
        multiply_add(weights[1], value, sums[1]),
        multiply_add(weights[2], value, sums[2]),
        multiply_add(weights[3], value, sums[3]),
    )


def _moment_lanes(width: int) -> Callable[..., Any]:
    """Make the moments of a range of rows for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**OPTIONS)
    def run(first, lanes, c, begin, end, mass, reference, displacement, moment):
        none = zero()
        for j in range(3):  # one component at a time: more sums than that no processor holds
            sums = (none, none, none, none)
            for i in range(begin, end):
                m = mass[i]
                weights = m * reference[i, 0], m * reference[i, 1], m * reference[i, 2], m
                sums = _grown(sums, weights, load(displacement, (3 * i + j) * lanes + first))
            at = (12 * c + 4 * j) * lanes + first
            store(moment, at, sums[0])
            store(moment, at + lanes, sums[1])
            store(moment, at + 2 * lanes, sums[2])
            store(moment, at + 3 * lanes, sums[3])

    return run


_moments = over_lanes(_moment_lanes, 2 * REGISTER_DOUBLES)


@serial_and_parallel
def displacement_moments(chunks, mass, reference, displacement, moment, lanes):
    """Partial sums of m u_j (X_x, X_y, X_z, 1), j = x, y, z, of every copy.

    Parameters
    ----------
    chunks
        Row boundaries.
    mass, reference
        (n_rows,) and X (n_rows, 3).
    displacement, moment
        Flat (n_rows, 3, lanes) and, out, flat (n_chunks, 12, lanes).
    lanes
        Padded number of copies.
    """
    for c in prange(len(chunks) - 1):
        _moments(0, lanes, c, chunks[c], chunks[c + 1], mass, reference, displacement, moment)


@njit(**OPTIONS)
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


@njit(**OPTIONS)
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


@njit(cache=True, **OPTIONS)
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
                total += moment[c, 4 * i + 3, k]
            mean[i, k] = total / total_mass
            for j in range(3):
                total = 0.0
                for c in range(moment.shape[0]):
                    total += moment[c, 4 * i + j, k]
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


@njit(**INLINED)
def _with_row(row, a, start):
    """Row · a + start."""
    return multiply_add(row[0], a[0], multiply_add(row[1], a[1], multiply_add(row[2], a[2], start)))


def _frame_lanes(width: int) -> Callable[..., Any]:
    """Make the view from the block frame of a range of rows for ``width`` copies."""
    load_triple, _ = triple_operations(width)

    @njit(**OPTIONS)
    def run(first, lanes, begin, end, turn, mean, reference, displacement, local, increment):
        tx = load_triple(turn, first, 3 * lanes)
        ty = load_triple(turn, first + lanes, 3 * lanes)
        tz = load_triple(turn, first + 2 * lanes, 3 * lanes)
        m = load_triple(mean, first, lanes)
        for i in range(begin, end):
            at = i * 3 * lanes + first
            w = minus(load_triple(displacement, at, lanes), m)
            p = plus(w, triple_of(reference, i))
            seen = _with_row(tx, p, w[0]), _with_row(ty, p, w[1]), _with_row(tz, p, w[2])
            if increment is not None:
                store_triple(increment, at, lanes, minus(seen, load_triple(local, at, lanes)))
            store_triple(local, at, lanes, seen)

    return run


_frames = over_lanes(_frame_lanes, 8)


@serial_and_parallel
def block_frame_displacement(chunks, turn, mean, reference, displacement, local, increment, lanes):
    """Displacement seen from the block frame, Qᵀ(X + u - ū) - X.

    Parameters
    ----------
    chunks
        Row boundaries.
    turn, mean
        Q - 1, flat (3, 3, lanes), and ū, flat (3, lanes), of `fit_frames`.
    reference
        X, (n_rows, 3) [mm].
    displacement, local
        u and the result, flat (n_rows, 3, lanes).
    increment
        None, or out: the change of ``local``, flat.
    lanes
        Padded number of copies.
    """
    for c in prange(len(chunks) - 1):
        _frames(
            0,
            lanes,
            chunks[c],
            chunks[c + 1],
            turn,
            mean,
            reference,
            displacement,
            local,
            increment,
        )


@njit(cache=True, **OPTIONS)
def set_spins(torque, compliance, spin):
    """Angular accelerations that take the torque from the forces of each block, ψ = J⁻¹ Σ u' × f.

    Parameters
    ----------
    torque
        Partial sums of u' × f, (n_chunks, 3, lanes).
    compliance
        J⁻¹ of `fit_frames`, (3, 3, lanes).
    spin
        Out: ψ, (3, lanes) [mm/s² per mm].
    """
    total = np.zeros(3)
    for k in range(torque.shape[2]):
        for j in range(3):
            total[j] = 0.0
            for c in range(torque.shape[0]):
                total[j] += torque[c, j, k]
        for i in range(3):
            spin[i, k] = (
                compliance[i, 0, k] * total[0]
                + compliance[i, 1, k] * total[1]
                + compliance[i, 2, k] * total[2]
            )


def placed_force(width: int) -> Callable[..., Any]:
    """Make ``placed(force, placing, reference, mass, i, at, first, lanes)``: see `place_force`."""
    load_triple = triple_operations(width).load

    @njit(**INLINED)
    def placed(force, placing, reference, mass, i, at, first, lanes):
        tx = load_triple(placing, first, lanes)
        ty = load_triple(placing, first + 3 * lanes, lanes)
        tz = load_triple(placing, first + 6 * lanes, lanes)
        sx, sy, sz = load_triple(placing, first + 9 * lanes, lanes)
        m = mass[i]
        rx, ry, rz = m * reference[i, 0], m * reference[i, 1], m * reference[i, 2]
        f = load_triple(force, at, lanes)
        f = (
            multiply_add(ry, sz, multiply_add(-rz, sy, f[0])),
            multiply_add(rz, sx, multiply_add(-rx, sz, f[1])),
            multiply_add(rx, sy, multiply_add(-ry, sx, f[2])),
        )
        return _with_row(tx, f, f[0]), _with_row(ty, f, f[1]), _with_row(tz, f, f[2])

    return placed


def _placement_lanes(width: int) -> Callable[..., Any]:
    """Make the turn back to the placement frame of a row for ``width`` copies."""
    placed = placed_force(width)

    @njit(**OPTIONS)
    def run(first, lanes, i, placing, mass, reference, force, result):
        at = i * 3 * lanes + first
        f = placed(force, placing, reference, mass, i, at, first, lanes)
        store_triple(result, at, lanes, f)

    return run


_placements = over_lanes(_placement_lanes, 8)


@njit(cache=True, **OPTIONS)
def place_force(placing, mass, reference, force, result, lanes):
    """Make block-frame forces torque-free and turn them to the placement axes: Q (f - m ψ × X).

    The motion does so in passing (`fem.explicit.kernels.motion.update`).

    Parameters
    ----------
    placing
        Q - 1, then ψ, flat (4, 3, lanes).
    mass, reference
        (n_rows,) and X (n_rows, 3).
    force, result
        Flat (n_rows, 3, lanes); the result is overwritten.
    lanes
        Padded number of copies.
    """
    for i in range(len(mass)):
        _placements(0, lanes, i, placing, mass, reference, force, result)
