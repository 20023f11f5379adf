"""The compiled loops of explicit contact: positions in, gaps, pressures and nodal forces out.

Work is cut into *units*: some alike pairs of blocks (`fem.explicit.contact.alike_pairs`),
which are the lanes of the vector unit. A unit gathers the differences and means of the positions
at its node pairs, works facet by facet on them, and leaves forces on differences and means in
arrays of its own; then each body collects the forces on its rows. Units and rows belong to one
thread each: nothing is shared, and one and two threads give the same bits.

The plain twins of the facet loop are the methods `kinematics` and `nodal_forces` of
`fem.contact.surfaces.ContactPoints`; tests compare both. An argument that is None removes its
branch when the kernel is compiled.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import prange

from fem.contact.friction import return_formula, slip_loss
from fem.contact.law import pressure_formula
from fem.explicit.contact.compiled_law import law_at
from fem.explicit.kernels.forms import OPTIONS, serial_and_parallel
from fem.explicit.kernels.lanes import (
    REGISTER_DOUBLES,
    ROUNDING_SHIFT,
    add_to,
    any_below,
    filled,
    lane_operations,
    larger,
    multiply_add,
    smaller,
    square_root,
    store,
    two_to_rounded,
    where_below,
    with_entry,
)
from fem.explicit.kernels.triples import (
    INLINED,
    cross,
    dot,
    minus,
    plus,
    store_triple,
    times,
    triple_of,
    triple_operations,
    turned,
    turned_back,
)
from geometry.compilation import njit
from geometry.mesh import FloatArray, IntArray

#: Last tangential position of points that did not touch.
NEVER = 1e300

#: Linear shape functions of an edge at its two Gauss points.
_NEAR = 0.5 * (1.0 + 1.0 / math.sqrt(3.0))
_FAR = 0.5 * (1.0 - 1.0 / math.sqrt(3.0))


class UnitArrays(NamedTuple):
    """Constant arrays of all units; see `fem.explicit.contact.paired`."""

    units: IntArray
    """For each unit: alike pairs, width, real lanes, first lane, first scalar of its node
    arrays, first scalar of its point arrays, first copy of master and of opposing block where
    copies follow each other, else -1; (n_units, 8)."""
    order: IntArray
    """Units in the order of the rows that they touch, (n_units,)."""
    shares: IntArray
    """First place of each thread in this order, (n_threads + 1,)."""
    alike: IntArray
    """For each kind of alike pairs: first node pair, first facet, body of master and of
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
    """Lanes of the bodies, (n_bodies,)."""


class UnitWork(NamedTuple):
    """Work arrays of all units, flat; rewritten in every step."""

    force: FloatArray
    """Forces on the master blocks and on the opposing ones, their frames,
    [side][node pair][component][lane] [N]."""
    gap: FloatArray
    """Gap at the points, [facet][point][lane] [mm]."""
    scratch: FloatArray
    """For each thread: x_s - x_m and (x_m + x_s)/2 of one unit and the forces on them,
    (n_threads, 4, largest unit)."""


class Rubbing(NamedTuple):
    """History of friction; evolves."""

    slip: FloatArray
    """Flat [facet][point][4][lane]: elastic slip along `slip_sides` of the mean surface, last
    position alike (`NEVER` where it did not touch) [mm]."""
    lost: FloatArray
    """Energy dissipated so far, flat (n_units, 8) [N mm]."""


@njit(**INLINED)
def _mixed(near, far):
    """Value at the Gauss point next to ``near`` on the edge from near to far."""
    return multiply_add(_NEAR, near, _FAR * far)


@njit(**INLINED)
def _at_points(a, b, c, d):
    """One component at the four Gauss points from the four corners."""
    ab, ba, dc, cd = _mixed(a, b), _mixed(b, a), _mixed(d, c), _mixed(c, d)
    return _mixed(ab, dc), _mixed(ba, cd), _mixed(cd, ba), _mixed(dc, ab)


