"""A tree of boxes along a space-filling curve: which of them others overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.mesh import FloatArray, IntArray, along_curve
from geometry.polyhedra.near.triangle_kernels import DEEPEST, boxes_in_tree

#: Pairs that there is room for at first, for each box.
_ROOM = 16


@dataclass(frozen=True)
class BoxTree:
    """Axis-parallel boxes in a binary tree; node k has the children 2k + 1 and 2k + 2.

    A search costs as much as it finds, and the logarithm of the number of boxes.
    """

    boxes: FloatArray
    """Lower and upper corner of each node's box, empty where it has none, (n_nodes, 6)."""
    group: IntArray
    """What all boxes below a node belong to, -1 where they differ or belong to none; (n_nodes,)."""
    order: IntArray
    """Number of the box at each leaf, (n,)."""

    @classmethod
    def of(cls, low: FloatArray, high: FloatArray, group: IntArray | None = None) -> BoxTree:
        """Make a tree of the boxes between two corners, (n, 3) each; groups as in `pairs`."""
        order = along_curve(0.5 * (low + high))
        n = 1 << (len(order) - 1).bit_length()
        boxes, groups = np.full((2 * n - 1, 6), np.inf), np.full(2 * n - 1, -1)
        boxes[:, 3:] = -np.inf
        leaves = slice(n - 1, n - 1 + len(order))
        boxes[leaves, :3], boxes[leaves, 3:] = low[order], high[order]
        if group is not None:
            groups[leaves] = group[order]
        while n > 1:
            below, here = slice(n - 1, 2 * n - 1), slice(n // 2 - 1, n - 1)
            left, right = boxes[below][0::2], boxes[below][1::2]
            np.minimum(left[:, :3], right[:, :3], out=boxes[here, :3])
            np.maximum(left[:, 3:], right[:, 3:], out=boxes[here, 3:])
            if group is not None:
                one, other = groups[below][0::2], groups[below][1::2]
                groups[here] = np.where(one == other, one, -1)
            n //= 2
        return cls(boxes, groups, order)

    def pairs(self, low: FloatArray, high: FloatArray, group: IntArray | None = None) -> IntArray:
        """Pairs (i, j) of a box between two corners (n, 3) and one of the tree that overlap.

        Sorted; (n_pairs, 2). Boxes of one group (n,) are no pair; negative: of none.
        """
        requested = np.hstack([low, high])
        of = np.full(len(low), -1) if group is None else group.astype(np.int64)
        stack = np.empty(DEEPEST, dtype=np.int64)
        pairs = np.empty((_ROOM * len(low), 2), dtype=np.int64)
        count = boxes_in_tree(requested, of, self.boxes, self.group, self.order, stack, pairs)
        if count > len(pairs):
            pairs = np.empty((count, 2), dtype=np.int64)
            boxes_in_tree(requested, of, self.boxes, self.group, self.order, stack, pairs)
        return pairs[:count]


def overlapping_boxes(
    low_a: FloatArray,
    high_a: FloatArray,
    low_b: FloatArray,
    high_b: FloatArray,
    groups: tuple[IntArray, IntArray] | None = None,
) -> IntArray:
    """Pairs (i, j) of boxes a_i, b_j that overlap, sorted; (n, 2).

    Parameters
    ----------
    low_a, high_a, low_b, high_b
        Corners of axis-parallel boxes, (n_a, 3) and (n_b, 3).
    groups
        What each box belongs to, (n_a,) and (n_b,): boxes of one group are no pair. Negative:
        to none.
    """
    if not len(low_a) or not len(low_b):
        return np.empty((0, 2), dtype=np.int64)
    of_a, of_b = groups or (None, None)
    return BoxTree.of(low_b, high_b, of_b).pairs(low_a, high_a, of_a)


def boxes_of_triangles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of the boxes round triangles (n, 3, 3): (n, 3) each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
