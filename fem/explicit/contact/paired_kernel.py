"""The compiled loops of explicit contact: positions in, gaps, pressures and nodal forces out.

Work is cut into *units*: up to eight alike pairs of blocks (`fem.explicit.contact.alike_pairs`),
which are the lanes of the vector unit. A unit gathers the differences and means of the positions
at its node pairs, works facet by facet on them, and leaves forces on differences and means in
arrays of its own; then each group collects the forces on its rows. Units and rows belong to one
thread each: nothing is shared, and one and two threads give the same bits.

Everything is float64, whatever the precision of the bodies. The plain twin of the facet loop is
`fem.contact.surfaces.point_kinematics` with `fem.contact.surfaces.corner_forces`; the tests
compare the two. An argument that is None removes its branch when the kernel is compiled.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import get_thread_id, prange

from fem.explicit.kernels.lanes import (
    ROUNDING_SHIFT,
    add,
    add_to,
    any_below,
    divide,
    filled,
    lane_operations,
    larger,
    load_like,
    multiply,
    multiply_add,
    scale,
    smaller,
    square_root,
    store,
    subtract,
    two_to_rounded,
    where_below,
    with_entry,
)
from geometry.compilation import njit
from geometry.mesh import FloatArray, IntArray

_OPTIONS = {"error_model": "numpy", "nogil": True}

#: Last tangential position of points that did not touch.
NEVER = 1e300

#: For what a loop does to every node or facet: vectors then stay in registers.
_INLINED = {**_OPTIONS, "forceinline": True}

#: Linear shape functions of an edge at its two Gauss points.
_NEAR = 0.5 * (1.0 + 1.0 / math.sqrt(3.0))
_FAR = 0.5 * (1.0 - 1.0 / math.sqrt(3.0))


class UnitArrays(NamedTuple):
    """Constant arrays of all units; see `fem.explicit.contact.paired`."""

    units: IntArray
    """For each unit: alike pairs, width, real lanes, first lane, first scalar of its node
    arrays, first scalar of its point arrays, first copy of master and of opposing block where
    copies follow each other, else -1; (n_units, 8)."""
    alike: IntArray
    """For each kind of alike pairs: first node pair, first facet, group of master and of
    opposing block (0 for rigid ones); one more row with the totals, (n_kinds + 1, 4)."""
    rows: IntArray
    """Body rows of master and opposing node, -1 for rigid blocks, (n_nodes, 2)."""
    offset: FloatArray
    """x_s - x_m of the node pairs, (n_nodes, 3) [mm]."""
    mean: FloatArray
    """(x_m + x_s)/2, (n_nodes, 3) [mm]."""
    real: FloatArray
    """One in lanes that hold a pair of blocks, zero in padding, (n_lanes,)."""
    rotation: FloatArray
    """Frame of the opposing block to that of the master, (n_kinds, 3, 3)."""
    corners: IntArray
    """Node pairs of each facet, counted within the kind, (n_facets, 4)."""
    weights: FloatArray
    """Reference area of the points, (n_facets, 4) [mm²]."""
    copies: IntArray
    """Copy of master and opposing block in each lane, (2, n_lanes)."""
    lanes: npt.NDArray[np.int64]
    """Lanes of the bodies, (n_groups,)."""


class UnitWork(NamedTuple):
    """Work arrays of all units, flat; rewritten in every step."""

    force_m: FloatArray
    """Forces on the master blocks, their frames, [node pair][component][lane] [N]."""
    force_s: FloatArray
    """Forces on the opposing blocks, their frames [N]."""
    gap: FloatArray
    """Gap at the points, [facet][point][lane] [mm]."""
    awake: npt.NDArray[np.int8]
    """Whether a unit is worked on, (n_units,)."""
    scratch: FloatArray
    """For each thread: x_s - x_m and (x_m + x_s)/2 of one unit and the forces on them,
    (n_threads, 4, largest unit)."""


@njit(**_INLINED)
def _cross(ax, ay, az, bx, by, bz):
    """Component by component, a × b."""
    return (
        subtract(multiply(ay, bz), multiply(az, by)),
        subtract(multiply(az, bx), multiply(ax, bz)),
        subtract(multiply(ax, by), multiply(ay, bx)),
    )


@njit(**_INLINED)
def _dot(ax, ay, az, bx, by, bz):
    return multiply_add(ax, bx, multiply_add(ay, by, multiply(az, bz)))


@njit(**_INLINED)
def _mixed(near, far):
    """Value at the Gauss point next to ``near`` on the edge from near to far."""
    return multiply_add(_NEAR, near, scale(_FAR, far))


@njit(**_INLINED)
def _at_points(a, b, c, d):
    """One component at the four Gauss points from the four corners."""
    ab, ba, dc, cd = _mixed(a, b), _mixed(b, a), _mixed(d, c), _mixed(c, d)
    return _mixed(ab, dc), _mixed(ba, cd), _mixed(cd, ba), _mixed(dc, ab)


@njit(**_INLINED)
def _slopes(a, b, c, d):
    """One component of dx/dr on the lower and upper, dx/ds on the left and right points."""
    low, high = scale(0.5, subtract(b, a)), scale(0.5, subtract(c, d))
    left, right = scale(0.5, subtract(d, a)), scale(0.5, subtract(c, b))
    return _mixed(low, high), _mixed(high, low), _mixed(left, right), _mixed(right, left)


#: Taylor coefficients 1/3!, 1/4!, … of the exponential: enough for |r| <= ln(2)/2.
_SERIES = tuple(1.0 / math.factorial(k) for k in range(3, 14))
_HIGH_LN2 = 6.93147180369123816490e-01
_LOW_LN2 = 1.90821492927058770002e-10
_PER_LN2 = 1.0 / math.log(2.0)


@njit(**_INLINED)
def exponential_minus_one(x):
    """Return eˣ - 1 of every entry, |x| < 700, to a few units in the last place.

    x = k ln 2 + r, eˣ - 1 = 2ᵏ (eʳ - 1) + (2ᵏ - 1), eʳ - 1 = r + r²/2 + r³ Σ rⁱ / (i + 3)!.
    """
    shift = filled(x, ROUNDING_SHIFT)
    shifted = multiply_add(_PER_LN2, x, shift)
    k = subtract(shifted, shift)
    r = multiply_add(-_LOW_LN2, k, multiply_add(-_HIGH_LN2, k, x))
    tail = filled(x, _SERIES[-1])
    for i in range(len(_SERIES) - 2, -1, -1):
        tail = multiply_add(r, tail, filled(x, _SERIES[i]))
    square = multiply(r, r)
    small = add(r, multiply_add(0.5, square, multiply(multiply(square, r), tail)))
    power = two_to_rounded(shifted)
    return multiply_add(power, small, subtract(power, filled(x, 1.0)))


@njit(**_INLINED)
def pressure_of_gap(gap, law):
    """`fem.contact.law.law_pressure` of minus the gap, in every entry, without branches.

    p = s X (eˣ - 1) + k_linear max(x - x_linear, 0) with X held between 0 and its end.
    """
    none = filled(gap, 0.0)
    end = (law.linear_start - law.start) / law.length
    x = scale(-1.0 / law.length, add(gap, filled(gap, law.start)))
    x = smaller(larger(x, none), filled(gap, end))
    curve = scale(law.scale, multiply(x, exponential_minus_one(x)))
    over = larger(subtract(filled(gap, -law.linear_start), gap), none)
    return multiply_add(law.linear_stiffness, over, curve)


@njit(**_INLINED)
def _slopes_to_corners(low, high, left, right):
    """Transpose of `_slopes`."""
    below, above = scale(0.5, _mixed(low, high)), scale(0.5, _mixed(high, low))
    west, east = scale(0.5, _mixed(left, right)), scale(0.5, _mixed(right, left))
    return (
        subtract(filled(low, 0.0), add(below, west)),
        subtract(below, east),
        add(above, east),
        subtract(west, above),
    )


def _unit_loops(width: int) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
    """Make the loops over node pairs and over facets for ``width`` lanes."""
    load, zero = lane_operations(width)

    @njit(**_INLINED)
    def fetch(like, array, base, copies, first, side, lane):
        """Displacements of the copies in the lanes; ``first`` is the first of a row, or -1."""
        if first >= 0:
            return load_like(zero(like), array, base + first)
        value = zero(like)
        for k in range(width):
            value = with_entry(value, k, np.float64(array[base + copies[side, lane + k]]))
        return value

    @njit(**_INLINED)
    def put(at, offset, mean, m, s, difference, middle):
        one = filled(m, 1.0)
        store(difference, at, multiply_add(offset, one, subtract(s, m)))
        store(middle, at, multiply_add(mean, one, scale(0.5, add(m, s))))

    @njit(**_OPTIONS)
    def gather(unit, data, u_m, u_s, difference, middle):
        kind, lane = data.units[unit, 0], data.units[unit, 3]
        first, last = data.alike[kind, 0], data.alike[kind + 1, 0]
        lanes_m = data.lanes[data.alike[kind, 2]]
        lanes_s = data.lanes[data.alike[kind, 3]]
        first_m, first_s = data.units[unit, 6], data.units[unit, 7]
        turn = data.rotation[kind]
        like = difference
        for node in range(first, last):
            mx, my, mz = zero(like), zero(like), zero(like)
            sx, sy, sz = zero(like), zero(like), zero(like)
            row = data.rows[node, 0]
            if row >= 0:
                base = 3 * row * lanes_m
                mx = fetch(like, u_m, base, data.copies, first_m, 0, lane)
                my = fetch(like, u_m, base + lanes_m, data.copies, first_m, 0, lane)
                mz = fetch(like, u_m, base + 2 * lanes_m, data.copies, first_m, 0, lane)
            row = data.rows[node, 1]
            if row >= 0:
                base = 3 * row * lanes_s
                x = fetch(like, u_s, base, data.copies, first_s, 1, lane)
                y = fetch(like, u_s, base + lanes_s, data.copies, first_s, 1, lane)
                z = fetch(like, u_s, base + 2 * lanes_s, data.copies, first_s, 1, lane)
                sx = multiply_add(turn[0, 0], x, multiply_add(turn[0, 1], y, scale(turn[0, 2], z)))
                sy = multiply_add(turn[1, 0], x, multiply_add(turn[1, 1], y, scale(turn[1, 2], z)))
                sz = multiply_add(turn[2, 0], x, multiply_add(turn[2, 1], y, scale(turn[2, 2], z)))
            at = 3 * (node - first) * width
            put(at, data.offset[node, 0], data.mean[node, 0], mx, sx, difference, middle)
            put(at + width, data.offset[node, 1], data.mean[node, 1], my, sy, difference, middle)
            put(
                at + 2 * width, data.offset[node, 2], data.mean[node, 2], mz, sz, difference, middle
            )

    @njit(**_INLINED)
    def corner_values(array, corners, j):
        """One component of an array at the four corners of a facet."""
        a, b, c, d = corners
        shift = j * width
        return (
            load(array, a + shift),
            load(array, b + shift),
            load(array, c + shift),
            load(array, d + shift),
        )

    @njit(**_INLINED)
    def at_points(array, corners, j):
        a, b, c, d = corner_values(array, corners, j)
        return _at_points(a, b, c, d)

    @njit(**_INLINED)
    def slopes(array, corners, j):
        a, b, c, d = corner_values(array, corners, j)
        return _slopes(a, b, c, d)

    @njit(**_INLINED)
    def spread(array, corners, j, values):
        """Add one component of corner forces."""
        shift = j * width
        for i in range(4):
            at = corners[i] + shift
            store(array, at, add(load(array, at), values[i]))

    @njit(**_INLINED)
    def far_apart(x, y, z, a0, a1, a2, a3, weights, clear, gap, at):
        """Whether no point of a facet can touch, told without the length of its normals.

        d · a / w is half to twice the gap as long as no area doubles or halves. A lower bound
        of the gap is left in ``gap``.
        """
        factor = 0.5 if clear >= 0.0 else 2.0
        lower = 0.5 / factor
        g0 = scale(factor / weights[0], _dot(x[0], y[0], z[0], a0[0], a0[1], a0[2]))
        g1 = scale(factor / weights[1], _dot(x[1], y[1], z[1], a1[0], a1[1], a1[2]))
        g2 = scale(factor / weights[2], _dot(x[2], y[2], z[2], a2[0], a2[1], a2[2]))
        g3 = scale(factor / weights[3], _dot(x[3], y[3], z[3], a3[0], a3[1], a3[2]))
        least = smaller(smaller(g0, g1), smaller(g2, g3))
        if any_below(least, clear):
            return False
        store(gap, at, smaller(g0, scale(lower, g0)))
        store(gap, at + width, smaller(g1, scale(lower, g1)))
        store(gap, at + 2 * width, smaller(g2, scale(lower, g2)))
        store(gap, at + 3 * width, smaller(g3, scale(lower, g3)))
        return True

    @njit(**_INLINED)
    def forget(slip, at):
        """Points that do not touch keep no elastic slip and no last position."""
        far = filled(zero(slip), NEVER)
        for point in range(4):
            first = 4 * (at + point * width)
            store(slip, first, zero(slip))
            store(slip, first + width, zero(slip))
            store(slip, first + 2 * width, far)

    @njit(**_INLINED)
    def rub(unit, force, pressing, weight, d, normal, tangent, slip, at, point, sliding):
        """Add the friction of one point to its force; updates slip and dissipation."""
        friction, dissipated = sliding
        stiffness = weight * friction[1]
        first = 4 * (at + point * width)
        none = zero(slip)
        square = _dot(tangent[0], tangent[1], tangent[2], tangent[0], tangent[1], tangent[2])
        inverse = divide(filled(none, 1.0), square_root(square))
        b = (
            multiply(tangent[0], inverse),
            multiply(tangent[1], inverse),
            multiply(tangent[2], inverse),
        )
        c = _cross(normal[0], normal[1], normal[2], b[0], b[1], b[2])
        along = _dot(d[0], d[1], d[2], b[0], b[1], b[2])
        across = _dot(d[0], d[1], d[2], c[0], c[1], c[2])
        old_x, old_y = load(slip, first), load(slip, first + width)
        last_x, last_y = load(slip, first + 2 * width), load(slip, first + 3 * width)
        known = filled(none, 0.5 * NEVER)
        moved_x = where_below(last_x, known, subtract(along, last_x), none)
        moved_y = where_below(last_x, known, subtract(across, last_y), none)
        trial_x, trial_y = add(old_x, moved_x), add(old_y, moved_y)
        size = square_root(multiply_add(trial_x, trial_x, multiply(trial_y, trial_y)))
        tiny = filled(none, 1e-300)
        limit = divide(scale(friction[0], pressing), larger(scale(stiffness, size), tiny))
        share = smaller(filled(none, 1.0), limit)
        new_x, new_y = multiply(share, trial_x), multiply(share, trial_y)
        # Work of the mean traction on what slipped.
        lost_x = multiply(add(old_x, new_x), subtract(moved_x, subtract(new_x, old_x)))
        lost_y = multiply(add(old_y, new_y), subtract(moved_y, subtract(new_y, old_y)))
        lost = scale(0.5 * stiffness, add(lost_x, lost_y))
        store(dissipated, unit * 8, add(load(dissipated, unit * 8), lost))
        touching = where_below(none, pressing, filled(none, 1.0), none)
        store(slip, first, new_x)
        store(slip, first + width, new_y)
        store(slip, first + 2 * width, where_below(none, touching, along, filled(none, NEVER)))
        store(slip, first + 3 * width, across)
        pull_x, pull_y = scale(-stiffness, new_x), scale(-stiffness, new_y)
        return (
            multiply_add(pull_x, b[0], multiply_add(pull_y, c[0], force[0])),
            multiply_add(pull_x, b[1], multiply_add(pull_y, c[1], force[1])),
            multiply_add(pull_x, b[2], multiply_add(pull_y, c[2], force[2])),
        )

    @njit(**_OPTIONS)
    def facets(
        unit, data, work, law, normals, slip, sliding, difference, middle, on_difference, on_middle
    ):
        kind, point = data.units[unit, 0], data.units[unit, 5]
        first, last = data.alike[kind, 1], data.alike[kind + 1, 1]
        clear = -law.start
        size = 3 * width * (data.alike[kind + 1, 0] - data.alike[kind, 0])
        on_difference[:size] = 0.0
        if normals is None:
            on_middle[:size] = 0.0
        like = difference
        for f in range(first, last):
            corners = (
                3 * width * data.corners[f, 0],
                3 * width * data.corners[f, 1],
                3 * width * data.corners[f, 2],
                3 * width * data.corners[f, 3],
            )
            at = point + 4 * width * (f - first)
            x = at_points(difference, corners, 0)
            y = at_points(difference, corners, 1)
            z = at_points(difference, corners, 2)
            if normals is None:
                # dx/dr below and above, dx/ds left and right of the centre
                tx = slopes(middle, corners, 0)
                ty = slopes(middle, corners, 1)
                tz = slopes(middle, corners, 2)
                a0 = _cross(tx[0], ty[0], tz[0], tx[2], ty[2], tz[2])
                a1 = _cross(tx[0], ty[0], tz[0], tx[3], ty[3], tz[3])
                a2 = _cross(tx[1], ty[1], tz[1], tx[3], ty[3], tz[3])
                a3 = _cross(tx[1], ty[1], tz[1], tx[2], ty[2], tz[2])
                if far_apart(x, y, z, a0, a1, a2, a3, data.weights[f], clear, work.gap, at):
                    if slip is not None:
                        forget(slip, at)
                    continue
                n0, n1, n2, n3 = (
                    _unit_normal(a0),
                    _unit_normal(a1),
                    _unit_normal(a2),
                    _unit_normal(a3),
                )
            else:
                n0 = _given(zero(like), normals[f, 0])
                n1 = _given(zero(like), normals[f, 1])
                n2 = _given(zero(like), normals[f, 2])
                n3 = _given(zero(like), normals[f, 3])
            g0 = _dot(x[0], y[0], z[0], n0[0], n0[1], n0[2])
            g1 = _dot(x[1], y[1], z[1], n1[0], n1[1], n1[2])
            g2 = _dot(x[2], y[2], z[2], n2[0], n2[1], n2[2])
            g3 = _dot(x[3], y[3], z[3], n3[0], n3[1], n3[2])
            store(work.gap, at, g0)
            store(work.gap, at + width, g1)
            store(work.gap, at + 2 * width, g2)
            store(work.gap, at + 3 * width, g3)
            if not any_below(smaller(smaller(g0, g1), smaller(g2, g3)), clear):
                if slip is not None:
                    forget(slip, at)
                continue
            q0 = scale(data.weights[f, 0], pressure_of_gap(g0, law))
            q1 = scale(data.weights[f, 1], pressure_of_gap(g1, law))
            q2 = scale(data.weights[f, 2], pressure_of_gap(g2, law))
            q3 = scale(data.weights[f, 3], pressure_of_gap(g3, law))
            f0, f1, f2, f3 = _along(q0, n0), _along(q1, n1), _along(q2, n2), _along(q3, n3)
            if slip is not None:
                low, high = (tx[0], ty[0], tz[0]), (tx[1], ty[1], tz[1])
                w = data.weights[f]
                d0, d1 = (x[0], y[0], z[0]), (x[1], y[1], z[1])
                d2, d3 = (x[2], y[2], z[2]), (x[3], y[3], z[3])
                f0 = rub(unit, f0, q0, w[0], d0, n0, low, slip, at, 0, sliding)
                f1 = rub(unit, f1, q1, w[1], d1, n1, low, slip, at, 1, sliding)
                f2 = rub(unit, f2, q2, w[2], d2, n2, high, slip, at, 2, sliding)
                f3 = rub(unit, f3, q3, w[3], d3, n3, high, slip, at, 3, sliding)
            for j in range(3):
                spread(on_difference, corners, j, _at_points(f0[j], f1[j], f2[j], f3[j]))
            if normals is None:
                e0 = _turning(x[0], y[0], z[0], n0, g0, q0)
                e1 = _turning(x[1], y[1], z[1], n1, g1, q1)
                e2 = _turning(x[2], y[2], z[2], n2, g2, q2)
                e3 = _turning(x[3], y[3], z[3], n3, g3, q3)
                # Forces on dx/dr are t_2 × e, on dx/ds e × t_1; two points share each.
                low = _plus(
                    _cross(tx[2], ty[2], tz[2], e0[0], e0[1], e0[2]),
                    _cross(tx[3], ty[3], tz[3], e1[0], e1[1], e1[2]),
                )
                high = _plus(
                    _cross(tx[3], ty[3], tz[3], e2[0], e2[1], e2[2]),
                    _cross(tx[2], ty[2], tz[2], e3[0], e3[1], e3[2]),
                )
                left = _plus(
                    _cross(e0[0], e0[1], e0[2], tx[0], ty[0], tz[0]),
                    _cross(e3[0], e3[1], e3[2], tx[1], ty[1], tz[1]),
                )
                right = _plus(
                    _cross(e1[0], e1[1], e1[2], tx[0], ty[0], tz[0]),
                    _cross(e2[0], e2[1], e2[2], tx[1], ty[1], tz[1]),
                )
                for j in range(3):
                    values = _slopes_to_corners(low[j], high[j], left[j], right[j])
                    spread(on_middle, corners, j, values)

    @njit(**_OPTIONS)
    def part(unit, data, work, normals, on_difference, on_middle):
        """Turn forces on differences and means into forces on the two blocks."""
        kind, start = data.units[unit, 0], data.units[unit, 4]
        turn = data.rotation[kind]
        real = load(data.real, data.units[unit, 3])
        half = scale(0.5, real)
        minus = scale(-1.0, real)
        for node in range(data.alike[kind + 1, 0] - data.alike[kind, 0]):
            local = 3 * width * node
            at = start + local
            x = multiply(real, load(on_difference, local))
            y = multiply(real, load(on_difference, local + width))
            z = multiply(real, load(on_difference, local + 2 * width))
            if normals is None:
                hx = multiply(half, load(on_middle, local))
                hy = multiply(half, load(on_middle, local + width))
                hz = multiply(half, load(on_middle, local + 2 * width))
                store(work.force_m, at, subtract(hx, x))
                store(work.force_m, at + width, subtract(hy, y))
                store(work.force_m, at + 2 * width, subtract(hz, z))
                x, y, z = add(hx, x), add(hy, y), add(hz, z)
            else:
                store(work.force_m, at, multiply(minus, x))
                store(work.force_m, at + width, multiply(minus, y))
                store(work.force_m, at + 2 * width, multiply(minus, z))
            for j in range(3):
                turned = multiply_add(
                    turn[0, j], x, multiply_add(turn[1, j], y, scale(turn[2, j], z))
                )
                store(work.force_s, at + j * width, turned)

    return gather, facets, part


@njit(**_INLINED)
def _unit_normal(a):
    """Unit vector along an area vector, and one over its length."""
    square = _dot(a[0], a[1], a[2], a[0], a[1], a[2])
    inverse = divide(filled(square, 1.0), square_root(square))
    return multiply(a[0], inverse), multiply(a[1], inverse), multiply(a[2], inverse), inverse


@njit(**_INLINED)
def _given(like, normal):
    """Return a normal that does not change; the fourth entry is not used."""
    return (
        filled(like, normal[0]),
        filled(like, normal[1]),
        filled(like, normal[2]),
        filled(like, 0.0),
    )


@njit(**_INLINED)
def _turning(x, y, z, normal, gap, force):
    """Force times e = (d - n (n · d)) / |a|, which turns the normal."""
    factor = multiply(force, normal[3])
    return (
        multiply(factor, subtract(x, multiply(gap, normal[0]))),
        multiply(factor, subtract(y, multiply(gap, normal[1]))),
        multiply(factor, subtract(z, multiply(gap, normal[2]))),
    )


@njit(**_INLINED)
def _along(force, normal):
    return multiply(force, normal[0]), multiply(force, normal[1]), multiply(force, normal[2])


@njit(**_INLINED)
def _plus(a, b):
    return add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2])


_load_8 = lane_operations(8)[0]
_load_4 = lane_operations(4)[0]
_gather_8, _facets_8, _part_8 = _unit_loops(8)
_gather_4, _facets_4, _part_4 = _unit_loops(4)
_gather_1, _facets_1, _part_1 = _unit_loops(1)


@njit(**_OPTIONS)
def _unit(unit, thread, data, displacements, work, law, normals, slip, sliding):
    if work.awake[unit] == 0:
        return
    kind, width = data.units[unit, 0], data.units[unit, 1]
    u_m = displacements[data.alike[kind, 2]]
    u_s = displacements[data.alike[kind, 3]]
    d, m = work.scratch[thread, 0], work.scratch[thread, 1]
    on_d, on_m = work.scratch[thread, 2], work.scratch[thread, 3]
    if width == 8:
        _gather_8(unit, data, u_m, u_s, d, m)
        _facets_8(unit, data, work, law, normals, slip, sliding, d, m, on_d, on_m)
        _part_8(unit, data, work, normals, on_d, on_m)
    elif width == 4:
        _gather_4(unit, data, u_m, u_s, d, m)
        _facets_4(unit, data, work, law, normals, slip, sliding, d, m, on_d, on_m)
        _part_4(unit, data, work, normals, on_d, on_m)
    else:
        _gather_1(unit, data, u_m, u_s, d, m)
        _facets_1(unit, data, work, law, normals, slip, sliding, d, m, on_d, on_m)
        _part_1(unit, data, work, normals, on_d, on_m)


@njit(cache=True, **_OPTIONS)
def contact_forces(data, displacements, work, law, normals, slip, sliding):
    """Gaps, pressures and forces of all units that are awake.

    Parameters
    ----------
    data, work
        Constant and work arrays.
    displacements
        Flat displacements of the groups, placement frames, (n_rows, 3, lanes) each.
    law
        Constants of the contact law.
    normals
        None for current normals, or reference normals in the master frame, (n_facets, 4, 3).
    slip
        None without friction, or flat [facet][point][4][lane]: elastic slip along and across
        dx/dr, last position along and across (`NEVER` where it did not touch) [mm].
    sliding
        None, or friction coefficient and stick stiffness (2,), and the energy dissipated so
        far, flat (n_units, 8) [N mm].
    """
    for unit in range(len(data.units)):
        _unit(unit, 0, data, displacements, work, law, normals, slip, sliding)


@njit(cache=True, parallel=True, **_OPTIONS)
def contact_forces_parallel(data, displacements, work, law, normals, slip, sliding):
    """`contact_forces` with units shared among threads."""
    for unit in prange(len(data.units)):
        _unit(unit, get_thread_id(), data, displacements, work, law, normals, slip, sliding)


@njit(**_OPTIONS)
def _collect_chunk(c, chunks, pointer, entries, data, work, lanes, applied):
    for row in range(chunks[c], chunks[c + 1]):
        base = 3 * row * lanes
        for e in range(pointer[row], pointer[row + 1]):
            unit, at = entries[e, 0], entries[e, 1]
            if work.awake[unit] == 0:
                continue
            if entries[e, 2] == 1:
                _add_entry(unit, 1, data, work.force_s, at, applied, base, lanes)
            else:
                _add_entry(unit, 0, data, work.force_m, at, applied, base, lanes)


@njit(**_OPTIONS)
def _add_entry(unit, side, data, force, at, applied, base, lanes):
    """Add the forces on one node in all lanes of a unit."""
    width, first = data.units[unit, 1], data.units[unit, 6 + side]
    if first >= 0 and width == 8:
        add_to(applied, base + first, _load_8(force, at))
        add_to(applied, base + first + lanes, _load_8(force, at + 8))
        add_to(applied, base + first + 2 * lanes, _load_8(force, at + 16))
        return
    if first >= 0 and width == 4:
        add_to(applied, base + first, _load_4(force, at))
        add_to(applied, base + first + lanes, _load_4(force, at + 4))
        add_to(applied, base + first + 2 * lanes, _load_4(force, at + 8))
        return
    lane = data.units[unit, 3]
    for k in range(data.units[unit, 2]):
        where = base + data.copies[side, lane + k]
        applied[where] += force[at + k]
        applied[where + lanes] += force[at + width + k]
        applied[where + 2 * lanes] += force[at + 2 * width + k]


@njit(cache=True, **_OPTIONS)
def collect_forces(chunks, pointer, entries, data, work, lanes, applied):
    """Add the forces of all units to the applied forces of one group.

    Parameters
    ----------
    chunks
        Boundaries of pieces of applied rows, (n_chunks + 1,).
    pointer, entries
        For each applied row, the (unit, first scalar of its node, side) that act on it.
    data, work
        Constant and work arrays.
    lanes
        Lanes of the group.
    applied
        Flat (n_applied, 3, lanes), updated.
    """
    for c in range(len(chunks) - 1):
        _collect_chunk(c, chunks, pointer, entries, data, work, lanes, applied)


@njit(cache=True, parallel=True, **_OPTIONS)
def collect_forces_parallel(chunks, pointer, entries, data, work, lanes, applied):
    """`collect_forces` with rows shared among threads."""
    for c in prange(len(chunks) - 1):
        _collect_chunk(c, chunks, pointer, entries, data, work, lanes, applied)


@njit(cache=True, **_OPTIONS)
def add_travel(rows, velocity, time_step, travel):
    """Add to the travel of every copy the way its fastest surface node goes in a step.

    Parameters
    ----------
    rows
        Rows on the surface, (n,).
    velocity
        (n_rows, 3, lanes) [mm/s].
    time_step
        [s]
    travel
        (n_copies,) [mm], updated.
    """
    lanes = len(travel)
    fastest = np.zeros(lanes)
    for row in rows:
        for k in range(lanes):
            x, y, z = velocity[row, 0, k], velocity[row, 1, k], velocity[row, 2, k]
            fastest[k] = max(fastest[k], x * x + y * y + z * z)
    for k in range(lanes):
        travel[k] += time_step * math.sqrt(fastest[k])
