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

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from fem.contact.law import ContactLaw
from fem.contact.surfaces import ContactError
from fem.element.facet import FACET_VALUES
from fem.explicit.contact.alike_pairs import AlikePairs
from fem.explicit.contact.paired import FaceContact
from fem.explicit.contact.sliding import SlidingContact
from fem.explicit.solve import ExplicitResult
from fem.system.model import BlockGroup, Model, rigid_motions
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


def motions_about_centroid(group: BlockGroup, points: FloatArray) -> FloatArray:
    """Displacements of points by unit translations and turns about the mass centroid.

    Turns are scaled by the radius of inertia, so all six columns are lengths; (n, 3, 6).
    """
    centroid, radius = _centre(group)
    return rigid_motions((points - centroid) / radius)


def _centre(group: BlockGroup) -> tuple[FloatArray, float]:
    mass, nodes = group.lumped_mass, group.mesh.nodes
    centroid: FloatArray = mass @ nodes / mass.sum()
    radius = np.sqrt((mass @ (nodes - centroid) ** 2).sum() / mass.sum())
    return centroid, float(radius)


def block_frequencies(model: Model, pressure: float) -> BlockFrequencies:
    """Estimate the lowest frequencies about a state of uniform contact pressure.

    Parameters
    ----------
    model
        Blocks with `FaceContact`, or `SlidingContact` as it stands before any displacement;
        blocks move as far as their supports let them.
    """
    first = np.cumsum([0, *(g.n_copies for g in model.groups)])
    size = 6 * int(first[-1])
    stiffness, mass, load = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for number, group in enumerate(model.groups):
        motions = motions_about_centroid(group, group.mesh.nodes)
        one = np.einsum("n,nij,nik->jk", group.lumped_mass, motions, motions)
        for copy in range(group.n_copies):
            rows = slice(6 * (first[number] + copy), 6 * (first[number] + copy + 1))
            mass[rows, rows] = one
            if group.springs is not None:
                flat = motions.reshape(-1, 6)
                stiffness[rows, rows] += flat.T @ (group.springs.stiffness @ flat)
        load += _generalised_load(model, number, motions, int(first[number]), size)
    for interaction in model.interactions:
        if isinstance(interaction, FaceContact):
            for pairs in interaction.pairs:
                law = interaction.law.on(*pairs.blocks[:1].T)
                tangent = _tangent(law, pressure, model, pairs.groups)
                _add_contact(stiffness, model, pairs, tangent, first)
        if isinstance(interaction, SlidingContact):
            _add_sliding(stiffness, model, interaction, pressure, first)
    free = _free_motions(model, first, size)
    if not free.shape[1]:  # blocks only deform between their supports
        lowest = min(map(_bar_frequency, model.groups))
        return BlockFrequencies(lowest, lowest)
    squares, modes = scipy.linalg.eigh(free.T @ stiffness @ free, free.T @ mass @ free)
    resisted = squares > _FREE_MOTION**2 * squares[-1]
    if not resisted.any():
        raise ContactError(f"no contact resists any motion of the {int(first[-1])} blocks")
    squares, modes = squares[resisted], modes[:, resisted]
    work = (modes.T @ (free.T @ load)) ** 2 / squares
    excited = work > _EXCITED * work.sum() if work.sum() > 0.0 else np.ones_like(work, np.bool_)
    hertz = np.sqrt(squares) / (2.0 * np.pi)
    return BlockFrequencies(lowest=float(hertz[0]), excited=float(hertz[excited][0]))


def _generalised_load(
    model: Model, number: int, motions: FloatArray, first: int, size: int
) -> FloatArray:
    """Loads of one group at amplitude one on the rigid motions of its copies, (size,)."""
    total = np.zeros(size)
    group = model.groups[number]
    for load in model.loads:
        if load.group == number:
            local = np.einsum("nij,ni->nj", group.rotations[load.copies], load.forces)
            each = np.einsum("nij,ni->nj", motions[load.nodes], local)
            np.add.at(total.reshape(-1, 6), first + load.copies, each)
    return total


