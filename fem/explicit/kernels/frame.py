# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Block frames: their fit, the view from them, and the way back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import over_lanes, serial_and_parallel
from fem.explicit.kernels.lanes import add, lane_operations, multiply_add, splat, store, subtract
from fem.explicit.kernels.options import OPTIONS
from geometry.compilation import njit


def _moment_lanes(width: int) -> Callable[..., Any]:
    """Make the moments of a range of rows for ``width`` copies from ``first`` on."""
    load, zero = lane_operations(width)

    @njit(**OPTIONS)
    def run(first, lanes, c, begin, end, mass, reference, displacement, moment):
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


_moments = over_lanes(_moment_lanes, 16)


@serial_and_parallel
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


def _frame_lanes(width: int) -> Callable[..., Any]:
    """Make the view from the block frame of a range of rows for ``width`` copies."""
    load, zero = lane_operations(width)

    @njit(**OPTIONS)
    def run(first, lanes, begin, end, turn, mean, reference, displacement, local, increment):
        none = zero(displacement)
        txx = load(turn, 0 * lanes + first)
        txy = load(turn, 1 * lanes + first)
        txz = load(turn, 2 * lanes + first)
        tyx = load(turn, 3 * lanes + first)
        tyy = load(turn, 4 * lanes + first)
        tyz = load(turn, 5 * lanes + first)
        tzx = load(turn, 6 * lanes + first)
        tzy = load(turn, 7 * lanes + first)
        tzz = load(turn, 8 * lanes + first)
        mx = load(mean, first)
        my = load(mean, lanes + first)
        mz = load(mean, 2 * lanes + first)
        for i in range(begin, end):
            x = i * 3 * lanes + first
            y, z = x + lanes, x + 2 * lanes
            wx = subtract(load(displacement, x), mx)
            wy = subtract(load(displacement, y), my)
            wz = subtract(load(displacement, z), mz)
            px = add(wx, splat(reference[i, 0], none))
            py = add(wy, splat(reference[i, 1], none))
            pz = add(wz, splat(reference[i, 2], none))
            lx = multiply_add(txx, px, multiply_add(tyx, py, multiply_add(tzx, pz, wx)))
            ly = multiply_add(txy, px, multiply_add(tyy, py, multiply_add(tzy, pz, wy)))
            lz = multiply_add(txz, px, multiply_add(tyz, py, multiply_add(tzz, pz, wz)))
            if increment is not None:
                store(increment, x, subtract(lx, load(local, x)))
                store(increment, y, subtract(ly, load(local, y)))
                store(increment, z, subtract(lz, load(local, z)))
            store(local, x, lx)
            store(local, y, ly)
            store(local, z, lz)

    made: Callable[..., Any] = run
    return made


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


def _placement_lanes(width: int) -> Callable[..., Any]:
    """Make the turn back to the placement frame of a range of rows for ``width`` copies."""
    load, _ = lane_operations(width)

    @njit(**OPTIONS)
    def run(first, lanes, begin, end, turn, spin, mass, reference, force):
        txx = load(turn, 0 * lanes + first)
        txy = load(turn, 1 * lanes + first)
        txz = load(turn, 2 * lanes + first)
        tyx = load(turn, 3 * lanes + first)
        tyy = load(turn, 4 * lanes + first)
        tyz = load(turn, 5 * lanes + first)
        tzx = load(turn, 6 * lanes + first)
        tzy = load(turn, 7 * lanes + first)
        tzz = load(turn, 8 * lanes + first)
        sx = load(spin, first)
        sy = load(spin, lanes + first)
        sz = load(spin, 2 * lanes + first)
        for i in range(begin, end):
            m = mass[i]
            rx, ry, rz = m * reference[i, 0], m * reference[i, 1], m * reference[i, 2]
            x = i * 3 * lanes + first
            y, z = x + lanes, x + 2 * lanes
            fx = multiply_add(ry, sz, multiply_add(-rz, sy, load(force, x)))
            fy = multiply_add(rz, sx, multiply_add(-rx, sz, load(force, y)))
            fz = multiply_add(rx, sy, multiply_add(-ry, sx, load(force, z)))
            gx = multiply_add(txx, fx, multiply_add(txy, fy, multiply_add(txz, fz, fx)))
            gy = multiply_add(tyx, fx, multiply_add(tyy, fy, multiply_add(tyz, fz, fy)))
            gz = multiply_add(tzx, fx, multiply_add(tzy, fy, multiply_add(tzz, fz, fz)))
            store(force, x, gx)
            store(force, y, gy)
            store(force, z, gz)

    made: Callable[..., Any] = run
    return made


_placements = over_lanes(_placement_lanes, 8)


@serial_and_parallel
def placement_frame_force(chunks, turn, spin, mass, reference, force, lanes):
    """Make block-frame forces torque-free and turn them back, in place: f ← Q (f - m ψ × X).

    Parameters
    ----------
    chunks
        Row boundaries.
    turn
        Q - 1, flat (3, 3, lanes).
    spin
        ψ, flat (3, lanes) [mm/s² per mm].
    mass, reference
        (n_rows,) and X (n_rows, 3).
    force
        Flat (n_rows, 3, lanes).
    lanes
        Padded number of copies.
    """
    for c in prange(len(chunks) - 1):
        _placements(0, lanes, chunks[c], chunks[c + 1], turn, spin, mass, reference, force)
