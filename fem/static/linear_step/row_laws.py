"""What contact does on the rows of a chain: the pressures of points, or the forces on node pairs.

Without friction rows are the points that press, and unknown are their forces: a row gives way by
1 / (w k). With friction rows are the components of pairs of nodes
(`fem.static.linear_step.pairs`) with forces μ = K d + g, and unknown are their relative
displacements d:

    d = -W μ + C α + …    is    (I + W K) d - C α = … - W g,
    Cᵀ μ + …              is    (Kᵀ C)ᵀ d + … + Cᵀ g.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from fem.contact.surfaces import ContactPoints
from fem.static.linear_step.block_tridiagonal import Leaning, Level
from fem.static.linear_step.linearisation import Linearisation
from geometry.machine.work import Operation, count
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True)
class Bound:
    """Levels of a chain with their law, and its part in the right-hand sides."""

    levels: Sequence[Level]
    rest: FloatArray
    """Of the rows, (n,) [mm]."""
    motions: Sequence[FloatArray]
    """Of the motions of each level, (n_motions,) [N]."""


@dataclass(frozen=True)
class PointLaw:
    """Points that press, each by itself."""

    active: IntArray
    """Their numbers, points per facet · facet + point, (n,)."""
    gradient: csr_array
    """∂x/∂u, (n, 3 n_nodes)."""
    softness: FloatArray
    """1 / (w k), (n,) [mm/N]."""
    rest: FloatArray
    """c - x̂ + p / k, (n,) [mm]."""

    def ordered(self, order: IntArray) -> PointLaw:
        """The same in another order."""
        return PointLaw(
            self.active[order], self.gradient[order], self.softness[order], self.rest[order]
        )

    def bind(self, levels: Sequence[Level]) -> Bound:
        """Add the law to the flexibilities of levels."""
        ends = np.cumsum([0, *(len(level.flexibility) for level in levels)])
        for level, (a, b) in zip(levels, pairwise(ends), strict=True):
            level.flexibility[np.diag_indices(b - a)] += self.softness[a:b]
        return Bound(levels, self.rest, [np.zeros(len(level.holding)) for level in levels])

    def forces(self, unknown: FloatArray, *, loaded: bool) -> FloatArray:  # noqa: ARG002
        """Forces of the rows, (n,) [N]."""
        return unknown


def point_law(points: ContactPoints, linear: Linearisation, least: float | FloatArray) -> PointLaw:
    """Law of all points that are stiffer than a stiffness [MPa/mm]; without friction."""
    slope = linear.slope[..., 0, 0]
    active = np.flatnonzero((slope.T > np.asarray(least).T).T.ravel())
    stiffness, pressure = slope.ravel()[active], linear.traction.ravel()[active]
    rest = (linear.constant - linear.at).ravel()[active] + pressure / stiffness
    softness = 1.0 / (linear.weights.ravel()[active] * stiffness)
    return PointLaw(active, points.gradient_matrix(linear.gradient, active), softness, rest)


@dataclass(frozen=True)
class PairLaw:
    """Forces on pairs of nodes, linear in their relative displacements."""

    active: IntArray
    """Numbers of the rows, 3 · pair + component, (n,)."""
    gradient: csr_array
    """d on the displacements in block frames, (n, 3 n_nodes)."""
    stiffness: csr_array
    """K, (n, n) [N/mm]."""
    constant: FloatArray
    """g, (n,) [N]."""

    def ordered(self, order: IntArray) -> PairLaw:
        """The same in another order."""
        stiffness = csr_array(self.stiffness[order][:, order])
        return PairLaw(self.active[order], self.gradient[order], stiffness, self.constant[order])

    def bind(self, levels: Sequence[Level]) -> Bound:
        """Turn the flexibilities of levels into what is felt of relative displacements."""
        ends = np.cumsum([0, *(len(level.flexibility) for level in levels)])
        own = [self.stiffness[a:b, a:b] for a, b in pairwise(ends)]
        constant = [self.constant[a:b] for a, b in pairwise(ends)]
        rest = [-level.flexibility @ g for level, g in zip(levels, constant, strict=True)]
        motions = [level.motions.T @ g for level, g in zip(levels, constant, strict=True)]
        bound = []
        for k, level in enumerate(levels):
            shared = slice(level.first_shared, None)
            after = own[k + 1 :][:1]
            if after:
                rest[k][shared] -= level.next_flexibility @ constant[k + 1]
                rest[k + 1] -= level.next_flexibility.T @ constant[k][shared]
                motions[k + 1] += level.next_motions.T @ constant[k][shared]
            stiff = own[k][shared, shared]
            n_next = level.next_flexibility.shape[1]
            count(Operation.ENTRY, own[k].nnz * len(level.flexibility) + stiff.nnz * n_next)
            felt = after[0].T @ level.next_flexibility.T if after else level.next_flexibility.T
            bound.append(
                replace(
                    level,
                    flexibility=np.asfortranarray(_identity_plus(level.flexibility, own[k])),
                    next_flexibility=felt.T,
                    leaning=Leaning(
                        motions=own[k].T @ level.motions,
                        next_flexibility=(stiff.T @ level.next_flexibility).T,
                        next_motions=stiff.T @ level.next_motions,
                    ),
                )
            )
        return Bound(bound, np.concatenate(rest), motions)

    def forces(self, unknown: FloatArray, *, loaded: bool) -> FloatArray:
        """Forces of the rows, (n,) [N]; without g where nothing is loaded."""
        forces: FloatArray = self.stiffness @ unknown
        return forces + self.constant if loaded else forces


def _identity_plus(flexibility: FloatArray, stiffness: csr_array) -> FloatArray:
    """I + W K, of a symmetric W in Fortran order."""
    result: FloatArray = (csr_array(stiffness.T) @ flexibility.T).T
    result[np.diag_indices(len(result))] += 1.0
    return result
