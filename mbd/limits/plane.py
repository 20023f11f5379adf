"""Contacts and loads of an analysis with friction, in the plane where it is plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from geometry.mesh import FloatArray, IntArray
from geometry.parts.placed import AnyBlocks
from mbd.contacts.friction import FrictionalContacts
from mbd.contacts.jacobian import RigidContacts
from mbd.options import FrictionLaw

#: Out-of-plane parts below this fraction are round-off of vertices and normals.
_FLAT = 1e-9


@dataclass(frozen=True)
class Reduced:
    """Half the contacts, half the unknowns where a problem is plane; else all of them.

    Walls and arches of one block's depth have each contact twice, on either face. If nothing acts
    out of the plane, the mean of an admissible state and its mirror image is one in the plane, so
    nothing is lost by contacts on one face that carry the forces of both, and blocks that move in
    the plane.
    """

    contacts: FrictionalContacts
    """Three rows for each free block in a plane: two forces and a couple."""
    rows: IntArray
    """Rows of the problem in space that are kept, (n,)."""
    kept: IntArray
    """Contacts of the problem in space that are kept, (n,)."""
    behind: FloatArray | None = None
    """From the face of these contacts to the other one, (3,) [mm]; None in space."""

    @property
    def has_cones(self) -> bool:
        """Whether admissible forces fill round cones; in a plane they lie between two edges."""
        return self.behind is None and self.contacts.law is FrictionLaw.CONE

    def motion(self, motion: FloatArray, n_rows: int) -> FloatArray:
        """Rows in space of a motion of these rows."""
        result = np.zeros(n_rows)
        result[self.rows] = motion
        return result


def reduced(
    blocks: AnyBlocks,
    contacts: RigidContacts,
    frictional: FrictionalContacts,
    *loads: FloatArray,
) -> Reduced:
    """Contacts in the plane in which blocks and loads (n_rows,) lie, or all contacts in space."""
    for axis in range(3):
        plane = _in_plane(blocks, contacts, frictional, axis)
        if plane is not None and all(
            np.abs(np.delete(load, plane.rows)).max(initial=0.0)
            <= _FLAT * np.abs(load).max(initial=0.0)
            for load in loads
        ):
            return plane
    return in_space(frictional)


def in_space(frictional: FrictionalContacts) -> Reduced:
    """All contacts and rows."""
    n_rows, _ = frictional.matrix.shape
    return Reduced(frictional, np.arange(n_rows), np.arange(frictional.n_contacts))


def _in_plane(
    blocks: AnyBlocks, contacts: RigidContacts, frictional: FrictionalContacts, axis: int
) -> Reduced | None:
    """Contacts on one face in the plane normal to x, y or z; None where the other has others."""
    keep = np.sort([(axis + 1) % 3, (axis + 2) % 3, 3 + axis])
    points = blocks.interfaces.centroids[contacts.index]
    normals = blocks.interfaces.normals[contacts.index]
    height, size = points[:, axis], float(np.ptp(points, axis=0).max(initial=0.0))
    front = height < height.mean() if size else np.zeros(0, np.bool_)
    if 2 * int(front.sum()) != len(front) or not front.any():
        return None
    faces = height[front].mean(), height[~front].mean()
    middles = blocks.centroids[contacts.free_blocks, axis]
    flat = np.abs(height - np.where(front, *faces)).max(), np.abs(middles - np.mean(faces)).max()
    if max(flat) > _FLAT * size or np.abs(normals[:, axis]).max() > _FLAT:
        return None
    # The same contacts of the same joint on either face: only then are states mirrored.
    places = np.column_stack([points[:, keep[:2]] / size, normals, contacts.joints[1]])
    one, other = KDTree(places[front]), KDTree(places[~front])
    if max(one.query(other.data)[0].max(), other.query(one.data)[0].max()) > _FLAT:
        return None
    motions = frictional.motions
    if motions is not None:
        if np.abs(np.delete(motions[:, keep], keep, axis=2)).max() > _FLAT:
            return None
        motions = motions[:, keep][:, :, keep]
    rows = (6 * np.arange(len(contacts.free_blocks))[:, None] + keep).ravel()
    kept = np.flatnonzero(front)
    columns = (3 * kept[:, None] + np.arange(3)).ravel()
    flat_contacts = replace(
        frictional,
        matrix=sp.csc_array(sp.csr_array(frictional.matrix)[rows].tocsc()[:, columns]),
        tangents=frictional.tangents[kept],
        friction=frictional.friction[kept],
        motions=motions,
    )
    return Reduced(flat_contacts, rows, kept, np.eye(3)[axis] * (faces[1] - faces[0]))
