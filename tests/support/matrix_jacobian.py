"""Any matrix as a contact Jacobian: the plain reference of `mbd.contacts.jacobian`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from geometry.mesh import FloatArray
from mbd.contacts.jacobian import NormalMap


@dataclass(frozen=True)
class MatrixJacobian:
    """Any G given as a matrix; its normal matrices are factored densely."""

    matrix: scipy.sparse.csc_array
    """(n_rows, n_contacts)."""
    motions = None

    @property
    def shape(self) -> tuple[int, int]:
        """(n_rows, n_contacts)."""
        n_rows, n_contacts = self.matrix.shape
        return int(n_rows), int(n_contacts)

    def admissible(self, rows: FloatArray) -> FloatArray:
        """All of some rows: no support takes any."""
        return rows

    @property
    def n_motions(self) -> int:
        """Independent motions."""
        return self.shape[0]

    def once(self, _: str, find: Callable[[], Any]) -> Any:
        """Return what follows from G alone, anew each time."""
        return find()

    def gap_rates(self, virtual_displacement: FloatArray) -> FloatArray:
        """Gᵀ δq, (n_contacts,)."""
        return self.matrix.T @ virtual_displacement

    def wrenches_on(self, block: int) -> FloatArray:
        """Columns that are not zero in six rows, (6, n)."""
        own = self.matrix.toarray()[6 * block : 6 * block + 6]
        return own[:, own.any(axis=0)]

    def condensed_rates(self, directions: FloatArray) -> FloatArray:
        """Gᵀ times some directions (n_rows, k): all rows, (n_contacts, k)."""
        return self.matrix.T @ directions

    def resultant(self, forces: FloatArray) -> FloatArray:
        """G λ, (n_rows,)."""
        return self.matrix @ forces

    def normal_product(self) -> NormalMap:
        """Product with G Gᵀ."""
        return lambda vector: self.matrix @ (self.matrix.T @ vector)

    def normal_solver(self, weights: FloatArray, shift: float) -> NormalMap:
        """Factor G diag(weights) Gᵀ + shift I."""
        weighted = self.matrix * weights[None, :]
        normal = (weighted @ self.matrix.T).toarray()
        normal[np.diag_indices_from(normal)] += shift
        factor = scipy.linalg.cho_factor(normal, lower=True, check_finite=False)

        def solve(right_hand_side: FloatArray) -> FloatArray:
            return scipy.linalg.cho_solve(factor, right_hand_side, check_finite=False)

        return solve

    def to_matrix(self) -> scipy.sparse.csc_array:
        """G as a sparse matrix, (n_rows, n_contacts)."""
        return self.matrix


def as_jacobian(matrix: FloatArray) -> MatrixJacobian:
    """G of a dense matrix (n_rows, n_contacts)."""
    return MatrixJacobian(scipy.sparse.csc_array(matrix))
