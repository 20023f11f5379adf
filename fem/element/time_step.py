"""Stable time steps from single elements: what Abaqus quotes, and two true bounds.

`characteristic_time_step` is L / c_d, the estimate that Abaqus/Explicit documents; it is not a
bound (a cube of nu = 0.4 rings faster than that). `uniform_strain_time_step` bounds the
one-point element, `element_eigenvalue_time_step` any element: with the lumped mass an assembled
mesh is never stiffer than its stiffest free element (Irons and Treharne 1971).
"""

from __future__ import annotations

import math

import numpy as np

from fem.element.hexahedron import (
    ElementType,
    chunks,
    element_lumped_mass,
    element_stiffness,
    gauss_gradients,
    mean_gradients,
)
from fem.element.material import Material
from geometry.mesh import HEX_FACES, FloatArray, HexMesh


def characteristic_length(coordinates: FloatArray) -> FloatArray:
    """Volume over the largest face: the smallest height of a parallelepiped; (n_elements,) [mm].

    Abaqus calls its L_e the smallest dimension of the element and does not publish more; this
    is the definition LS-DYNA documents for its bricks.
    """
    corners = coordinates[:, HEX_FACES]
    vectors = 0.5 * np.cross(
        corners[:, :, 2] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 1]
    )
    largest = np.linalg.norm(vectors, axis=2).max(axis=1)
    volume = np.concatenate(
        [gauss_gradients(coordinates[part])[1].sum(axis=1) for part in chunks(len(coordinates))]
    )
    return volume / largest


def damped_factor(damping_ratio: float) -> float:
    """Factor sqrt(1 + xi²) - xi by which a damping ratio of the highest mode cuts the step."""
    return math.sqrt(1.0 + damping_ratio**2) - damping_ratio


def characteristic_time_step(
    mesh: HexMesh, material: Material, *, linear_bulk_viscosity: float = 0.0
) -> float:
    """Element estimate of Abaqus/Explicit, min L_e / c_d · (sqrt(1 + b1²) - b1) [s].

    Parameters
    ----------
    mesh
        The block.
    material
        Its dilatational wave speed.
    linear_bulk_viscosity
        Abaqus' damping ratio of the dilatational mode, b1 (0.06 there by default).
    """
    length = characteristic_length(mesh.nodes[mesh.elements]).min()
    return float(length) / material.dilatational_wave_speed * damped_factor(linear_bulk_viscosity)


def uniform_strain_time_step(mesh: HexMesh, material: Material) -> float:
    """Bound of the one-point element, 2 / omega with omega² <= 8 c_d² B:B [s].

    Flanagan and Belytschko (1981), eq. 73 f.: B the averaged gradients, a corner carrying
    an eighth of the mass; where the corners share the mass unequally, the lightest counts.
    """
    bound = math.inf
    for part in chunks(mesh.n_elements):
        coordinates = mesh.nodes[mesh.elements[part]]
        mean, volume = mean_gradients(*gauss_gradients(coordinates))
        lightest = element_lumped_mass(coordinates, material.density).min(axis=1)
        square = np.einsum("eai,eai->e", mean, mean)
        highest = (volume * material.constrained_modulus * square / lightest).max()
        bound = min(bound, 2.0 / math.sqrt(highest))
    return bound


def element_frequencies(mesh: HexMesh, material: Material, element: ElementType) -> FloatArray:
    """Highest frequency of each free element with its lumped mass, (n_elements,) [rad/s]."""
    squares = np.empty(mesh.n_elements)
    for part in chunks(mesh.n_elements):
        coordinates = mesh.nodes[mesh.elements[part]]
        stiffness = element_stiffness(coordinates, material, element)
        scale = np.repeat(
            1.0 / np.sqrt(element_lumped_mass(coordinates, material.density)), 3, axis=1
        )
        scaled = stiffness * scale[:, :, None] * scale[:, None, :]
        squares[part] = np.linalg.eigvalsh(scaled)[:, -1]
    return np.sqrt(squares)


def element_eigenvalue_time_step(mesh: HexMesh, material: Material, element: ElementType) -> float:
    """Bound of any element, 2 / omega_max over the free elements with their lumped masses [s]."""
    return 2.0 / float(element_frequencies(mesh, material, element).max())
