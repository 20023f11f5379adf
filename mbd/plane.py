"""Plane problems out of blocks with two flat faces: half the contacts, half the unknowns.

Walls and arches of one block's depth have each contact twice, on either face. If nothing acts out
of the plane, the mean of an admissible state and its mirror image is one in the plane, so nothing
is lost by contacts on one face that carry the forces of both, and blocks that move in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geometry.mesh import FloatArray, IntArray
from geometry.placed_blocks import AnyBlocks
from mbd.contact_jacobian import Contacts
from mbd.friction import FrictionalContacts, FrictionError

#: Out-of-plane parts below this fraction are round-off of vertices and normals.
_FLAT = 1e-9


@dataclass(frozen=True)
class PlaneProblem:
    """Contacts of one face and the generalized forces in the plane."""

    contacts: FrictionalContacts
    """Three rows for each free block: two forces and a couple."""
    rows: IntArray
    """Rows of the problem in space that are kept, (3 n_free,)."""
    kept: IntArray
    """Contacts of the problem in space that are kept, (n,)."""

    def load(self, load: FloatArray) -> FloatArray:
        """Rows in the plane of a generalized force in space.

        Raises
        ------
        FrictionError
            When it acts out of the plane.
        """
        outside = np.delete(load, self.rows)
        if np.abs(outside).max(initial=0.0) > _FLAT * np.abs(load).max(initial=0.0):
            raise FrictionError("plane problem: the load acts out of the plane")
        return load[self.rows]


def plane_problem(
    assembly: AnyBlocks, contacts: Contacts, frictional: FrictionalContacts, axis: int
) -> PlaneProblem:
    """Reduce to the plane normal to a coordinate axis.

    Parameters
    ----------
    assembly, contacts, frictional
        Blocks, contacts and their wrenches in space.
    axis
        0, 1 or 2: x, y or z, out of the plane.

    Raises
    ------
    FrictionError
        When normals lean out of the plane or contacts do not lie on two faces, one for one.
    """
    points = assembly.interfaces.centroids[contacts.index]
    normals = assembly.interfaces.normals[contacts.index]
    height = points[:, axis]
    front = height < height.mean()
    size = float(np.ptp(points, axis=0).max())
    flat = np.ptp(height[front]) <= _FLAT * size and np.ptp(height[~front]) <= _FLAT * size
    paired = 2 * int(front.sum()) == len(front)
    if not (flat and paired and np.abs(normals[:, axis]).max() <= _FLAT):
        raise FrictionError(
            "plane problem: expected contacts on two flat faces, one behind the other, with "
            "normals in the plane"
        )
    first, second = (axis + 1) % 3, (axis + 2) % 3
    keep = np.sort([first, second, 3 + axis])
    rows = (6 * np.arange(len(contacts.free_blocks))[:, None] + keep).ravel()
    kept = np.flatnonzero(front)
    columns = (3 * kept[:, None] + np.arange(3)).ravel()
    matrix = sp.csc_array(sp.csr_array(frictional.matrix)[rows].tocsc()[:, columns])
    reduced = replace(frictional, matrix=matrix, tangents=frictional.tangents[kept])
    return PlaneProblem(reduced, rows, kept)
