# mypy: disable-error-code="no-untyped-def, untyped-decorator"

"""Central difference update, moving supports and sums."""

from __future__ import annotations

import numpy as np
from numba import prange

from fem.explicit.kernels.forms import serial_and_parallel
from fem.explicit.kernels.options import OPTIONS
from geometry.compilation import njit


@njit(**OPTIONS)
def _update_chunk(
    c,
    chunks,
    time_step,
    gain,
    keep,
    mass,
    internal_force,
    ratio,
    elastic_before,
    viscous_work,
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
    if viscous_work is not None:
        viscous_work[c, 1] = 0.0
    for i in range(chunks[c], chunks[c + 1]):
        impulse = gain / mass[i]
        applied = -1
        if applied_force is not None:
            applied = applied_row[i]
        for j in range(3):
            for k in range(lanes):
                before = velocity[i, j, k]
                force = internal_force[i, j, k]
                if ratio is not None:
                    viscous = ratio * (force - elastic_before[i, j, k])
                    force += viscous
                force = -force
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
                if viscous_work is not None:
                    viscous_work[c, 0, k] += 0.5 * np.float64(viscous) * (before + after)
                    viscous_work[c, 1, k] += 0.5 * np.float64(viscous) * after
                if dissipated is not None:
                    mean = 0.5 * loss * mass[i] * (before + after)
                    dissipated[c, 0, k] += mean * (before + after)
                    dissipated[c, 1, k] += mean * after


@serial_and_parallel
def update(
    chunks,
    time_step,
    gain,
    keep,
    mass,
    internal_force,
    ratio,
    elastic_before,
    viscous_work,
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
    ratio, elastic_before, viscous_work
        None, or β/Δt of the stiffness-proportional damping in the precision of the arrays, the
        internal force of the step before and (n_chunks, 2, lanes). With v = (u - u_old)/Δt the
        damping force is β K v = (β/Δt) (K u - K u_old): no second product, and no pass of its own.
        [:, 0] grows by half its product with v₋ + v₊, [:, 1] is overwritten with the half of
        that which comes after the time of the force.
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
    for c in prange(len(chunks) - 1):
        _update_chunk(
            c,
            chunks,
            time_step,
            gain,
            keep,
            mass,
            internal_force,
            ratio,
            elastic_before,
            viscous_work,
            applied_row,
            applied_force,
            acceleration,
            displacement,
            velocity,
            kinetic,
            loss,
            dissipated,
        )


@njit(cache=True, **OPTIONS)
def viscous_power(index, ratio, elastic, elastic_before, velocity):
    """Power of the damping force of `update` on some entries of flat arrays, in float64."""
    total = 0.0
    for k in range(len(index)):
        at = index[k]
        force = ratio * (elastic[at] - elastic_before[at])
        total += np.float64(force) * velocity[at]
    return total


@njit(cache=True, **OPTIONS)
def dot_lanes(a, b, total):
    """Write a · b of every copy to ``total`` (lanes,), in float64; a, b (n_rows, 3, lanes)."""
    total[:] = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(a.shape[2]):
                total[k] += np.float64(a[i, j, k]) * b[i, j, k]


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
