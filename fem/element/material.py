"""Isotropic linear elasticity: constants, elasticity matrix and wave speeds.

Stresses and strains are six-vectors in the order (xx, yy, zz, xy, yz, xz), which is VTK's
order for symmetric tensors. Shear strains are engineering strains, gamma = 2 epsilon.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Lt

from geometry.errors import RefusedError, is_number
from geometry.mesh import FloatArray

#: Above zero.
Positive = Annotated[float, Gt(0)]

#: Speed of sound √(E/ρ), slower than in wood across its grain, faster than in diamond [mm/s]: of
#: constants in other units it is another one.
SLOWEST_SOUND, FASTEST_SOUND = 2e5, 2.5e7


class MaterialError(RefusedError):
    """A material that cannot be used: the message names the constant and its allowed range."""


@dataclass(frozen=True, kw_only=True)
class Material:
    """Isotropic linear-elastic solid.

    Raises
    ------
    MaterialError
        Density, modulus or radius not finite and positive, Poisson's ratio outside (-1, 0.5).
    """

    density: Positive
    """Steel 7.85e-9, concrete 2.4e-9 [t/mm³]."""
    young_modulus: Positive
    """[MPa]"""
    poisson_ratio: Annotated[float, Gt(-1), Lt(0.5)]
    """[-]"""
    averaging_radius: Positive = 10.0
    """Radius of the sphere for the averaged (non-local) maximum principal stress [mm]; for
    concrete about the aggregate size."""
    tensile_strength: Positive | None = None
    """If given, static runs print the load factor at first cracking [MPa]."""
    compressive_strength: Positive | None = None
    """If given, static runs print the load factor at first crushing [MPa]."""

    def __post_init__(self) -> None:
        units = {"density": "t/mm³", "young_modulus": "MPa", "averaging_radius": "mm"}
        strengths = ("tensile_strength", "compressive_strength")
        units |= {name: "MPa" for name in strengths if getattr(self, name) is not None}
        for name, unit in units.items():
            value = getattr(self, name)
            if not (is_number(value) and value > 0.0):
                raise MaterialError(
                    f"material: got {name} = {value} {unit}; expected a finite positive number"
                )
        if not (is_number(self.poisson_ratio) and -1.0 < self.poisson_ratio < 0.5):
            raise MaterialError(
                f"material: got poisson_ratio = {self.poisson_ratio}; expected -1 < nu < 0.5 "
                "(for a nearly incompressible solid use 0.4999 and the element b-bar)"
            )

    @property
    def shear_modulus(self) -> float:
        """Return mu = E / (2 (1 + nu)) [MPa]."""
        return self.young_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def lame_modulus(self) -> float:
        """Return lambda = E nu / ((1 + nu)(1 - 2 nu)) [MPa]."""
        nu = self.poisson_ratio
        return self.young_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))

    @property
    def bulk_modulus(self) -> float:
        """Return K = E / (3 (1 - 2 nu)) [MPa]."""
        return self.young_modulus / (3.0 * (1.0 - 2.0 * self.poisson_ratio))

    @property
    def constrained_modulus(self) -> float:
        """Return lambda + 2 mu [MPa], the stiffness of a plane dilatational wave."""
        return self.lame_modulus + 2.0 * self.shear_modulus

    @property
    def bar_wave_speed(self) -> float:
        """Return sqrt(E / rho) [mm/s]."""
        return math.sqrt(self.young_modulus / self.density)

    @property
    def dilatational_wave_speed(self) -> float:
        """Return c_d = sqrt((lambda + 2 mu) / rho) [mm/s]."""
        return math.sqrt(self.constrained_modulus / self.density)

    def elasticity_matrix(self) -> FloatArray:
        """Stress from engineering strain in the order (xx, yy, zz, xy, yz, xz); (6, 6) [MPa]."""
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = self.lame_modulus
        matrix[[0, 1, 2], [0, 1, 2]] = self.constrained_modulus
        matrix[[3, 4, 5], [3, 4, 5]] = self.shear_modulus
        return matrix


def one_strength(name: str, strengths: Iterable[float | None]) -> float | None:
    """Strength of all blocks [MPa]; None where none is stated."""
    different = set(strengths)
    if len(different) > 1:
        raise MaterialError(
            f"{name}: got different ones for different blocks; expected one for all blocks, or none"
        )
    return different.pop()


def each_material(material: object, n: int) -> tuple[Material, ...]:
    """Material of each of n bodies: one for all, or one for each."""
    if isinstance(material, Material):
        return (material,) * n
    given = tuple(material) if isinstance(material, Sequence) else (material,)
    others = [type(m).__name__ for m in given if not isinstance(m, Material)]
    if others:
        raise MaterialError(
            f"material: got a {others[0]}; expected a Material such as fem.concrete, or "
            "one for each block"
        )
    if len(given) != n:
        raise MaterialError(f"material: got {len(given)} materials for {n} blocks; expected {n}")
    return given


#: The concrete of the paper.
concrete = Material(density=2.4e-9, young_modulus=33_000.0, poisson_ratio=0.2)
