"""The compiled loop of the rate form: one pass over all elements of all copies.

`fem.explicit.rate_form` says what is computed and holds the plain reference of the same step.
"""

# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import numpy as np

from fem.element.hexahedron import HOURGLASS_VECTORS
from geometry.compilation import njit

_GAMMA = HOURGLASS_VECTORS

#: Fused multiply-add is allowed, reordering is not: the same bits on every run.
compiled = njit(cache=True, fastmath={"contract"}, error_model="numpy", nogil=True)


@compiled
def corner_gradient(y1, y2, y3, y4, y5, y7, z1, z2, z3, z4, z5, z7):
    """Volume times the averaged gradient of corner 0 (Flanagan and Belytschko 1981, eq. 79)."""
    return (
        y1 * ((z5 - z2) - (z3 - z4))
        + y2 * (z1 - z3)
        + y3 * ((z2 - z7) - (z4 - z1))
        + y4 * ((z7 - z5) - (z1 - z3))
        + y5 * (z4 - z1)
        + y7 * (z3 - z4)
    ) * (1.0 / 12.0)


@compiled
def mean_gradient(x, b):
    """Averaged gradients of one element in closed form; fills b (8, 3), returns the volume.

    Every corner has the formula of corner 0 with the corners renumbered as seen from it
    (table I of the paper), every direction that of x with (y, z) the next two directions.
    """
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        y0, y1, y2, y3 = x[0, i], x[1, i], x[2, i], x[3, i]
        y4, y5, y6, y7 = x[4, i], x[5, i], x[6, i], x[7, i]
        z0, z1, z2, z3 = x[0, j], x[1, j], x[2, j], x[3, j]
        z4, z5, z6, z7 = x[4, j], x[5, j], x[6, j], x[7, j]
        b[0, k] = corner_gradient(y1, y2, y3, y4, y5, y7, z1, z2, z3, z4, z5, z7)
        b[1, k] = corner_gradient(y2, y3, y0, y5, y6, y4, z2, z3, z0, z5, z6, z4)
        b[2, k] = corner_gradient(y3, y0, y1, y6, y7, y5, z3, z0, z1, z6, z7, z5)
        b[3, k] = corner_gradient(y0, y1, y2, y7, y4, y6, z0, z1, z2, z7, z4, z6)
        b[4, k] = corner_gradient(y7, y6, y5, y0, y3, y1, z7, z6, z5, z0, z3, z1)
        b[5, k] = corner_gradient(y4, y7, y6, y1, y0, y2, z4, z7, z6, z1, z0, z2)
        b[6, k] = corner_gradient(y5, y4, y7, y2, y1, y3, z5, z4, z7, z2, z1, z3)
        b[7, k] = corner_gradient(y6, y5, y4, y3, y2, y0, z6, z5, z4, z3, z2, z0)
    volume = 0.0
    for a in range(8):
        volume += x[a, 0] * b[a, 0]
    inverse = 1.0 / volume
    for a in range(8):
        for k in range(3):
            b[a, k] *= inverse
    return volume


@compiled
def hourglass_projection(values, moments):
    """Project corner values (8, 3) on the hourglass base vectors; fills moments (4, 3)."""
    for i in range(3):
        bottom = values[0, i] - values[1, i] + values[2, i] - values[3, i]
        top = values[4, i] - values[5, i] + values[6, i] - values[7, i]
        front = values[0, i] + values[1, i] - values[4, i] - values[5, i]
        back = values[2, i] + values[3, i] - values[6, i] - values[7, i]
        left = values[0, i] + values[3, i] - values[4, i] - values[7, i]
        right = values[1, i] + values[2, i] - values[5, i] - values[6, i]
        moments[0, i] = front - back
        moments[1, i] = left - right
        moments[2, i] = bottom + top
        moments[3, i] = top - bottom


@compiled
def spin_rotation(g, r):
    """Rotation (I - w/2)⁻¹ (I + w/2) of the spin w = skew g; fills r (3, 3)."""
    p = 0.25 * (g[2, 1] - g[1, 2])
    q = 0.25 * (g[0, 2] - g[2, 0])
    s = 0.25 * (g[1, 0] - g[0, 1])
    f = 2.0 / (1.0 + p * p + q * q + s * s)
    r[0, 0] = 1.0 - f * (q * q + s * s)
    r[1, 1] = 1.0 - f * (p * p + s * s)
    r[2, 2] = 1.0 - f * (p * p + q * q)
    r[0, 1] = f * (p * q - s)
    r[1, 0] = f * (p * q + s)
    r[0, 2] = f * (p * s + q)
    r[2, 0] = f * (p * s - q)
    r[1, 2] = f * (q * s - p)
    r[2, 1] = f * (q * s + p)


@compiled
def jaumann_update(t, r, e, lame, shear, out):
    """Stress after one increment, out = r t rᵀ + lambda tr(e) I + 2 mu e; (3, 3) each."""
    dilatation = lame * (e[0, 0] + e[1, 1] + e[2, 2])
    for i in range(3):
        h0 = r[i, 0] * t[0, 0] + r[i, 1] * t[1, 0] + r[i, 2] * t[2, 0]
        h1 = r[i, 0] * t[0, 1] + r[i, 1] * t[1, 1] + r[i, 2] * t[2, 1]
        h2 = r[i, 0] * t[0, 2] + r[i, 1] * t[1, 2] + r[i, 2] * t[2, 2]
        for j in range(3):
            turned = h0 * r[j, 0] + h1 * r[j, 1] + h2 * r[j, 2]
            out[i, j] = turned + 2.0 * shear * e[i, j]
        out[i, i] += dilatation