@njit(**INLINED)
def _slopes(a, b, c, d):
    """One component of dx/dr on the lower and upper, dx/ds on the left and right points."""
    low, high = 0.5 * (b - a), 0.5 * (c - d)
    left, right = 0.5 * (d - a), 0.5 * (c - b)
    return _mixed(low, high), _mixed(high, low), _mixed(left, right), _mixed(right, left)


@njit(**INLINED)
def _slopes_to_corners(low, high, left, right):
    """Transpose of `_slopes`."""
    below, above = 0.5 * _mixed(low, high), 0.5 * _mixed(high, low)
    west, east = 0.5 * _mixed(left, right), 0.5 * _mixed(right, left)
    return 0.0 - (below + west), below - east, above + east, west - above


@njit(**INLINED)
def _four_triples(x, y, z):
    """Four vectors from four values of each component."""
    return (
        (x[0], y[0], z[0]),
        (x[1], y[1], z[1]),
        (x[2], y[2], z[2]),
        (x[3], y[3], z[3]),
    )


#: Taylor coefficients 1/3!, 1/4!, … of the exponential: enough for |r| <= ln(2)/2.
_SERIES = tuple(1.0 / math.factorial(k) for k in range(3, 14))
_HIGH_LN2 = 6.93147180369123816490e-01
_LOW_LN2 = 1.90821492927058770002e-10
_PER_LN2 = 1.0 / math.log(2.0)


@njit(**INLINED)
def exponential_minus_one(x):
    """Return eˣ - 1 of every entry, |x| < 700, to a few units in the last place.

    x = k ln 2 + r, eˣ - 1 = 2ᵏ (eʳ - 1) + (2ᵏ - 1), eʳ - 1 = r + r²/2 + r³ Σ rⁱ / (i + 3)!.
    """
    shifted = multiply_add(_PER_LN2, x, ROUNDING_SHIFT)
    k = shifted - ROUNDING_SHIFT
    r = multiply_add(-_LOW_LN2, k, multiply_add(-_HIGH_LN2, k, x))
    tail = filled(x, _SERIES[-1])
    for i in range(len(_SERIES) - 2, -1, -1):
        tail = multiply_add(r, tail, _SERIES[i])
    square = r * r
    small = r + multiply_add(0.5, square, square * r * tail)
    power = two_to_rounded(shifted)
    return multiply_add(power, small, power - 1.0)


#: `fem.contact.law.law_pressure` in every entry, without branches.
lanes_pressure = njit(error_model="numpy", forceinline=True)(
    pressure_formula(larger, smaller, exponential_minus_one)
)
#: The return of friction alike.
lanes_share = njit(error_model="numpy", forceinline=True)(return_formula(larger, square_root))


@njit(**INLINED)
def _unit_normal(a):
    """Unit vector along an area vector, and one over its length."""
    inverse = 1.0 / square_root(dot(a, a))
    return times(inverse, a), inverse


@njit(**INLINED)
def _length(a):
    return square_root(dot(a, a))


@njit(**INLINED)
def _between(a, b, length_a, length_b):
    """Unit vector half-way between two directions."""
    sum_ = plus(times(length_b, a), times(length_a, b))
    return times(1.0 / _length(sum_), sum_)


@njit(**INLINED)
def _given(like, normal):
    """Return a normal that does not change; nothing is turned with it."""
    n = filled(like, normal[0]), filled(like, normal[1]), filled(like, normal[2])
    return n, filled(like, 0.0)


@njit(**INLINED)
def _turning(d, normal, gap, force):
    """Force times e = (d - n (n · d)) / |a|, which turns the normal."""
    n, inverse = normal
    return times(force * inverse, minus(d, times(gap, n)))