def _add_contact(
    stiffness: FloatArray, model: Model, pairs: AlikePairs, tangent: float, first: IntArray
) -> None:
    """Add w k g gᵀ of all points of alike pairs, g the gap of a unit motion."""
    vectors = pairs.area_vectors()
    weights = np.linalg.norm(vectors, axis=2)
    normal = (vectors / weights[:, :, None]).reshape(-1, 3)
    rows = []
    for side, sign, turn in ((0, -1.0, np.eye(3)), (1, 1.0, pairs.rotation)):
        group = pairs.groups[side]
        if group < 0:
            rows.append(np.zeros((len(normal), 6)))
            continue
        corners = model.groups[group].mesh.nodes[pairs.nodes[pairs.corners, side]]
        points = np.einsum("pa,fai->fpi", FACET_VALUES, corners).reshape(-1, 3)
        motions = motions_about_centroid(model.groups[group], points)
        rows.append(sign * np.einsum("pi,pij->pj", normal @ turn, motions))
    gap = np.concatenate(rows, axis=1)
    block = gap.T @ (tangent * weights.reshape(-1, 1) * gap)
    for copies in pairs.copies:
        where = [6 * (first[max(g, 0)] + c) for g, c in zip(pairs.groups, copies, strict=True)]
        for i, row in enumerate(where):
            for j, column in enumerate(where):
                part = block[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
                stiffness[row : row + 6, column : column + 6] += part


def _tangent(law: ContactLaw, pressure: float, model: Model, groups: Iterable[int]) -> float:
    """Stiffness of a joint [MPa/mm]: the law's in series with that of the blocks on its sides."""
    compliance = 1.0 / float(law.stiffness(law.overclosure(pressure)))
    for group in (model.groups[g] for g in groups if g >= 0):
        compliance += _centre(group)[1] / group.material.young_modulus
    return 1.0 / compliance


def _add_sliding(
    stiffness: FloatArray, model: Model, contact: SlidingContact, pressure: float, first: IntArray
) -> None:
    """Add w k g gᵀ of all points that face a facet at the start, block pair by block pair."""
    state = contact.at_start
    surfaces = {surface.block: surface for surface in contact.surfaces}
    pairs, which = np.unique(
        np.column_stack([state.block_m, state.block_s]), axis=0, return_inverse=True
    )
    for number, (m, s) in enumerate(pairs.tolist()):
        points = np.flatnonzero(which.ravel()[state.facet] == number)
        rows, gaps = [], []
        for block, sign in ((m, -1.0), (s, 1.0)):
            surface = surfaces[block]
            if surface.group < 0:
                continue
            group = model.groups[surface.group]
            turn = surface.rotation
            shift = surface.reference[0] - turn @ group.mesh.nodes[surface.nodes[0]]
            shift = shift + surface.origin
            motions = motions_about_centroid(group, (state.positions[points] - shift) @ turn)
            gaps.append(sign * np.einsum("pi,pij->pj", state.normals[points] @ turn, motions))
            rows.append(6 * (first[surface.group] + surface.copy) + np.arange(6))
        gap, where = np.concatenate(gaps, axis=1), np.concatenate(rows)
        sides = (surfaces[m].group, surfaces[s].group)
        law = contact.law.on(np.array([m]), np.array([s]))
        weights = _tangent(law, pressure, model, sides) * state.point_areas[points]
        # In a sector both may be images of one block.
        np.add.at(stiffness, np.ix_(where, where), gap.T @ (weights[:, None] * gap))


def _free_motions(model: Model, first: IntArray, size: int) -> FloatArray:
    """Rigid motions of all blocks that supports leave, orthonormal columns, (size, n)."""
    squares = np.zeros((size // 6, 6, 6))
    for support in model.supports:
        group = model.groups[support.group]
        motions = motions_about_centroid(group, group.mesh.nodes[support.nodes])
        local = np.einsum("nij,ni->nj", group.rotations[support.copies], support.directions)
        held = np.einsum("nij,ni->nj", motions, local)
        blocks = first[support.group] + support.copies
        np.add.at(squares, blocks, held[:, :, None] * held[:, None, :])
    parts = []
    for square in squares:
        sizes, axes = np.linalg.eigh(square)
        left = sizes <= _HELD * sizes[-1]
        parts.append(axes[:, left] if sizes[-1] > 0.0 else np.eye(6))
    return np.asarray(scipy.linalg.block_diag(*parts))


def _bar_frequency(group: BlockGroup) -> float:
    """Lowest frequency of a bar as long as a block that is held at one end [Hz]."""
    longest = float(np.ptp(group.mesh.nodes, axis=0).max())
    return group.material.bar_wave_speed / (4.0 * longest)


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


def recommended_times(model: Model, *, damped: bool, closing: bool = False) -> RecommendedTimes:
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

    Raises
    ------
    ValueError
        No contact resists any motion.
    """
    frequencies = block_frequencies(model, REFERENCE_PRESSURE)
    period = 1.0 / frequencies.excited
    periods = _RAMP_PERIODS[damped]
    contacts = [i for i in model.interactions if isinstance(i, FaceContact | SlidingContact)]
    if any(contact.friction is not None for contact in contacts):
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
            f"{result.round_off:.1e}; use a larger fem.residual"
        )
    elif result.residual is not None and not result.residual <= largest_residual:
        faults.append(
            f"the force residual {result.residual:.1e} exceeds {largest_residual:.1e}: {longer}"
        )
    if not settling <= largest_settling:
        faults.append(
            f"the remaining displacement is {100 * settling:.2g} % (at most "
            f"{100 * largest_settling:.2g} %)" + ("" if result.round_off else f": {longer}")
        )
    if result.residual is None:
        faults.append("the force residual was not monitored")
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
