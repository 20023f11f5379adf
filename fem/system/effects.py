"""What a run adds to elasticity and inertia; an effect that is None does not exist in the loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from geometry.errors import RefusedError
from geometry.mesh import FloatArray
from geometry.parts.options import NonNegative

#: Share of the critical time step that explicit runs take where nothing else is stated.
SAFETY_FACTOR = 0.9
#: Steps smaller than this part of the critical one end no run.
LEAST_FACTOR = 1e-3


class EffectError(RefusedError):
    """An effect with a coefficient that no solver can use."""


def _require(ok: bool, name: str, value: object, expected: str) -> None:
    if not ok:
        raise EffectError(f"effects.{name}: got {value}, expected {expected}")


@dataclass(frozen=True)
class RayleighDamping:
    """Viscous damping C = mass_proportional · M + stiffness_proportional · K.

    The damping ratio of a mode is (mass_proportional / ω + stiffness_proportional · ω) / 2.
    """

    mass_proportional: NonNegative | None = None
    """α [1/s], Abaqus *DAMPING, ALPHA; by default absent."""
    stiffness_proportional: NonNegative | None = None
    """β [s], Abaqus *DAMPING, BETA; by default absent. Reduces the critical time step."""

    def __post_init__(self) -> None:
        for name in ("mass_proportional", "stiffness_proportional"):
            value = getattr(self, name)
            good = value is None or (math.isfinite(value) and value >= 0.0)
            _require(good, f"rayleigh.{name}", value, "a finite number >= 0")


#: The paper's damping of its Abaqus runs (Table material_parameters): α [1/s] and β [s].
PAPER_RAYLEIGH = RayleighDamping(mass_proportional=2.0, stiffness_proportional=1.0e-8)


@dataclass(frozen=True)
class BulkViscosity:
    """Bulk viscosity pressure of Abaqus/Explicit (see `fem.explicit.body`)."""

    linear_bulk_viscosity: NonNegative = 0.06
    """Fraction of critical damping of the dilatational mode of an element [-]."""
    quadratic_bulk_viscosity: NonNegative = 1.2
    """Acts in compression only; smears a shock over a few elements [-]."""

    def __post_init__(self) -> None:
        for name in ("linear_bulk_viscosity", "quadratic_bulk_viscosity"):
            value = getattr(self, name)
            good = math.isfinite(value) and value >= 0.0
            _require(good, f"bulk_viscosity.{name}", value, "a finite number >= 0")


@dataclass(frozen=True)
class AdaptiveMassDamping:
    """A numerical device, not physics: critical damping of the lowest active mode.

    Drives a run to its static state (see `fem.explicit.damping.adapt`).
    """

    interval: int = 20
    """Steps between two estimates of the lowest active frequency."""
    fraction_of_critical: float = 1.0
    """Mass damping is 2 · fraction · ω of the estimate [-]."""
    loading_time: float = 0.0
    """Duration of the loading [s], during which another fraction may count: drag against the slow
    motion is remembered by friction."""
    fraction_while_loading: float = 1.0
    """That fraction [-]."""

    def __post_init__(self) -> None:
        _require(self.interval >= 1, "adaptive_mass_damping.interval", self.interval, ">= 1")
        for name in ("fraction_of_critical", "fraction_while_loading"):
            fraction = getattr(self, name)
            good = math.isfinite(fraction) and fraction > 0.0
            _require(good, f"adaptive_mass_damping.{name}", fraction, "> 0")
        duration = self.loading_time
        good = math.isfinite(duration) and duration >= 0.0
        _require(good, "adaptive_mass_damping.loading_time", duration, ">= 0")

    def fraction(self, time: float) -> float:
        """Fraction of critical damping at a time [-]."""
        if time < self.loading_time:
            return self.fraction_while_loading
        return self.fraction_of_critical


@dataclass(frozen=True)
class Effects:
    """Effects of a model; the default is linear elasticity alone."""

    rayleigh: RayleighDamping | None = None
    """Rayleigh damping."""
    bulk_viscosity: BulkViscosity | None = None
    """Bulk viscosity."""
    finite_rotation: bool = False
    """Whether blocks may turn by any angle; otherwise rotations must stay small."""
    gravity: FloatArray | None = None
    """Uniform acceleration in world axes, (3,) [mm/s²]."""
    gravity_amplitude: Callable[[float], float] | None = None
    """Factor of gravity in time; None: one."""
    adaptive_mass_damping: AdaptiveMassDamping | None = None
    """Damping to the static state; excludes `RayleighDamping.mass_proportional`."""

    def __post_init__(self) -> None:
        rayleigh = self.rayleigh
        if self.adaptive_mass_damping is not None and rayleigh is not None:
            _require(
                rayleigh.mass_proportional is None,
                "adaptive_mass_damping",
                f"rayleigh.mass_proportional = {rayleigh.mass_proportional} beside it",
                "one of the two: both are mass-proportional damping",
            )
        if self.gravity is not None:
            good = self.gravity.shape == (3,) and all(math.isfinite(g) for g in self.gravity)
            _require(good, "gravity", self.gravity, "three finite numbers [mm/s²]")
        alone = self.gravity is None and self.gravity_amplitude is not None
        _require(not alone, "gravity_amplitude", "one", "effects.gravity beside it")

    @property
    def mass_damping(self) -> float | None:
        """Constant mass-proportional coefficient [1/s], None when absent."""
        return None if self.rayleigh is None else self.rayleigh.mass_proportional

    @property
    def stiffness_damping(self) -> float | None:
        """Stiffness-proportional coefficient [s], None when absent."""
        return None if self.rayleigh is None else self.rayleigh.stiffness_proportional
