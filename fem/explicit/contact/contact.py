"""What contact on paired and on searched facets has in common in an explicit run."""

from __future__ import annotations

from abc import abstractmethod

from fem.contact.friction import coulomb
from fem.explicit.contact.compiled_law import compiled_law
from fem.explicit.step import Interaction, Loop
from fem.explicit.timed import TimedSystem
from fem.system.time_step import critical_time_step
from geometry.mesh import IntArray


class BlockContact(Interaction):
    """Contact of the blocks that are computed: arrays of one run."""

    def __init__(self, stated: TimedSystem) -> None:
        self._stated, self._clearance = stated, stated.system.whole.surfaces.clearance
        self._allowed: float | None = None

    @property
    def _rubs(self) -> bool:
        return self._stated.system.whole.contact.friction is not None

    def _set_constants(self, block_m: IntArray, block_s: IntArray) -> None:
        """Law between blocks m and s of each unit or point, (n,) each, and its constants."""
        stated, contact = self._stated, self._stated.system.whole.contact
        law = coulomb(contact.law, contact.friction, stated.stick, block_m, block_s)
        self._law, self._constants = law.normal, compiled_law(law, self._clearance)

    @abstractmethod
    def _deepest(self) -> tuple[int, float, int, int] | None:
        """Where contact is stiffest: unit or point, gap [mm] and the two blocks; None: nowhere."""

    def fault(self, loop: Loop) -> str | None:
        """Where the stiffness of the law exceeds what the time step allows, and the remedy."""
        counted = self._stated.counted_stiffness
        laws = self._stated.system.whole.contact.law.members
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
            stated = loop.stated
            bulk = critical_time_step(stated.bodies, stated.effects)
            square = 4.0 / loop.time_step**2 - 4.0 / bulk.critical_time_step**2
            bodies = zip(stated.contact_areas, stated.bodies, strict=True)
            self._allowed = square / max(
                float((areas / body.lumped_mass).max()) for areas, body in bodies
            )
        return self._allowed
