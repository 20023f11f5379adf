"""Contact laws of one's own: an object with two methods, or a table of points.

A law is any object with ``pressure(overclosure)`` [MPa] and ``stiffness(overclosure)``, its slope
[MPa/mm]: arrays of overclosures [mm] of any shape in, arrays of the same shape out. Pressure must
be zero where surfaces are far apart, and never fall. What else a solver asks (stored energy,
overclosure at a pressure) follows from the two::

    class Spring:
        def pressure(self, overclosure):
            return 50.0 * np.maximum(overclosure, 0.0) ** 2

        def stiffness(self, overclosure):
            return 100.0 * np.maximum(overclosure, 0.0)

    solve_static(Problem(blocks, pipe(0.01), concrete, law=Spring()))

The static solver takes any law; the compiled loops of explicit runs take `ExponentialLaw` and
`LinearPenalty`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from fem.contact.law import LARGEST_OVERCLOSURE, ContactLaw, ContactLawError, LawConstants
from geometry.mesh import FloatArray

#: Surfaces this far apart do not press, and overclosures do not reach so far [mm].
_FAR = 1e3
#: Overclosures beyond the start at which a law is looked at when it is given [mm].
_LOOKS = np.geomspace(1e-6, 1.0, 61)
#: … up to this pressure, which no solid bears [MPa].
_HIGHEST = 1e4
#: A slope and the change of pressure over 1e-4 of an overclosure differ by less, but at kinks [-].
_SLOPE = 1e-2
#: The least of those looks at which slopes must agree [-].
_MOST = 0.8
#: Pressure whose stiffness stands for that at touch, where that vanishes [MPa].
_LOW_PRESSURE = 1e-3
#: Parts in which the pressure is integrated, and Gauss points of each.
_PANELS, _POINTS = 8, 6


@runtime_checkable
class PressureLaw(Protocol):
    """Interface of a user-defined contact law."""

    def pressure(self, overclosure: FloatArray) -> FloatArray:
        """Pressure [MPa] at overclosures [mm] of any shape; negative ones are gaps."""

    def stiffness(self, overclosure: FloatArray) -> FloatArray:
        """Its slope [MPa/mm]."""


def as_law(law: ContactLaw | PressureLaw) -> ContactLaw:
    """Give a law of one's own what solvers ask of one; a built-in law stays.

    Raises
    ------
    ContactLawError
        What is no law.
    """
    return law if isinstance(law, ContactLaw) else OwnLaw(law)


def _values(function: Callable[[FloatArray], Any], x: npt.ArrayLike) -> FloatArray:
    """Values of a law at overclosures of any shape, those beyond all measure cut."""
    at = np.clip(np.asarray(x, dtype=np.float64), -LARGEST_OVERCLOSURE, LARGEST_OVERCLOSURE)
    values = np.asarray(function(at), dtype=np.float64)
    if values.shape != at.shape:
        raise ContactLawError(
            f"law: got values of shape {values.shape} at overclosures of shape {at.shape}; "
            "expected the same shape"
        )
    return values


class _WithoutConstants(ContactLaw):
    """Laws that compiled loops do not know."""

    name = "own"

    @property
    def constants(self) -> LawConstants:
        """Reject them."""
        raise ContactLawError(
            f"law: got {self}; the compiled loops of explicit runs take ExponentialLaw or "
            "LinearPenalty: expected one of these, or solve_static"
        )

    @property
    def touching_stiffness(self) -> float:
        """Stiffness at zero clearance, at a low pressure where that vanishes [MPa/mm]."""
        at_touch = float(self.stiffness(1e-300))
        return at_touch or float(self.stiffness(self.overclosure(_LOW_PRESSURE)))

    @property
    def _curve_end(self) -> float:
        return _FAR


@dataclass(frozen=True)
class OwnLaw(_WithoutConstants):
    """A law of one's own, with what solvers ask beside pressure and stiffness."""

    law: PressureLaw
    """The object with two methods."""

    def __post_init__(self) -> None:
        if not isinstance(self.law, PressureLaw):
            raise ContactLawError(
                f"law: got a {type(self.law).__name__}; expected ExponentialLaw, LinearPenalty, "
                "TabularLaw or an object with the methods pressure and stiffness"
            )
        if float(self.pressure(-_FAR)) != 0.0:
            raise ContactLawError(
                f"law: got a pressure of {float(self.pressure(-_FAR)):.3g} MPa at a gap of "
                f"{_FAR:g} mm; expected zero where surfaces are apart"
            )
        self._check_slope()

    def __str__(self) -> str:
        """Name of the class."""
        return type(self.law).__name__

    def _check_slope(self) -> None:
        low = self.pressure(self.start + _LOOKS) < _HIGHEST
        looks = _LOOKS[low]
        at, step = self.start + looks, 1e-4 * looks
        pressure = self.pressure(at)
        if not np.isfinite(pressure).all() or (np.diff(pressure) < 0.0).any() or pressure[0] < 0.0:
            raise ContactLawError(
                f"law: the pressure of {self} is negative, falls or is not finite between "
                f"overclosures of {at[0]:.3g} and {at[-1]:.3g} mm; expected one that rises"
            )
        slope = (self.pressure(at + step) - self.pressure(at - step)) / (2.0 * step)
        wrong = np.abs(self.stiffness(at) - slope) > _SLOPE * np.abs(slope)
        if wrong.mean() > 1.0 - _MOST:
            worst = int(np.flatnonzero(wrong)[0])
            raise ContactLawError(
                f"law: the stiffness of {self} at an overclosure of {at[worst]:.3g} mm is "
                f"{float(self.stiffness(at)[worst]):.4g} MPa/mm; expected the slope of its "
                f"pressure there, {slope[worst]:.4g}"
            )

    def pressure(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Pressure [MPa] at overclosures [mm] of any shape."""
        return _values(self.law.pressure, overclosure)

    def stiffness(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Slope dp/dx [MPa/mm] at overclosures [mm] of any shape."""
        return _values(self.law.stiffness, overclosure)

    @cached_property
    def start(self) -> float:
        """Overclosure up to which the pressure is zero [mm]."""
        low, high = -_FAR, _FAR
        if not float(self.pressure(high)) > 0.0:
            raise ContactLawError(
                f"law: {self} has no pressure at an overclosure of {_FAR:g} mm; expected a pressure"
            )
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if float(self.pressure(middle)) > 0.0 else (middle, high)
        return low

    def stored_energy(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Energy per area ∫ p dx [N/mm], by Gauss' rule in eight parts."""
        x = np.asarray(overclosure, dtype=np.float64)
        deep = np.maximum(x - self.start, 0.0)
        points, weights = np.polynomial.legendre.leggauss(_POINTS)
        parts = (np.arange(_PANELS)[:, None] + 0.5 * (points + 1.0)).ravel() / _PANELS
        shares = np.tile(0.5 * weights / _PANELS, _PANELS)
        return np.asarray((self.pressure(self.start + deep[..., None] * parts) @ shares) * deep)

    def overclosure(self, pressure: npt.ArrayLike) -> FloatArray:
        """Inverse of `pressure` by bisection; the start where the pressure is zero or less."""
        p = np.asarray(pressure, dtype=np.float64)
        low, high = np.full(p.shape, self.start), np.full(p.shape, self.start + 1e-6)
        for _ in range(100):
            short = (self.pressure(high) < p) & (high < _FAR)
            if not short.any():
                break
            high = np.where(short, self.start + 2.0 * (high - self.start), high)
        for _ in range(100):
            middle = 0.5 * (low + high)
            above = self.pressure(middle) >= p
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return np.where(p > 0.0, high, self.start)


@dataclass(frozen=True)
class TabularLaw(_WithoutConstants):
    """Pressure linear between points, beyond the last one with the last slope.

    ``TabularLaw([(0.0, 0.0), (0.01, 0.5), (0.02, 2.0)])`` has overclosures [mm] and pressures
    [MPa], as a measured curve; of static answers.

    Raises
    ------
    ContactLawError
        Points that do not rise in both columns from a pressure of zero.
    """

    name = "table"
    points: Sequence[tuple[float, float]] | FloatArray
    """Overclosure [mm] and pressure [MPa], (n, 2), rising in both; the first pressure is zero."""
    table: FloatArray = field(init=False, repr=False, compare=False)
    """The same as an array, (n, 2)."""

    def __post_init__(self) -> None:
        table = np.array(self.points, dtype=np.float64)
        good = table.ndim == 2 and table.shape[1:] == (2,) and len(table) > 1
        if not good or not np.isfinite(table).all():
            raise ContactLawError(
                f"law: got a table of shape {table.shape}; expected two finite points or more, "
                "each an overclosure in mm and a pressure in MPa"
            )
        if table[0, 1] != 0.0 or (np.diff(table, axis=0) <= 0.0).any():
            raise ContactLawError(
                f"law: got a table from {table[0].tolist()} to {table[-1].tolist()}; expected "
                "overclosures and pressures that rise from a pressure of zero"
            )
        table.flags.writeable = False
        object.__setattr__(self, "table", table)

    def __str__(self) -> str:
        """Name and number of points."""
        return f"TabularLaw of {len(self.table)} points"

    @property
    def start(self) -> float:
        """Overclosure of the first point [mm]."""
        return float(self.table[0, 0])

    @cached_property
    def _slopes(self) -> FloatArray:
        """Before the first point, between points and beyond the last one, (n + 1,) [MPa/mm]."""
        steps = np.diff(self.table, axis=0)
        slopes = steps[:, 1] / steps[:, 0]
        return np.concatenate([[0.0], slopes, slopes[-1:]])

    def _piece(self, overclosure: npt.ArrayLike) -> tuple[FloatArray, npt.NDArray[np.intp]]:
        x = np.minimum(np.asarray(overclosure, dtype=np.float64), LARGEST_OVERCLOSURE)
        return x, np.searchsorted(self.table[:, 0], x, side="right")

    def pressure(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Pressure [MPa] at overclosures [mm] of any shape."""
        x, piece = self._piece(overclosure)
        first = self.table[np.maximum(piece - 1, 0)]
        return np.asarray(first[..., 1] + self._slopes[piece] * (x - first[..., 0]))

    def stiffness(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Slope dp/dx [MPa/mm] at overclosures [mm] of any shape; at a point that beyond it."""
        return np.asarray(self._slopes[self._piece(overclosure)[1]])

    def stored_energy(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Energy per area ∫ p dx [N/mm]."""
        x, piece = self._piece(overclosure)
        steps = np.diff(self.table[:, 0])
        means = 0.5 * (self.table[1:, 1] + self.table[:-1, 1])
        before = np.concatenate([[0.0], np.cumsum(steps * means)])
        row = np.maximum(piece - 1, 0)
        deep = x - self.table[row, 0]
        own = deep * (self.table[row, 1] + 0.5 * self._slopes[piece] * deep)
        return np.where(piece > 0, before[row] + own, 0.0)

    def overclosure(self, pressure: npt.ArrayLike) -> FloatArray:
        """Inverse of `pressure`; the start where the pressure is zero or less."""
        p = np.asarray(pressure, dtype=np.float64)
        x, last = np.interp(p, self.table[:, 1], self.table[:, 0]), self.table[-1]
        beyond = last[0] + (p - last[1]) / self._slopes[-1]
        return np.where(p > last[1], beyond, x)