def _unit_loops(width: int) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
    """Make the loops over node pairs and over facets for ``width`` lanes."""
    load, zero = lane_operations(width)
    load_triple = triple_operations(width).load

    @njit(**INLINED)
    def fetch(array, base, copies, first, side, lane):
        """Displacements of the copies in the lanes; ``first`` is the first of a row, or -1."""
        if first >= 0:
            return load(array, base + first)
        value = zero()
        for k in range(width):
            value = with_entry(value, k, array[base + copies[side, lane + k]])
        return value

    @njit(**OPTIONS)
    def gather(unit, data, u_m, u_s, scratch):
        difference, middle, _, _ = scratch
        kind, lane = data.units[unit, 0], data.units[unit, 3]
        first, last = data.alike[kind, 0], data.alike[kind + 1, 0]
        lanes_m = data.lanes[data.alike[kind, 2]]
        lanes_s = data.lanes[data.alike[kind, 3]]
        first_m, first_s = data.units[unit, 6], data.units[unit, 7]
        turn = data.rotation[kind]
        none = zero(), zero(), zero()
        for node in range(first, last):
            m = s = none  # rigid blocks have no displacements
            # Not one function for both: what branches in two nested calls counts references.
            row = data.rows[node, 0]
            if row >= 0:
                base = 3 * row * lanes_m
                m = (
                    fetch(u_m, base, data.copies, first_m, 0, lane),
                    fetch(u_m, base + lanes_m, data.copies, first_m, 0, lane),
                    fetch(u_m, base + 2 * lanes_m, data.copies, first_m, 0, lane),
                )
            row = data.rows[node, 1]
            if row >= 0:
                base = 3 * row * lanes_s
                local = (
                    fetch(u_s, base, data.copies, first_s, 1, lane),
                    fetch(u_s, base + lanes_s, data.copies, first_s, 1, lane),
                    fetch(u_s, base + 2 * lanes_s, data.copies, first_s, 1, lane),
                )
                s = turned(turn, local)
            at = 3 * (node - first) * width
            offset, mean = triple_of(data.offset, node), triple_of(data.mean, node)
            store_triple(difference, at, width, plus(minus(s, m), offset))
            store_triple(middle, at, width, plus(times(0.5, plus(m, s)), mean))

    @njit(**INLINED)
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

    @njit(**INLINED)
    def at_points(array, corners):
        """Vectors at the four Gauss points."""
        x = _at_points(*corner_values(array, corners, 0))
        y = _at_points(*corner_values(array, corners, 1))
        z = _at_points(*corner_values(array, corners, 2))
        return _four_triples(x, y, z)

    @njit(**INLINED)
    def slopes(array, corners):
        """Vectors dx/dr below and above, dx/ds left and right of the centre."""
        x = _slopes(*corner_values(array, corners, 0))
        y = _slopes(*corner_values(array, corners, 1))
        z = _slopes(*corner_values(array, corners, 2))
        return _four_triples(x, y, z)

    @njit(**INLINED)
    def spread(array, corners, j, values):
        """Add one component of corner forces."""
        shift = j * width
        for i in range(4):
            at = corners[i] + shift
            store(array, at, load(array, at) + values[i])

    @njit(**INLINED)
    def far_apart(d, areas, weights, clear, gap, at):
        """Whether no point of a facet can touch, told without the length of its normals.

        d · a / w is half to twice the gap as long as no area doubles or halves. A lower bound
        of the gap is left in ``gap``.
        """
        factor = 0.5 if clear >= 0.0 else 2.0
        lower = 0.5 / factor
        g0 = (factor / weights[0]) * dot(d[0], areas[0])
        g1 = (factor / weights[1]) * dot(d[1], areas[1])
        g2 = (factor / weights[2]) * dot(d[2], areas[2])
        g3 = (factor / weights[3]) * dot(d[3], areas[3])
        least = smaller(smaller(g0, g1), smaller(g2, g3))
        if any_below(least, clear):
            return False
        store(gap, at, smaller(g0, lower * g0))
        store(gap, at + width, smaller(g1, lower * g1))
        store(gap, at + 2 * width, smaller(g2, lower * g2))
        store(gap, at + 3 * width, smaller(g3, lower * g3))
        return True

    @njit(**INLINED)
    def touched(slip, at):
        """Whether a point of a facet touched in the last step."""
        first = 4 * at + 2 * width
        a, b = load(slip, first), load(slip, first + 4 * width)
        c, d = load(slip, first + 8 * width), load(slip, first + 12 * width)
        return any_below(smaller(smaller(a, b), smaller(c, d)), 0.5 * NEVER)

    @njit(**INLINED)
    def rub(unit, law, force, pressing, weight, d, normal, b, rubbing, at, point):
        """Add the friction of one point to its force; updates slip and loss.

        Along ``b`` and across it. A point that opens loses the energy of its elastic slip, as one
        that slides without a limit; one that was open begins at its present slip.
        """
        slip, lost = rubbing
        stiffness = weight * law.stick
        first = 4 * (at + point * width)
        none = zero()
        c = cross(normal, b)
        along, across = dot(d, b), dot(d, c)
        old_x, old_y = load(slip, first), load(slip, first + width)
        last_x, last_y = load(slip, first + 2 * width), load(slip, first + 3 * width)
        moved_x = where_below(last_x, 0.5 * NEVER, along - last_x, none)
        moved_y = where_below(last_x, 0.5 * NEVER, across - last_y, none)
        trial_x, trial_y = old_x + moved_x, old_y + moved_y
        share = lanes_share(trial_x, trial_y, stiffness, law.coefficient * pressing)
        new_x, new_y = share * trial_x, share * trial_y
        loss = slip_loss((old_x, old_y), (trial_x, trial_y), (new_x, new_y))
        store(lost, unit * 8, multiply_add(0.5 * stiffness, loss, load(lost, unit * 8)))
        touching = where_below(none, pressing, 1.0, none)
        store(slip, first, new_x)
        store(slip, first + width, new_y)
        store(slip, first + 2 * width, where_below(none, touching, along, NEVER))
        store(slip, first + 3 * width, across)
        pull_x, pull_y = -stiffness * new_x, -stiffness * new_y
        return (
            multiply_add(pull_x, b[0], multiply_add(pull_y, c[0], force[0])),
            multiply_add(pull_x, b[1], multiply_add(pull_y, c[1], force[1])),
            multiply_add(pull_x, b[2], multiply_add(pull_y, c[2], force[2])),
        )

    @njit(**OPTIONS)
    def facets(unit, data, work, law, normals, rubbing, scratch):
        difference, middle, on_difference, on_middle = scratch
        kind, point = data.units[unit, 0], data.units[unit, 5]
        first, last = data.alike[kind, 1], data.alike[kind + 1, 1]
        own = law_at(law, unit)
        clear = -own.start
        size = 3 * width * (data.alike[kind + 1, 0] - data.alike[kind, 0])
        on_difference[:size] = 0.0
        if normals is None:
            on_middle[:size] = 0.0
        for f in range(first, last):
            corners = (
                3 * width * data.corners[f, 0],
                3 * width * data.corners[f, 1],
                3 * width * data.corners[f, 2],
                3 * width * data.corners[f, 3],
            )
            at = point + 4 * width * (f - first)
            # A slice would count references to the array, at every facet.
            w = data.weights[f, 0], data.weights[f, 1], data.weights[f, 2], data.weights[f, 3]
            d = at_points(difference, corners)
            rests = True
            if rubbing is not None:
                rests = not touched(rubbing.slip, at)
            if normals is None:
                low, high, left, right = slopes(middle, corners)
                areas = cross(low, left), cross(low, right), cross(high, right), cross(high, left)
                if rests and far_apart(d, areas, w, clear, work.gap, at):
                    continue
                n0, n1 = _unit_normal(areas[0]), _unit_normal(areas[1])
                n2, n3 = _unit_normal(areas[2]), _unit_normal(areas[3])
            else:
                n0, n1 = _given(zero(), normals[f, 0]), _given(zero(), normals[f, 1])
                n2, n3 = _given(zero(), normals[f, 2]), _given(zero(), normals[f, 3])
            g0, g1 = dot(d[0], n0[0]), dot(d[1], n1[0])
            g2, g3 = dot(d[2], n2[0]), dot(d[3], n3[0])
            store(work.gap, at, g0)
            store(work.gap, at + width, g1)
            store(work.gap, at + 2 * width, g2)
            store(work.gap, at + 3 * width, g3)
            if rests and not any_below(smaller(smaller(g0, g1), smaller(g2, g3)), clear):
                continue
            q0 = w[0] * lanes_pressure(0.0 - g0, own)
            q1 = w[1] * lanes_pressure(0.0 - g1, own)
            q2 = w[2] * lanes_pressure(0.0 - g2, own)
            q3 = w[3] * lanes_pressure(0.0 - g3, own)
            f0, f1, f2, f3 = times(q0, n0[0]), times(q1, n1[0]), times(q2, n2[0]), times(q3, n3[0])
            if rubbing is not None:
                below, above, west, east = (
                    _length(low),
                    _length(high),
                    _length(left),
                    _length(right),
                )
                b0, b1 = _between(low, left, below, west), _between(low, right, below, east)
                b2, b3 = _between(high, right, above, east), _between(high, left, above, west)
                f0 = rub(unit, own, f0, q0, w[0], d[0], n0[0], b0, rubbing, at, 0)
                f1 = rub(unit, own, f1, q1, w[1], d[1], n1[0], b1, rubbing, at, 1)
                f2 = rub(unit, own, f2, q2, w[2], d[2], n2[0], b2, rubbing, at, 2)
                f3 = rub(unit, own, f3, q3, w[3], d[3], n3[0], b3, rubbing, at, 3)
            for j in range(3):
                spread(on_difference, corners, j, _at_points(f0[j], f1[j], f2[j], f3[j]))
            if normals is None:
                e0, e1 = _turning(d[0], n0, g0, q0), _turning(d[1], n1, g1, q1)
                e2, e3 = _turning(d[2], n2, g2, q2), _turning(d[3], n3, g3, q3)
                # Forces on dx/dr are t_2 × e, on dx/ds e × t_1; two points share each.
                on_low = plus(cross(left, e0), cross(right, e1))
                on_high = plus(cross(right, e2), cross(left, e3))
                on_left = plus(cross(e0, low), cross(e3, high))
                on_right = plus(cross(e1, low), cross(e2, high))
                for j in range(3):
                    values = _slopes_to_corners(on_low[j], on_high[j], on_left[j], on_right[j])
                    spread(on_middle, corners, j, values)

    @njit(**OPTIONS)
    def part(unit, data, work, normals, scratch):
        """Turn forces on differences and means into forces on the two blocks."""
        _, _, on_difference, on_middle = scratch
        kind, start = data.units[unit, 0], data.units[unit, 4]
        other = start + len(work.force) // 2
        turn = data.rotation[kind]
        real = load(data.real, data.units[unit, 3])
        for node in range(data.alike[kind + 1, 0] - data.alike[kind, 0]):
            local = 3 * width * node
            apart = times(real, load_triple(on_difference, local, width))
            if normals is None:
                shared = times(0.5 * real, load_triple(on_middle, local, width))
                on_m, on_s = minus(shared, apart), plus(shared, apart)
            else:
                on_m, on_s = times(-1.0, apart), apart
            store_triple(work.force, start + local, width, on_m)
            store_triple(work.force, other + local, width, turned_back(turn, on_s))

    return gather, facets, part


