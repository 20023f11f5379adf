"""Contact Jacobian G: one column per contact, six rows per free block (eq. gap-variation).

The reference point of each block is its mass centroid and moments are divided by a
characteristic length, so a row is a force in every unit system and no result depends on units:
a virtual displacement is (δt, ℓ δθ), a wrench is (F, M/ℓ).

Two forms of the same operator live here. `MatrixJacobian` holds any matrix. `PairJacobian` uses
that all contacts between two blocks act through one six-dimensional wrench, so products and
normal matrices cost little even with 500 000 contacts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from geometry.assembly import BoolArray
from geometry.contact_assembly import ContactAssembly
from geometry.mesh import FloatArray, IntArray


class ContactJacobian(Protocol):
    """What the solvers need of G."""

    @property
    def shape(self) -> tuple[int, int]:
        """(n_rows, n_contacts)."""

    def gap_rates(self, virtual_displacement: FloatArray) -> FloatArray:
        """Gᵀ δq, (n_contacts,)."""

    def resultant(self, forces: FloatArray) -> FloatArray:
        """G λ, (n_rows,)."""

    def normal_solver(self, weights: FloatArray, shift: float) -> NormalSolver:
        """Factor G diag(weights) Gᵀ + shift I."""

    def to_matrix(self) -> sp.csc_array:
        """G as a sparse matrix, (n_rows, n_contacts)."""


class NormalSolver(Protocol):
    """A factored normal matrix."""

    def __call__(self, right_hand_side: FloatArray) -> FloatArray:
        """Solve for one right-hand side, (n_rows,)."""


@dataclass(frozen=True)
class MatrixJacobian:
    """Any G given as a matrix; its normal matrices are factored densely."""

    matrix: sp.csc_array
    """(n_rows, n_contacts)."""

    @property
    def shape(self) -> tuple[int, int]:
        """(n_rows, n_contacts)."""
        n_rows, n_contacts = self.matrix.shape
        return int(n_rows), int(n_contacts)

    def gap_rates(self, virtual_displacement: FloatArray) -> FloatArray:
        """Gᵀ δq, (n_contacts,)."""
        rates: FloatArray = self.matrix.T @ virtual_displacement
        return rates

    def resultant(self, forces: FloatArray) -> FloatArray:
        """G λ, (n_rows,)."""
        total: FloatArray = self.matrix @ forces
        return total

    def normal_solver(self, weights: FloatArray, shift: float) -> NormalSolver:
        """Factor G diag(weights) Gᵀ + shift I."""
        weighted = self.matrix * weights[None, :]
        normal = (weighted @ self.matrix.T).toarray()
        normal[np.diag_indices_from(normal)] += shift
        factor = scipy.linalg.cho_factor(normal, lower=True, check_finite=False)

        def solve(right_hand_side: FloatArray) -> FloatArray:
            x: FloatArray = scipy.linalg.cho_solve(factor, right_hand_side, check_finite=False)
            return x

        return solve

    def to_matrix(self) -> sp.csc_array:
        """G as a sparse matrix, (n_rows, n_contacts)."""
        return self.matrix


#: The 21 pairs (i, j) with i <= j of a symmetric 6 × 6 matrix.
_UPPER = np.triu_indices(6)


def _cross_matrix(vector: FloatArray) -> FloatArray:
    """Skew matrices [v]× of vectors (n, 3): (n, 3, 3)."""
    out = np.zeros((len(vector), 3, 3))
    out[:, 0, 1], out[:, 0, 2] = -vector[:, 2], vector[:, 1]
    out[:, 1, 0], out[:, 1, 2] = vector[:, 2], -vector[:, 0]
    out[:, 2, 0], out[:, 2, 1] = -vector[:, 1], vector[:, 0]
    return out


@dataclass(frozen=True)
class PairJacobian:
    """G of an assembly, contacts grouped by block pair (m, s)."""

    wrenches: FloatArray
    """Unit wrench (n, (x - x_pair) × n / ℓ) of each contact about its pair's point; (n, 6)."""
    pair_start: IntArray
    """First contact of each pair, and the total; (n_pairs + 1,)."""
    transfer_m: FloatArray
    """Moves a pair wrench to block m's centroid; zero where m is fixed; (n_pairs, 6, 6)."""
    transfer_s: FloatArray
    """The same for block s, (n_pairs, 6, 6)."""
    row_m: IntArray
    """Free-block number of m (0 where m is fixed: its transfer is zero), (n_pairs,)."""
    row_s: IntArray
    """Free-block number of s, (n_pairs,)."""
    n_free: int
    """Number of free blocks."""

    @property
    def shape(self) -> tuple[int, int]:
        """(6 n_free, n_contacts)."""
        return 6 * self.n_free, len(self.wrenches)

    @cached_property
    def _pair_of(self) -> IntArray:
        count = np.diff(self.pair_start)
        pair_of: IntArray = np.repeat(np.arange(len(count)), count)
        return pair_of

    def gap_rates(self, virtual_displacement: FloatArray) -> FloatArray:
        """Gᵀ δq, (n_contacts,)."""
        q = virtual_displacement.reshape(-1, 6)
        relative = np.einsum("pji,pj->pi", self.transfer_s, q[self.row_s])
        relative -= np.einsum("pji,pj->pi", self.transfer_m, q[self.row_m])
        rates: FloatArray = np.einsum("ci,ci->c", self.wrenches, relative[self._pair_of])
        return rates

    def resultant(self, forces: FloatArray) -> FloatArray:
        """G λ, (6 n_free,)."""
        pair_wrench = self._pair_sums(self.wrenches * forces[:, None])
        total = np.zeros((self.n_free, 6))
        np.add.at(total, self.row_s, np.einsum("pij,pj->pi", self.transfer_s, pair_wrench))
        np.subtract.at(total, self.row_m, np.einsum("pij,pj->pi", self.transfer_m, pair_wrench))
        return total.ravel()

    def _pair_sums(self, values: FloatArray) -> FloatArray:
        if not len(values):
            return np.zeros((len(self.pair_start) - 1, values.shape[1]))
        sums: FloatArray = np.add.reduceat(values, self.pair_start[:-1], axis=0)
        return sums

    @cached_property
    def _outer(self) -> FloatArray:
        """Upper triangles of the wrench outer products, (n_contacts, 21)."""
        return self.wrenches[:, _UPPER[0]] * self.wrenches[:, _UPPER[1]]

    @cached_property
    def _band(self) -> tuple[IntArray, int]:
        """Bandwidth-reducing order of the free blocks, and the half bandwidth in rows."""
        graph = sp.coo_array(
            (np.ones(len(self.row_m)), (self.row_m, self.row_s)), shape=(self.n_free,) * 2
        ).tocsr()
        order = reverse_cuthill_mckee(sp.csr_array(graph + graph.T), symmetric_mode=True)
        position = np.empty(self.n_free, dtype=np.int64)
        position[order] = np.arange(self.n_free)
        reach = np.abs(position[self.row_m] - position[self.row_s]).max(initial=0)
        return position, int(6 * reach + 5)

    def _block_entries(self, weights: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """6 × 6 blocks of G diag(weights) Gᵀ: block rows, block columns, values."""
        upper = self._pair_sums(self._outer * weights[:, None])
        pair = np.empty((len(upper), 6, 6))
        pair[:, _UPPER[0], _UPPER[1]] = upper
        pair[:, _UPPER[1], _UPPER[0]] = upper
        left_m, left_s = self.transfer_m @ pair, self.transfer_s @ pair
        t_m, t_s = self.transfer_m.transpose(0, 2, 1), self.transfer_s.transpose(0, 2, 1)
        rows = np.concatenate([self.row_m, self.row_s, self.row_m, self.row_s])
        columns = np.concatenate([self.row_m, self.row_s, self.row_s, self.row_m])
        values = np.concatenate([left_m @ t_m, left_s @ t_s, -left_m @ t_s, -left_s @ t_m])
        return rows, columns, values

    def normal_solver(self, weights: FloatArray, shift: float) -> NormalSolver:
        """Factor G diag(weights) Gᵀ + shift I by a banded Cholesky decomposition."""
        position, half_band = self._band
        n = 6 * self.n_free
        rows, columns, values = self._block_entries(weights)
        i = (6 * position[rows])[:, None, None] + np.arange(6)[None, :, None]
        j = (6 * position[columns])[:, None, None] + np.arange(6)[None, None, :]
        i, j = np.broadcast_arrays(i, j)
        lower = i >= j
        band = np.bincount(
            (i[lower] - j[lower]) * n + j[lower],
            weights=values[lower],
            minlength=(half_band + 1) * n,
        ).reshape(half_band + 1, n)
        band[0] += shift
        factor = scipy.linalg.cholesky_banded(
            band, lower=True, overwrite_ab=True, check_finite=False
        )
        scatter = (6 * position[:, None] + np.arange(6)).ravel()

        def solve(right_hand_side: FloatArray) -> FloatArray:
            ordered = np.empty(n)
            ordered[scatter] = right_hand_side
            x = scipy.linalg.cho_solve_banded((factor, True), ordered, check_finite=False)
            solution: FloatArray = x[scatter]
            return solution

        return solve

    def to_matrix(self) -> sp.csc_array:
        """G as a sparse matrix, (6 n_free, n_contacts)."""
        pair = self._pair_of
        values_m = -np.einsum("cij,cj->ci", self.transfer_m[pair], self.wrenches)
        values_s = np.einsum("cij,cj->ci", self.transfer_s[pair], self.wrenches)
        columns = np.repeat(np.arange(len(self.wrenches)), 6)
        rows_m = (6 * self.row_m[pair][:, None] + np.arange(6)).ravel()
        rows_s = (6 * self.row_s[pair][:, None] + np.arange(6)).ravel()
        matrix = sp.coo_array(
            (
                np.concatenate([values_m.ravel(), values_s.ravel()]),
                (np.concatenate([rows_m, rows_s]), np.concatenate([columns, columns])),
            ),
            shape=self.shape,
        ).tocsc()
        matrix.eliminate_zeros()
        return matrix


@dataclass(frozen=True)
class Contacts:
    """The contacts that touch at least one free block, and what belongs to them."""

    jacobian: PairJacobian
    """G, moments divided by `length`."""
    index: IntArray
    """Position of each contact in the assembly's interfaces, (n_contacts,)."""
    block_m: IntArray
    """Master block, (n_contacts,)."""
    block_s: IntArray
    """Opposing block, (n_contacts,)."""
    areas: FloatArray
    """Facet areas, (n_contacts,) [mm²]."""
    free_blocks: IntArray
    """Block number of each group of six rows, (n_free,)."""
    length: float
    """Characteristic length ℓ [mm]."""


def _transfer(points: FloatArray, centroids: FloatArray, length: float) -> FloatArray:
    """Matrices that move a wrench (F, M/ℓ) from points to centroids, (n, 6, 6)."""
    out = np.zeros((len(points), 6, 6))
    out[:, range(6), range(6)] = 1.0
    out[:, 3:, :3] = _cross_matrix(points - centroids) / length
    return out


def contact_jacobian(assembly: ContactAssembly, fixed: BoolArray | None = None) -> Contacts:
    """Assemble G for the contacts of an assembly (eq. gap-variation).

    Parameters
    ----------
    assembly
        Blocks and their conforming interfaces.
    fixed
        Blocks held in space, (n_blocks,); by default the frame.

    Returns
    -------
    Contacts
        Contacts between two fixed blocks are left out: they constrain nothing.
    """
    held = assembly.fixed if fixed is None else fixed
    interfaces = assembly.interfaces
    index = np.flatnonzero(~(held[interfaces.block_m] & held[interfaces.block_s]))
    block_m, block_s = interfaces.block_m[index], interfaces.block_s[index]
    change = np.flatnonzero((np.diff(block_m) != 0) | (np.diff(block_s) != 0)) + 1
    start = np.concatenate([[0], change, [len(index)]]) if len(index) else np.zeros(1, dtype=int)
    count = np.diff(start)
    points = interfaces.centroids[index]
    normals = interfaces.normals[index]
    length = assembly.characteristic_length
    if len(index):
        middle = np.add.reduceat(points, start[:-1], axis=0) / count[:, None]
    else:
        middle = np.zeros((0, 3))
    arm = points - np.repeat(middle, count, axis=0)
    wrenches = np.hstack([normals, np.cross(arm, normals) / length])

    number = np.cumsum(~held) - 1
    pair_m, pair_s = block_m[start[:-1]], block_s[start[:-1]]
    transfer_m = _transfer(middle, assembly.centroids[pair_m], length)
    transfer_s = _transfer(middle, assembly.centroids[pair_s], length)
    transfer_m[held[pair_m]] = 0.0
    transfer_s[held[pair_s]] = 0.0
    jacobian = PairJacobian(
        wrenches=wrenches,
        pair_start=start,
        transfer_m=transfer_m,
        transfer_s=transfer_s,
        row_m=np.where(held[pair_m], number[pair_s], number[pair_m]),
        row_s=np.where(held[pair_s], number[pair_m], number[pair_s]),
        n_free=int((~held).sum()),
    )
    return Contacts(
        jacobian=jacobian,
        index=index,
        block_m=block_m,
        block_s=block_s,
        areas=interfaces.areas[index],
        free_blocks=np.flatnonzero(~held),
        length=length,
    )
