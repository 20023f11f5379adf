"""Surfaces of the blocks of an assembly, as the search for facing facets takes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.symmetry import Orbits
from fem.contact.search import BlockSurface, FacingPoints
from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray


def block_surfaces(
    deformable: DeformableAssembly, orbits: Orbits | None = None, copy_of: IntArray | None = None
) -> tuple[BlockSurface, ...]:
    """Collect the facets of all blocks that can touch others, in the order of their groups.

    Parameters
    ----------
    deformable
        Blocks where they stand before any displacement.
    orbits
        Blocks that are computed once; None: every block is computed.
    copy_of
        Copy of its group that moves as each block does, (n_blocks,); None: those of ``deformable``.
    """
    assembly = deformable.assembly
    copies = deformable.copy_of if copy_of is None else copy_of
    turns = _turns(deformable, orbits)
    found = []
    for block in range(assembly.n_blocks):
        if len(assembly.shape(block).contact_quads):
            surface = block_surface(assembly, block, deformable.offsets[block])
            found.append(
                replace(
                    surface,
                    group=int(deformable.group_of[block]),
                    copy=int(max(copies[block], 0)),
                    stands=block if orbits is None else int(orbits.representative[block]),
                    turn=int(turns[block]),
                )
            )
    return tuple(sorted(found, key=lambda surface: surface.group))


def block_surface(assembly: Assembly, block: int, offset: FloatArray) -> BlockSurface:
    """Facets of one block that can touch others, moved by an offset (3,) [mm]; it moves alone."""
    quads = assembly.shape(block).contact_quads
    nodes, local = np.unique(quads, return_inverse=True)
    return BlockSurface(
        block=block,
        group=0,
        copy=block,
        rotation=assembly.rotations[block],
        nodes=nodes,
        reference=(assembly.nodes(block) + offset)[nodes],
        quads=local.reshape(quads.shape).astype(np.int64),
        stands=block,
    )


def _turns(deformable: DeformableAssembly, orbits: Orbits | None) -> IntArray:
    """By how many angles of the sector each block is turned from the one that stands for it."""
    assembly = deformable.assembly
    if orbits is None or orbits.order == 1:
        return np.zeros(assembly.n_blocks, dtype=np.int64)
    relative = assembly.rotations @ np.swapaxes(assembly.rotations[orbits.representative], 1, 2)
    twice_sine = relative - np.swapaxes(relative, 1, 2)
    axis = np.stack([twice_sine[:, 2, 1], twice_sine[:, 0, 2], twice_sine[:, 1, 0]], axis=1)
    sine = 0.5 * axis @ assembly.axis
    cosine = 0.5 * (np.trace(relative, axis1=1, axis2=2) - 1.0)
    angle: FloatArray = np.arctan2(sine, cosine) * orbits.order / (2.0 * np.pi)
    return np.rint(angle).astype(np.int64) % orbits.order


def facing_points(
    deformable: DeformableAssembly,
    displacements: tuple[FloatArray, ...] | None = None,
    orbits: Orbits | None = None,
) -> FacingPoints:
    """Find what faces what in an assembly.

    Parameters
    ----------
    deformable
        Blocks and contact law.
    displacements
        Of its groups, world axes, (n_copies, n_nodes, 3) [mm]; None: before any displacement.
    orbits
        Points are those of one block of each orbit; None: of all blocks.
    """
    reach = -deformable.contact.law.constants.start - deformable.surfaces.clearance
    order = 1 if orbits is None else orbits.order
    points = FacingPoints(block_surfaces(deformable, orbits), reach=reach, symmetry=order)
    if displacements is not None:
        points.displace(displacements)
        points.search()
    return points
