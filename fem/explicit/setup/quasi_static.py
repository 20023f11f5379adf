"""Quasi-static control of explicit runs: how fast to load, and whether the end is static.

Kinetic energy below 1 % of the internal energy does not mean static: a tube that still rings at
0.25 % is 1.5 % off in displacement and 5 % off in pressure. What tells is the force residual
and how far the motion still has to go; the energy ratio is reported beside them.

How fast follows from the lowest frequencies of an assembly whose blocks move as rigid bodies on
their contacts. Blocks are mostly stiffer than the contact between them, so the slow motions of a
tube are rigid motions of its blocks. Restricted to them (Rayleigh and Ritz), stiffness and mass are
small matrices, 6 rows for each block. Contact is linearised as if it pressed everywhere with one
pressure: on the matched facets, or, where a search finds facets, on all that face each other at
the start. The blocks themselves yield in series with it, each by its radius of inertia over its
modulus, so that a stiff contact does not promise a frequency that no elastic block has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from fem.contact.surfaces import ContactError
from fem.explicit.timed import RecommendedTimes
from fem.state import State
from fem.system.body import Body, rigid_motions
from fem.system.system import Sector
from geometry.mesh import FloatArray, IntArray

#: Modes below this share of the highest frequency are taken for motions nothing resists.
_FREE_MOTION = 1e-6

#: Squares of held motions below this share of the largest are round-off.
_HELD = 1e-9

#: A mode counts as excited when it holds this share of the work of the loads.
_EXCITED = 1e-9


@dataclass(frozen=True)
class BlockFrequencies:
    """Frequencies that decide how slowly an assembly must be loaded."""

    lowest: float
    """Of all modes that something resists [Hz]."""
    excited: float
    """Lowest of those that the loads excite [Hz]; `lowest` when nothing is loaded."""


def motions_about_centroid(body: Body, points: FloatArray) -> FloatArray:
    """Displacements of points by unit translations and turns about the mass centroid.

    Turns are scaled by the radius of inertia, so all six columns are lengths; (n, 3, 6).
    """
    centroid, radius = _centre(body)
    return rigid_motions((points - centroid) / radius)


def _centre(body: Body) -> tuple[FloatArray, float]:
    mass, nodes = body.lumped_mass, body.mesh.nodes
    centroid: FloatArray = mass @ nodes / mass.sum()
    radius = np.sqrt((mass @ (nodes - centroid) ** 2).sum() / mass.sum())
    return centroid, float(radius)


def block_frequencies(system: Sector, pressure: float) -> BlockFrequencies:
    """Estimate the lowest frequencies about a state of uniform contact pressure [MPa].

    Parameters
    ----------
    system
        Blocks with contact on their facets, or on the points of a search as it stands before any
        displacement; blocks move as far as their supports let them.
    """
    motions, n = np.zeros((system.n_nodes + 1, 3, 6)), system.n_slots
    mass, stiffness = np.zeros((n, 6, 6)), np.zeros((n + 1, n + 1, 6, 6))
    for slot in range(n):
        body, rows = system.body(slot), system.nodes_of(slot)
        motions[rows] = motions_about_centroid(body, body.mesh.nodes)
        mass[slot] = np.einsum("n,nij,nik->jk", body.lumped_mass, motions[rows], motions[rows])
        if body.springs is not None:
            flat = motions[rows].reshape(-1, 6)
            stiffness[slot, slot] += flat.T @ (body.springs.stiffness @ flat)
    _add_contact(stiffness, system, motions, pressure)
    block_of = np.repeat(np.arange(n), np.diff(system.node_start))
    load = np.zeros((n, 6))
    np.add.at(
        load, block_of, np.einsum("nij,ni->nj", motions[:-1], system.nodal_forces(weight=False))
    )
    free = _free_motions(system, motions, block_of)
    if not free.shape[1]:  # blocks only deform between their supports
        lowest = min(map(_bar_frequency, system.whole.bodies))
        return BlockFrequencies(lowest, lowest)
    whole = stiffness[:-1, :-1].swapaxes(1, 2).reshape(6 * n, 6 * n)
    squares, modes = scipy.linalg.eigh(
        free.T @ whole @ free, free.T @ scipy.linalg.block_diag(*mass) @ free
    )
    resisted = squares > _FREE_MOTION**2 * squares[-1]
    if not resisted.any():
        raise ContactError(f"no contact resists any motion of the {n} blocks")
    squares, modes = squares[resisted], modes[:, resisted]
    work = (modes.T @ (free.T @ load.ravel())) ** 2 / squares
    excited = work > _EXCITED * work.sum() if work.sum() > 0.0 else np.ones_like(work, np.bool_)
    hertz = np.sqrt(squares) / (2.0 * np.pi)
    return BlockFrequencies(lowest=float(hertz[0]), excited=float(hertz[excited][0]))


def _add_contact(
    stiffness: FloatArray, system: Sector, motions: FloatArray, pressure: float
) -> None:
    """Add w k g gᵀ of all points to the 6 × 6 blocks of two slots, g the gap of a unit motion.

    k is the stiffness of the law in series with that of the blocks on its sides.
    """
    points, law = system.points, system.law.normal
    rigid = points.with_reference_normals.kinematics(np.zeros((*points.rows.shape, 3)))
    per_side = points.rows.shape[1] // 2
    split = rigid.gradient.reshape(*points.weights.shape, 2, per_side, 3)
    nodes = motions[points.rows].reshape(-1, 2, per_side, 3, 6)
    gaps = np.einsum("fpbai,fbik,fbakj->fpbj", split, points.axes, nodes, optimize=True)
    sides = np.stack([system.slot_of[points.block_m], system.slot_of[points.block_s]], axis=1)
    bodies = map(system.body, range(system.n_slots))
    yields = [_centre(body)[1] / body.material.young_modulus for body in bodies]
    compliance = 1.0 / law.stiffness(law.overclosure(pressure))
    compliance = compliance + np.array([*yields, 0.0])[sides].sum(axis=1)
    weights = points.weights / np.reshape(compliance, (-1, 1))
    for one, two in np.ndindex(2, 2):
        block = np.einsum("fp,fpj,fpk->fjk", weights, gaps[:, :, one], gaps[:, :, two])
        np.add.at(stiffness, (sides[:, one], sides[:, two]), block)


def _free_motions(system: Sector, motions: FloatArray, block_of: IntArray) -> FloatArray:
    """Rigid motions of all blocks that supports leave, orthonormal columns, (6 n_slots, n)."""
    squares, held = np.zeros((system.n_slots, 6, 6)), system.held
    along = np.einsum("nki,nkj->nij", held.axes, motions[held.nodes]) * held.held[:, :, None]
    np.add.at(squares, block_of[held.nodes], along.swapaxes(1, 2) @ along)
    parts = []
    for square in squares:
        sizes, axes = np.linalg.eigh(square)
        left = sizes <= _HELD * sizes[-1]
        parts.append(axes[:, left] if sizes[-1] > 0.0 else np.eye(6))
    return np.asarray(scipy.linalg.block_diag(*parts))


def _bar_frequency(body: Body) -> float:
    """Lowest frequency of a bar as long as a block that is held at one end [Hz]."""
    longest = float(np.ptp(body.mesh.nodes, axis=0).max())
    return body.material.bar_wave_speed / (4.0 * longest)


#: Contact pressure about which frequencies are estimated [MPa].
REFERENCE_PRESSURE = 0.01

#: Ramp in periods of the lowest excited mode: with adaptive damping the ramp only has to keep
#: the blocks from flying apart; without, inertia must stay small against the load.
_RAMP_PERIODS = {True: 0.25, False: 10.0}

#: Least ramp where friction acts: what slid too far in a fast ramp stays there. After a quarter of
#: a period, coarse TSB1 tubes rest at pressures 1 to 40 % from those of slow loading; after four,
#: 0 to 5 %; after sixteen with `FRACTION_WHILE_LOADING`, 0 to 1 %.
_RAMP_PERIODS_WITH_FRICTION = 16.0

#: The same where blocks must first close a gap: they fly through it and slide where they land, so
#: little load may act by then. In 16 periods a pipe with 0.05 mm lands under a tenth of its load.
_RAMP_PERIODS_CLOSING = 64.0

#: Damping while the load grows, over critical: drag against the slow motion holds blocks back where
#: friction keeps them, too little lets them ring and rub. Coarse TSB1 pipes of six layers (mu 0.1),
#: displacement against slow static loading: -3.0 % at 0.3, -1.4 % at 0.1, -0.9 % at 0.03. One
#: layer, p_max: shaft (mu 0.3) 1.9 % at 1, 1.1 % at 0.3, 1.0 % at 0.1, pillar (mu 0.05) -1.5 %,
#: -0.2 %, +0.8 %. Damping of velocities less their running mean gives 1.1 % and 1.1 %; stopping all
#: nodes when the kinetic energy falls 2.4 % and -2.6 %.
FRACTION_WHILE_LOADING = 0.1

#: Periods after which a damped run that has not settled will hardly do so.
_END_PERIODS = 50.0

#: Largest way still to go over the way gone in a static state [-].
_SETTLED = 2e-3


def recommended_times(system: Sector, *, damped: bool, closing: bool = False) -> RecommendedTimes:
    """Recommend times from the lowest frequency of rigid blocks on their contacts.

    With friction the static state depends on the load path: the ramp is slower then.

    Parameters
    ----------
    system
        Blocks with contact.
    damped
        Whether mass damping adapts to the motion (`static`), or hardly damps (`paper`).
    closing
        Whether blocks must first close gaps.

    Raises
    ------
    ValueError
        No contact resists any motion.
    """
    frequencies = block_frequencies(system, REFERENCE_PRESSURE)
    period = 1.0 / frequencies.excited
    periods = _RAMP_PERIODS[damped]
    if system.whole.contact.friction is not None:
        slow = _RAMP_PERIODS_CLOSING if closing else _RAMP_PERIODS_WITH_FRICTION
        periods = max(periods, slow)
    ramp = periods * period
    return RecommendedTimes(
        frequencies.excited, frequencies.lowest, ramp, ramp + _END_PERIODS * period
    )


@dataclass(frozen=True)
class QuasiStaticReport:
    """How static the end of a run is."""

    ramp_time: float
    """Duration of the loading [s]."""
    hold_time: float
    """Time under full load [s]."""
    kinetic_over_internal_energy: float
    """Kinetic over strain plus contact energy; small is necessary, not sufficient [-]."""
    velocity_norm: float
    """Root of the mean square velocity, weighted by mass [mm/s]."""
    settling: float
    """Estimate of the way still to go over the way gone, velocity / (ω displacement) [-]."""
    residual: float | None
    """Unbalanced over applied force; None where the run did not watch it [-]."""
    is_static: bool
    """Whether full load acts, the residual is below its bound and the motion has settled."""
    verdict: str
    """The same in words, with what to do."""


def quasi_static_report(state: State) -> QuasiStaticReport | None:
    """Judge the end of an explicit run; None where nothing recommends a frequency."""
    run = state.run
    if run is None or run.rest is None or run.stated.times.recommended is None:
        return None
    times, ramp_time, rest = run.stated.times.recommended, run.stated.times.settled, run.rest
    system = run.stated.system
    masses = np.concatenate([system.body(slot).lumped_mass for slot in range(system.n_slots)])
    moved, speed = (
        0.0 if of is None else float(masses @ (of**2).sum(axis=1))
        for of in (state.displacement, state.velocity)
    )
    settling = rest.settling
    if settling is None:
        settling = np.sqrt(speed / moved) / (2.0 * np.pi * times.frequency) if moved else 0.0
    energies = run.energies
    ratio = 0.0
    if energies is not None:
        internal = energies.strain_energy + energies.contact_energy
        ratio = energies.kinetic_energy / internal if internal > 0.0 else 0.0
    hold = run.time - ramp_time
    faults = []
    if hold < 0.0:
        faults.append("the load is not fully applied: raise fem.end_time")
    damped = run.stated.effects.adaptive_mass_damping is not None
    longer = ": raise fem.end_time" if damped else ""
    if rest.round_off is not None:
        faults.append(
            f"the force residual {run.residual:.1e} no longer falls: round-off leaves about "
            f"{rest.round_off:.1e}; use a larger fem.residual"
        )
    elif run.residual is not None and not run.residual <= rest.below:
        faults.append(f"the force residual {run.residual:.1e} exceeds {rest.below:.1e}{longer}")
    if not settling <= _SETTLED:
        faults.append(
            f"the remaining displacement is {100 * settling:.2g} % (at most "
            f"{100 * _SETTLED:.2g} %)" + ("" if rest.round_off else longer)
        )
    if run.residual is None:
        faults.append("the force residual was not monitored")
    if not faults:
        verdict = "static"
    elif damped:
        verdict = f"not static: {'; '.join(faults)}"
    else:
        advice = 'for a state at rest use fem.damping = "static"'
        verdict = f"in motion at {1e3 * run.time:.4g} ms: {'; '.join(faults)}; {advice}"
    return QuasiStaticReport(
        ramp_time=ramp_time,
        hold_time=max(hold, 0.0),
        kinetic_over_internal_energy=ratio,
        velocity_norm=float(np.sqrt(speed / masses.sum())),
        settling=float(settling),
        residual=run.residual,
        is_static=not faults,
        verdict=verdict,
    )
