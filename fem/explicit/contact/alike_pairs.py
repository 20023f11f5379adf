"""Contact interfaces as the explicit solver lays them out: alike pairs of blocks in SIMD lanes.

Two pairs of blocks are alike when the shapes, the facets that meet and the relative placement
are the same; in a tube nearly all are. Alike pairs share connectivity and reference geometry
and differ only in which copies of the groups they join, so they are lanes of one computation,
done in the placement frame of the master block.

Facets conform, so their corners come as pairs of nodes, one of each block, and all that contact
needs is the difference and the mean of the two positions at each *node pair*.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem.element.facet import FACET_SLOPES, FACET_VALUES
from fem.explicit.kernels.lanes import REGISTER_DOUBLES
from fem.system.build import DeformableAssembly
from fem.system.sector import Orbits
from geometry.mesh import FloatArray, IntArray

#: Placements (in block sizes and as rotations) that differ by less are the same.
_SAME_PLACEMENT = 1e-9

#: Pairs of blocks that are worked on together: entries of a register (a facet needs dozens).
WIDTHS = tuple(sorted({1, 4, REGISTER_DOUBLES}))
WIDEST = WIDTHS[-1]


@dataclass(frozen=True)
class AlikePairs:
    """Pairs of blocks that meet in the same way."""

    groups: tuple[int, int]
    """Group of master and opposing block; -1 for a rigid one."""
    copies: IntArray
    """Copies of those groups in each pair, 0 for rigid blocks; (n_pairs, 2)."""
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

    def initial_gaps(self) -> FloatArray:
        """Gap at the Gauss points before any displacement, (n_facets, 4) [mm]."""
        vectors = self.area_vectors()
        normals = vectors / np.linalg.norm(vectors, axis=2, keepdims=True)
        offset = np.einsum("pa,fai->fpi", FACET_VALUES, self.offset[self.corners])
        return np.einsum("fpi,fpi->fp", normals, offset)


@dataclass(frozen=True)
class _Pair:
    """One pair of blocks, its facets in an order that alike pairs share."""

    blocks: tuple[int, int]
    quads_m: IntArray
    quads_s: IntArray

    def key(self, deformable: DeformableAssembly) -> tuple[int | float | bytes, ...]:
        """Shapes, groups, friction, law and connectivity."""
        shapes = [int(deformable.assembly.shape_of[b]) for b in self.blocks]
        groups = [int(deformable.group_of[b]) for b in self.blocks]
        rubs = friction_of(deformable, *self.blocks)
        law = law_of(deformable, *self.blocks)
        return (*shapes, *groups, rubs, law, self.quads_m.tobytes(), self.quads_s.tobytes())


def law_of(deformable: DeformableAssembly, m: int, s: int) -> int:
    """Place of the contact law between two blocks among all laws."""
    law = deformable.contact.law
    return law.members.index(law.on(np.array([m]), np.array([s])))


def friction_of(deformable: DeformableAssembly, m: int, s: int) -> float:
    """Coefficient of friction between two blocks; 0 without friction."""
    friction = deformable.contact.friction
    if friction is None or not friction.of_pairs:
        return 0.0 if friction is None else friction.coefficient
    return float(np.asarray(friction.on(np.array([m]), np.array([s])))[0])


def _ordered(m: int, s: int, quads_m: IntArray, quads_s: IntArray) -> _Pair:
    """Facets sorted, each beginning with its smallest master node."""
    first = quads_m.argmin(axis=1)
    turn = (first[:, None] + np.arange(4)) % 4
    turned_m = np.take_along_axis(quads_m, turn, axis=1)
    turned_s = np.take_along_axis(quads_s, turn, axis=1)
    order = np.lexsort(turned_m.T[::-1])
    return _Pair((m, s), turned_m[order], turned_s[order])


def _either_way(m: int, s: int, quads_m: IntArray, quads_s: IntArray) -> tuple[_Pair, _Pair]:
    """Return the pair and the same with master and opposing block exchanged.

    Contact favours neither side, so both mean the same; seen from the other block the corners
    run the other way round.
    """
    backwards = [0, 3, 2, 1]
    return (
        _ordered(m, s, quads_m, quads_s),
        _ordered(s, m, quads_s[:, backwards], quads_m[:, backwards]),
    )


def alike_pairs(
    deformable: DeformableAssembly, orbits: Orbits, copy_of: IntArray
) -> tuple[AlikePairs, ...]:
    """Sort the contact interfaces of an assembly into alike pairs.

    Parameters
    ----------
    deformable
        Blocks and matched facets.
    orbits
        Blocks that are computed once; facets of each orbit are integrated once.
    copy_of
        Copy that carries the unknowns of each block, its representative's; (n_blocks,).
    """
    surfaces = deformable.surfaces.subset(orbits.facets)
    result: dict[tuple[int | float | bytes, ...], list[list[_Pair]]] = {}
    for k in range(len(surfaces.pair_start) - 1):
        facets = slice(int(surfaces.pair_start[k]), int(surfaces.pair_start[k + 1]))
        m, s = int(surfaces.block_m[facets.start]), int(surfaces.block_s[facets.start])
        ways = _either_way(m, s, surfaces.quads_m[facets], surfaces.quads_s[facets])
        pair = min(ways, key=lambda p: p.key(deformable))
        alike = result.setdefault(pair.key(deformable), [])
        for others in alike:
            if _same_placement(deformable, others[0], pair):
                others.append(pair)
                break
        else:
            alike.append([pair])
    return tuple(_join(deformable, pairs, copy_of) for alike in result.values() for pairs in alike)


def _relative_placement(
    deformable: DeformableAssembly, pair: _Pair
) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation from the frame of block s to that of block m."""
    assembly = deformable.assembly
    m, s = pair.blocks
    to_master = assembly.rotations[m].T
    place = assembly.translations + deformable.offsets
    return to_master @ assembly.rotations[s], to_master @ (place[s] - place[m])