_load_wide = lane_operations(REGISTER_DOUBLES)[0]
_load_4 = lane_operations(4)[0]
_gather, _facets, _part = _unit_loops(REGISTER_DOUBLES)
_gather_4, _facets_4, _part_4 = (
    (_gather, _facets, _part) if REGISTER_DOUBLES == 4 else _unit_loops(4)
)
_gather_1, _facets_1, _part_1 = _unit_loops(1)


@njit(**OPTIONS)
def _unit(unit, thread, data, displacements, work, law, normals, rubbing, wide, four, one):
    kind, width = data.units[unit, 0], data.units[unit, 1]
    u_m = displacements[data.alike[kind, 2]]
    u_s = displacements[data.alike[kind, 3]]
    own = work.scratch[thread]
    scratch = own[0], own[1], own[2], own[3]
    if wide is not None:
        if width == REGISTER_DOUBLES:
            _gather(unit, data, u_m, u_s, scratch)
            _facets(unit, data, work, law, normals, rubbing, scratch)
            _part(unit, data, work, normals, scratch)
    if four is not None:
        if width == 4:
            _gather_4(unit, data, u_m, u_s, scratch)
            _facets_4(unit, data, work, law, normals, rubbing, scratch)
            _part_4(unit, data, work, normals, scratch)
    if one is not None:
        if width == 1:
            _gather_1(unit, data, u_m, u_s, scratch)
            _facets_1(unit, data, work, law, normals, rubbing, scratch)
            _part_1(unit, data, work, normals, scratch)


