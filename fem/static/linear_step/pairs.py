"""Contact of matched facets seen from their pairs of nodes: what friction is solved in.

Facets that match have their nodes in pairs. With d the displacements of the second nodes relative
to the first ones, the overclosure and the slips of all points of a facet are B d, and the forces on
the pairs are

    μ = K d + g    with    K = Σ w Bᵀ k B,    g = Σ w Bᵀ (t + k (x - B d - x̂)),

where k are the slopes of the tractions t. A facet of degree n has (n + 2)² points with three rows
each, and about n² pairs with three components: there are fewer unknowns, and the flexibility
between them does not change while points come and go.

Current normals turn with the mean of both sides, too. That part of the gradients, a share of 1e-3
or less, moves points and forces as it did at the displacement before.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from fem.static.linear_step.linearisation import Linearisation
from fem.static.linear_step.row_laws import PairLaw
from fem.system.system import Sector
from geometry.mesh import FloatArray, IntArray


class NodePairs:
    """Pairs of nodes of the matched facets of a system."""

    def __init__(self, system: Sector) -> None:
        surfaces = self._points = system.points
        first, second = np.split(surfaces.rows, 2, axis=1)
        joint = np.repeat(np.arange(len(surfaces.pair_start) - 1), np.diff(surfaces.pair_start))
        keys = np.stack([np.broadcast_to(joint[:, None], first.shape), first, second], axis=2)
        unique, where, number = np.unique(
            keys.reshape(-1, 3), axis=0, return_index=True, return_inverse=True
        )
        #: Pairs of each facet, (n_facets, n).
        self._of_facets: IntArray = np.asarray(number).reshape(first.shape)
        facet = where // first.shape[1]
        #: First facet of each pair, (n_pairs,).
        self.facet: IntArray = facet
        self.relative = self._relative(unique[:, 1:], surfaces.axes[facet])
        """d on the displacements in block frames, (3 n_pairs, 3 n_nodes)."""

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.facet)

    def _relative(self, nodes: IntArray, rotations: FloatArray) -> csr_array:
        shape = 3 * self.count, 3 * self._points.n_rows
        rows = 3 * np.arange(self.count)[:, None, None] + np.arange(3)[:, None]
        parts = []
        for side, sign in enumerate((-1.0, 1.0)):
            moves = nodes[:, side] < self._points.n_rows
            columns = 3 * nodes[moves, side][:, None, None] + np.arange(3)
            values = sign * rotations[moves, side]
            at = np.broadcast_to(rows[moves], values.shape)
            where = at.ravel(), np.broadcast_to(columns, values.shape).ravel()
            parts.append(csr_array(coo_array((values.ravel(), where), shape)))
        return csr_array(parts[0] + parts[1])

    def law(
        self, linear: Linearisation, before: FloatArray, least: float | FloatArray
    ) -> tuple[PairLaw, FloatArray]:
        """Forces on the pairs with the law linearised, and what turned normals add to the loads.

        Parameters
        ----------
        linear
            Tangents at all points.
        before
            Where both sides are, (n_nodes, 3) [mm].
        least
            Stiffness up to which a point is open [MPa/mm].

        Returns
        -------
        tuple[PairLaw, FloatArray]
            Of the pairs on which forces act, and (n_nodes, 3) [N].
        """
        n_facets, rows_of_point = len(linear.slope), linear.slope.shape[2]
        flat = linear.gradient.reshape(n_facets, -1, *linear.gradient.shape[3:])
        gradient, weights = self._on_pairs(flat), linear.weights[:, :, None]
        width = gradient.shape[2]
        slope = weights[..., None] * linear.slope
        slope[..., 0] *= (linear.slope[..., 0, 0].T > np.asarray(least).T).T[..., None]
        by_pairs = slope @ gradient.reshape(n_facets, -1, rows_of_point, width)
        blocks = np.swapaxes(gradient, 1, 2) @ by_pairs.reshape(gradient.shape)
        dofs = (3 * self._of_facets[:, :, None] + np.arange(3)).reshape(n_facets, width)
        pressed = slope.any(axis=(1, 2, 3))
        active, place = np.unique(dofs[pressed], return_inverse=True)
        place, size = np.reshape(place, dofs[pressed].shape), len(active)
        rows, columns = (
            np.broadcast_to(at, blocks[pressed].shape).ravel()
            for at in (place[:, :, None], place[:, None])
        )
        stiffness = csr_array(coo_array((blocks[pressed].ravel(), (rows, columns)), (size, size)))
        apart = (self.relative @ before.ravel())[dofs]
        away = linear.constant + self._points.gather(linear.gradient, before) - linear.at
        away -= np.einsum("frw,fw->fr", gradient, apart).reshape(away.shape)
        forces = weights * linear.traction
        at_rest = forces + np.einsum("fpkl,fpl->fpk", slope, away)
        turned = self._points.scatter(linear.gradient, forces)
        turned += (self.relative.T @ self._summed(gradient, forces, dofs)).reshape(-1, 3)
        law = PairLaw(
            active,
            csr_array(self.relative[active]),
            stiffness,
            self._summed(gradient, at_rest, dofs)[active],
        )
        return law, turned

    def _summed(self, gradient: FloatArray, forces: FloatArray, dofs: IntArray) -> FloatArray:
        """Forces on the pairs of those of the rows, (3 n_pairs,) [N]."""
        values = np.einsum("frw,fr->fw", gradient, forces.reshape(gradient.shape[:2]))
        return np.bincount(dofs.ravel(), values.ravel(), minlength=3 * self.count)

    def _on_pairs(self, gradient: FloatArray) -> FloatArray:
        """Rows on the relative displacements of their pairs, (n_facets, n_rows, 3 n)."""
        first, second = np.split(gradient, 2, axis=2)
        back = np.swapaxes(self._points.axes, 2, 3)[:, :, None]
        moves = self._points.moves[:, [0, first.shape[2]]]
        share = moves / np.maximum(moves.sum(axis=1, keepdims=True), 1.0)
        on_first, on_second = first @ back[:, 0], second @ back[:, 1]
        relative = share[:, 1, None, None, None] * on_second
        relative -= share[:, 0, None, None, None] * on_first
        return relative.reshape(*gradient.shape[:2], -1)
