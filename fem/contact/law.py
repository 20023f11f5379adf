"""Contact laws: pressure as a function of overclosure, its slope, its integral, its inverse.

Two laws, one formula. Both are zero up to an overclosure at which contact begins, then
exponential (the linear penalty has no such part), then linear for ever:

    p = s X (eˣ - 1) with X = (x - x_start) / c0     x_start < x < x_linear
    p = p_linear + k_linear (x - x_linear)           x >= x_linear

The scalar functions below take a `LawConstants` and are compiled: kernels call the same ones
that the methods of the laws call. Overclosures count up to 1e90 mm, so nothing overflows.

Reference: Abaqus Analysis User's Guide, "Contact pressure-overclosure relationships", for the
exponential law with its three data c0, p0 and k_max.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from geometry.compilation import njit
from geometry.errors import RefusedError, is_number
from geometry.mesh import FloatArray, IntArray

#: Overclosures are taken as at most this: its square times any stiffness is still a float [mm].
LARGEST_OVERCLOSURE = 1e90

#: The exponential ends here at the latest, far above any strength (5e14 MPa with the paper's
#: constants): products and squares of what lies beyond are still floats [-].
LARGEST_EXPONENT = 40.0

#: Pressure whose stiffness the critical time step counts in where the law has no cap [MPa].
COUNTED_PRESSURE = 1.0

#: How often the stiffness of a linear law counts, which begins and ends at once when a joint closes
#: and opens. Central differences keep ½ v₋ v₊ + ½ ω² x² while a point touches. It touches and
#: leaves within a step, so that one touch multiplies its kinetic energy by up to
#: 1 / (1 - (ω Δt)²/4): without bound at the critical step, by 4/3 at half of it.
TOUCHES = 4.0

#: Blocks whose surfaces press with more than this before any load acts are badly placed [MPa].
LARGEST_INITIAL_PRESSURE = 10.0

#: Below this the stored energy is summed as a series: its closed form loses digits [-].
_SERIES_END = 0.5


class ContactLawError(RefusedError):
    """A contact law that cannot be used: the message names the constant and its range."""


class LawConstants(NamedTuple):
    """What the compiled functions need; the same numbers for every law, and friction beside it."""

    start: float
    """Overclosure at which pressure begins (minus the clearance at zero pressure) [mm]."""
    length: float
    """c0, the length over which the exponential grows by e [mm]."""
    scale: float
    """s = p_c0 / (e - 1) [MPa]."""
    linear_start: float
    """Overclosure from which the law is linear [mm]."""
    linear_pressure: float
    """Pressure there [MPa]."""
    linear_stiffness: float
    """Slope from there on [MPa/mm]."""
    linear_energy: float
    """Stored energy there [N/mm]."""
    coefficient: float = 0.0
    """Of the friction of a point [-]."""
    stick: float = 1.0
    """Stiffness of its stick [MPa/mm]."""


def pressure_formula(
    larger: Callable[..., Any], smaller: Callable[..., Any], expm1: Callable[..., Any]
) -> Callable[..., Any]:
    """Make the pressure [MPa] at an overclosure [mm], without branches.

    Written once, for arrays, compiled for numbers here and for vectors in the explicit solver: they
    differ in the three functions that are given.
    """

    def pressure(overclosure, law):  # type: ignore[no-untyped-def]
        end = (law.linear_start - law.start) / law.length
        x = smaller(larger((overclosure - law.start) * (1.0 / law.length), 0.0), end)
        beyond = larger(overclosure - law.linear_start, 0.0)
        return law.linear_stiffness * beyond + law.scale * (x * expm1(x))

    return pressure


_pressure = njit(error_model="numpy", forceinline=True)(pressure_formula(max, min, math.expm1))
_pressures = pressure_formula(np.maximum, np.minimum, np.expm1)


@njit(cache=True)
def law_pressure(overclosure: float, law: LawConstants) -> float:
    """Pressure [MPa] at an overclosure [mm]."""
    if overclosure <= law.start:
        return 0.0
    return _pressure(min(overclosure, LARGEST_OVERCLOSURE), law)


def _energy_integral(x: npt.ArrayLike) -> FloatArray:
    """∫ t (eᵗ - 1) dt from 0 to x = (x - 1) eˣ + 1 - x²/2 = Σ_{k>=3} (k - 1) xᵏ / k!."""
    x = np.asarray(x, dtype=np.float64)
    term, total = 0.5 * x * x, np.zeros_like(x)
    for k in range(3, 20):
        term = term * x / k
        total += (k - 1) * term
    return np.where(x > _SERIES_END, (x - 1.0) * np.exp(x) + 1.0 - 0.5 * x * x, total)


class ContactLaw:
    """What all laws do with their constants; scenes name them, and their constants, as they do.

    A law of one's own needs none of it: see `fem.contact.own_law`.
    """

    name: ClassVar[str]
    """What scenes call it."""
    keys: ClassVar[dict[str, str]] = {}
    """What scenes call constants that have another name here."""

    @property
    def words(self) -> str:
        """Its name and its finite constants, as scenes call them."""
        given = ((self.keys.get(name, name), value) for name, value in vars(self).items())
        numbers = [
            f"{name} {value:g}"
            for name, value in given
            if isinstance(value, int | float) and math.isfinite(value)
        ]
        return f"{self.name} law" + (f" ({', '.join(numbers).replace('_', ' ')})" * bool(numbers))

    @property
    def constants(self) -> LawConstants:
        """Numbers for the compiled functions."""
        raise NotImplementedError

    @property
    def members(self) -> tuple[ContactLaw, ...]:
        """The law, or all those that pairs of blocks have (`fem.contact.pair_laws`)."""
        return (self,)

    def on(self, block_m: IntArray, block_s: IntArray) -> ContactLaw:  # noqa: ARG002
        """Law of each of some joints, blocks (n,) each; one law where all have it."""
        return self

    def one(self, point: int) -> ContactLaw:  # noqa: ARG002
        """Law of one facet or point of those of `on`."""
        return self

    def stiffest(self, overclosure: FloatArray) -> int:
        """Place of the largest stiffness at overclosures (n,) [mm]: the deepest for one law."""
        return int(np.argmax(overclosure))

    @property
    def start(self) -> float:
        """Overclosure at which contact begins [mm]; negative: before the surfaces touch."""
        return self.constants.start

    def pressure(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Pressure [MPa] at overclosures [mm] of any shape."""
        law, x = self.constants, np.asarray(overclosure, dtype=np.float64)
        return np.asarray(_pressures(np.clip(x, law.start, LARGEST_OVERCLOSURE), law))

    def stiffness(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Slope dp/dx [MPa/mm] at overclosures [mm] of any shape."""
        law, given = self.constants, np.asarray(overclosure, dtype=np.float64)
        x = np.clip(given, law.start, law.linear_start)
        x = (x - law.start) / law.length
        growth = np.expm1(x)
        curve = law.scale / law.length * (x * (growth + 1.0) + growth)
        result = np.where(given < law.linear_start, curve, law.linear_stiffness)
        return np.where(given <= law.start, 0.0, result)

    def stored_energy(self, overclosure: npt.ArrayLike) -> FloatArray:
        """Energy per area ∫ p dx [N/mm] at overclosures [mm] of any shape."""
        law, given = self.constants, np.asarray(overclosure, dtype=np.float64)
        x = (np.clip(given, law.start, law.linear_start) - law.start) / law.length
        beyond = np.clip(given - law.linear_start, 0.0, LARGEST_OVERCLOSURE - law.linear_start)
        linear = law.linear_pressure + 0.5 * law.linear_stiffness * beyond
        curve = law.scale * law.length * _energy_integral(x)
        with np.errstate(under="ignore"):  # no energy, then
            return np.where(beyond > 0.0, law.linear_energy + beyond * linear, curve)

    def overclosure(self, pressure: npt.ArrayLike) -> FloatArray:
        """Inverse of `pressure`: overclosures [mm] for pressures [MPa] of any shape.

        Where the pressure is zero or less, the overclosure at which contact begins. In the
        exponential part ln X + ln(eˣ - 1) = ln(p / s) is solved by Newton in ln X, where the left
        side is convex with a slope of at least two: it converges from anywhere.
        """
        law, p = self.constants, np.asarray(pressure, dtype=np.float64)
        result = law.linear_start + (p - law.linear_pressure) / law.linear_stiffness
        curved = (p > 0.0) & (p < law.linear_pressure)
        target = np.log(p[curved] / law.scale) if law.scale else np.empty(0)
        log_x = np.where(target < 0.0, 0.5 * target, np.log1p(np.maximum(target, 0.0)))
        for _ in range(60):
            x = np.exp(log_x)
            growth = np.expm1(x)
            step = (target - log_x - np.log(growth)) / (1.0 + x * (growth + 1.0) / growth)
            log_x += step
            if not (np.abs(step) > 4e-16 * np.maximum(np.abs(log_x), 1.0)).any():
                break
        result = np.where(p > 0.0, result, law.start)
        result[curved] = law.start + law.length * np.exp(log_x)
        return result

    @property
    def touching_stiffness(self) -> float:
        """Stiffness where the surfaces just touch, at zero clearance [MPa/mm]."""
        return float(self.stiffness(1e-300))

    @property
    def largest_initial_overclosure(self) -> float:
        """Overclosure beyond which blocks are rejected at the start [mm].

        Where the law presses with `LARGEST_INITIAL_PRESSURE`, or where its exponential ends. A
        micrometre is always allowed, which the coordinates of a mesh may well be off by.
        """
        hard = float(self.overclosure(LARGEST_INITIAL_PRESSURE))
        return max(min(self._curve_end, hard), 1e-3)

    def allowed_overclosure(self, clearance: float) -> float:
        """Overclosure beyond which facets are rejected at the start [mm].

        A negative clearance [mm] is an interference that is stated, and placement not to blame: it
        may reach to the end of the exponential, and with a law that has none to any depth.
        """
        if clearance >= 0.0:
            return self.largest_initial_overclosure
        end = self._curve_end
        return max(end, self.largest_initial_overclosure) if end > 0.0 else math.inf

    @property
    def _curve_end(self) -> float:
        """Overclosure at which the exponential ends [mm]."""
        return self.constants.linear_start


def _require_positive(law: str, name: str, value: float, *, finite: bool = True) -> None:
    good = (is_number(value) and value > 0.0) or (not finite and value == math.inf)
    if not good:
        expected = "a finite positive number" if finite else "a positive number or infinity"
        raise ContactLawError(f"contact.{name}: got {value}, expected {expected} ({law} law)")


@dataclass(frozen=True)
class ExponentialLaw(ContactLaw):
    """Abaqus' exponential pressure-overclosure law.

    p = p_c0 / (e - 1) X (eˣ - 1) with X = overclosure / c0 + 1, zero for X <= 0. With a maximum
    stiffness it continues linearly beyond the overclosure at which its slope reaches that.

    Raises
    ------
    ContactLawError
        For a constant that is not positive, or a maximum stiffness that the law exceeds before
        the surfaces touch.
    """

    # A cap is another law: with the other two as here 1000 acts above 0.883 MPa and takes more than
    # a tenth off the peak pressures of the paper's tubes. Abaqus does not publish its default for
    # penalty contact.
    name = "exponential"
    clearance_at_zero_pressure: float = 1e-3
    """c0 of the exponential law [mm]."""
    pressure_at_zero_clearance: float = 1e-4
    """p_c0 of the exponential law [MPa]."""
    maximum_stiffness: float = math.inf
    """Stiffness cap [MPa/mm]: the exponential law continues linearly beyond this slope. By default
    no cap. A run prints where a cap acted."""

    def __post_init__(self) -> None:
        for name in ("clearance_at_zero_pressure", "pressure_at_zero_clearance"):
            _require_positive("exponential", name, getattr(self, name))
        _require_positive("exponential", "maximum_stiffness", self.maximum_stiffness, finite=False)
        touching = self._curve_stiffness(1.0)
        if self.maximum_stiffness < touching:
            raise ContactLawError(
                f"maximum_stiffness: got {self.maximum_stiffness} MPa/mm; expected at "
                f"least {touching:.4g}, the stiffness at zero clearance"
            )

    def _curve_stiffness(self, x: float) -> float:
        scale = self.pressure_at_zero_clearance / (math.e - 1.0) / self.clearance_at_zero_pressure
        return scale * (x * math.exp(x) + math.expm1(x))

    def _linear_exponent(self) -> float:
        """X at which the slope reaches the maximum stiffness, by bisection to the last bit."""
        low, high = 0.0, LARGEST_EXPONENT
        if self._curve_stiffness(high) <= self.maximum_stiffness:
            return high
        for _ in range(200):
            middle = 0.5 * (low + high)
            if self._curve_stiffness(middle) < self.maximum_stiffness:
                low = middle
            else:
                high = middle
        return high

    @cached_property
    def constants(self) -> LawConstants:
        """Numbers for the compiled functions."""
        length = self.clearance_at_zero_pressure
        scale = self.pressure_at_zero_clearance / (math.e - 1.0)
        x = self._linear_exponent()
        return LawConstants(
            start=-length,
            length=length,
            scale=scale,
            linear_start=length * (x - 1.0),
            linear_pressure=scale * x * math.expm1(x),
            linear_stiffness=self._curve_stiffness(x),
            linear_energy=scale * length * float(_energy_integral(x)),
        )


@dataclass(frozen=True)
class LinearPenalty(ContactLaw):
    """p = stiffness · overclosure, zero where the surfaces are apart.

    Raises
    ------
    ContactLawError
        For a stiffness that is not positive and finite.
    """

    name = "linear"
    keys = {"stiffness_per_area": "stiffness"}  # noqa: RUF012 - a class variable of the base
    stiffness_per_area: float
    """Slope of the linear law [MPa/mm]."""

    def __post_init__(self) -> None:
        _require_positive("linear", "stiffness", self.stiffness_per_area)

    @cached_property
    def constants(self) -> LawConstants:
        """Numbers for the compiled functions."""
        return LawConstants(0.0, 1.0, 0.0, 0.0, 0.0, self.stiffness_per_area, 0.0)


#: Laws that scenes name.
LAWS: dict[str, type[ExponentialLaw | LinearPenalty]] = {
    law.name: law for law in (ExponentialLaw, LinearPenalty)
}


def counted_stiffness(law: ContactLaw, pressure: float = COUNTED_PRESSURE) -> float:
    """Stiffness of a law that the critical time step counts in [MPa/mm]; of several, the largest.

    The stiffness at ``pressure`` [MPa], which a run then watches; where the law is linear there,
    nothing exceeds it, and it counts `TOUCHES` times.
    """
    return max(_counted(one, pressure) for one in law.members)


def _counted(law: ContactLaw, pressure: float) -> float:
    largest = law.constants.linear_stiffness
    there = float(law.stiffness(law.overclosure(pressure)))
    return there if there < largest else TOUCHES * largest