@njit(**OPTIONS)
def _units_of(thread, data, *arguments):
    for place in range(data.shares[thread], data.shares[thread + 1]):
        _unit(data.order[place], thread, data, *arguments)


@serial_and_parallel
def contact_forces(data, displacements, work, law, normals, rubbing, wide, four, one):
    """Gaps, pressures and forces of all units.

    Parameters
    ----------
    data, work
        Constant and work arrays.
    displacements
        Flat displacements of the bodies, placement frames, (n_rows, 3, lanes) each.
    law
        Constants of the contact law, or of that of each unit, (n_units, 9).
    normals
        None for current normals, or reference normals in the master frame, (n_facets, 4, 3).
    rubbing
        None without friction, or `Rubbing`.
    wide, four, one
        None where no unit is `REGISTER_DOUBLES`, 4 or 1 wide: its loops are not compiled, a third
        of all.
    """
    widths = (wide, four, one)
    for thread in prange(len(work.scratch)):
        _units_of(np.int64(thread), data, displacements, work, law, normals, rubbing, *widths)


class Collection(NamedTuple):
    """Which forces act on the applied rows of one body."""

    chunks: IntArray
    """Boundaries of pieces of applied rows, (n_chunks + 1,)."""
    pointer: IntArray
    """First entry of each applied row, (n_applied + 1,)."""
    entries: IntArray
    """(unit, first scalar of its node, first copy or -1, first of its lanes in both sides' copies)
    that act on a row, (n, 4)."""


