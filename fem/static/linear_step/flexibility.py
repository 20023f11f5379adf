"""Flexibilities of blocks on the nodes that contact and supports act on, kept between solves."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array

from fem.static.linear_step.condensation import CondensedBlock, condense, mirror
from fem.static.linear_step.linearisation import UnheldBlocksError
from fem.system.body import Body, rigid_motions
from geometry.machine.work import Operation, count
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Energy of a rigid motion of order one over that of a block strained as much, below which no
#: spring resists it: what rounding leaves.
_RESISTED = 1e-12


@dataclass(frozen=True)
class Flexibility:
    """Response of one kind of block (a shape and its supports) on its retained variables."""

    condensed: CondensedBlock
    """Schur complement on contact and held nodes."""
    stiffness: FloatArray
    """The same on the retained variables v, u = T v; (3 n_c, 3 n_c) [N/mm]."""
    free: IntArray
    """Retained variables that are not prescribed, (n_free,)."""
    inverse: FloatArray
    """G, pseudo-inverse of the stiffness on the free variables, (n_free, n_free) [mm/N]."""
    rigid: FloatArray
    """Rigid motions that the supports leave, rotations times ℓ; (n_free, 0 … 6)."""


def block_motions(group: Body, nodes: IntArray) -> FloatArray:
    """Translations, and rotations about the mean of all nodes times ℓ, at nodes; (3 n, 6).

    That mean, not the mass centroid: no bit of a static answer shall hang on the density. ℓ is the
    cube root of the volume of the block's bounding box, so all six are of order one.
    """
    points = group.mesh.nodes
    arm = (points[nodes] - points.mean(axis=0)) / np.cbrt(np.prod(np.ptp(points, axis=0)))
    return rigid_motions(arm).reshape(-1, 6)


def symmetric_pseudo_inverse(stiffness: FloatArray, rigid: FloatArray) -> FloatArray:
    """(S + s R̂ R̂ᵀ)⁻¹ - R̂ R̂ᵀ / s with R̂ an orthonormal basis of the rigid motions."""
    if not stiffness.size:  # supports prescribe every node
        return stiffness
    shifted = np.array(stiffness, order="F")
    count(Operation.DENSE, 0.5 * float(len(stiffness)) ** 3)
    scale = float(np.diag(stiffness).mean())
    basis = np.linalg.qr(rigid)[0] if rigid.shape[1] else rigid
    shifted += scale * basis @ basis.T
    factor, fail = scipy.linalg.lapack.dpotrf(shifted, lower=1, overwrite_a=1)
    if fail:
        raise UnheldBlocksError("a block's stiffness is not positive definite", ())
    inverse, _ = scipy.linalg.lapack.dpotri(factor, lower=1, overwrite_c=1)
    full: FloatArray = inverse.T
    mirror(full)
    full -= basis @ basis.T / scale
    return full


def _unresisted(stiffness: FloatArray, rigid: FloatArray) -> FloatArray:
    """Rigid motions (n, k) that no spring resists, (n, 0 … k)."""
    energy = rigid.T @ stiffness @ rigid
    values, vectors = np.linalg.eigh(energy)
    scale = float(np.abs(stiffness).max()) * len(rigid)
    return rigid @ vectors[:, values <= _RESISTED * scale]


def flexibility_of(
    group: Body, condensed: CondensedBlock, axes: csr_array | None, is_free: BoolArray
) -> Flexibility:
    """Return the flexibility of a block on its retained variables.

    ``axes`` are the T of its supports, (3 n_c, 3 n_c); None: it has none. ``is_free`` says which
    variables are not prescribed, (3 n_c,).
    """
    stiffness = condensed.stiffness
    rigid = block_motions(group, condensed.retained)
    if axes is not None:
        stiffness = axes.T @ (axes.T @ stiffness.T).T
        rigid = axes.T @ rigid
    free = np.flatnonzero(is_free)
    if len(free) < len(is_free):
        # Motions that no prescribed component feels.
        rigid = rigid @ scipy.linalg.null_space(rigid[~is_free], rcond=1e-9)
    rigid = rigid[free]
    if group.springs is not None:
        rigid = _unresisted(stiffness[np.ix_(free, free)], rigid)
    inverse = symmetric_pseudo_inverse(stiffness[np.ix_(free, free)], rigid)
    return Flexibility(condensed, stiffness, free, inverse, rigid)


class FlexibilityStore:
    """Keeps the flexibilities of one problem for the next one on the same blocks.

    Loads, contact laws and gaps may differ; what the next problem does not need is let go before
    anything new is made.
    """

    def __init__(self) -> None:
        self._kept: dict[bytes, Flexibility] = {}
        self._condensed: dict[bytes, CondensedBlock] = {}

    def keep(self, keys: set[bytes]) -> None:
        """Let go of all others."""
        self._kept = {key: result for key, result in self._kept.items() if key in keys}

    def get(self, key: bytes, make: Callable[[], Flexibility]) -> Flexibility:
        """Return the flexibility of a key, made if there is none."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def condensed(self, group: Body, nodes: IntArray) -> CondensedBlock:
        """Return a block condensed on nodes (n,), sorted, and on those it was before."""
        key = content_of(group)
        before = self._condensed.get(key)
        if before is None or not np.isin(nodes, before.retained).all():
            more = nodes if before is None else np.union1d(before.retained, nodes)
            self._condensed[key] = condense(group, more)
        return self._condensed[key]


def content_of(group: Body) -> bytes:
    """Digest of all of a block that its flexibility depends on."""
    digest = hashlib.sha256()
    for array in (group.mesh.nodes, group.mesh.connectivity):
        digest.update(np.ascontiguousarray(array).tobytes())
    material, springs = group.material, group.springs
    if springs is not None:
        digest.update(springs.element.tobytes() + springs.places.tobytes())
        digest.update(springs.matrices.tobytes())
    digest.update(repr((group.element, material.young_modulus, material.poisson_ratio)).encode())
    return digest.digest()
