"""Stresses at integration points and at nodes, principal stresses.

Every operator is linear in the displacement and the same for all copies of a block, so it is
built once and applied to all copies. Displacements are (n_nodes, 3) or (n_copies, n_nodes, 3);
stresses are (n_points, 6) or (n_copies, n_points, 6) in the order (xx, yy, zz, xy, yz, xz), in
the frame in which the displacement is given: the block's own.

Nodal recovery: the stresses at the 2 × 2 × 2 Gauss points are continued to the corners by the
trilinear polynomial through them (a reduced element is constant), then averaged at each node
over the elements **of the same block** with the element volumes as weights. It reproduces any
constant stress exactly; inside a block its error falls with h², on the surface with h. Blocks
never share an average, for stress may jump between them.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import bsr_array

from fem.element.hexahedron import (
    ELEMENTS,
    VOIGT,
    ElementType,
    assemble_nodal_operator,
    chunks,
    gauss_gradients,
    point_volumes,
)
from fem.element.material import Material
from geometry.errors import RefusedError
from geometry.mesh import CORNERS, FloatArray, HexMesh, gauss_points, shape_values


class DisplacementShapeError(RefusedError):
    """Displacements that do not belong to the mesh: got and expected shapes."""


def corner_extrapolation(element: ElementType) -> FloatArray:
    """Weights that continue integration point values to the corners: (8 corners, n_points)."""
    if ELEMENTS[element].points == 1:
        return np.ones((8, 1))
    points = gauss_points(2)[0]
    # Trilinear Lagrange polynomials on the points ± 1/√3: the product of (1 + 3 x x_p) / 2.
    return np.prod(0.5 * (1.0 + 3.0 * CORNERS[:, None] * points[None]), axis=2)


def integration_points(mesh: HexMesh, element: ElementType) -> FloatArray:
    """Positions of the integration points, (n_elements · n_points, 3) [mm], element by element."""
    order = 1 if ELEMENTS[element].points == 1 else 2
    values = shape_values(gauss_points(order)[0])
    points: FloatArray = values @ mesh.nodes[mesh.elements]
    return points.reshape(-1, 3)


def _columns(n_nodes: int, displacement: FloatArray) -> FloatArray:
    """Displacements of the copies as columns, (3 n_nodes, n_copies); another mesh is rejected."""
    if displacement.ndim not in (2, 3) or displacement.shape[-2:] != (n_nodes, 3):
        raise DisplacementShapeError(
            f"displacement: got shape {displacement.shape}; expected ({n_nodes}, 3) or "
            f"(n_copies, {n_nodes}, 3)"
        )
    return np.ascontiguousarray(displacement.reshape(-1, 3 * n_nodes).T)


def _rows(columns: FloatArray, displacement: FloatArray) -> FloatArray:
    """Stresses (6 n, n_copies) as (n, 6) or (n_copies, n, 6), as the displacement has copies."""
    copies: FloatArray = np.ascontiguousarray(columns.T).reshape(columns.shape[1], -1, 6)
    return copies if displacement.ndim == 3 else copies.reshape(-1, 6)


def integration_point_stress(
    mesh: HexMesh, material: Material, element: ElementType, displacement: FloatArray
) -> FloatArray:
    """Stress at the integration points of a block or of all its copies.

    Displacements (n_nodes, 3) or (n_copies, n_nodes, 3) [mm], computed with that element, give
    (n_elements · n_points, 6) or (n_copies, n_elements · n_points, 6) [MPa], points in the order of
    `integration_points`.

    Raises
    ------
    DisplacementShapeError
        The displacement is not the mesh's.
    """
    columns = _columns(mesh.n_nodes, displacement).reshape(mesh.n_nodes, 3, -1)
    n_copies = columns.shape[2]
    rows = 6 * ELEMENTS[element].points
    elasticity = material.elasticity_matrix()
    stress = np.empty((mesh.n_elements, rows, n_copies))
    for part in chunks(mesh.n_elements):
        corners = mesh.elements[part]
        strain = ELEMENTS[element].strain(mesh.nodes[corners], material)
        operator = (elasticity @ strain).reshape(len(corners), rows, 24)
        stress[part] = operator @ columns[corners].reshape(len(corners), 24, n_copies)
    return _rows(stress.reshape(-1, n_copies), displacement)


def nodal_stress_operator(mesh: HexMesh, material: Material, element: ElementType) -> bsr_array:
    """Recovered nodal stress as one sparse matrix (module docstring says how it is recovered).

    Returns
    -------
    bsr_array
        (6 n_nodes, 3 n_nodes) [MPa/mm] in 6 × 3 node blocks.
    """
    volume = point_volumes(mesh.nodes[mesh.elements]).sum(axis=1)
    share = np.bincount(mesh.elements.ravel(), np.repeat(volume, 8), minlength=mesh.n_nodes)
    extrapolation = corner_extrapolation(element)
    elasticity = material.elasticity_matrix()

    def weighted(coordinates: FloatArray) -> FloatArray:
        strain = ELEMENTS[element].strain(coordinates, material)
        corner: FloatArray = np.einsum(
            "cp,epij->ecij", extrapolation, elasticity @ strain, optimize=True
        )
        corner *= gauss_gradients(coordinates)[1].sum(axis=1)[:, None, None, None]
        return corner.reshape(-1, 48, 24)

    operator = assemble_nodal_operator(mesh, weighted, rows=6)
    row = np.repeat(np.arange(mesh.n_nodes), np.diff(operator.indptr))
    operator.data /= share[row, None, None]
    return operator


def nodal_stress(operator: bsr_array, displacement: FloatArray) -> FloatArray:
    """Apply a nodal stress operator to one block or to all its copies.

    Displacements (n_nodes, 3) or (n_copies, n_nodes, 3) [mm] give (n_nodes, 6) or
    (n_copies, n_nodes, 6) [MPa].

    Raises
    ------
    DisplacementShapeError
        The displacement is not that of the operator's mesh.
    """
    columns = _columns(operator.shape[1] // 3, displacement)
    return _rows(np.asarray(operator @ columns, dtype=np.float64), displacement)


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
