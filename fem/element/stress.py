"""Tensors, principal stresses and invariants of stresses (..., 6), xx, yy, zz, xy, yz, xz."""

from __future__ import annotations

import numpy as np

from fem.element.hexahedron import VOIGT
from fem.element.material import Material
from geometry.errors import RefusedError
from geometry.mesh import FloatArray


class DisplacementShapeError(RefusedError):
    """Displacements that do not belong to the mesh: got and expected shapes."""


def stress_of_gradient(gradient: FloatArray, material: Material) -> FloatArray:
    """Stress of displacement gradients ∂uᵢ/∂xⱼ, (..., 3, 3) [-] to (..., 6) [MPa]."""
    strain = gradient + np.swapaxes(gradient, -1, -2)
    # Engineering shear strains, hence no half of theirs.
    voigt = [strain[..., i, j] * (0.5 if i == j else 1.0) for i, j in VOIGT]
    return np.stack(voigt, axis=-1) @ material.elasticity_matrix().T


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
