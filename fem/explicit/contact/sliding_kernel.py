"""The compiled loop of sliding contact: points of one surface on facets of another.

Positions are in world axes. A point x_s = Σ N_a x_a of the *slave* surface meets the closest
point x_m(ξ) of its master facet, found by Newton from where it was in the last step. There
d = x_s - x_m stands on the facet, so ∂gap/∂x_s = n, ∂gap/∂x_b = -N_b(ξ) n exactly: forces are
the gradient of the energy, and forces and moments balance.
"""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import math

import numpy as np

from fem.contact.law import law_pressure
from geometry.compilation import njit

_OPTIONS = {"error_model": "numpy", "nogil": True}

#: Newton iterations on the closest point; a step moves it by far less than a facet.
_PROJECTIONS = 6

#: The same from the centre of a facet that may be another.
_SEARCH_STEPS = 12


@njit(**_OPTIONS)
def _shapes(xi, values):
    for a in range(4):
        r = -1.0 if a in (0, 3) else 1.0
        s = -1.0 if a in (0, 1) else 1.0
        values[a, 0] = 0.25 * (1.0 + r * xi[0]) * (1.0 + s * xi[1])
        values[a, 1] = 0.25 * r * (1.0 + s * xi[1])
        values[a, 2] = 0.25 * s * (1.0 + r * xi[0])


@njit(**_OPTIONS)
def _frame(position, quad, xi, values, x, first, second):
    """Point of a facet and its tangents at natural coordinates."""
    _shapes(xi, values)
    for i in range(3):
        x[i], first[i], second[i] = 0.0, 0.0, 0.0
        for a in range(4):
            y = position[quad[a], i]
            x[i] += values[a, 0] * y
            first[i] += values[a, 1] * y
            second[i] += values[a, 2] * y


@njit(**_OPTIONS)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**_OPTIONS)
def _twist(position, quad, d):
    """(x_s - x_m) · ∂²x_m/∂r∂s."""
    total = 0.0
    for i in range(3):
        mixed = position[quad[0], i] - position[quad[1], i]
        mixed += position[quad[2], i] - position[quad[3], i]
        total += 0.25 * mixed * d[i]
    return total


@njit(**_OPTIONS)
def _closest(position, quad, point, xi, values, x, first, second, d):
    """Move ξ to the closest point of the facet (or its bilinear continuation)."""
    for _ in range(_PROJECTIONS):
        _frame(position, quad, xi, values, x, first, second)
        for i in range(3):
            d[i] = point[i] - x[i]
        a, b, c = _dot(first, first), _dot(first, second), _dot(second, second)
        b -= _twist(position, quad, d)
        p, q = _dot(d, first), _dot(d, second)
        scale = a * c - b * b
        dr, ds = (c * p - b * q) / scale, (a * q - b * p) / scale
        xi[0] += dr
        xi[1] += ds
        if abs(dr) + abs(ds) < 1e-14:
            break
    _frame(position, quad, xi, values, x, first, second)
    for i in range(3):
        d[i] = point[i] - x[i]


@njit(cache=True, **_OPTIONS)
def closest_on_facets(corners, points, xi, gap, normal):
    """Closest points of facets to points, by Newton from the centres.

    Parameters
    ----------
    corners
        Facets for each point, (n, k, 4, 3) [mm].
    points
        (n, 3) [mm].
    xi
        Out: natural coordinates, held within twice the facet, (n, k, 2).
    gap
        Out: (point - closest point) · normal, (n, k) [mm].
    normal
        Out: of the facets there, (n, k, 3).
    """
    values, whole = np.empty((4, 3)), np.arange(4)
    x, first, second, d = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for n in range(corners.shape[0]):
        for k in range(corners.shape[1]):
            facet, at, out = corners[n, k], xi[n, k], normal[n, k]
            at[0], at[1] = 0.0, 0.0
            for _ in range(_SEARCH_STEPS):
                _frame(facet, whole, at, values, x, first, second)
                for i in range(3):
                    d[i] = points[n, i] - x[i]
                a, b, c = _dot(first, first), _dot(first, second), _dot(second, second)
                b -= _twist(facet, whole, d)
                p, q = _dot(d, first), _dot(d, second)
                scale = a * c - b * b
                r = min(max(at[0] + (c * p - b * q) / scale, -2.0), 2.0)
                s = min(max(at[1] + (a * q - b * p) / scale, -2.0), 2.0)
                way = abs(r - at[0]) + abs(s - at[1])
                at[0], at[1] = r, s
                if way < 1e-14:
                    break
            _frame(facet, whole, at, values, x, first, second)
            out[0] = first[1] * second[2] - first[2] * second[1]
            out[1] = first[2] * second[0] - first[0] * second[2]
            out[2] = first[0] * second[1] - first[1] * second[0]
            size = math.sqrt(_dot(out, out))
            gap[n, k] = 0.0
            for i in range(3):
                out[i] /= size
                gap[n, k] += (points[n, i] - x[i]) * out[i]


