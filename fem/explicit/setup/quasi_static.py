"""Quasi-static control of explicit runs: how fast to load, and whether the end is static.

Kinetic energy below 1 % of the internal energy does not mean static: a tube that still rings at
0.25 % is 1.5 % off in displacement and 5 % off in pressure. What tells is the force residual
and how far the motion still has to go; the energy ratio is reported beside them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.explicit.contact.paired import FaceContact
from fem.explicit.contact.sliding import SlidingContact
from fem.explicit.setup.block_frequency import block_frequencies
from fem.explicit.solve import ExplicitResult
from fem.problem.model import Model

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
#: friction keeps them, too little lets them ring and rub. Coarse TSB1 tubes with friction, ramps of
#: 16 periods, p_max against slow loading: shaft (mu 0.3) 1.9 % at 1, 1.1 % at 0.3, 1.0 % at 0.1,
#: pillar (mu 0.05) -1.5 %, -0.2 %, +0.8 %. Damping of velocities less their running mean gives
#: 1.1 % and 1.1 %; stopping all nodes when the kinetic energy falls 2.4 % and -2.6 %.
FRACTION_WHILE_LOADING = 0.3

#: Periods after which a damped run that has not settled will hardly do so.
_END_PERIODS = 50.0


@dataclass(frozen=True)
class RecommendedTimes:
    """Times of a quasi-static run."""

    frequency: float
    """Lowest frequency that the loads excite, an estimate from above [Hz]."""
    lowest_frequency: float
    """Lowest frequency of all, excited or not [Hz]."""
    ramp_time: float
    """Smooth step of the loads [s]."""
    end_time: float
    """Latest end of a run that stops when it is static [s]."""


def recommended_times(
    model: Model, *, damped: bool, closing: bool = False, pressure: float = REFERENCE_PRESSURE
) -> RecommendedTimes:
    """Recommend times from the lowest frequency of rigid blocks on their contacts.

    With friction the static state depends on the way there: the ramp is slower then.

    Parameters
    ----------
    model
        Blocks with contact.
    damped
        Whether mass damping adapts to the motion (`static`), or hardly damps (`paper`).
    closing
        Whether blocks must first close gaps.
    pressure
        Contact pressure that decides the stiffness of the law [MPa].

    Raises
    ------
    ValueError
        No contact resists any motion.
    """
    found = block_frequencies(model, pressure)
    period = 1.0 / found.excited
    periods = _RAMP_PERIODS[damped]
    if _has_friction(model):
        slow = _RAMP_PERIODS_CLOSING if closing else _RAMP_PERIODS_WITH_FRICTION
        periods = max(periods, slow)
    ramp = periods * period
    return RecommendedTimes(found.excited, found.lowest, ramp, ramp + _END_PERIODS * period)


def _has_friction(model: Model) -> bool:
    contacts = [i for i in model.interactions if isinstance(i, FaceContact | SlidingContact)]
    return any(contact.friction is not None for contact in contacts)


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


def quasi_static_report(
    result: ExplicitResult,
    *,
    ramp_time: float,
    frequency: float,
    largest_residual: float = 1e-4,
    largest_settling: float = 2e-3,
) -> QuasiStaticReport:
    """Judge the end of an explicit run.

    Parameters
    ----------
    result
        The run.
    ramp_time
        Duration of its loading [s].
    frequency
        Lowest excited frequency, of `recommended_times` [Hz].
    largest_residual, largest_settling
        Bounds for a static state [-].
    """
    moved = speed = mass = 0.0
    for group, u, v in zip(
        result.model.groups, result.displacements, result.velocities, strict=True
    ):
        moved += float(np.einsum("n,cni,cni->", group.lumped_mass, u, u))
        speed += float(np.einsum("n,cni,cni->", group.lumped_mass, v, v))
        mass += group.n_copies * float(group.lumped_mass.sum())
    settling = result.settling
    if settling is None:
        settling = np.sqrt(speed / moved) / (2.0 * np.pi * frequency) if moved else 0.0
    energies = result.energies
    ratio = 0.0
    if energies is not None:
        internal = energies.strain_energy + energies.contact_energy
        ratio = energies.kinetic_energy / internal if internal > 0.0 else 0.0
    hold = result.time - ramp_time
    faults = []
    if hold < 0.0:
        faults.append("the load is not fully applied: raise fem.end_time")
    damped = result.model.effects.adaptive_mass_damping is not None
    longer = "raise fem.end_time" + ("" if damped else ' or use fem.damping = "static"')
    if result.round_off is not None:
        faults.append(
            f"the force residual {result.residual:.1e} no longer falls: round-off leaves about "
            f'{result.round_off:.1e}; use fem.precision = "float64", or a larger fem.residual'
        )
    elif result.residual is not None and not result.residual <= largest_residual:
        faults.append(
            f"the force residual {result.residual:.1e} exceeds {largest_residual:.1e}: {longer}"
        )
    if not settling <= largest_settling:
        faults.append(
            f"the motion still has {100 * settling:.2g} % of its way to go (bound "
            f"{100 * largest_settling:.2g} %)" + ("" if result.round_off else f": {longer}")
        )
    if result.residual is None:
        faults.append("the force residual was not watched")
    return QuasiStaticReport(
        ramp_time=ramp_time,
        hold_time=max(hold, 0.0),
        kinetic_over_internal_energy=ratio,
        velocity_norm=float(np.sqrt(speed / mass)),
        settling=float(settling),
        residual=result.residual,
        is_static=not faults,
        verdict="static" if not faults else "not static: " + "; ".join(faults),
    )
