"""Coulomb friction at contacts: which forces are admissible, and what they do to the blocks.

A contact force (λ_n, λ_1, λ_2) is admissible if ‖(λ_1, λ_2)‖ <= μ λ_n, a second-order cone; the
pyramid |λ_1| + |λ_2| <= μ λ_n lies inside it and makes linear programs. Without friction λ_n >= 0
is all that remains.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from geometry.parts.placed import AnyBlocks
from mbd.contacts.jacobian import ContactJacobian, RigidContacts
from mbd.contacts.supports import admissible
from mbd.options import FrictionLaw
from mbd.programs import Cones

#: Coefficients of dry materials stay below 2; beyond this a number is something else.
MOST_FRICTION = 10.0
#: Sides of the pyramid |λ_1| + |λ_2| <= μ λ_n.
TANGENTS = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]], dtype=np.float64)


class RigidFrictionError(RefusedError):
    """A friction coefficient that means nothing."""


@dataclass(frozen=True)
class FrictionalContacts(ReadOnlyArrays):
    """Wrenches of unit normal and tangential forces at each contact."""

    matrix: sp.csc_array
    """(6 n_free, 3 n_contacts), columns (normal, first, second tangent) contact by contact."""
    tangents: FloatArray
    """Unit tangents, (n_contacts, 2, 3)."""
    friction: FloatArray
    """μ of each contact, (n_contacts,)."""
    law: FrictionLaw
    motions: FloatArray | None = None
    """Projectors on the motions that supports leave, (n_free, m, m) for m rows each; None: all."""

    def admissible(self, motion: FloatArray) -> FloatArray:
        """Part of a motion (n_rows,) that supports leave."""
        return admissible(self.motions, motion)

    @property
    def n_contacts(self) -> int:
        """Number of contact points."""
        return len(self.tangents)

    def slip(self, displacement: FloatArray) -> FloatArray:
        """Relative displacement (normal, first, second tangent) at each contact, (n, 3)."""
        return (self.matrix.T @ displacement).reshape(-1, 3)

    def slip_size(self, tangential: FloatArray) -> FloatArray:
        """Return the friction work per μ λ_n of slips along the tangents, (n, 2) to (n,).

        Their length; for the pyramid the larger of the two parts.
        """
        return (
            np.linalg.norm(tangential, axis=1)
            if self.law is FrictionLaw.CONE
            else np.abs(tangential).max(axis=1)
        )

    def shear_size(self, tangential: FloatArray) -> FloatArray:
        """Return the size of tangential forces that the law compares with μ λ_n, (n, 2) to (n,)."""
        return (
            np.linalg.norm(tangential, axis=1)
            if self.law is FrictionLaw.CONE
            else np.abs(tangential).sum(axis=1)
        )

    def dissipated(self, normal: FloatArray, slip: FloatArray, factor: float = 1.0) -> float:
        """Sum of μ λ_n ‖δ_t‖ times a factor, from λ_n and ‖δ_t‖ of the contacts, (n,) each."""
        return factor * float((self.friction * normal) @ slip)

    def sides(self, of_normal: FloatArray, of_shear: FloatArray) -> sp.sparray:
        """Rows μ λ_n · a + (λ_1, λ_2) · b of each contact, for rows a (n,) and b (n, 2)."""
        shear = np.column_stack([np.zeros(len(of_normal)), of_shear])
        normal = np.column_stack([of_normal, np.zeros((len(of_normal), 2))])
        return sp.kron(sp.eye_array(self.n_contacts), shear) + sp.kron(
            sp.diags_array(self.friction), normal
        )

    @property
    def cones(self) -> Cones:
        """Rows R and cones K such that R x in K says that the forces x are admissible."""
        import clarabel

        mu, rows, kinds = self.friction, list[Any](), list[Any]()
        smooth, rough = np.flatnonzero(mu == 0.0), np.flatnonzero(mu > 0.0)
        if len(smooth):
            # A second-order cone of zero width has no interior: λ_1 = λ_2 = 0, λ_n >= 0 instead.
            tangential = np.sort(np.concatenate([3 * smooth + 1, 3 * smooth + 2]))
            order = np.concatenate([tangential, 3 * smooth])
            rows.append(sp.eye_array(3 * len(mu), format="csr")[order])
            kinds += [clarabel.ZeroConeT(2 * len(smooth)), clarabel.NonnegativeConeT(len(smooth))]
        if len(rough) and self.law is FrictionLaw.CONE:
            scale = np.column_stack([mu, np.ones((len(mu), 2))]).ravel()
            rows.append(_some(sp.diags_array(scale), rough, 3))
            kinds += [clarabel.SecondOrderConeT(3)] * len(rough)
        elif len(rough):
            rows.append(_some(self.sides(np.ones(4), TANGENTS), rough, 4))
            kinds.append(clarabel.NonnegativeConeT(4 * len(rough)))
        return Cones(sp.vstack(rows) if rows else sp.csc_array((0, 0)), kinds)

    def smallest_work(self, displacement: FloatArray) -> FloatArray:
        """Return the least work of an admissible force with λ_n = 1 at each contact, (n,)."""
        relative = self.slip(displacement)
        return relative[:, 0] - self.friction * self.slip_size(relative[:, 1:])

    def world(self, forces: FloatArray, normals: FloatArray) -> FloatArray:
        """Forces (normal, first, second tangent) as vectors on block s, (n_contacts, 3) [N].

        ``normals`` are those of the contacts, (n_contacts, 3).
        """
        tangential: FloatArray = np.einsum("nk,nki->ni", forces[:, 1:], self.tangents)
        return forces[:, :1] * normals + tangential

    def projected(self, forces: FloatArray) -> FloatArray:
        """Nearest admissible forces along the tangents, (n, 3): the return to Coulomb's law."""
        normal, trial = np.maximum(forces[:, 0], 0.0), forces[:, 1:]
        return np.column_stack([normal, trial * self._share(normal, trial)[:, None]])

    def _share(self, normal: FloatArray, trial: FloatArray) -> FloatArray:
        """Part of tangential forces (n, 2) that normal forces (n,) admit, at most 1; (n,)."""
        size, limit = self.shear_size(trial), self.friction * normal
        return np.where(size > limit, limit / np.maximum(size, 1e-300), 1.0)

    def returned_by(self, forces: FloatArray) -> FloatArray:
        """Derivative of `projected` by the forces, (n, 3) to (n, 3, 3)."""
        trial, mu = forces[:, 1:], self.friction
        share = self._share(np.maximum(forces[:, 0], 0.0), trial)
        way = (share < 1.0)[:, None] * trial / np.maximum(self.shear_size(trial), 1e-300)[:, None]
        along = way if self.law is FrictionLaw.CONE else np.sign(trial)
        slope = np.zeros((len(mu), 3, 3))
        slope[:, 0, 0] = 1.0
        slope[:, 1:, 0] = mu[:, None] * way
        slope[:, 1:, 1:] = share[:, None, None] * (np.eye(2) - way[:, :, None] * along[:, None])
        return slope * (forces[:, 0] > 0.0)[:, None, None]


