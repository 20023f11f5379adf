"""Direct solution of a chain of dense saddle-point blocks.

Level k has unknowns q (forces) and α (motions):

    A q - C α + (couplings) = d,    -Cᵀ q - τ α + (couplings) = e

Only the last forces of a level, those shared with the next one, couple with it. A is positive
definite, so each level is a Cholesky factorisation, and a small one for its motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from geometry.mesh import FloatArray

#: Forces and motions of a level, or their right-hand sides.
Side = tuple[FloatArray, FloatArray]

#: Smallest accepted ratio of the pivots of a level's motions: less is a motion nothing resists.
_SMALLEST_PIVOT = 1e-10


class UnresistedMotionError(ValueError):
    """A level with a motion that nothing resists."""

    def __init__(self, level: int, motion: FloatArray) -> None:
        super().__init__(f"level {level}: a motion meets no resistance")
        self.level = level
        """Number of the level."""
        self.motion = motion
        """The motion, (n_motions,)."""


@dataclass(frozen=True)
class Level:
    """One level and its coupling with the next; arrays are overwritten by `factor_chain`."""

    flexibility: FloatArray
    """A, (n, n), Fortran order."""
    motions: FloatArray
    """C, (n, n_motions)."""
    holding: FloatArray
    """τ, (n_motions, n_motions)."""
    first_shared: int
    """First force that couples with the next level."""
    next_flexibility: FloatArray
    """Coupling of the shared forces with the next level's forces, (n - first_shared, n_next)."""
    next_motions: FloatArray
    """Minus their coupling with its motions, like C; (n - first_shared, n_motions_next)."""


@dataclass(frozen=True)
class _Eliminated:
    """Factors of one level."""

    factor: FloatArray
    motions: FloatArray
    pivot: FloatArray


@dataclass(frozen=True)
class ChainFactor:
    """A chain with all its levels eliminated: solves for any right-hand sides."""

    levels: Sequence[Level]
    eliminated: tuple[_Eliminated, ...]

    def solve(self, sides: Sequence[Side]) -> list[Side]:
        """Solve for the forces and motions of all levels.

        Parameters
        ----------
        sides
            (d, e) of each level, (n,) and (n_motions,).

        Returns
        -------
        list[tuple[FloatArray, FloatArray]]
            (q, α) of each level.
        """
        done: list[Side] = []
        change: Side | None = None
        for level, eliminated, (force, motion) in zip(
            self.levels, self.eliminated, sides, strict=True
        ):
            side = (force, motion) if change is None else (force - change[0], motion - change[1])
            done.append(side)
            forces, _ = _solve(eliminated, *side)
            shared = forces[level.first_shared :]
            change = level.next_flexibility.T @ shared, -level.next_motions.T @ shared
        result: list[Side] = []
        for level, eliminated, side in zip(
            reversed(self.levels), reversed(self.eliminated), reversed(done), strict=True
        ):
            force = side[0].copy()
            if result:
                after = result[-1]
                shared = level.next_motions @ after[1] - level.next_flexibility @ after[0]
                force[level.first_shared :] += shared
            result.append(_solve(eliminated, force, side[1]))
        return result[::-1]


def factor_chain(levels: Sequence[Level]) -> ChainFactor:
    """Eliminate the levels one after the other.

    Raises
    ------
    UnresistedMotionError
        A motion without resistance.
    LinAlgError
        A flexibility that is not positive definite.
    """
    done: list[_Eliminated] = []
    for k, level in enumerate(levels):
        eliminated = _eliminate(k, level)
        done.append(eliminated)
        if k + 1 < len(levels):
            _update(level, eliminated, levels[k + 1])
    return ChainFactor(levels, tuple(done))


def _lower_solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    return scipy.linalg.solve_triangular(factor, right, lower=True, check_finite=False)


def _eliminate(number: int, level: Level) -> _Eliminated:
    factor = scipy.linalg.cholesky(
        level.flexibility, lower=True, overwrite_a=True, check_finite=False
    )
    motions = _lower_solve(factor, level.motions)
    pivot = level.holding + motions.T @ motions
    _check_resistance(number, pivot)
    return _Eliminated(
        factor=factor,
        motions=motions,
        pivot=scipy.linalg.cholesky(pivot, lower=True) if len(pivot) else pivot,
    )


def _check_resistance(number: int, pivot: FloatArray) -> None:
    if not len(pivot):
        return
    scale = np.sqrt(np.diag(pivot))
    if (scale > 0.0).all():
        values, vectors = np.linalg.eigh(pivot / np.outer(scale, scale))
        if values[0] > _SMALLEST_PIVOT * values[-1]:
            return
        raise UnresistedMotionError(number, vectors[:, 0] / scale)
    raise UnresistedMotionError(number, (scale == 0.0).astype(np.float64))


def _solve(eliminated: _Eliminated, force_side: FloatArray, motion_side: FloatArray) -> Side:
    """(q, α) of one level for given right-hand sides."""
    right = _lower_solve(eliminated.factor, force_side)
    alpha = np.zeros(len(motion_side))
    if len(alpha):
        alpha = -scipy.linalg.cho_solve(
            (eliminated.pivot, True), motion_side + eliminated.motions.T @ right
        )
    forces = scipy.linalg.solve_triangular(
        eliminated.factor,
        right + eliminated.motions @ alpha,
        lower=True,
        trans="T",
        check_finite=False,
    )
    return forces, alpha


def _update(level: Level, eliminated: _Eliminated, after: Level) -> None:
    """Subtract what the eliminated level does to the next one."""
    first = level.first_shared
    n = level.next_flexibility.shape[1]
    coupling = np.asfortranarray(np.hstack([level.next_flexibility, -level.next_motions]))
    response = _lower_solve(eliminated.factor[first:, first:], coupling)
    update = response.T @ response
    if len(eliminated.pivot):
        through = _lower_solve(eliminated.pivot, eliminated.motions[first:].T @ response)
        update -= through.T @ through
    after.flexibility[...] -= update[:n, :n]
    after.motions[...] += update[:n, n:]
    after.holding[...] += update[n:, n:]