@compiled
def contract(a, b):
    """Double contraction a : b of two (3, 3) tensors."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += a[i, j] * b[i, j]
    return total


@compiled
def add_elastic(t, e, lame, shear, factor):
    """Add factor · C : e to a stress (3, 3); return the work of what was added on e."""
    dilatation = e[0, 0] + e[1, 1] + e[2, 2]
    for i in range(3):
        for j in range(3):
            t[i, j] += 2.0 * shear * factor * e[i, j]
        t[i, i] += lame * factor * dilatation
    return factor * (lame * dilatation * dilatation + 2.0 * shear * contract(e, e))


@compiled
def gather(nodes, position, velocity, copy, time_step, x, middle, du):
    """Corners at the end and the middle of a step and their displacement; (8, 3) each."""
    for a in range(8):
        for i in range(3):
            x[a, i] = position[nodes[a], i, copy]
            du[a, i] = time_step * velocity[nodes[a], i, copy]
            middle[a, i] = x[a, i] - 0.5 * du[a, i]


@compiled
def increments(du, b, g, e):
    """Displacement gradient du bᵀ and its symmetric part; return the sum of squares of b."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(8):
                total += du[a, i] * b[a, j]
            g[i, j] = total
    for i in range(3):
        for j in range(3):
            e[i, j] = 0.5 * (g[i, j] + g[j, i])
    square = 0.0
    for a in range(8):
        for i in range(3):
            square += b[a, i] * b[a, i]
    return square


@compiled
def hourglass_update(q, r, g, shape, stretch, coefficient):
    """Turn hourglass forces (4, 3) with r and add what the increment gives; return its work.

    gamma · du = Gamma · du - (Gamma · x) · (du bᵀ), with ``shape`` = Gamma · x and
    ``stretch`` = Gamma · du, (4, 3) each.
    """
    work = 0.0
    for m in range(4):
        q0, q1, q2 = q[m, 0], q[m, 1], q[m, 2]
        for i in range(3):
            increment = stretch[m, i] - (
                shape[m, 0] * g[i, 0] + shape[m, 1] * g[i, 1] + shape[m, 2] * g[i, 2]
            )
            turned = r[i, 0] * q0 + r[i, 1] * q1 + r[i, 2] * q2
            q[m, i] = turned + coefficient * increment
            work += 0.5 * (turned + q[m, i]) * increment
    return work


@compiled
def scatter(nodes, copy, volume, t, b, shape, q, s, force):
    """Add the corner forces V t b + gamma q of one element.

    gamma q = Gamma q - b (Gamma · x) q: the second part joins the stress; ``s`` (3, 3) is
    room for it.
    """
    for i in range(3):
        for j in range(3):
            s[i, j] = volume * t[i, j] - (
                shape[0, j] * q[0, i]
                + shape[1, j] * q[1, i]
                + shape[2, j] * q[2, i]
                + shape[3, j] * q[3, i]
            )
    for a in range(8):
        for i in range(3):
            f = s[i, 0] * b[a, 0] + s[i, 1] * b[a, 1] + s[i, 2] * b[a, 2]
            for m in range(4):
                f += _GAMMA[a, m] * q[m, i]
            force[nodes[a], i, copy] += f


@compiled
def rate_form_step(
    elements,
    position,
    velocity,
    time_step,
    lame,
    shear,
    hourglass_scale,
    crossing_time,
    linear_viscosity,
    quadratic_viscosity,
    stiffness_damping,
    stress,
    hourglass,
    work,
    force,
):
    """One step of every element of every copy; see `fem.explicit.rate_form.internal_force`.

    ``crossing_time`` is the characteristic length over the wave speed, (n_elements,) [s].
    ``linear_viscosity``, ``quadratic_viscosity`` and ``stiffness_damping`` are None where the
    effect is off: the compiler then drops their branches.

    Updates ``stress`` (n_elements, 3, 3, n_copies), ``hourglass`` (n_elements, 4, 3, n_copies),
    ``work`` (4, n_copies) and adds to ``force`` (n_nodes, 3, n_copies).
    """
    modulus = lame + 2.0 * shear
    x, middle, du, b = np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3))
    g, e, r, t = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    shape, stretch = np.empty((4, 3)), np.empty((4, 3))
    for element in range(elements.shape[0]):
        nodes = elements[element]
        for copy in range(position.shape[2]):
            s, q = stress[element, :, :, copy], hourglass[element, :, :, copy]
            gather(nodes, position, velocity, copy, time_step, x, middle, du)
            volume = mean_gradient(middle, b)
            square = increments(du, b, g, e)
            spin_rotation(g, r)
            before = contract(s, e)
            jaumann_update(s, r, e, lame, shear, t)
            s[:] = t
            work[0, copy] += 0.5 * volume * (before + contract(s, e))

            hourglass_projection(middle, shape)
            hourglass_projection(du, stretch)
            coefficient = hourglass_scale * shear * volume * square
            work[1, copy] += hourglass_update(q, r, g, shape, stretch, coefficient)

            dilatation = e[0, 0] + e[1, 1] + e[2, 2]
            viscous = 0.0
            if linear_viscosity is not None:
                viscous += linear_viscosity * crossing_time[element] * dilatation / time_step
            if quadratic_viscosity is not None:
                rate = quadratic_viscosity * crossing_time[element] * dilatation / time_step
                viscous -= rate * min(rate, 0.0)
            if linear_viscosity is not None or quadratic_viscosity is not None:
                for i in range(3):
                    t[i, i] += modulus * viscous
                work[2, copy] += volume * modulus * viscous * dilatation
            if stiffness_damping is not None:
                power = add_elastic(t, e, lame, shear, stiffness_damping / time_step)
                work[3, copy] += volume * power

            volume = mean_gradient(x, b)
            hourglass_projection(x, shape)
            scatter(nodes, copy, volume, t, b, shape, q, g, force)