def check_coefficients(friction: FloatArray) -> None:
    """Reject coefficients of friction that no joint has."""
    wrong = friction[~(np.isfinite(friction) & (friction >= 0.0))]
    if wrong.size:
        raise RigidFrictionError(f"friction: got {wrong[0]}, expected 0 or a positive number")
    most = float(friction.max(initial=0.0))
    if most > MOST_FRICTION:
        raise RigidFrictionError(
            f"friction: got {most:g}, expected a coefficient up to {MOST_FRICTION:g}; an "
            "angle of friction φ is given as its tangent: 30° is 0.577"
        )


def smooth_contacts(jacobian: ContactJacobian) -> FrictionalContacts:
    """Contacts without friction, whose tangents do nothing."""
    n = jacobian.shape[1]
    columns = sp.csc_array((np.ones(n), (np.arange(n), 3 * np.arange(n))), shape=(n, 3 * n))
    matrix = sp.csc_array(jacobian.to_matrix() @ columns)
    return FrictionalContacts(
        matrix, np.zeros((n, 2, 3)), np.zeros(n), FrictionLaw.CONE, jacobian.motions
    )


def frictional_contacts(
    assembly: AnyBlocks,
    contacts: RigidContacts,
    friction: float | FloatArray,
    law: FrictionLaw = FrictionLaw.CONE,
) -> FrictionalContacts:
    """Assemble the wrenches of normal and tangential contact forces.

    Friction is that of all contacts, or of each one, (n_contacts,).
    """
    check_coefficients(np.atleast_1d(friction))
    normals = assembly.interfaces.normals[contacts.index]
    # Rounded: joints that mirror each other have mirrored tangents where two axes are as far.
    axis = np.eye(3)[np.abs(normals).round(6).argmin(axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    tangents = np.stack([first, second], axis=1)
    matrix = _wrenches(assembly, contacts, np.concatenate([normals[:, None], tangents], axis=1))
    motions = contacts.jacobian.motions
    if motions is not None:
        matrix = sp.block_diag([sp.csc_array(each) for each in motions], format="csc") @ matrix
        matrix.eliminate_zeros()
    mu = np.broadcast_to(np.asarray(friction, dtype=np.float64), len(normals))
    return FrictionalContacts(matrix, tangents, mu, law, motions)


def _wrenches(assembly: AnyBlocks, contacts: RigidContacts, directions: FloatArray) -> sp.csc_array:
    """Wrenches (F, M/ℓ) of unit forces along directions (n, 3, 3) on s, and opposite ones on m."""
    free, places = contacts.free_blocks, np.arange(directions[..., 0].size).reshape(-1, 3)
    number = np.full(assembly.n_blocks, -1, dtype=np.int64)
    number[free] = np.arange(len(free))
    points, parts = assembly.interfaces.centroids[contacts.index], []
    for block, sign in ((contacts.block_m, -1.0), (contacts.block_s, 1.0)):
        moves = np.flatnonzero(number[block] >= 0)
        arm, along = (points - assembly.centroids[block])[moves, None], directions[moves]
        wrench = sign * np.concatenate([along, np.cross(arm, along) / contacts.length], axis=2)
        rows = 6 * number[block[moves], None, None] + np.arange(6)
        columns = places[moves, :, None]
        parts.append([np.broadcast_to(v, wrench.shape).ravel() for v in (wrench, rows, columns)])
    values, rows, columns = (np.concatenate(part) for part in zip(*parts, strict=True))
    shape = 6 * len(free), places.size
    return sp.coo_array((values, (rows, columns)), shape=shape).tocsc()


def _some(rows: Any, contacts: IntArray, each: int) -> Any:
    """Rows of some contacts, ``each`` of every one."""
    if len(contacts) * each == rows.shape[0]:
        return rows
    return rows.tocsr()[(each * contacts[:, None] + np.arange(each)).ravel()]
