"""How far blocks slide along each other: where facets stay paired, an answer has an end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fem.assembly.contact_state import corner_displacements
from fem.assembly.deformable import DeformableAssembly
from geometry.mesh import FloatArray


def largest_slip(
    deformable: DeformableAssembly, displacements: Sequence[FloatArray], pressures: FloatArray
) -> tuple[float, float]:
    """Largest slip between facets that press on each other, and the size of its facet [mm].

    Parameters
    ----------
    deformable
        The blocks; their contact pairs facets as built.
    displacements
        Of each group, (n_copies, n_nodes, 3) [mm].
    pressures
        Of each facet, (n_facets,) [MPa].
    """
    surfaces = deformable.surfaces
    on_m, on_s = np.split(corner_displacements(deformable, tuple(displacements)), 2, axis=1)
    jump: FloatArray = on_s - on_m
    normal = surfaces.normals.mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    along = np.einsum("fai,fi->fa", jump, normal)
    slip = np.linalg.norm(jump - along[:, :, None] * normal[:, None], axis=2).max(axis=1)
    size = np.sqrt(surfaces.areas)
    pressing = pressures > 0.0
    worst = int(np.argmax(np.where(pressing, slip / size, 0.0)))
    return float(slip[worst]) if pressing.any() else 0.0, float(size[worst])
