"""The explosion of a tube: all blocks, the frame included, move radially outward at once.

Each block is translated along the direction from the tube axis to its mass centroid, all by the
same distance, without turning (the paper's "explosion of a tubular interlocking").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly, AssemblyError
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.overlap import Overlap, find_overlaps

#: Halvings between the last free and the first blocked step.
_BISECTIONS = 6


def outward_directions(assembly: Assembly) -> FloatArray:
    """Unit vector from the tube axis to each block's centroid, (n_blocks, 3).

    Raises
    ------
    AssemblyError
        When a block is centred on the axis: outward means nothing there.
    """
    arm = assembly.centroids - assembly.origin
    arm = arm - np.outer(arm @ assembly.axis, assembly.axis)
    length = np.linalg.norm(arm, axis=1, keepdims=True)
    if assembly.unmatched_allowed or (length < 1e-6 * assembly.characteristic_length).any():
        raise AssemblyError(
            f"{assembly.name}: is not a tube round an axis; expected blocks that all lie off the "
            "axis to move outward"
        )
    return arm / length


@dataclass(frozen=True)
class FiniteExplosion:
    """How the explosion goes on beyond first order."""

    distances: FloatArray
    """Outward displacement of every block, growing, (n_steps,) [mm]."""
    depths: FloatArray
    """How deep blocks are in each other there, (n_steps,) [mm]."""
    free_distance: float
    """Largest displacement up to which nothing is deeper than `tolerance` [mm]."""
    tolerance: float
    """Depth that counts as touching [mm]."""
    first_overlap: Overlap | None
    """Deepest overlap at the first step beyond; None if the last step is still free."""


def follow_explosion(
    surfaces: PolyhedralAssembly,
    directions: FloatArray,
    distances: FloatArray,
    tolerance: float,
) -> FiniteExplosion:
    """Move the blocks outward step by step and look how deep they are in each other.

    Parameters
    ----------
    surfaces
        The tube's blocks as closed surfaces.
    directions
        Of `outward_directions`, (n_blocks, 3).
    distances
        Displacements to look at, growing from above zero, (n_steps,) [mm].
    tolerance
        Depth that counts as touching [mm].
    """

    def deepest(distance: float) -> Overlap | None:
        overlaps = find_overlaps(
            surfaces.shapes,
            surfaces.shape_of,
            surfaces.rotations,
            surfaces.translations + distance * directions,
            1e-9 * surfaces.characteristic_length,
        )
        return overlaps[0] if overlaps else None

    depths = np.zeros(len(distances))
    first: Overlap | None = None
    free, blocked = 0.0, np.inf
    for step, distance in enumerate(distances.tolist()):
        overlap = deepest(distance)
        depths[step] = 0.0 if overlap is None else overlap.depth
        if depths[step] > tolerance and first is None:
            first, blocked = overlap, distance
        if first is None:
            free = distance
    for _ in range(_BISECTIONS if np.isfinite(blocked) else 0):
        middle = 0.5 * (free + blocked)
        overlap = deepest(middle)
        if overlap is not None and overlap.depth > tolerance:
            blocked = middle
        else:
            free = middle
    return FiniteExplosion(distances, depths, free, tolerance, first)
