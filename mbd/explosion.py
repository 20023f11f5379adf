"""Is the explosion of a tube admissible to first order, and what holds it together if not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.mesh import FloatArray
from mbd.contact_jacobian import contact_jacobian
from mbd.equilibrium import Equilibrium, newton_equilibrium

#: Gap rates above minus this fraction of the displacement are round-off of tangential sliding.
_CLOSING = 1e-9


@dataclass(frozen=True)
class FirstOrderExplosion:
    """First-order answer: nothing is held, every block moves outward by the same amount."""

    smallest_gap_rate: float
    """min Gᵀδq for a unit displacement of every block; negative: some contact closes."""
    closing_area_percent: float
    """Share of the contact area that closes [%]."""
    opening_area_percent: float
    """Share of the contact area that opens [%]; the rest slides."""
    push: Equilibrium
    """Contact forces under a unit outward push on every block with nothing held. Where they
    exist no admissible motion moves the blocks outward on the whole, turning and shifting
    allowed (fᵀδq = -λᵀGᵀδq <= 0); else the mechanism that the push drives."""

    @property
    def admissible(self) -> bool:
        """Whether no contact closes."""
        return self.smallest_gap_rate >= -_CLOSING

    @property
    def held_together(self) -> bool:
        """Whether contacts alone carry an outward push, whatever accompanies the motion."""
        return self.push.holds


def first_order_explosion(assembly: AnyBlocks, directions: FloatArray) -> FirstOrderExplosion:
    """Judge the simultaneous outward motion with the frame released.

    Parameters
    ----------
    assembly
        A tube.
    directions
        Outward unit vector of each block, (n_blocks, 3).
    """
    contacts = contact_jacobian(assembly, np.zeros(assembly.n_blocks, dtype=bool))
    motion = np.zeros((assembly.n_blocks, 6))
    motion[:, :3] = directions
    rates = contacts.jacobian.gap_rates(motion.ravel())
    total = contacts.areas.sum()
    closing = float(contacts.areas[rates < -_CLOSING].sum() / total)
    opening = float(contacts.areas[rates > _CLOSING].sum() / total)
    return FirstOrderExplosion(
        smallest_gap_rate=float(rates.min()) if len(rates) else 0.0,
        closing_area_percent=100 * closing,
        opening_area_percent=100 * opening,
        push=newton_equilibrium(contacts.jacobian, motion.ravel()),
    )
