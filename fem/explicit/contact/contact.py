"""What contact on paired and on searched facets has in common in an explicit run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fem.contact.friction import CoulombFriction, FrictionError, coulomb
from fem.contact.law import ContactLaw
from fem.explicit.body import LaneBody
from fem.explicit.contact.compiled_law import compiled_law
from fem.explicit.state import Interaction, Loop
from fem.system.time_step import critical_time_step
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True)
class ExplicitContact(ABC):
    """Contact of the blocks that are computed."""

    areas: tuple[FloatArray, ...]
    """Contact area at each node of each group, of the copy that has most, times the number of
    sides that move, (n_nodes,) [mm²]: `nodal_stiffness` for a law of stiffness one."""
    law: ContactLaw
    """Pressure as a function of overclosure."""
    clearance: float
    """Added to every gap [mm]."""
    counted_stiffness: float
    """Stiffness of the law that the critical time step counts in [MPa/mm]."""
    friction: CoulombFriction | None = None
    """Needs current normals; None: absent."""

    def __post_init__(self) -> None:
        if self.friction is not None and self.stick > self.counted_stiffness:
            raise FrictionError(
                f"stick_stiffness: got {self.stick} MPa/mm, expected at most "
                f"{self.counted_stiffness:.4g}, the contact stiffness "
                "included in the critical time step"
            )

    @property
    def stick(self) -> float:
        """Stiffness of points that stick: the most that the time step allows unless stated."""
        stated = None if self.friction is None else self.friction.stick_stiffness
        return self.counted_stiffness if stated is None else stated

    def touched_nodes(self, group: int) -> IntArray:
        """Mesh nodes of the group on which contact may act, (n,)."""
        return np.flatnonzero(self.areas[group])

    def nodal_stiffness(self, group: int) -> FloatArray:
        """Stiffness to count on each node for the critical time step, (n_nodes,) [N/mm].

        Contact springs of stiffness w k between points of two blocks have
        K_ab = w k c_a c_b n nᵀ with |c_a| = N_a and Σ N = 1 on each side: row sums bound them
        by the diagonal w k N_a times the number of sides that move.
        """
        return self.counted_stiffness * self.areas[group]

    @abstractmethod
    def bind(self, bodies: tuple[LaneBody, ...]) -> BoundContact:
        """Prepare the force for the loop."""


class BoundContact(Interaction):
    """Arrays of one run."""

    def __init__(self, statement: ExplicitContact) -> None:
        self._statement = statement
        self._allowed: float | None = None

    def _set_constants(self, block_m: IntArray, block_s: IntArray) -> None:
        """Law between blocks m and s of each unit or point, (n,) each, and its constants."""
        stated = self._statement
        law = coulomb(stated.law, stated.friction, stated.stick, block_m, block_s)
        self._law, self._constants = law.normal, compiled_law(law, stated.clearance)

    @abstractmethod
    def _deepest(self) -> tuple[int, float, int, int] | None:
        """Where contact is stiffest: unit or point, gap [mm] and the two blocks; None: nowhere."""

    def fault(self, loop: Loop) -> str | None:
        """Where the stiffness of the law exceeds what the time step allows, and the remedy."""
        counted = self._statement.counted_stiffness
        laws = self._statement.law.members
        if all(law.constants.linear_stiffness <= counted for law in laws):
            return None
        deepest = self._deepest()
        if deepest is None:
            return None
        which, gap, m, s = deepest
        law = self._law.one(which)
        pressure, stiffness = float(law.pressure(-gap)), float(law.stiffness(-gap))
        if stiffness <= counted or stiffness <= self._largest_stiffness(loop):
            return None
        return (
            f"contact pressure between blocks {m} and {s} reached {pressure:.3g} MPa, a stiffness "
            f"of {stiffness:.3g} MPa/mm; the time step {loop.time_step:.4g} s allows "
            f"{self._largest_stiffness(loop):.3g}; take a smaller `safety_factor` or set "
            "`maximum_stiffness`"
        )

    def _largest_stiffness(self, loop: Loop) -> float:
        """Stiffness of a law that is stable: (ω_bulk² + ω_contact²)/4 = 1/Δt² [MPa/mm]."""
        if self._allowed is None:
            bulk = critical_time_step(loop.stated.bodies, loop.stated.effects)
            square = 4.0 / loop.time_step**2 - 4.0 / bulk.critical_time_step**2
            groups = zip(self._statement.areas, loop.stated.bodies, strict=True)
            self._allowed = square / max(
                float((areas / group.lumped_mass).max()) for areas, group in groups
            )
        return self._allowed
