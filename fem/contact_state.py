"""Contact of a finished run: overclosures and pressures at every point of contact."""

from __future__ import annotations

import numpy as np

from fem.contact import point_kinematics
from fem.deformable_assembly import DeformableAssembly
from geometry.mesh import FloatArray, IntArray


def corner_displacements(
    deformable: DeformableAssembly, displacements: tuple[FloatArray, ...]
) -> FloatArray:
    """World displacements of the eight corners of every facet pair, m's four first.

    Parameters
    ----------
    deformable
        Blocks and surfaces; rigid blocks do not move.
    displacements
        Of each group, (n_copies, n_nodes, 3) [mm], world axes.

    Returns
    -------
    FloatArray
        (n_facets, 8, 3) [mm].
    """
    surfaces = deformable.surfaces
    moved = np.zeros((surfaces.n_facets, 8, 3))
    for half, (block, quads) in enumerate(
        ((surfaces.block_m, surfaces.quads_m), (surfaces.block_s, surfaces.quads_s))
    ):
        corners = slice(4 * half, 4 * half + 4)
        for group, u in enumerate(displacements):
            rows: IntArray = np.flatnonzero(deformable.group_of[block] == group)
            copies = deformable.copy_of[block[rows]]
            moved[rows, corners] = u[copies[:, None], quads[rows]]
    return moved


def contact_state(
    deformable: DeformableAssembly, displacements: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """Contact pressures and overclosures of a displacement.

    Returns
    -------
    FloatArray
        Pressures at the points of `DeformableAssembly.surfaces`, (n_facets, 4) [MPa].
    FloatArray
        Overclosures, (n_facets, 4) [mm].
    """
    corners = corner_displacements(deformable, displacements)
    found = point_kinematics(deformable.surfaces, corners, deformable.contact.normals)
    return deformable.contact.law.pressure(found.overclosure), found.overclosure
