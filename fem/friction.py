"""Coulomb friction, regularised: a spring that sticks up to the limit of Coulomb and then slips.

The tangential traction is τ = k s with s the elastic slip, the part of the relative motion that
has not slipped; |τ| never exceeds μ p:

    s* = s + Δd_t,    s ← s* min(1, μ p / (k |s*|)).

What is not elastic is dissipated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


class FrictionError(ValueError):
    """Friction that cannot be computed."""


@dataclass(frozen=True)
class CoulombFriction:
    """Coulomb friction on all contact surfaces.

    Raises
    ------
    FrictionError
        For a coefficient that is negative or a stiffness that is not positive.
    """

    coefficient: float
    """μ, traction over pressure at slip [-]."""
    stick_stiffness: float = 100.0
    """k, traction per elastic slip where surfaces stick [MPa/mm]. The elastic slip at the limit,
    μ p / k, must be small against the motions of interest: 3e-5 mm at μ = 0.01, p = 0.3 MPa."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.coefficient) and self.coefficient >= 0.0):
            raise FrictionError(
                f"effects.friction: got {self.coefficient}, expected a finite coefficient >= 0"
            )
        if not (math.isfinite(self.stick_stiffness) and self.stick_stiffness > 0.0):
            raise FrictionError(
                f"effects.friction: got a stick stiffness of {self.stick_stiffness} MPa/mm, "
                "expected a positive number"
            )