@njit(**OPTIONS)
def _collect_chunk(c, collection, data, work, lanes, begin, applied):
    # Slices and flat views of arrays would count references: not in the loops.
    copies, force = data.copies.ravel(), work.force
    chunks, pointer, entries = collection
    first, last = 3 * lanes * chunks[c], 3 * lanes * chunks[c + 1]
    if begin is None:
        applied[first:last] = 0.0
    else:
        applied[first:last] = begin[first:last]
    for row in range(chunks[c], chunks[c + 1]):
        base = 3 * row * lanes
        for e in range(pointer[row], pointer[row + 1]):
            unit, at, first = entries[e, 0], entries[e, 1], entries[e, 2]
            width = data.units[unit, 1]
            if first >= 0 and width == REGISTER_DOUBLES:
                to = base + first
                add_to(applied, to, _load_wide(force, at))
                add_to(applied, to + lanes, _load_wide(force, at + REGISTER_DOUBLES))
                add_to(applied, to + 2 * lanes, _load_wide(force, at + 2 * REGISTER_DOUBLES))
            elif first >= 0 and width == 4:
                to = base + first
                add_to(applied, to, _load_4(force, at))
                add_to(applied, to + lanes, _load_4(force, at + 4))
                add_to(applied, to + 2 * lanes, _load_4(force, at + 8))
            else:
                lane = entries[e, 3]
                for k in range(data.units[unit, 2]):
                    to = base + copies[lane + k]
                    applied[to] += force[at + k]
                    applied[to + lanes] += force[at + width + k]
                    applied[to + 2 * lanes] += force[at + 2 * width + k]


@serial_and_parallel
def collect_forces(collection, data, work, lanes, begin, applied):
    """Sum the loads and the forces of all units on one body.

    Parameters
    ----------
    collection, data, work
        Which forces act, constant and work arrays.
    lanes
        Lanes of the body.
    begin
        None, or loads, flat (n_applied, 3, lanes) [N].
    applied
        The sum, alike; overwritten.
    """
    for c in prange(len(collection.chunks) - 1):
        _collect_chunk(c, collection, data, work, lanes, begin, applied)
