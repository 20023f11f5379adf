"""Contact facets of an assembly as surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray, QuadSurface

if TYPE_CHECKING:
    import pyvista as pv


def interface_surface(assembly: Assembly, contacts: IntArray | None = None) -> QuadSurface:
    """Contact facets in world coordinates, four nodes of their own each.

    ``contacts`` are positions in `assembly.interfaces`; all by default.
    """
    interfaces = assembly.interfaces
    chosen = np.arange(interfaces.n_contacts) if contacts is None else contacts
    block, quads = interfaces.block_m[chosen], interfaces.quads_m[chosen]
    corners = np.empty((len(chosen), 4, 3))
    for number in np.unique(assembly.shape_of[block]):
        rows = np.flatnonzero(assembly.shape_of[block] == number)
        local = assembly.shapes[number].mesh.nodes[quads[rows]]
        turned = np.einsum("fij,fcj->fci", assembly.rotations[block[rows]], local)
        corners[rows] = turned + assembly.translations[block[rows], None, :]
    return QuadSurface(corners.reshape(-1, 3), np.arange(4 * len(chosen)).reshape(-1, 4))


def contact_mesh(
    assembly: Assembly, contacts: IntArray | None = None, **values: FloatArray
) -> pv.PolyData:
    """Contact facets as a mesh that pyvista draws.

    Parameters
    ----------
    assembly
        Blocks and their interfaces.
    contacts
        Positions in `assembly.interfaces`, such as `mbd.RigidResult.contact_index`; all by default.
    **values
        One value for each contact, such as ``pressure``, by the name that the mesh gives it.
    """
    import pyvista as pv

    surface = interface_surface(assembly, contacts)
    mesh = pv.PolyData.from_regular_faces(surface.nodes, surface.quads)
    for name, value in values.items():
        mesh.cell_data[name] = value
    return mesh
