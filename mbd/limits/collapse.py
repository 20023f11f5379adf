"""Limit analysis with associated friction: how far a live load can grow on top of a dead one.

A load that admits equilibrium with admissible forces *can* be carried; by the lower-bound
theorem for rigid blocks no more is claimed (sliding friction is not associated). A load that
does not is certain to set the blocks in motion; the certificate is a virtual displacement d with
n·δ >= μ ‖δ_t‖ in every contact (δ the relative displacement there) and fᵀd > 0: no admissible
force does negative work on it.

References: eq. SCP-linear of the paper with friction added; Kao, Iannuzzo, Thomaszewski, Coros,
Van Mele, Block, "Coupled rigid-block analysis", Computer-Aided Design 146 (2022); Livesley, "Limit
analysis of structures formed from rigid blocks", Int. J. Numer. Methods Eng. 12 (1978).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from geometry.mesh import FloatArray
from geometry.parts.rows import Row, finite, plain
from mbd.contacts.friction import FrictionalContacts, RigidFrictionError
from mbd.equilibrium import (
    EQUILIBRIUM_TOLERANCE,
    by_block,
    certified,
    frictional_equilibrium,
    least_forces,
)


def require_live(live: FloatArray) -> None:
    """Reject a load that cannot grow, as there is none."""
    if not live.any():
        raise RigidFrictionError("limit load: the live load is zero; expected one that can grow")


@dataclass(frozen=True, kw_only=True)
class CollapseLoad:
    """How far a live load can grow on top of a dead load until the first mechanism."""

    factor: float
    """Largest α for which dead + α live can be carried with associated friction and infinite
    strength; infinity where there is none, nan where the dead load alone is not carried."""
    upper_bound: float = np.inf
    """-f_deadᵀd / f_liveᵀd of the mechanism: no larger α can be carried."""
    forces: FloatArray
    """Contact forces at collapse (at an infinite factor: those of the live load alone); (n, 3)."""
    residual: float
    """Relative residual of those forces."""
    mechanism: FloatArray | None = None
    """Collapse mechanism d, f_liveᵀd > 0, ‖d‖ = 1; None at an infinite factor. Where the dead load
    alone is not carried, the one that it drives."""
    smallest_contact_work: float = 0.0
    """Least work of an admissible unit force on the mechanism; zero to round-off."""
    status: str
    """Verdict in words."""

    @property
    def certified(self) -> bool:
        """Whether forces and mechanism prove the factor from both sides, to 1e-4 of it."""
        if np.isnan(self.factor):
            return self.mechanism is not None
        if np.isinf(self.factor):
            return self.residual <= EQUILIBRIUM_TOLERANCE
        return (
            self.mechanism is not None
            and self.residual <= EQUILIBRIUM_TOLERANCE
            and abs(self.upper_bound - self.factor) <= 1e-4 * max(abs(self.factor), 1e-3)
        )

    @property
    def rows(self) -> list[Row]:
        """The factor and its proof."""
        proof = ""
        if np.isfinite(self.upper_bound):
            proof = f"; kinematic upper bound {self.upper_bound:.6g}, residual {self.residual:.1e}"
        return [Row("limit load", self.status + proof, finite(self.factor), "", "verdict")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        names = (
            "factor",
            "upper_bound",
            "certified",
            "residual",
            "smallest_contact_work",
            "status",
        )
        never, mechanism = bool(np.isinf(self.factor)), by_block(self.mechanism)
        return {**plain(self, *names), "never": never, "mechanism": mechanism}


def collapse_load(contacts: FrictionalContacts, dead: FloatArray, live: FloatArray) -> CollapseLoad:
    """Limit analysis: the largest α such that dead + α live, (n_rows,) each [N], can be carried."""
    require_live(live)
    base = frictional_equilibrium(contacts, dead)
    if not base.holds:
        verdict = "not decided" if base.mechanism is None else "not carried"
        return CollapseLoad(
            factor=np.nan,
            upper_bound=np.nan,
            forces=np.zeros_like(base.forces),
            residual=base.residual,
            mechanism=base.mechanism,
            smallest_contact_work=base.smallest_contact_work,
            status=f"none: the dead load alone is {verdict}",
        )
    alone = frictional_equilibrium(contacts, live)
    if alone.holds:
        return CollapseLoad(
            factor=np.inf,
            forces=alone.forces,
            residual=alone.residual,
            status="load factor unbounded: rigid blocks, associated friction (sliding joints "
            "dilate), no crushing. Dry joints may slide under a smaller load: `sliding` searches "
            "for it",
        )
    factor, forces, dual = _largest_factor(contacts, dead, live)
    total = dead + factor * live
    residual = float(np.linalg.norm(contacts.matrix @ forces.ravel() + total))
    residual /= max(float(np.linalg.norm(total)), 1e-300)
    answer = partial(CollapseLoad, factor=factor, forces=forces, residual=residual)
    proof = certified(contacts, dual, live, 1e-5)
    if proof is not None:
        unit, _, least = proof
        return answer(
            upper_bound=-float(dead @ unit) / float(live @ unit),
            mechanism=unit,
            smallest_contact_work=least,
            status=f"collapse load factor {factor:.6g} (limit analysis)",
        )
    return answer(status=f"load factor of at least {factor:.6g}; no mechanism was certified")


def _largest_factor(
    contacts: FrictionalContacts, dead: FloatArray, live: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Factor of the live load at collapse, contact forces there, and the mechanism's direction."""
    size = float(np.linalg.norm(live))
    scale = max(float(np.linalg.norm(dead)), size)
    cost = np.append(np.zeros(3 * contacts.n_contacts), -1.0)
    x, dual = least_forces(contacts, dead / scale, cost=cost, live=live / size)
    return float(x[-1]) * scale / size, scale * contacts.projected(x[:-1].reshape(-1, 3)), dual
