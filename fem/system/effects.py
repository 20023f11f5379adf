"""What a run adds to elasticity and inertia; an effect that is None does not exist in the loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt

from geometry.errors import RefusedError
from geometry.mesh import FloatArray
from geometry.parts.options import Count, NonNegative, Options

#: Share of the critical time step that explicit runs take where nothing else is stated.
SAFETY_FACTOR = 0.9
#: Steps smaller than this part of the critical one end no run.
LEAST_FACTOR = 1e-3


class EffectError(RefusedError):
    """An effect with a coefficient that no solver can use."""


@dataclass(frozen=True)
class RayleighDamping(Options):
    """Viscous damping C = mass_proportional · M + stiffness_proportional · K.

    The damping ratio of a mode is (mass_proportional / ω + stiffness_proportional · ω) / 2.
    """

    mass_proportional: NonNegative | None = None
    """α [1/s], Abaqus *DAMPING, ALPHA; by default absent."""
    stiffness_proportional: NonNegative | None = None
    """β [s], Abaqus *DAMPING, BETA; by default absent. Reduces the critical time step."""


def paper_rayleigh() -> RayleighDamping:
    """Damping of the Abaqus runs of the paper, Table material_parameters."""
    return RayleighDamping(mass_proportional=2.0, stiffness_proportional=1.0e-8)


@dataclass(frozen=True)
class BulkViscosity(Options):
    """Bulk viscosity pressure of Abaqus/Explicit (see `fem.explicit.body`)."""

    linear_bulk_viscosity: NonNegative = 0.06
    """Fraction of critical damping of the dilatational mode of an element [-]."""
    quadratic_bulk_viscosity: NonNegative = 1.2
    """Acts in compression only; smears a shock over a few elements [-]."""


@dataclass(frozen=True)
class AdaptiveMassDamping(Options):
    """A numerical device, not physics: critical damping of the lowest active mode.

    Drives a run to its static state (see `fem.explicit.damping.adapt`).
    """

    interval: Count = 20
    """Steps between two estimates of the lowest active frequency."""
    loading_time: NonNegative = 0.0
    """Duration of the loading [s], during which less than critical damping may count: drag against
    the slow motion is remembered by friction."""
    fraction_while_loading: Annotated[float, Gt(0)] = 1.0
    """Mass damping is 2 · fraction · ω of the estimate: this fraction then, later 1 [-]."""

    def fraction(self, time: float) -> float:
        """Fraction of critical damping at a time [-]."""
        return self.fraction_while_loading if time < self.loading_time else 1.0


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
        if self.adaptive_mass_damping is not None and self.mass_damping is not None:
            raise EffectError(
                f"effects.adaptive_mass_damping: got rayleigh.mass_proportional = "
                f"{self.mass_damping} beside it, expected one of the two: both are "
                "mass-proportional damping"
            )
        gravity = self.gravity
        if gravity is not None and not (gravity.shape == (3,) and all(map(math.isfinite, gravity))):
            raise EffectError(
                f"effects.gravity: got {gravity}, expected three finite numbers [mm/s²]"
            )
        if gravity is None and self.gravity_amplitude is not None:
            raise EffectError("effects.gravity_amplitude: got one, expected gravity beside it")

    @property
    def mass_damping(self) -> float | None:
        """Constant mass-proportional coefficient [1/s], None when absent."""
        return None if self.rayleigh is None else self.rayleigh.mass_proportional

    @property
    def stiffness_damping(self) -> float | None:
        """Stiffness-proportional coefficient [s], None when absent."""
        return None if self.rayleigh is None else self.rayleigh.stiffness_proportional