@njit(**_OPTIONS)
def _rub(p, friction, pressure, weight, moved, normal, slip, dissipated, force):
    """Add friction of one point to its force; ``moved`` is its way on the master."""
    stiffness = friction[1]
    along = _dot(moved, normal)
    turned = slip[p, 0] * normal[0] + slip[p, 1] * normal[1] + slip[p, 2] * normal[2]
    size = 0.0
    old = np.empty(3)
    trial = np.empty(3)
    for i in range(3):
        moved[i] -= along * normal[i]
        old[i] = slip[p, i] - turned * normal[i]
        trial[i] = old[i] + moved[i]
        size += trial[i] * trial[i]
    size = stiffness * math.sqrt(size)
    limit = friction[0] * pressure
    share = 1.0 if size <= limit else limit / size
    for i in range(3):
        new = share * trial[i]
        dissipated[0] += 0.5 * weight * stiffness * (old[i] + new) * (moved[i] - (new - old[i]))
        slip[p, i] = new
        force[i] -= weight * stiffness * new


@njit(cache=True, **_OPTIONS)
def sliding_forces(
    position, quads, slave, shapes, weights, facet, xi, law, friction, slip, dissipated, gap, force
):
    """Gaps and nodal forces of all points that have a master facet.

    Parameters
    ----------
    position
        Surface nodes of all blocks, world axes, (n_nodes, 3) [mm].
    quads
        Facets of all blocks as surface nodes, (n_facets, 4).
    slave, shapes, weights
        Facet of each point, (n,), shape functions there, (n, 4), and area, (n,) [mm²].
    facet, xi
        Master facet of each point, -1 where none is near, (n,), and the closest point on it,
        (n, 2), updated.
    law
        Constants of the contact law, in terms of -d · n.
    friction, slip, dissipated
        None without friction; or coefficient and stick stiffness (2,), elastic slip (n, 3) [mm]
        and the energy lost so far (1,) [N mm], updated.
    gap
        Out: d · n of each point, infinite without a facet, (n,) [mm].
    force
        Out: on the surface nodes, world axes, (n_nodes, 3) [N].
    """
    force[:] = 0.0
    values = np.empty((4, 3))
    x, first, second, d = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    point, normal, pull, moved = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for p in range(len(facet)):
        gap[p] = np.inf
        if facet[p] < 0:
            continue
        own, quad = quads[slave[p]], quads[facet[p]]
        for i in range(3):
            point[i] = 0.0
            for a in range(4):
                point[i] += shapes[p, a] * position[own[a], i]
        if friction is not None:
            _frame(position, quad, xi[p], values, x, first, second)
            for i in range(3):
                moved[i] = point[i] - x[i]
        _closest(position, quad, point, xi[p], values, x, first, second, d)
        normal[0] = first[1] * second[2] - first[2] * second[1]
        normal[1] = first[2] * second[0] - first[0] * second[2]
        normal[2] = first[0] * second[1] - first[1] * second[0]
        size = math.sqrt(_dot(normal, normal))
        for i in range(3):
            normal[i] /= size
        gap[p] = _dot(d, normal)
        pressure = law_pressure(-gap[p], law)
        if pressure == 0.0:
            if friction is not None:
                slip[p] = 0.0
            continue
        for i in range(3):
            pull[i] = weights[p] * pressure * normal[i]
        if friction is not None:
            _rub(p, friction, pressure, weights[p], moved, normal, slip, dissipated, pull)
        for a in range(4):
            for i in range(3):
                force[own[a], i] += shapes[p, a] * pull[i]
                force[quad[a], i] -= values[a, 0] * pull[i]


@njit(cache=True, **_OPTIONS)
def place_surface(reference, rows, lanes, copies, rotations, displacement, position):
    """World positions of the surface nodes of one group, R (X + u) + t.

    Parameters
    ----------
    reference
        R X + t of each node, (n, 3) [mm].
    rows, copies
        Body row and copy of each node, (n,).
    lanes
        Lanes of the body.
    rotations
        Placement of each copy, (n_copies, 3, 3).
    displacement
        Flat (n_rows, 3, lanes) [mm].
    position
        Out: (n, 3).
    """
    for k in range(len(rows)):
        turn = rotations[copies[k]]
        base = 3 * rows[k] * lanes + copies[k]
        x, y, z = displacement[base], displacement[base + lanes], displacement[base + 2 * lanes]
        for i in range(3):
            position[k, i] = reference[k, i] + (turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z)


@njit(cache=True, **_OPTIONS)
def apply_surface(force, rows, lanes, copies, rotations, applied):
    """Add world forces of the surface nodes of one group to its applied forces, Rᵀ f."""
    for k in range(len(rows)):
        turn = rotations[copies[k]]
        base = 3 * rows[k] * lanes + copies[k]
        for j in range(3):
            local = turn[0, j] * force[k, 0] + turn[1, j] * force[k, 1] + turn[2, j] * force[k, 2]
            applied[base + j * lanes] += local
