"""Bulk viscosity of Abaqus/Explicit on the shared-stiffness path.

With the volumetric strain rate ε̇ of an element (gradients averaged over its volume), its
length L (`fem.element.time_step.characteristic_length`), density ρ and dilatational wave
speed c, the viscous mean stress is

    q = b₁ ρ c L ε̇ + ρ (b₂ L)² |ε̇| min(0, ε̇),

Abaqus Theory Manual, "Explicit dynamic analysis". Nodal forces are V q times the averaged
gradients. Differences from the rate form (`fem.explicit.rate_form`): reference gradients in the
block frame, ε̇ the backward difference of the strain, which is the rate at the half step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from fem.element.hexahedron import gauss_gradients, mean_gradients
from fem.element.time_step import characteristic_length
from fem.explicit.kernels.layout import LaneArray, equal_work
from fem.problem.effects import BulkViscosity
from geometry.mesh import IntArray

if TYPE_CHECKING:
    from fem.problem.model import BlockGroup


@dataclass(frozen=True)
class ElementViscosity:
    """Constant data of the bulk viscosity of one reference block."""

    element_rows: npt.NDArray[np.int32]
    """Solver rows of the corners, (n_elements, 8)."""
    gradient: LaneArray
    """Volume-averaged shape gradients, (n_elements, 8, 3) [1/mm]."""
    linear: LaneArray
    """V b₁ ρ c L, (n_elements,) [N mm s]."""
    quadratic: LaneArray
    """V ρ (b₂ L)², (n_elements,) [N mm s²]."""
    element_chunks: IntArray
    """Even pieces of the elements."""
    pointer: IntArray
    """First corner of each row, (n_rows + 1,)."""
    corner: npt.NDArray[np.int32]
    """8 · element + corner for every corner at a row, (8 n_elements,)."""


def element_viscosity(
    group: BlockGroup, row: IntArray, coefficients: BulkViscosity, dtype: npt.DTypeLike
) -> ElementViscosity:
    """Gather gradients and coefficients of a reference block.

    Parameters
    ----------
    group
        Mesh and material.
    row
        Solver row of each mesh node.
    coefficients
        b₁ and b₂.
    dtype
        float64 or float32.
    """
    mesh, material = group.mesh, group.material
    mean, volume = mean_gradients(*gauss_gradients(mesh.nodes[mesh.elements]))
    length = characteristic_length(mesh.nodes[mesh.elements])
    b1, b2 = coefficients.linear_bulk_viscosity, coefficients.quadratic_bulk_viscosity
    rho, c = material.density, material.dilatational_wave_speed
    element_rows = row[mesh.elements].astype(np.int32)
    corner = np.argsort(element_rows.ravel(), kind="stable").astype(np.int32)
    pointer = np.searchsorted(element_rows.ravel()[corner], np.arange(mesh.n_nodes + 1))
    return ElementViscosity(
        element_rows=element_rows,
        gradient=mean.astype(dtype),
        linear=(volume * b1 * rho * c * length).astype(dtype),
        quadratic=(volume * rho * (b2 * length) ** 2).astype(dtype),
        element_chunks=equal_work(np.arange(mesh.n_elements + 1)),
        pointer=pointer.astype(np.int64),
        corner=corner,
    )
