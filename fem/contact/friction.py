"""Coulomb friction with a regularised stick: an elastic slip up to the limit, then sliding.

With s the slip of a point (the tangential part of its opposing displacement), a its *anchor*,
the slip at which it would be free of traction, and k the stick stiffness,

    t = k (s - a)                       while |t| <= mu p: it sticks
    t = mu p (s - a) / |s - a|          else: it slides, and the anchor follows, a = s - t / k

The anchor is the history of a point. A point without pressure has its anchor at its slip, so
contact begins without traction. The scalar function is compiled: kernels call the same one.

Reference: Wriggers, Computational Contact Mechanics (2006), section 5.2, elastic slip and radial
return.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geometry.compilation import njit
from geometry.errors import RefusedError, is_number
from geometry.mesh import FloatArray, IntArray
from geometry.parts.pairs import OfPairs, pair_values

#: Coefficients of dry materials stay below 2; beyond this a number is something else.
MOST_FRICTION = 10.0


class FrictionError(RefusedError):
    """Friction that cannot be used: the constant and its range."""


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
    stick_stiffness: float = 100.0
    """Slope of the traction while sticking [MPa/mm]. The default lets a point slip elastically by
    mu p / 100: 0.05 µm at mu = 0.01 and 0.5 MPa, a hundredth of the slips in the paper's tubes,
    and is softer than the contact law where it matters, so it costs no time step."""
    of_pairs: OfPairs = ()
    """Coefficients between some pairs of blocks, such as ``((0, 1, 0.6),)``; 0: frictionless."""

    def __post_init__(self) -> None:
        for name in ("coefficient", "stick_stiffness"):
            value = getattr(self, name)
            some = name == "coefficient" and any(pair[2] > 0.0 for pair in self.of_pairs)
            if not (is_number(value) and (value > 0.0 or (some and value == 0.0))):
                raise FrictionError(
                    f"effects.friction.{name}: got {value}, expected a finite positive number "
                    "(leave friction out for none)"
                )
        for value in (self.coefficient, *(pair[2] for pair in self.of_pairs)):
            if not 0.0 <= value <= MOST_FRICTION:
                raise FrictionError(
                    f"effects.friction.coefficient: got {value:g}, expected up to "
                    f"{MOST_FRICTION:g}; an angle of friction φ is given as its tangent: 30° is "
                    "0.577"
                )

    def on(self, block_m: IntArray, block_s: IntArray) -> float | FloatArray:
        """Coefficient of each of some joints, blocks (n,) each; one number where all have it."""
        return pair_values(self.coefficient, self.of_pairs, block_m, block_s)


@njit(cache=True)
def friction_traction(
    slip_1: float, slip_2: float, anchor_1: float, anchor_2: float, limit: float, stiffness: float
) -> tuple[float, float, float, float]:
    """Traction and new anchor of one point.

    Parameters
    ----------
    slip_1, slip_2
        Slip along two orthonormal tangents [mm].
    anchor_1, anchor_2
        Anchor [mm].
    limit
        mu p [MPa].
    stiffness
        Stick stiffness [MPa/mm].

    Returns
    -------
    tuple[float, float, float, float]
        Traction [MPa] that resists the slip and anchor [mm], along the tangents. The work
        lost is the traction times the path of the anchor.
    """
    if limit <= 0.0:
        return 0.0, 0.0, slip_1, slip_2
    traction_1 = stiffness * (slip_1 - anchor_1)
    traction_2 = stiffness * (slip_2 - anchor_2)
    size = math.hypot(traction_1, traction_2)
    if size <= limit:
        return traction_1, traction_2, anchor_1, anchor_2
    traction_1 *= limit / size
    traction_2 *= limit / size
    return (
        traction_1,
        traction_2,
        slip_1 - traction_1 / stiffness,
        slip_2 - traction_2 / stiffness,
    )


@njit(cache=True)
def _each(
    slip: FloatArray,
    anchor: FloatArray,
    limit: FloatArray,
    stiffness: float,
    traction: FloatArray,
    moved: FloatArray,
) -> None:
    for i in range(len(limit)):
        t1, t2, a1, a2 = friction_traction(
            slip[i, 0], slip[i, 1], anchor[i, 0], anchor[i, 1], limit[i], stiffness
        )
        traction[i, 0], traction[i, 1], moved[i, 0], moved[i, 1] = t1, t2, a1, a2


def friction_tractions(
    friction: CoulombFriction,
    slip: FloatArray,
    anchor: FloatArray,
    pressure: FloatArray,
    coefficient: float | FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Tractions [MPa] and new anchors [mm] of many points, (..., 2) each.

    Slips and anchors are (..., 2) [mm], pressures (...,) [MPa]. The coefficient is that of the law,
    or another of each point, (...,).
    """
    coefficient = friction.coefficient if coefficient is None else coefficient
    traction, moved = np.empty(slip.shape), np.empty(slip.shape)
    _each(
        np.ascontiguousarray(slip).reshape(-1, 2),
        np.ascontiguousarray(anchor).reshape(-1, 2),
        np.ascontiguousarray(coefficient * pressure).reshape(-1),
        friction.stick_stiffness,
        traction.reshape(-1, 2),
        moved.reshape(-1, 2),
    )
    return traction, moved
