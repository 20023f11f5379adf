"""How the explicit solver lays out its arrays: [node][component][copy].

Copies of one block shape are the lanes of the vector unit, so they come last and are padded
to whole vectors; nodes are renumbered so that neighbours in the mesh are neighbours in memory
(Cuthill and McKee). Only this module knows about padding and renumbering: outside the solver
arrays are (n_copies, n_nodes, 3) in the numbering of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_array, csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from geometry.mesh import FloatArray, IntArray

LaneArray = npt.NDArray[Any]
"""(n_rows, components, n_lanes)."""

#: Bytes of a cache line.
_LINE = 64

#: Numbers of two cache lines: what lies next to each other is fetched together.
_OWN = 16

#: Bytes of u and f that a row reaches, above which whole rows are faster (measured).
HALF_WINDOW = 1 << 17

#: Row chunks of a kernel: fixed, so that sums do not depend on the number of threads.
N_CHUNKS = 16


def padded_lanes(n_copies: int) -> int:
    """Lanes that hold ``n_copies``: 1, 2 or 4 (half a cache line), then multiples of four."""
    if n_copies > 4:
        return -(-n_copies // 4) * 4
    return 1 << (n_copies - 1).bit_length()


def widths(lanes: int) -> tuple[int | None, int | None]:
    """Arguments ``fours`` and ``ones`` of `fem.explicit.kernels.motion.update`."""
    return (4, None) if lanes % 4 == 0 else (None, 1)


def aligned_zeros(shape: tuple[int, ...]) -> LaneArray:
    """Zeros that start on a cache line and may be read one vector beyond their end."""
    count = int(np.prod(shape))
    raw = np.zeros(8 * count + 2 * _LINE, dtype=np.uint8)
    start = -raw.ctypes.data % _LINE
    return raw[start : start + 8 * count].view(np.float64).reshape(shape)


def sums_of_chunks(*shape: int) -> LaneArray:
    """Zeros (n_chunks, …, lanes) to which threads add often: each chunk has cache lines of its own.

    With more lanes than asked for, where that is why.
    """
    *first, lanes = shape
    return aligned_zeros((*first, -(-lanes // _OWN) * _OWN))


@dataclass(frozen=True)
class BlockRows:
    """A sparse stiffness as 3 × 3 node blocks, rows in the solver's node order.

    Few copies are bound by loading the stiffness, so that each pair of neighbours in one chunk (of
    one copy, each pair) is stored once, with the earlier of its rows: their rows are *half*, else
    they are *whole*.
    """

    order: IntArray
    """Mesh node of each row, (n_nodes,)."""
    row: IntArray
    """Row of each mesh node, (n_nodes,)."""
    pointer: IntArray
    """First block of each row, (n_nodes + 1,)."""
    shared: IntArray | None
    """Half rows: first block (the diagonal) and end of those that stand for both rows of a pair,
    (n_nodes, 2): all blocks, where there is one copy. None: whole rows."""
    reach: int | None
    """Half rows of one copy: largest distance of two rows that share a block; else None."""
    column: npt.NDArray[np.int32]
    """Row number of the neighbour of each block, (n_blocks,); ascends in a row."""
    blocks: LaneArray
    """Nine entries of each block, column by column (row by row in half rows of one copy), flat
    (9 n_blocks,) [N/mm]."""
    chunks: IntArray
    """Row boundaries of pieces of equal work, (n_chunks + 1,)."""

    @property
    def n_nodes(self) -> int:
        """Number of rows."""
        return len(self.order)

    @property
    def packed(self) -> tuple[Any, ...]:
        """First arguments of `fem.explicit.kernels.stiffness.stiffness_product`.

        What rows are not (whole, half of several copies, half of one) is None, and not compiled.
        """
        whole = 1 if self.shared is None else None
        shared = self.shared if self.reach is None else None
        return self.chunks, self.pointer, whole, shared, self.reach, self.column, self.blocks


def node_order(stiffness: bsr_array) -> IntArray:
    """Narrow-banded order of the nodes: reverse Cuthill-McKee, or none if that is no better."""
    graph = csr_array(
        (np.ones(len(stiffness.indices), dtype=np.int8), stiffness.indices, stiffness.indptr)
    )
    order: IntArray = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    return order if _bandwidth(graph, order) < 0.9 * _bandwidth(graph) else np.arange(len(order))


def _bandwidth(graph: csr_array, order: IntArray | None = None) -> int:
    """Largest distance of two neighbours in a numbering."""
    n = graph.shape[0]
    number = np.arange(n)
    if order is not None:
        number[order] = np.arange(n)
    row = np.repeat(np.arange(n), np.diff(graph.indptr))
    return int(np.abs(number[row] - number[graph.indices]).max())


def block_rows(stiffness: bsr_array, *, lanes: int, half: bool | None = None) -> BlockRows:
    """Pack a stiffness matrix for the kernels.

    Parameters
    ----------
    stiffness
        (3 n_nodes, 3 n_nodes) in 3 × 3 blocks, symmetric to the bit [N/mm].
    lanes
        Padded number of copies.
    half
        Whether rows are half; None: where it is faster.
    """
    order = node_order(stiffness)
    row = np.empty_like(order)
    row[order] = np.arange(len(order))
    numbered = csr_array((np.arange(len(stiffness.indices)), stiffness.indices, stiffness.indptr))[
        order
    ][:, order]
    numbered.sort_indices()
    pointer, column = numbered.indptr.astype(np.int64), numbered.indices.astype(np.int32)
    bandwidth = _bandwidth(numbered)
    if half is None:
        half = _half_is_faster(bandwidth, lanes)
    # Fewer chunks of half rows: pairs across their boundaries are stored twice.
    few = min(max(2, len(order) // (6 * bandwidth + 1) // 2 * 2), N_CHUNKS)
    chunks = equal_work(pointer, few if half else N_CHUNKS)
    kept: Any = slice(None)
    shared, reach = None, None
    if half:
        # One copy sends to rows of later chunks, too.
        within = chunks if lanes > 1 else chunks[[0, -1]]
        kept, pointer, shared = _half_rows(pointer, column, within)
        column = column[kept]
        reach = bandwidth if lanes == 1 else None
    blocks = aligned_zeros((9 * len(column),))
    entries = stiffness.data[numbered.data[kept]]
    blocks[:] = (entries.transpose(0, 2, 1) if reach is None else entries).ravel()
    return BlockRows(order, row, pointer, shared, reach, column, blocks, chunks)


def _half_is_faster(bandwidth: int, lanes: int) -> bool:
    """Whether loading the stiffness is what takes time: it is where u and f are small."""
    window = 48 * bandwidth * lanes
    return lanes == 1 or (lanes < 16 and window <= HALF_WINDOW)


def _half_rows(
    pointer: IntArray, column: npt.NDArray[np.int32], chunks: IntArray
) -> tuple[npt.NDArray[np.bool_], IntArray, IntArray]:
    """Leave out what an earlier row of the same chunk stands for.

    Returns
    -------
    tuple
        Which blocks are kept, the pointer of the rows that they make and `BlockRows.shared`.
    """
    n_rows = len(pointer) - 1
    row = np.repeat(np.arange(n_rows), np.diff(pointer))
    chunk = np.repeat(np.arange(len(chunks) - 1), np.diff(chunks))
    side = np.sign(chunk[column] - chunk[row])
    kept = (side != 0) | (column >= row)
    earlier, here, later = (
        np.bincount(row[kept & (side == s)], minlength=n_rows) for s in (-1, 0, 1)
    )
    new = np.append(0, np.cumsum(earlier + here + later)).astype(np.int64)
    first = new[:-1] + earlier
    return kept, new, np.column_stack([first, first + here])


def equal_work(pointer: IntArray, n_chunks: int = N_CHUNKS) -> IntArray:
    """Row boundaries that split the entries counted by ``pointer`` evenly; (≤ n_chunks + 1,)."""
    target = np.linspace(0, pointer[-1], n_chunks + 1)
    boundary = np.searchsorted(pointer, target)
    boundary[0], boundary[-1] = 0, len(pointer) - 1
    return np.unique(boundary).astype(np.int64)


@dataclass(frozen=True)
class Runs:
    """Positions in a flat array as runs of neighbours, in the order of the memory."""

    start: IntArray
    """First position of each run, (n_runs,)."""
    pointer: IntArray
    """First entry of each run, (n_runs + 1,)."""

    @property
    def index(self) -> IntArray:
        """Position of every entry, (n,)."""
        length = np.diff(self.pointer)
        offset: IntArray = np.arange(self.pointer[-1]) - np.repeat(self.pointer[:-1], length)
        return np.repeat(self.start, length) + offset


def runs(index: IntArray) -> tuple[Runs, IntArray]:
    """Gather positions to runs.

    Parameters
    ----------
    index
        Positions in a flat array, (n,); may repeat.

    Returns
    -------
    tuple[Runs, IntArray]
        The runs, and which position each of their entries was, (n,): equal ones keep their order.
    """
    order: IntArray = np.argsort(index, kind="stable").astype(np.int64)
    sorted_index = index[order]
    first = np.flatnonzero(np.diff(sorted_index, prepend=-2) != 1).astype(np.int64)
    pointer = np.append(first, len(index)).astype(np.int64)
    return Runs(sorted_index[first].astype(np.int64), pointer), order


def to_lanes(values: FloatArray, order: IntArray) -> LaneArray:
    """(n_copies, n_nodes, 3) in mesh numbering to padded (n_rows, 3, n_lanes)."""
    n_copies, n_nodes, n_components = values.shape
    lanes = aligned_zeros((n_nodes, n_components, padded_lanes(n_copies)))
    lanes[:, :, :n_copies] = values[:, order].transpose(1, 2, 0)
    return lanes


def from_lanes(lanes: LaneArray, row: IntArray, n_copies: int) -> FloatArray:
    """Inverse of `to_lanes`."""
    return np.ascontiguousarray(lanes[row, :, :n_copies].transpose(2, 0, 1))
