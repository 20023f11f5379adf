"""Lowest frequencies of an assembly whose blocks move as rigid bodies on their contacts.

Blocks are mostly stiffer than the contact between them, so the slow motions of a tube are rigid
motions of its blocks. Restricted to them (Rayleigh and Ritz), stiffness and mass are small
matrices, 6 rows for each block. Contact is linearised as if it pressed everywhere with one
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
from fem.problem.model import BlockGroup, Model
from fem.problem.rigid_motions import rigid_motions
from geometry.mesh import FloatArray, IntArray

#: Modes below this share of the highest frequency are taken for motions nothing resists.
_FREE_MOTION = 1e-6

#: A mode counts as excited when it holds this share of the work of the loads.
_EXCITED = 1e-9


@dataclass(frozen=True)
class BlockFrequencies:
    """What decides how slowly an assembly must be loaded."""

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
        blocks with supports count as held.
    pressure
        Contact pressure that decides the stiffness of the law [MPa].

    Raises
    ------
    ContactError
        Nothing resists any motion of the blocks.
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
        load += _generalised_load(model, number, motions, int(first[number]), size)
    for interaction in model.interactions:
        if isinstance(interaction, FaceContact):
            for pairs in interaction.pairs:
                tangent = _tangent(interaction.law, pressure, model, pairs.groups)
                _add_contact(stiffness, model, pairs, tangent, first)
        if isinstance(interaction, SlidingContact):
            _add_sliding(stiffness, model, interaction, pressure, first)
    free = _free_rows(model, first, size)
    squares, modes = scipy.linalg.eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)])
    resisted = squares > _FREE_MOTION**2 * squares[-1]
    if not len(squares) or not resisted.any():
        raise ContactError(f"no contact resists any motion of the {int(first[-1])} blocks")
    squares, modes = squares[resisted], modes[:, resisted]
    work = (modes.T @ load[free]) ** 2 / squares
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
            motions = motions_about_centroid(group, (state.positions[points] - shift) @ turn)
            gaps.append(sign * np.einsum("pi,pij->pj", state.normals[points] @ turn, motions))
            rows.append(6 * (first[surface.group] + surface.copy) + np.arange(6))
        gap, where = np.concatenate(gaps, axis=1), np.concatenate(rows)
        sides = (surfaces[m].group, surfaces[s].group)
        weights = _tangent(contact.law, pressure, model, sides) * state.point_areas[points]
        # In a sector both may be images of one block.
        np.add.at(stiffness, np.ix_(where, where), gap.T @ (weights[:, None] * gap))


def _free_rows(model: Model, first: IntArray, size: int) -> IntArray:
    """Rows of the blocks without supports."""
    held = np.zeros(size // 6, dtype=np.bool_)
    for support in model.supports:
        held[first[support.group] + support.copies] = True
    return np.flatnonzero(~np.repeat(held, 6))
