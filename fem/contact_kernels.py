"""The compiled loops of explicit contact: positions in, gaps, pressures and nodal forces out.

Work is cut into *units*: up to eight alike pairs of blocks (`fem.contact_lanes`), which are the
lanes of the vector unit. A unit gathers the differences and means of the positions at its node
pairs, works facet by facet on them, and leaves forces on differences and means in arrays of its
own; then each group collects the forces on its rows. Units and rows belong to one thread each:
nothing is shared, and one and two threads give the same bits.

Everything is float64, whatever the precision of the bodies. The plain twin of the facet loop is
`fem.contact.point_kinematics` with `fem.contact.corner_forces`; the tests compare the two.
An argument that is None removes its branch when the kernel is compiled.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from fem.contact_law import law_pressure
from fem.lanes import (
    add,
    any_below,
    divide,
    entry,
    filled,
    lane_operations,
    multiply,
    multiply_add,
    scale,
    square_root,
    store,
    subtract,
    with_entry,
)
from geometry.mesh import FloatArray, IntArray

_OPTIONS = {"error_model": "numpy", "nogil": True}

#: Linear shape functions of an edge at its two Gauss points.
_NEAR = 0.5 * (1.0 + 1.0 / math.sqrt(3.0))
_FAR = 0.5 * (1.0 - 1.0 / math.sqrt(3.0))


class UnitArrays(NamedTuple):
    """Constant arrays of all units; see `fem.explicit_contact`."""

    units: IntArray
    """For each unit: alike pairs, width, real lanes, first lane, first scalar of its node
    arrays, first scalar of its point arrays; (n_units, 6)."""
    alike: IntArray
    """For each kind of alike pairs: first node pair, first facet, group of master and of
    opposing block (0 for rigid ones); one more row with the totals, (n_kinds + 1, 4)."""
    rows: IntArray
    """Body rows of master and opposing node, -1 for rigid blocks, (n_nodes, 2)."""
    offset: FloatArray
    """x_s - x_m of the node pairs, (n_nodes, 3) [mm]."""
    mean: FloatArray
    """(x_m + x_s)/2, (n_nodes, 3) [mm]."""
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

    difference: FloatArray
    """x_s - x_m, [node pair][component][lane]."""
    mean: FloatArray
    """(x_m + x_s)/2."""
    force_difference: FloatArray
    """Force on the difference [N]."""
    force_mean: FloatArray
    """Force on the mean [N]."""
    gap: FloatArray
    """Gap at the points, [facet][point][lane] [mm]."""
    awake: npt.NDArray[np.int8]
    """Whether a unit is worked on, (n_units,)."""


@njit(**_OPTIONS)
def _cross(ax, ay, az, bx, by, bz):
    """Component by component, a × b."""
    return (
        subtract(multiply(ay, bz), multiply(az, by)),
        subtract(multiply(az, bx), multiply(ax, bz)),
        subtract(multiply(ax, by), multiply(ay, bx)),
    )


@njit(**_OPTIONS)
def _dot(ax, ay, az, bx, by, bz):
    return multiply_add(ax, bx, multiply_add(ay, by, multiply(az, bz)))


@njit(**_OPTIONS)
def _mixed(near, far):
    """Value at the Gauss point next to ``near`` on the edge from near to far."""
    return multiply_add(_NEAR, near, scale(_FAR, far))


@njit(**_OPTIONS)
def _at_points(a, b, c, d):
    """One component at the four Gauss points from the four corners."""
    ab, ba, dc, cd = _mixed(a, b), _mixed(b, a), _mixed(d, c), _mixed(c, d)
    return _mixed(ab, dc), _mixed(ba, cd), _mixed(cd, ba), _mixed(dc, ab)


@njit(**_OPTIONS)
def _slopes(a, b, c, d):
    """One component of dx/dr on the lower and upper, dx/ds on the left and right points."""
    low, high = scale(0.5, subtract(b, a)), scale(0.5, subtract(c, d))
    left, right = scale(0.5, subtract(d, a)), scale(0.5, subtract(c, b))
    return _mixed(low, high), _mixed(high, low), _mixed(left, right), _mixed(right, left)


@njit(**_OPTIONS)
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


def _unit_loops(width: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Make the loops over node pairs and over facets for ``width`` lanes."""
    load, zero = lane_operations(width)

    @njit(**_OPTIONS)
    def fetch(like, array, base, copies, side, lane):
        value = zero(like)
        for k in range(width):
            value = with_entry(value, k, np.float64(array[base + copies[side, lane + k]]))
        return value

    @njit(**_OPTIONS)
    def put(at, offset, mean, m, s, work):
        one = filled(m, 1.0)
        store(work.difference, at, multiply_add(offset, one, subtract(s, m)))
        store(work.mean, at, multiply_add(mean, one, scale(0.5, add(m, s))))

    @njit(**_OPTIONS)
    def gather(unit, data, u_m, u_s, work):
        kind, lane, start = data.units[unit, 0], data.units[unit, 3], data.units[unit, 4]
        first, last = data.alike[kind, 0], data.alike[kind + 1, 0]
        lanes_m = data.lanes[data.alike[kind, 2]]
        lanes_s = data.lanes[data.alike[kind, 3]]
        turn = data.rotation[kind]
        like = work.difference
        for node in range(first, last):
            mx, my, mz = zero(like), zero(like), zero(like)
            sx, sy, sz = zero(like), zero(like), zero(like)
            row = data.rows[node, 0]
            if row >= 0:
                base = 3 * row * lanes_m
                mx = fetch(like, u_m, base, data.copies, 0, lane)
                my = fetch(like, u_m, base + lanes_m, data.copies, 0, lane)
                mz = fetch(like, u_m, base + 2 * lanes_m, data.copies, 0, lane)
            row = data.rows[node, 1]
            if row >= 0:
                base = 3 * row * lanes_s
                x = fetch(like, u_s, base, data.copies, 1, lane)
                y = fetch(like, u_s, base + lanes_s, data.copies, 1, lane)
                z = fetch(like, u_s, base + 2 * lanes_s, data.copies, 1, lane)
                sx = multiply_add(turn[0, 0], x, multiply_add(turn[0, 1], y, scale(turn[0, 2], z)))
                sy = multiply_add(turn[1, 0], x, multiply_add(turn[1, 1], y, scale(turn[1, 2], z)))
                sz = multiply_add(turn[2, 0], x, multiply_add(turn[2, 1], y, scale(turn[2, 2], z)))
            at = start + 3 * (node - first) * width
            put(at, data.offset[node, 0], data.mean[node, 0], mx, sx, work)
            put(at + width, data.offset[node, 1], data.mean[node, 1], my, sy, work)
            put(at + 2 * width, data.offset[node, 2], data.mean[node, 2], mz, sz, work)

    @njit(**_OPTIONS)
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

    @njit(**_OPTIONS)
    def at_points(array, corners, j):
        a, b, c, d = corner_values(array, corners, j)
        return _at_points(a, b, c, d)

    @njit(**_OPTIONS)
    def slopes(array, corners, j):
        a, b, c, d = corner_values(array, corners, j)
        return _slopes(a, b, c, d)

    @njit(**_OPTIONS)
    def spread(array, corners, j, values):
        """Add one component of corner forces."""
        shift = j * width
        for i in range(4):
            at = corners[i] + shift
            store(array, at, add(load(array, at), values[i]))

    @njit(**_OPTIONS)
    def point_force(gap, weight, law):
        """Weight times pressure in every lane."""
        force = filled(gap, 0.0)
        for k in range(width):
            pressure = law_pressure(-entry(gap, k), law)
            force = with_entry(force, k, weight * pressure)
        return force

    @njit(**_OPTIONS)
    def facets(unit, data, work, law, normals):
        kind, start, point = data.units[unit, 0], data.units[unit, 4], data.units[unit, 5]
        first, last = data.alike[kind, 1], data.alike[kind + 1, 1]
        clear = -law.start
        size = 3 * width * (data.alike[kind + 1, 0] - data.alike[kind, 0])
        work.force_difference[start : start + size] = 0.0
        if normals is None:
            work.force_mean[start : start + size] = 0.0
        like = work.difference
        for f in range(first, last):
            corners = (
                start + 3 * width * data.corners[f, 0],
                start + 3 * width * data.corners[f, 1],
                start + 3 * width * data.corners[f, 2],
                start + 3 * width * data.corners[f, 3],
            )
            x = at_points(work.difference, corners, 0)
            y = at_points(work.difference, corners, 1)
            z = at_points(work.difference, corners, 2)
            if normals is None:
                # dx/dr below and above, dx/ds left and right of the centre
                tx = slopes(work.mean, corners, 0)
                ty = slopes(work.mean, corners, 1)
                tz = slopes(work.mean, corners, 2)
                n0 = _normal(tx[0], ty[0], tz[0], tx[2], ty[2], tz[2])
                n1 = _normal(tx[0], ty[0], tz[0], tx[3], ty[3], tz[3])
                n2 = _normal(tx[1], ty[1], tz[1], tx[3], ty[3], tz[3])
                n3 = _normal(tx[1], ty[1], tz[1], tx[2], ty[2], tz[2])
            else:
                n0 = _given(zero(like), normals[f, 0])
                n1 = _given(zero(like), normals[f, 1])
                n2 = _given(zero(like), normals[f, 2])
                n3 = _given(zero(like), normals[f, 3])
            g0 = _dot(x[0], y[0], z[0], n0[0], n0[1], n0[2])
            g1 = _dot(x[1], y[1], z[1], n1[0], n1[1], n1[2])
            g2 = _dot(x[2], y[2], z[2], n2[0], n2[1], n2[2])
            g3 = _dot(x[3], y[3], z[3], n3[0], n3[1], n3[2])
            at = point + 4 * width * (f - first)
            store(work.gap, at, g0)
            store(work.gap, at + width, g1)
            store(work.gap, at + 2 * width, g2)
            store(work.gap, at + 3 * width, g3)
            near = any_below(g0, clear) or any_below(g1, clear)
            if not (near or any_below(g2, clear) or any_below(g3, clear)):
                continue
            q0 = point_force(g0, data.weights[f, 0], law)
            q1 = point_force(g1, data.weights[f, 1], law)
            q2 = point_force(g2, data.weights[f, 2], law)
            q3 = point_force(g3, data.weights[f, 3], law)
            target = work.force_difference
            for j in range(3):
                along = _at_points(
                    multiply(q0, n0[j]),
                    multiply(q1, n1[j]),
                    multiply(q2, n2[j]),
                    multiply(q3, n3[j]),
                )
                spread(target, corners, j, along)
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
                target = work.force_mean
                for j in range(3):
                    values = _slopes_to_corners(low[j], high[j], left[j], right[j])
                    spread(target, corners, j, values)

    return gather, facets


