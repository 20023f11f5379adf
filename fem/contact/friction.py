"""Coulomb friction with a regularised stick: an elastic slip up to the limit, then sliding.

With s the slip of a point (the tangential part of its opposing displacement), a its *anchor*,
the slip at which it would be free of traction, and k the stick stiffness,

    t = k (s - a)                       while |t| <= mu p: it sticks
    t = mu p (s - a) / |s - a|          else: it slides, and the anchor follows, a = s - t / k

The anchor is the history of a point. A point without pressure has its anchor at its slip, so
contact begins without traction. Explicit runs keep the elastic slip s - a instead, along sides
that turn with the surface (`slip_sides`). `return_formula` is the return of both.

Reference: Wriggers, Computational Contact Mechanics (2006), section 5.2, elastic slip and radial
return.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fem.contact.law import ContactLaw
from geometry.compilation import njit
from geometry.errors import RefusedError, is_number
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.pairs import OfPairs, pair_values

#: Overclosure that counts as touch where a law has no pressure at none [mm].
_TOUCHING = 1e-9
#: Default stick stiffness over Young's modulus per length of a block [-]. Judged on three cubes
#: under their weight (averaged tension 20 % from rigid stick at 3, 2.7 % at 30), walls and tubes.
#: Tubes take the same time with both; at 300 first iterations of tubes fail.
STIFFER = 30.0
#: Friction over that stated with which points that press stick.
_STICKING = 1e3
#: Friction without slip: nothing is divided by zero.
_NO_FRICTION = 1e-300
#: Coefficients of dry materials stay below 2; beyond this a number is something else.
MOST_FRICTION = 10.0


class FrictionError(RefusedError):
    """Friction that cannot be used: the constant and its range."""


def return_formula(
    larger: Callable[..., Any], square_root: Callable[..., Any]
) -> Callable[..., Any]:
    """Make the radial return from functions of a kind of numbers: arrays, scalars or SIMD lanes."""

    def share(x: Any, y: Any, stick: Any, limit: Any) -> Any:
        """Share of an elastic slip (x, y) whose friction stays below a limit, mu p."""
        return limit / larger(larger(stick * square_root(x * x + y * y), limit), _NO_FRICTION)

    return share


_shares = return_formula(np.maximum, np.sqrt)


@njit(error_model="numpy", forceinline=True)
def slip_loss(before: Any, trial: Any, after: Any) -> Any:
    """Energy lost by the return of a slip over half the stick stiffness [mm²].

    It is the work of the mean traction on what slid. Slips have two components.
    """
    lost = (before[0] + after[0]) * (trial[0] - after[0])
    return lost + (before[1] + after[1]) * (trial[1] - after[1])


def slip_sides(tangents: FloatArray) -> FloatArray:
    """Directions of slip that turn with a surface, orthonormal, (..., 2, 3).

    The first lies half-way between the tangents dx/dr and dx/ds, (..., 2, 3), the second across it:
    another corner to start from turns both by a right angle, which no isotropic law notices.
    """
    unit = tangents / np.linalg.norm(tangents, axis=-1, keepdims=True)
    normal = np.cross(tangents[..., 0, :], tangents[..., 1, :])
    along = unit.sum(axis=-2)
    both = np.stack([along, np.cross(normal, along)], axis=-2)
    sides: FloatArray = both / np.linalg.norm(both, axis=-1, keepdims=True)
    return sides


@dataclass(frozen=True)
class CoulombFriction:
    """Coulomb's law with an elastic slip.

    Raises
    ------
    FrictionError
        For a constant that is not positive and finite, or a coefficient above `MOST_FRICTION`.
        Beside pairs that have friction, other joints may have none.
    """

    coefficient: float
    """mu [-]"""
    stick_stiffness: float | None = None
    """Slope of the traction while sticking [MPa/mm]. None: `STIFFER` times Young's modulus per
    length of a block; explicit runs take no more than the contact stiffness that their time step
    allows."""
    of_pairs: OfPairs = ()
    """Coefficients between some pairs of blocks, such as ``((0, 1, 0.6),)``; 0: frictionless."""

    def __post_init__(self) -> None:
        for name in ("coefficient", "stick_stiffness"):
            value = getattr(self, name)
            if value is None and name == "stick_stiffness":
                continue
            some = name == "coefficient" and any(pair[2] > 0.0 for pair in self.of_pairs)
            if not (is_number(value) and (value > 0.0 or (some and value == 0.0))):
                raise FrictionError(
                    f"{name}: got {value}, expected a finite positive number "
                    "(leave friction out for none)"
                )
        for value in (self.coefficient, *(pair[2] for pair in self.of_pairs)):
            if not 0.0 <= value <= MOST_FRICTION:
                raise FrictionError(
                    f"coefficient: got {value:g}, expected 0 to {MOST_FRICTION:g}; an angle of "
                    "friction φ is given as its tangent: 30° is 0.577"
                )

    def stick(self, modulus: float, length: float, most: float = math.inf) -> float:
        """Stiffness of points that stick, as stated or of blocks [MPa/mm].

        By default it scales with Young's modulus [MPa] and the length of a block [mm], does not
        depend on a mesh, and is at most ``most``.
        """
        stated = self.stick_stiffness
        return min(STIFFER * modulus / length, most) if stated is None else stated

    def on(self, block_m: IntArray, block_s: IntArray) -> float | FloatArray:
        """Coefficient of each of some joints, blocks (n,) each; one number where all have it."""
        return pair_values(self.coefficient, self.of_pairs, block_m, block_s)


@dataclass(frozen=True)
class Coulomb:
    """Tractions of contact points by their overclosures and slips: pressure and friction.

    ``x`` are (n, n_points, 1) without friction and (n, n_points, 3) with it: overclosure, then the
    slips along two orthonormal tangents [mm]. Tractions are alike: pressure, then friction that
    resists the slips [MPa]. Anchors are (n, n_points, 0 or 2) [mm].
    """

    normal: ContactLaw
    """Pressure of the overclosure."""
    coefficient: float | FloatArray = 0.0
    """μ of all points, or of those of each facet, (n, 1) [-]."""
    stick: float = 1.0
    """Slope of the friction while sticking [MPa/mm]."""

    def tractions(self, x: FloatArray, anchor: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tractions [MPa] and new anchors [mm].

        The work lost is the traction times the path of the anchor.
        """
        traction = np.empty_like(x)
        traction[..., 0] = self.normal.pressure(x[..., 0])
        if x.shape[-1] == 1:
            return traction, anchor
        trial, share, slides = self._returned(x, anchor, traction[..., 0])
        traction[..., 1:] = share * trial
        return traction, np.where(slides, x[..., 1:] - traction[..., 1:] / self.stick, anchor)

    def slope(self, x: FloatArray, anchor: FloatArray) -> FloatArray:
        """∂(traction)/∂x, (n, n_points, 1 or 3, 1 or 3) [MPa/mm].

        Not symmetric where a point slides: its friction follows its pressure.
        """
        slope = np.zeros((*x.shape, x.shape[-1]))
        slope[..., 0, 0] = self.normal.stiffness(x[..., 0])
        if x.shape[-1] == 1:
            return slope
        pressure = self.normal.pressure(x[..., 0])
        trial, share, slides = self._returned(x, anchor, pressure)
        length = np.linalg.norm(trial, axis=-1, keepdims=True)
        along = np.divide(trial, length, out=np.zeros_like(trial), where=slides & (length > 0.0))
        grows = (self.coefficient * slope[..., 0, 0])[..., None]
        slope[..., 1:, 0] = np.where(pressure[..., None] > 0.0, grows * along, 0.0)
        across = np.eye(2) - along[..., None] * along[..., None, :]
        slope[..., 1:, 1:] = self.stick * share[..., None] * across
        return slope

    def _returned(
        self, x: FloatArray, anchor: FloatArray, pressure: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Friction of full stick, the share of it that acts, and whether a point slides.

        Shapes are (n, n_points, 2), (n, n_points, 1) and (n, n_points, 1).
        """
        slip = x[..., 1:] - anchor
        limit = self.coefficient * pressure
        share = _shares(slip[..., 0], slip[..., 1], self.stick, limit)[..., None]
        return self.stick * slip, share, share < 1.0

    @property
    def sticking(self) -> Coulomb:
        """The law with so much friction that points which press stick; frictionless ones slide."""
        return replace(self, coefficient=_STICKING * self.coefficient)

    @property
    def touching_pressure(self) -> FloatArray:
        """Pressure at which contacts begin to press, one number or one for each facet [MPa]."""
        law = self.normal
        return np.maximum(law.pressure(0.0), _TOUCHING * law.touching_stiffness)


def coulomb(
    law: ContactLaw,
    friction: CoulombFriction | None,
    stick: float,
    block_m: IntArray,
    block_s: IntArray,
) -> Coulomb:
    """Law of facets or points between blocks (n,) each, and its stick stiffness [MPa/mm]."""
    normal = law.on(block_m, block_s)
    if friction is None:
        return Coulomb(normal)
    found = friction.on(block_m, block_s)
    coefficient = found if isinstance(found, float | int) else found[:, None]
    return Coulomb(normal, coefficient, stick)
