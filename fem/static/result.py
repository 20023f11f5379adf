"""What a static solution is, and how much of it is due to the parts in which its load was applied.

Without friction the state does not depend on the load path, and the load is applied at once. With
friction it does: where a point slips first, and under which pressure, is history. Most of that
history lies under small loads, where contact by an exponential law is soft and blocks make most of
their motion: load factors are squares of equal parts, (k/n)², so that four of them do what
sixteen equal ones did. Twice as many parts show the error of the first half (step doubling).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.contact.search import SearchedPoints
from fem.contact.surfaces import ContactPoints
from fem.system.build import DeformableAssembly
from fem.system.reactions import PushCurve
from fem.system.state import (
    ContactState,
    contact_state,
)
from geometry.errors import RefusedError
from geometry.machine.work import LimitError
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays


class StaticError(RefusedError):
    """A static problem that has no solution, or none that was found: what to do."""


@dataclass(frozen=True)
class StaticResult(ReadOnlyArrays):
    """A static state of the whole assembly, copies of a sector included."""

    deformable: DeformableAssembly
    """What was solved."""
    displacements: tuple[FloatArray, ...]
    """Of each group in world axes, each (n_copies, n_nodes, 3) [mm]."""
    overclosures: FloatArray
    """Of every contact point, (n_facets, n_points), or (n_points, 1) of a search [mm]."""
    pressures: FloatArray
    """Of every contact point, alike [MPa]."""
    residual: float
    """Norm of the unbalanced forces over norm of the loads [-]."""
    converged: bool
    """Whether the residual reached the tolerance."""
    status: str
    """What happened, and what to do if it did not converge."""
    loose_blocks: IntArray
    """Blocks that could move while all contacts keep pressing: their place is not determined."""
    residuals: tuple[float, ...]
    """Residual after each iteration [-]."""
    strain_energy: float
    """[N mm]"""
    contact_energy: float
    """[N mm]"""
    external_work: float
    """Of the full loads along the displacements, as dead loads [N mm]."""
    frictional_dissipation: float
    """Work lost in sliding, zero without friction [N mm]. What slides in a load step does so at the
    limit, which counts with the mean of the pressures at its ends: with few load steps too much, by
    about a tenth with four."""
    symmetry: int
    """Order of the sector model that was used."""
    representative: IntArray
    """Block that stands for each block, (n_blocks,)."""
    n_unknowns: int
    """Displacement unknowns of the representative blocks."""
    cpu_seconds: dict[str, float]
    """CPU time: setup, newton, recovery, total [s]."""
    reached: bool = True
    """Whether supports that move have arrived; else this is the last equilibrium on their way."""
    load_steps: int = 1
    """Parts in which the load was to be applied."""
    coarser_loading: StaticResult | None = None
    """State by half as many load steps, where friction made the way to the load count and both
    were compared."""
    steps: tuple[tuple[float, tuple[FloatArray, ...]], ...] = ()
    """Load factor and displacements after each load step, where they were to be kept."""
    support_forces: tuple[FloatArray, ...] = ()
    """Of the supports on the nodes of each group, (n_copies, n_nodes, 3) [N]; () where nothing is
    held."""
    pushed: tuple[tuple[float, tuple[FloatArray, ...]], ...] = ()
    """Time [s] and the same after each step in which supports moved."""
    searched: SearchedPoints | None = None
    """Points of the last residual, where a search found them; None: matched facets."""
    frictions: FloatArray | None = None
    """Friction on block s in the last residual at every contact point, world axes,
    (n_facets, n_points, 3) [MPa]; None without friction."""
    curves: tuple[PushCurve, ...] = ()
    """Forces of supports that move in the last stage of a history (`fem.static.history`)."""

    @property
    def surfaces(self) -> ContactPoints:
        """Facets of `pressures`."""
        return self.searched or self.deformable.surfaces

    @property
    def newton_iterations(self) -> int:
        """Linear problems solved."""
        return len(self.residuals)

    @cached_property
    def contact_state(self) -> ContactState:
        """Contact facet by facet."""
        at_points = self.surfaces, self.frictions, self.overclosures
        return contact_state(self.deformable, self.displacements, *at_points)

    @property
    def max_displacement(self) -> float:
        """Largest displacement of any node [mm]."""
        return max(float(np.linalg.norm(u, axis=2).max()) for u in self.displacements)


#: Change of the measures by twice as many parts below which they are enough [-].
LOAD_TOLERANCE = 0.01
#: Parts that are not doubled any more.
MOST_PARTS = 16


def load_factors(parts: int, *, friction: bool) -> tuple[float, ...]:
    """Load factors at the ends of the load steps, the last one 1.

    Parameters
    ----------
    parts
        Number of load steps.
    friction
        Whether the way to the load matters; else the parts are equal.
    """
    power = 2 if friction else 1
    return tuple((k / parts) ** power for k in range(1, parts + 1))


def path_change(coarse: StaticResult, fine: StaticResult) -> float:
    """Relative change of an answer: displacement, pressure at a point, pressures in the mean [-].

    Both are states of the same facets; of a search only what does not name facets is compared.
    """

    def numbers(result: StaticResult) -> tuple[float, float, float]:
        pressures, areas = result.contact_state.pressures, result.contact_state.areas
        mean = float(np.sqrt(areas @ pressures**2 / max(float(areas.sum()), 1e-300)))
        return result.max_displacement, float(result.pressures.max(initial=0.0)), mean

    pairs = zip(numbers(coarse), numbers(fine), strict=True)
    return max(abs(a - b) / abs(b) if b else float(a != b) for a, b in pairs)


def refined(
    solve: Callable[[int], StaticResult], parts: int, tolerance: float
) -> tuple[StaticResult, StaticResult | None]:
    """Double the parts of the load until that changes the answer by less than a tolerance.

    Returns
    -------
    tuple[StaticResult, StaticResult | None]
        The last state that was reached, and the one before it, in fewer parts; None where there is
        but one.

    Raises
    ------
    LimitError
        A limit is reached before any state.
    """
    known: StaticResult | None = None
    while True:
        try:
            fine = solve(parts)
        except LimitError:
            if known is None:
                raise
            return known, None
        parts = max(parts, fine.load_steps)  # more than asked for where so few had no equilibrium
        enough = known is not None and fine.converged and path_change(known, fine) <= tolerance
        if enough or 2 * parts > MOST_PARTS:
            break
        known = fine if fine.converged else known
        parts *= 2
    if known is None or fine.converged:
        return fine, known
    return known, None