@njit(**_OPTIONS)
def _normal(ax, ay, az, bx, by, bz):
    """Unit normal of two tangents, and one over the length of their product."""
    nx, ny, nz = _cross(ax, ay, az, bx, by, bz)
    square = _dot(nx, ny, nz, nx, ny, nz)
    inverse = divide(filled(square, 1.0), square_root(square))
    return multiply(nx, inverse), multiply(ny, inverse), multiply(nz, inverse), inverse


@njit(**_OPTIONS)
def _given(like, normal):
    """Return a normal that does not change; the fourth entry is not used."""
    return (
        filled(like, normal[0]),
        filled(like, normal[1]),
        filled(like, normal[2]),
        filled(like, 0.0),
    )


@njit(**_OPTIONS)
def _turning(x, y, z, normal, gap, force):
    """Force times e = (d - n (n · d)) / |a|, which turns the normal."""
    factor = multiply(force, normal[3])
    return (
        multiply(factor, subtract(x, multiply(gap, normal[0]))),
        multiply(factor, subtract(y, multiply(gap, normal[1]))),
        multiply(factor, subtract(z, multiply(gap, normal[2]))),
    )


@njit(**_OPTIONS)
def _plus(a, b):
    return add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2])


_gather_8, _facets_8 = _unit_loops(8)
_gather_4, _facets_4 = _unit_loops(4)
_gather_1, _facets_1 = _unit_loops(1)


