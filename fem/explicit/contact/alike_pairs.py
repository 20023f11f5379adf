"""Contact interfaces as the explicit solver lays them out: alike pairs of blocks in SIMD lanes.

Two pairs of blocks are alike when the shapes, the facets that meet and the relative placement
are the same; in a tube nearly all are. Alike pairs share connectivity and reference geometry
and differ only in which copies of the bodies they join, so they are lanes of one computation,
done in the placement frame of the master block.

Facets conform, so their corners come as pairs of nodes, one of each block, and all that contact
needs is the difference and the mean of the two positions at each *node pair*.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fem.element.functions import FACET_SLOPES
from fem.explicit.kernels.lanes import REGISTER_DOUBLES
from fem.system.system import Sector
from geometry.interface import SAME_PLACEMENT
from geometry.mesh import FloatArray, IntArray

#: Pairs of blocks that are worked on together: entries of a register (a facet needs dozens).
WIDTHS = tuple(sorted({1, 4, REGISTER_DOUBLES}))
WIDEST = WIDTHS[-1]


@dataclass(frozen=True)
class AlikePairs:
    """Pairs of blocks that meet in the same way."""

    bodies: tuple[int, int]
    """Body of master and opposing block; -1 for a rigid one."""
    copies: IntArray
    """Copies of those bodies in each pair, 0 for rigid blocks; (n_pairs, 2)."""
    blocks: IntArray
    """Blocks of the assembly in each pair, (n_pairs, 2)."""
    nodes: IntArray
    """Mesh nodes of master and opposing block in each node pair, (n_nodes, 2)."""
    corners: IntArray
    """Node pairs at the corners of each facet, counter-clockwise from outside the master."""
    offset: FloatArray
    """x_s - x_m of each node pair before any displacement, master frame, (n_nodes, 3) [mm]."""
    mean: FloatArray
    """(x_m + x_s)/2 before any displacement, master frame, (n_nodes, 3) [mm]."""
    rotation: FloatArray
    """From the frame of the opposing block to that of the master, (3, 3)."""
    weights: FloatArray
    """Area of each Gauss point, (n_facets, 4) [mm²]."""
    facets: IntArray
    """Which of the matched facets that are computed each one is, (n_pairs, n_facets)."""
    begins: IntArray
    """Which of its corners each corner is there, (n_pairs, n_facets, 4)."""

    @property
    def n_pairs(self) -> int:
        """Number of pairs of blocks."""
        return len(self.copies)

    @property
    def n_facets(self) -> int:
        """Facets of one pair."""
        return len(self.corners)

    def area_vectors(self) -> FloatArray:
        """t_1 × t_2 at the Gauss points before any displacement, (n_facets, 4, 3) [mm²]."""
        tangents = np.einsum("pak,fai->fpki", FACET_SLOPES, self.mean[self.corners])
        return np.cross(tangents[:, :, 0], tangents[:, :, 1])


@dataclass(frozen=True)
class _Pair:
    """One pair of blocks, its facets in an order that alike pairs share."""

    blocks: tuple[int, int]
    facets: IntArray
    begins: IntArray
    quads: IntArray
    """Nodes of both sides in the meshes of the representatives, (n_facets, 2, 4)."""
    share: FloatArray
    key: tuple[int | float | bytes, ...]
    """Shapes, bodies, friction, law and connectivity."""
    rotation: FloatArray
    """From the frame of block s to that of block m, (3, 3)."""
    translation: FloatArray
    """The same, (3,) [mm]."""

    def like(self, other: _Pair, size: float) -> bool:
        """Whether both are placed alike, in blocks of a size [mm]."""
        near = float(np.abs(self.translation - other.translation).max()) <= SAME_PLACEMENT * size
        return near and float(np.abs(self.rotation - other.rotation).max()) <= SAME_PLACEMENT


def _kind(system: Sector, m: int, s: int) -> tuple[float, int]:
    """Coefficient of friction between two blocks, and the place of their law among all laws."""
    contact, joint = system.whole.contact, (np.array([m]), np.array([s]))
    friction = 0.0 if contact.friction is None else contact.friction.on(*joint)
    return float(np.ravel(friction)[0]), contact.law.members.index(contact.law.on(*joint))


def _seen(
    system: Sector,
    facets: IntArray,
    *,
    swapped: bool,
) -> _Pair:
    """Facets of a pair of blocks, sorted, each beginning with its smallest master node.

    Contact favours neither side: with the blocks ``swapped`` it is the same, but seen from the
    other one corners run the other way round.
    """
    points, (frames, origins, alike) = system.points, system.frames
    corners = np.array([0, 3, 2, 1] if swapped else [0, 1, 2, 3])
    sides = [(points.block_m[facets], points.quads_m), (points.block_s[facets], points.quads_s)]
    sides = sides[::-1] if swapped else sides
    m, s = (int(blocks[0]) for blocks, _ in sides)
    both = [alike[blocks[:, None], quads[facets][:, corners]] for blocks, quads in sides]
    turn = (both[0].argmin(axis=1)[:, None] + np.arange(4)) % 4
    quads = np.stack([np.take_along_axis(of, turn, axis=1) for of in both], axis=1)
    order = np.lexsort(quads[:, 0].T[::-1])
    facets, quads = facets[order], quads[order]
    share = np.broadcast_to(system.orbits.share, (points.n_facets, 1))[facets, 0]
    shapes = (int(system.whole.assembly.shape_of[b]) for b in (m, s))
    bodies = (int(system.whole.body_number[b]) for b in (m, s))
    parts = (quads[:, 0].tobytes(), quads[:, 1].tobytes(), share.tobytes())
    return _Pair(
        blocks=(m, s),
        facets=facets,
        begins=corners[turn][order],
        quads=quads,
        share=share,
        key=(*shapes, *bodies, *_kind(system, m, s), *parts),
        rotation=frames[m].T @ frames[s],
        translation=frames[m].T @ (origins[s] - origins[m]),
    )


def alike_pairs(system: Sector, copy_of: IntArray) -> tuple[AlikePairs, ...]:
    """Sort the matched facets of an assembly into alike pairs.

    Parameters
    ----------
    system
        Facets that are computed, one of each orbit.
    copy_of
        Copy that carries the unknowns of each block, its representative's; (n_blocks,).
    """
    size = system.whole.assembly.characteristic_length
    result: dict[tuple[int | float | bytes, ...], list[list[_Pair]]] = {}
    for first, last in pairwise(system.points.pair_start.tolist()):
        facets = np.arange(first, last)
        ways = (_seen(system, facets, swapped=swapped) for swapped in (False, True))
        pair = min(ways, key=lambda way: way.key)
        alike = result.setdefault(pair.key, [])
        for others in alike:
            if others[0].like(pair, size):
                others.append(pair)
                break
        else:
            alike.append([pair])
    return tuple(_join(system, pairs, copy_of) for alike in result.values() for pairs in alike)


def _join(system: Sector, pairs: list[_Pair], copy_of: IntArray) -> AlikePairs:
    """Gather alike pairs; the reference geometry is that of the first."""
    copies = np.maximum(copy_of[np.array([pair.blocks for pair in pairs])], 0)
    pairs = [pairs[k] for k in np.lexsort((copies[:, 1], copies[:, 0])).tolist()]
    first = pairs[0]
    both = first.quads.transpose(0, 2, 1).reshape(-1, 2)
    nodes, corner = np.unique(both, axis=0, return_inverse=True)
    m, s = first.blocks
    x_m = system.whole.assembly.shape(m).mesh.nodes[nodes[:, 0]]
    x_s = system.whole.assembly.shape(s).mesh.nodes[nodes[:, 1]]
    x_s = x_s @ first.rotation.T + first.translation
    blocks = np.array([pair.blocks for pair in pairs], dtype=np.int64)
    return AlikePairs(
        bodies=(int(system.whole.body_number[m]), int(system.whole.body_number[s])),
        copies=np.maximum(copy_of[blocks], 0),
        blocks=blocks,
        nodes=nodes.astype(np.int64),
        corners=corner.reshape(-1, 4).astype(np.int64),
        offset=x_s - x_m,
        mean=0.5 * (x_m + x_s),
        rotation=first.rotation,
        weights=np.take_along_axis(system.points.weights[first.facets], first.begins, axis=1),
        facets=np.array([pair.facets for pair in pairs]),
        begins=np.array([pair.begins for pair in pairs]),
    )


def unit_widths(n_pairs: int) -> list[int]:
    """Split pairs into the widest vectors, and one of the width that holds the rest."""
    full, rest = divmod(n_pairs, WIDEST)
    widths = [WIDEST] * full
    if rest:
        widths.append(next(w for w in WIDTHS if w >= rest))
    return widths
