"""The compiled loop of sliding contact: points of one surface on facets of another.

Positions are in world axes. A point x_s = Σ N_a x_a of the *slave* surface meets the closest
point x_m(ξ) of its master facet, found by Newton from where it was in the last step. There
d = x_s - x_m stands on the facet, so ∂gap/∂x_s = n, ∂gap/∂x_b = -N_b(ξ) n exactly: forces are
the gradient of the energy, and forces and moments balance. With x_m = A + B r + C s + D r s the
facet and its tangents cost a third of sums over corners.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fem.contact.friction import return_formula, slip_loss
from fem.contact.law import law_pressure
from fem.explicit.contact.compiled_law import law_at
from fem.explicit.kernels.forms import OPTIONS, over_lanes
from fem.explicit.kernels.lanes import REGISTER_DOUBLES, lane_operations, larger, store
from fem.explicit.kernels.triples import dot, triple_of, triple_operations
from geometry.compilation import njit
from geometry.mesh import FloatArray, IntArray

#: Newton iterations on the closest point; a step moves it by far less than a facet.
_PROJECTIONS = 6

#: What Newton leaves of the natural coordinates: rounding.
_LEFT = 1e-15

_share = njit(error_model="numpy", forceinline=True)(return_formula(max, math.sqrt))


# Vectors are tuples of three: they stay in registers, where small arrays would go through memory.


@njit(**OPTIONS)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**OPTIONS)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**OPTIONS)
def _plus(a, share, b):
    """A + share b."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@njit(**OPTIONS)
def _sum(wa, a, wb, b, wc, c, wd, d):
    return (
        wa * a[0] + wb * b[0] + wc * c[0] + wd * d[0],
        wa * a[1] + wb * b[1] + wc * c[1] + wd * d[1],
        wa * a[2] + wb * b[2] + wc * c[2] + wd * d[2],
    )


@njit(**OPTIONS)
def _add(force, n, share, f):
    for i in range(3):
        force[n, i] += share * f[i]


@njit(**OPTIONS)
def _frame(facet, r, s, point):
    """Tangents of a facet and what lies between a point and it, at natural coordinates."""
    middle, along, across, warp = facet
    first, second = _plus(along, s, warp), _plus(across, r, warp)
    there = _plus(_plus(middle, r, along), s, second)
    return first, second, _plus(point, -1.0, there)


@njit(**OPTIONS)
def _closest(facet, point, r, s, frame):
    """Closest point of a facet by Newton from (r, s), where ``frame`` was asked; asked there."""
    warp = facet[3]
    bent = _dot(warp, warp)
    for _ in range(_PROJECTIONS):
        first, second, d = frame
        a, b, c = _dot(first, first), _dot(first, second), _dot(second, second)
        b -= _dot(warp, d)
        p, q = _dot(d, first), _dot(d, second)
        scale = 1.0 / (a * c - b * b)
        dr, ds = (c * p - b * q) * scale, (a * q - b * p) * scale
        r, s = r + dr, s + ds
        frame = _frame(facet, r, s, point)
        # The next step would be a share of this one's square that warp and gap give.
        way = dr * dr + ds * ds
        if way * way * (bent + _dot(d, d)) < _LEFT * _LEFT * min(a, c):
            break
    return r, s, frame


@njit(**OPTIONS)
def _sides(first, second, normal):
    """Directions of slip, as `fem.contact.friction.slip_sides`."""
    ratio = math.sqrt(_dot(first, first) / _dot(second, second))
    along = _plus(first, ratio, second)
    size = 1.0 / math.sqrt(_dot(along, along))
    along = size * along[0], size * along[1], size * along[2]
    return along, _cross(normal, along)


@njit(**OPTIONS)
def _rub(p, law, pressure, weight, moved, sides, slip, dissipated):
    """Friction of one point, whose way on the master is ``moved``; times its area.

    A point that opens loses the energy of its elastic slip, as one that slides without a limit; one
    that was open begins at its present slip.
    """
    stiffness, (along, across) = law.stick, sides
    x, y = slip[p, 0], slip[p, 1]
    to_x, to_y = x, y
    if slip[p, 2] != 0.0:
        to_x, to_y = x + _dot(moved, along), y + _dot(moved, across)
    share = _share(to_x, to_y, stiffness, law.coefficient * pressure)
    new_x, new_y = share * to_x, share * to_y
    dissipated[0] += 0.5 * weight * stiffness * slip_loss((x, y), (to_x, to_y), (new_x, new_y))
    slip[p, 0], slip[p, 1], slip[p, 2] = new_x, new_y, 1.0 if pressure > 0.0 else 0.0
    pull = weight * stiffness
    new_x, new_y = pull * new_x, pull * new_y
    return (
        new_x * along[0] + new_y * across[0],
        new_x * along[1] + new_y * across[1],
        new_x * along[2] + new_y * across[2],
    )