@njit(**_OPTIONS)
def _unit(unit, data, displacements, work, law, normals):
    if work.awake[unit] == 0:
        return
    kind, width = data.units[unit, 0], data.units[unit, 1]
    u_m = displacements[data.alike[kind, 2]]
    u_s = displacements[data.alike[kind, 3]]
    if width == 8:
        _gather_8(unit, data, u_m, u_s, work)
        _facets_8(unit, data, work, law, normals)
    elif width == 4:
        _gather_4(unit, data, u_m, u_s, work)
        _facets_4(unit, data, work, law, normals)
    else:
        _gather_1(unit, data, u_m, u_s, work)
        _facets_1(unit, data, work, law, normals)


@njit(cache=True, **_OPTIONS)
def contact_forces(data, displacements, work, law, normals):
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
    """
    for unit in range(len(data.units)):
        _unit(unit, data, displacements, work, law, normals)


@njit(cache=True, parallel=True, **_OPTIONS)
def contact_forces_parallel(data, displacements, work, law, normals):
    """`contact_forces` with units shared among threads."""
    for unit in prange(len(data.units)):
        _unit(unit, data, displacements, work, law, normals)


@njit(**_OPTIONS)
def _collect_chunk(c, chunks, pointer, entries, data, work, with_mean, lanes, applied):
    for row in range(chunks[c], chunks[c + 1]):
        for e in range(pointer[row], pointer[row + 1]):
            unit, at, side = entries[e, 0], entries[e, 1], entries[e, 2]
            if work.awake[unit] == 0:
                continue
            width, real, lane = data.units[unit, 1], data.units[unit, 2], data.units[unit, 3]
            turn = data.rotation[data.units[unit, 0]]
            sign = 1.0 if side == 1 else -1.0
            for k in range(real):
                fx = sign * work.force_difference[at + k]
                fy = sign * work.force_difference[at + width + k]
                fz = sign * work.force_difference[at + 2 * width + k]
                if with_mean is not None:
                    fx += 0.5 * work.force_mean[at + k]
                    fy += 0.5 * work.force_mean[at + width + k]
                    fz += 0.5 * work.force_mean[at + 2 * width + k]
                base = 3 * row * lanes + data.copies[side, lane + k]
                if side == 1:
                    gx = turn[0, 0] * fx + turn[1, 0] * fy + turn[2, 0] * fz
                    gy = turn[0, 1] * fx + turn[1, 1] * fy + turn[2, 1] * fz
                    fz = turn[0, 2] * fx + turn[1, 2] * fy + turn[2, 2] * fz
                    fx, fy = gx, gy
                applied[base] += fx
                applied[base + lanes] += fy
                applied[base + 2 * lanes] += fz


@njit(cache=True, **_OPTIONS)
def collect_forces(chunks, pointer, entries, data, work, with_mean, lanes, applied):
    """Add the forces of all units to the applied forces of one group.

    Parameters
    ----------
    chunks
        Boundaries of pieces of applied rows, (n_chunks + 1,).
    pointer, entries
        For each applied row, the (unit, first scalar of its node, side) that act on it.
    data, work
        Constant and work arrays.
    with_mean
        None where the forces on the means vanish (reference normals), else anything.
    lanes
        Lanes of the group.
    applied
        Flat (n_applied, 3, lanes), updated.
    """
    for c in range(len(chunks) - 1):
        _collect_chunk(c, chunks, pointer, entries, data, work, with_mean, lanes, applied)


@njit(cache=True, parallel=True, **_OPTIONS)
def collect_forces_parallel(chunks, pointer, entries, data, work, with_mean, lanes, applied):
    """`collect_forces` with rows shared among threads."""
    for c in prange(len(chunks) - 1):
        _collect_chunk(c, chunks, pointer, entries, data, work, with_mean, lanes, applied)