def _same_placement(deformable: DeformableAssembly, a: _Pair, b: _Pair) -> bool:
    turn_a, move_a = _relative_placement(deformable, a)
    turn_b, move_b = _relative_placement(deformable, b)
    size = deformable.assembly.characteristic_length
    near = float(np.abs(move_a - move_b).max()) <= _SAME_PLACEMENT * size
    return near and float(np.abs(turn_a - turn_b).max()) <= _SAME_PLACEMENT


def _join(deformable: DeformableAssembly, pairs: list[_Pair], copy_of: IntArray) -> AlikePairs:
    """Gather alike pairs; the reference geometry is that of the first."""
    blocks = np.array([pair.blocks for pair in pairs], dtype=np.int64)
    copies = np.maximum(copy_of[blocks], 0)
    order = np.lexsort((copies[:, 1], copies[:, 0]))
    first = pairs[int(order[0])]
    both = np.stack([first.quads_m.ravel(), first.quads_s.ravel()], axis=1)
    nodes, corner = np.unique(both, axis=0, return_inverse=True)
    rotation, translation = _relative_placement(deformable, first)
    shape_m, shape_s = (deformable.assembly.shape(b) for b in first.blocks)
    x_m = shape_m.mesh.nodes[nodes[:, 0]]
    x_s = shape_s.mesh.nodes[nodes[:, 1]] @ rotation.T + translation
    m, s = first.blocks
    return AlikePairs(
        groups=(int(deformable.group_of[m]), int(deformable.group_of[s])),
        copies=copies[order],
        blocks=blocks[order],
        nodes=nodes.astype(np.int64),
        corners=corner.reshape(-1, 4).astype(np.int64),
        offset=x_s - x_m,
        mean=0.5 * (x_m + x_s),
        rotation=rotation,
    )


def unit_widths(n_pairs: int) -> list[int]:
    """Split pairs into the widest vectors, and one of the width that holds the rest."""
    full, rest = divmod(n_pairs, WIDEST)
    widths = [WIDEST] * full
    if rest:
        widths.append(next(w for w in WIDTHS if w >= rest))
    return widths