@njit(cache=True, **OPTIONS)
def sliding_forces(position, quads, points, law, slip, dissipated, gap, force):
    """Gaps and nodal forces of all points.

    Parameters
    ----------
    position
        Surface nodes of all blocks, world axes, (n_nodes, 3) [mm].
    quads
        Facets of all blocks as surface nodes, (n_facets, 4).
    points
        `fem.contact.cuts.PointsOnFacets`; the closest points ``xi`` are updated.
    law
        Constants of the contact law, in terms of -d · n, or of that of each point, (n, 9).
    slip, dissipated
        None without friction; or elastic slip along the two sides [mm] and whether the point
        touches, (n, 3), and the energy lost so far (1,) [N mm], updated.
    gap
        Out: d · n of each point, (n,) [mm].
    force
        Out: on the surface nodes, world axes, (n_nodes, 3) [N].
    """
    slave, shapes, weights, _, facet, xi = points
    force[:] = 0.0
    for p in range(len(facet)):
        own, quad = quads[slave[p]], quads[facet[p]]
        a, b = triple_of(position, quad[0]), triple_of(position, quad[1])
        c, d = triple_of(position, quad[2]), triple_of(position, quad[3])
        master = (
            _sum(0.25, a, 0.25, b, 0.25, c, 0.25, d),
            _sum(-0.25, a, 0.25, b, 0.25, c, -0.25, d),
            _sum(-0.25, a, -0.25, b, 0.25, c, 0.25, d),
            _sum(0.25, a, -0.25, b, 0.25, c, -0.25, d),
        )
        a, b = triple_of(position, own[0]), triple_of(position, own[1])
        c, d = triple_of(position, own[2]), triple_of(position, own[3])
        point = _sum(shapes[p, 0], a, shapes[p, 1], b, shapes[p, 2], c, shapes[p, 3], d)
        before = _frame(master, xi[p, 0], xi[p, 1], point)
        r, s, (first, second, away) = _closest(master, point, xi[p, 0], xi[p, 1], before)
        xi[p, 0], xi[p, 1] = r, s
        normal = _cross(first, second)
        size = 1.0 / math.sqrt(_dot(normal, normal))
        normal = normal[0] * size, normal[1] * size, normal[2] * size
        gap[p] = _dot(away, normal)
        joint = law_at(law, p)
        pressure = law_pressure(-gap[p], joint)
        if pressure == 0.0:
            if slip is None:
                continue
            if slip[p, 2] == 0.0:
                continue
        push = weights[p] * pressure
        pull = push * normal[0], push * normal[1], push * normal[2]
        if slip is not None:
            sides = _sides(first, second, normal)
            rub = _rub(p, joint, pressure, weights[p], before[2], sides, slip, dissipated)
            pull = _plus(pull, -1.0, rub)
        for k in range(4):
            _add(force, own[k], shapes[p, k], pull)
        _add(force, quad[0], -0.25 * (1.0 - r) * (1.0 - s), pull)
        _add(force, quad[1], -0.25 * (1.0 + r) * (1.0 - s), pull)
        _add(force, quad[2], -0.25 * (1.0 + r) * (1.0 + s), pull)
        _add(force, quad[3], -0.25 * (1.0 - r) * (1.0 + s), pull)


class SurfaceNodes(NamedTuple):
    """Surface nodes of one body."""

    reference: FloatArray
    """R X + t of each node, (n, 3) [mm]."""
    rows: IntArray
    """Body row of each, (n,)."""
    applied: IntArray
    """Row of the applied force, alike."""
    copies: IntArray
    """Copy, alike."""
    turns: FloatArray
    """Placements of blocks, (n_blocks, 3, 3)."""
    turn_of: IntArray
    """Which of them each node has, (n,)."""


@njit(cache=True, **OPTIONS)
def place_surface(nodes, lanes, displacement, position):
    """World positions (n, 3) of `SurfaceNodes`, R (X + u) + t, u flat (n_rows, 3, lanes) [mm]."""
    reference, rows, _, copies, turns, turn_of = nodes
    for k in range(len(rows)):
        turn = turns[turn_of[k]]
        base = 3 * rows[k] * lanes + copies[k]
        x, y, z = displacement[base], displacement[base + lanes], displacement[base + 2 * lanes]
        for i in range(3):
            position[k, i] = reference[k, i] + (turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z)


@njit(cache=True, **OPTIONS)
def apply_surface(nodes, lanes, force, applied):
    """Add world forces (n, 3) of `SurfaceNodes` to flat applied ones, Rᵀ f."""
    _, _, rows, copies, turns, turn_of = nodes
    for k in range(len(rows)):
        turn = turns[turn_of[k]]
        base = 3 * rows[k] * lanes + copies[k]
        for j in range(3):
            local = turn[0, j] * force[k, 0] + turn[1, j] * force[k, 1] + turn[2, j] * force[k, 2]
            applied[base + j * lanes] += local


def _speed_lanes(width: int) -> Callable[..., Any]:
    """Make the largest squared speed so far, with one more row, of ``width`` copies."""
    load, _ = lane_operations(width)
    load_triple = triple_operations(width).load

    @njit(**OPTIONS)
    def run(first, _, at, lanes, velocity, fastest):
        v = load_triple(velocity, at + first, lanes)
        store(fastest, first, larger(load(fastest, first), dot(v, v)))

    return run


_faster = over_lanes(_speed_lanes, 4 * REGISTER_DOUBLES)


@njit(cache=True, **OPTIONS)
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
    lanes = velocity.shape[2]
    flat, fastest = velocity.ravel(), np.zeros(len(travel), velocity.dtype)
    for row in rows:
        _faster(0, len(travel), 3 * row * lanes, lanes, flat, fastest)
    for k in range(len(travel)):
        travel[k] += time_step * math.sqrt(fastest[k])
