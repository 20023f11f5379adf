"""Isotropic linear elasticity: constants, wave speeds, and tensors and invariants of stresses.

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

#: Rows and columns of the six components xx, yy, zz, xy, yz, xz.
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))

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


class DisplacementShapeError(RefusedError):
    """Displacements that do not belong to the mesh: got and expected shapes."""


def stress_of_gradient(gradient: FloatArray, material: Material) -> FloatArray:
    """Stress of displacement gradients ∂uᵢ/∂xⱼ, (..., 3, 3) [-] to (..., 6) [MPa]."""
    by_gradient = np.zeros((6, 3, 3))
    for strain, (i, j) in zip(material.elasticity_matrix().T, VOIGT, strict=True):
        by_gradient[:, i, j] = by_gradient[:, j, i] = strain
    stress = gradient.reshape(-1, 9) @ by_gradient.reshape(6, 9).T
    return stress.reshape(*gradient.shape[:-2], 6)


def stress_tensor(stress: FloatArray) -> FloatArray:
    """Symmetric tensors (..., 3, 3) of stresses (..., 6)."""
    tensor = np.empty((*stress.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(VOIGT):
        tensor[..., i, j] = tensor[..., j, i] = stress[..., k]
    return tensor


def rotate_stress(stress: FloatArray, rotations: FloatArray) -> FloatArray:
    """Stress of each copy in world axes, R s Rᵀ, (n_copies, n, 6) [MPa].

    From that in the block's own frame, with rotations from there to the world's, (n_copies, 3, 3).
    """
    turn = rotations[:, None]
    turned = turn @ stress_tensor(stress) @ np.swapaxes(turn, -1, -2)
    return np.stack([turned[..., i, j] for i, j in VOIGT], axis=-1)


def invariants(stress: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean stress [MPa] and J₂ [MPa²], half the square of the deviator, (...,) of (..., 6)."""
    mean = stress[..., :3] @ np.full(3, 1.0 / 3.0)
    deviator, shear = stress[..., :3] - mean[..., None], stress[..., 3:]
    squares = 0.5 * np.einsum("...i,...i->...", deviator, deviator)
    return mean, squares + np.einsum("...i,...i->...", shear, shear)


def von_mises(principal: FloatArray) -> FloatArray:
    """Von Mises stress √(½ Σ (σᵢ - σⱼ)²) of principal stresses, (...,) of (..., 3) [MPa]."""
    first, second, third = np.moveaxis(principal, -1, 0)
    squares = (first - second) ** 2 + (second - third) ** 2 + (third - first) ** 2
    return np.asarray(np.sqrt(0.5 * squares))


def principal_stress(stress: FloatArray) -> FloatArray:
    """Principal stresses, sigma_1 >= sigma_2 >= sigma_3: (..., 3) of (..., 6) [MPa]."""
    ascending = np.linalg.eigvalsh(stress_tensor(stress)).astype(np.float64, copy=False)
    return np.ascontiguousarray(ascending[..., ::-1])


def largest_tension(stress: FloatArray) -> FloatArray:
    """σ₁ of stresses (..., 6) where it may be the largest of all, -∞ elsewhere, (...,) [MPa].

    It is larger than the mean by once to twice √(J₂/3).
    """
    mean, second = invariants(stress)
    least = np.sqrt(second / 3.0)
    most = float((mean + least).max())
    may = mean + 2.0 * least >= most - 1e-6 * abs(most)
    result = np.full(mean.shape, -np.inf)
    result[may] = principal_stress(stress[may])[..., 0]
    return result
