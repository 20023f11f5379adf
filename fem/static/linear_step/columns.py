"""Flexibility of a structured block between points of its faces, by congruent columns of elements.

A block is cut into columns round it. Columns that a rotation or a reflection maps onto each other,
half waves of a Sine Block and whole ones, are condensed once for all: elements by nested dissection
to the two planes at which a column ends, columns to longer ones by elimination of the planes
between them, the whole block by elimination of its two ends, held by springs on its rigid motions.
Points on the lower and upper faces are carried along as unknowns that are never eliminated,

    [ K  Bᵀ ]
    [ B  0  ],

with B u the displacements that points ask for: what remains is minus their flexibility B K⁻¹ Bᵀ,
and no node of a face need be retained. Displacements under any forces follow by substitution.

Reference: George (1973), doi:10.1137/0710032, for nested dissection; Kabsch (1976),
doi:10.1107/S0567739476001873, for the rotation between two sets of points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg
import scipy.linalg.blas
from scipy.sparse import csr_array

from fem.static.linear_step.condensation import Elimination, mirror
from geometry.machine.work import count_elimination
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Columns are congruent where nodes map onto each other to this part of their size.
_CONGRUENT = 1e-9
#: Elements have one stiffness where they differ by a shift to this part of their size: round-off.
_SHIFTED = 1e-13


@dataclass(frozen=True)
class ColumnBlock:
    """Elements of one degree in a structured block, and the points that are asked for."""

    nodes: FloatArray
    """Grid of nodes, (n_1, n_2, n_3, 3) [mm]; columns follow each other in the second direction."""
    degree: int
    """Of the elements."""
    stiffness: Callable[[FloatArray], FloatArray]
    """Stiffness matrices of elements from their nodes, (m, n, 3) to (m, 3 n, 3 n) [N/mm]."""
    rows: csr_array
    """B: points of the lower and upper face, each quad by quad with the second direction faster,
    points of a quad likewise; then any points of both ends."""
    per_line: int
    """Points of a quad along an edge."""
    vectors: bool = False
    """Whether a point has three rows, its displacement along the axes; else one, along a normal."""

    @property
    def counts(self) -> tuple[int, int, int]:
        """Elements in each direction."""
        n_1, n_2, n_3 = ((n - 1) // self.degree for n in self.nodes.shape[:3])
        return n_1, n_2, n_3

    @cached_property
    def alike_lengths(self) -> list[int]:
        """Numbers of elements of columns whose copies make it up, each of the one before."""
        n = self.counts[1]
        result = [n]
        for length in reversed([k for k in range(1, n) if n % k == 0]):
            if result[-1] % length == 0 and _copies(self, length, n) is not None:
                result.append(length)
        return result[::-1]

    def memory(self, n_points: int) -> tuple[float, float]:
        """Bytes of the factors and the flexibility of so many points; more while they are made."""
        n_1, _, n_3 = self.nodes.shape[:3]
        plane, lengths = 3 * n_1 * n_3, self.alike_lengths
        copies = lengths[-1] // lengths[-2] if len(lengths) > 1 else 1
        # A plane is eliminated from one on either side of it, once in columns that are alike.
        planes = lengths[0] + 1 + sum(b // a - 1 for a, b in pairwise(lengths))
        kept = 3.0 * planes * plane**2 + n_points**2
        fronts = copies * (2.0 * plane + self.n_beside / copies) ** 2
        return 8.0 * kept, 8.0 * (fronts + n_points**2)

    @property
    def n_beside(self) -> int:
        """Rows of the lower and upper faces."""
        return self.point_grid(self.counts[1]).size

    def node_grid(self, columns: int) -> IntArray:
        """Numbers of the nodes of the first columns."""
        n_1, _, n_3 = self.nodes.shape[:3]
        n_2 = columns * self.degree + 1
        return np.arange(n_1 * n_2 * n_3).reshape(n_1, n_2, n_3)

    def point_grid(self, columns: int) -> IntArray:
        """Rows of the first columns: face, quads and points in two directions, components."""
        shape = (2, self.counts[0], columns, self.per_line, self.per_line, 1 + 2 * self.vectors)
        return np.arange(int(np.prod(shape))).reshape(shape)


@dataclass(frozen=True)
class _Copy:
    """A shorter column within a longer one."""

    nodes: IntArray
    """Nodes of the longer one at those of the shorter one, (n,)."""
    points: IntArray
    """The same of points."""
    turn: FloatArray
    """Rotation or reflection T of the shorter one, (3, 3)."""


@dataclass(frozen=True)
class _Front:
    """Condensed stiffness on planes across the columns, or on parts of elements, and on points."""

    planes: dict[Any, IntArray]
    """Unknowns of the nodes of each plane, in the order of the matrix; shared by its number, of
    parts of elements by their places in the grid (`_Dissection.places`)."""
    points: IntArray
    """Numbers of the points that come after them, (n_points,)."""
    matrix: FloatArray
    """Symmetric, (n, n)."""

    @property
    def starts(self) -> IntArray:
        """Where planes and points begin, and the end."""
        sizes = [len(plane) for plane in self.planes.values()]
        return np.cumsum([0, *sizes, len(self.points)])


@dataclass(frozen=True)
class _Column:
    """Eliminations in a column of a length, shared by all that are congruent."""

    n_nodes: int
    planes: IntArray
    """Nodes of both ends, (n,)."""
    copies: tuple[_Copy, ...]
    """Shorter columns that it is made of; none where it is made of elements."""
    shorter: _Column | None
    steps: tuple[Elimination, ...]
    """Eliminations of its own, in their order."""

    @cached_property
    def _inner(self) -> BoolArray:
        """Nodes between the planes."""
        result = np.ones(self.n_nodes, dtype=np.bool_)
        result[self.planes] = False
        return result

    def forward(self, forces: FloatArray) -> list[FloatArray]:
        """Move forces (n_nodes, 3, n_cases) to the planes; returns what `backward` needs."""
        kept: list[FloatArray] = []
        if self.shorter is not None:
            inner, ends = self.shorter._inner, self.shorter.planes
            n = forces.shape[2]
            local = np.zeros((self.shorter.n_nodes, 3, len(self.copies) * n))
            for k, copy in enumerate(self.copies):
                local[inner, :, k * n : (k + 1) * n] = copy.turn.T @ forces[copy.nodes[inner]]
            kept = [local, *self.shorter.forward(local)]
            for k, copy in enumerate(self.copies):
                forces[copy.nodes[ends]] += copy.turn @ local[ends, :, k * n : (k + 1) * n]
        flat = forces.reshape(-1, forces.shape[2])
        for step in self.steps:
            step.forward(flat)
        return kept

    def backward(self, found: FloatArray, kept: list[FloatArray]) -> None:
        """Displacements of all nodes from those of the planes, in place of what remained."""
        flat = found.reshape(-1, found.shape[2])
        for step in reversed(self.steps):
            step.backward(flat)
        if self.shorter is None:
            return
        inner, ends = self.shorter._inner, self.shorter.planes
        local, n = kept[0], found.shape[2]
        for k, copy in enumerate(self.copies):
            local[ends, :, k * n : (k + 1) * n] = copy.turn.T @ found[copy.nodes[ends]]
        self.shorter.backward(local, kept[1:])
        for k, copy in enumerate(self.copies):
            found[copy.nodes[inner]] = copy.turn @ local[inner, :, k * n : (k + 1) * n]


@dataclass(frozen=True)
class FlexibleBlock:
    """A block without its rigid motions: any generalised inverse G serves forces in balance."""

    points: IntArray
    """Points that were asked for, in the order of the flexibility, (n,)."""
    flexibility: FloatArray
    """B G Bᵀ between them, (n, n) [mm/N]."""
    column: _Column
    """The whole block."""
    held: IntArray
    """Unknowns that springs hold against rigid motions."""

    def displacements(self, forces: FloatArray) -> FloatArray:
        """G of nodal forces, (n_cases, n_nodes, 3) [N], to displacements of that shape [mm]."""
        work = np.moveaxis(forces, 0, 2).copy(order="C")
        self.column.backward(work, self.column.forward(work))
        return np.ascontiguousarray(np.moveaxis(work, 2, 0))


def flexible_block(block: ColumnBlock, asked: BoolArray, rigid: FloatArray) -> FlexibleBlock:
    """Eliminate all nodes of a block and keep the flexibility between points that are asked for.

    ``asked`` is (n_rows,), all or none of a point that has three; ``rigid`` the rigid motions of
    the nodes, (3 n_nodes, 6).
    """
    column, fronts = _parts(block, block.alike_lengths, asked[: block.n_beside])
    steps, last = list(column.steps), len(fronts)
    numbers = block.n_beside + np.flatnonzero(asked[block.n_beside :])
    # The ends go first: no front has more than two planes, and the last one has only one.
    front = _joined([fronts[0], _end(block, fronts[0], 0, numbers)], [0], steps)
    for k, other in enumerate(fronts[1:-1], 1):
        front = _joined([front, other], [k], steps)
    end = _end(block, fronts[-1], last, numbers)
    final = last - 1 if last > 1 else last
    other = _joined([fronts[-1], end], [last], steps) if last > 1 else end
    held = front.planes[final]
    springs = np.linalg.qr(rigid[held])[0]
    stiffness = float(np.diag(front.matrix)[: len(held)].mean())
    spring = _Front({final: held}, np.empty(0, dtype=np.int64), stiffness * springs @ springs.T)
    front = _joined([front, other, spring], [final], steps)
    return FlexibleBlock(front.points, -front.matrix, replace(column, steps=tuple(steps)), held)


def _end(block: ColumnBlock, front: _Front, plane: int, points: IntArray) -> _Front:
    """Those points that lie on a plane."""
    unknowns = front.planes[plane]
    rows = block.rows[points][:, unknowns].toarray()
    here = rows.any(axis=1)
    n, m = len(unknowns), int(here.sum())
    matrix = np.zeros((n + m, n + m))
    matrix[n:, :n] = rows[here]
    matrix[:n, n:] = rows[here].T
    return _Front({plane: unknowns}, points[here], matrix)


def _unknowns(nodes: IntArray) -> IntArray:
    return (3 * nodes[:, None] + np.arange(3)).ravel()


# ---------------------------------------------------------------------------------------------
# Congruence


def _copies(block: ColumnBlock, length: int, longer: int) -> tuple[_Copy, ...] | None:
    """Columns of a length within the first longer one as copies of the first; None: not alike."""
    result = []
    for start in range(0, longer, length):
        copy = _copy(block, length, longer, start)
        if copy is None:
            return None
        result.append(copy)
    return tuple(result)


def _copy(block: ColumnBlock, length: int, longer: int, start: int) -> _Copy | None:
    """A column as it is, turned upside down, reversed, or both."""
    p, points = block.degree, block.nodes[:, : longer * block.degree + 1].reshape(-1, 3)
    nodes = block.node_grid(longer)[:, start * p : (start + length) * p + 1]
    on_faces = block.point_grid(longer)[:, :, start : start + length]
    own = block.nodes[:, : length * p + 1].reshape(-1, 3)
    for back in (1, -1):
        for down in (1, -1):
            image = nodes[:, ::back, ::down].ravel()
            turn = _rotation(own, points[image])
            if turn is not None:
                ordered = on_faces[::down, :, ::back, :, ::back].ravel()
                return _Copy(image, ordered, turn)
    return None


def _rotation(points: FloatArray, images: FloatArray) -> FloatArray | None:
    """Orthogonal matrix that takes points to their images but for a shift; None where none does."""
    one, other = points - points.mean(axis=0), images - images.mean(axis=0)
    left, _, right = np.linalg.svd(one.T @ other)
    turn = (left @ right).T
    if np.abs(one @ turn.T - other).max() > _CONGRUENT * np.ptp(points, axis=0).max():
        return None
    return turn


# ---------------------------------------------------------------------------------------------
# Elimination


def _condensed(block: ColumnBlock, lengths: list[int], wanted: BoolArray) -> tuple[_Column, _Front]:
    """A column of the last of some lengths between its ends, with the points wanted of it."""
    column, (front, *others) = _parts(block, lengths, wanted)
    steps = list(column.steps)
    for k, other in enumerate(others, 1):
        front = _joined([front, other], [k], steps)
    return replace(column, steps=tuple(steps)), front


def _parts(
    block: ColumnBlock, lengths: list[int], wanted: BoolArray
) -> tuple[_Column, list[_Front]]:
    """The same as the columns that it consists of, one after the other between their planes."""
    length = lengths[-1]
    nodes = block.node_grid(length)
    planes = np.concatenate([nodes[:, 0].ravel(), nodes[:, -1].ravel()])
    if len(lengths) == 1:
        steps, front = _Dissection(block, length, wanted).condensed(planes)
        return _Column(nodes.size, planes, (), None, steps), [front]
    copies = _copies(block, lengths[-2], length)
    assert copies is not None
    needed = np.any([wanted[copy.points] for copy in copies], axis=0)
    shorter, own = _condensed(block, lengths[:-1], needed)
    fronts = [
        _placed(own, copy, shorter, wanted, k, vectors=block.vectors)
        for k, copy in enumerate(copies)
    ]
    return _Column(nodes.size, planes, copies, shorter, ()), fronts


def _placed(
    front: _Front,
    copy: _Copy,
    shorter: _Column,
    wanted: BoolArray,
    number: int,
    *,
    vectors: bool,
) -> _Front:
    """The front of the copy of a number in a longer column, its nodes ascending in each plane."""
    n = len(shorter.planes)
    places = copy.nodes[shorter.planes].reshape(2, -1)
    one, other = np.argsort(places, axis=1)
    other += n // 2
    if places[0].min() > places[1].min():
        one, other = other, one
    numbers = copy.points[front.points]
    kept = np.flatnonzero(wanted[numbers])
    take = np.concatenate([_unknowns(one), _unknowns(other), 3 * n + kept])
    same = np.array_equal(take, np.arange(len(front.matrix)))
    matrix = front.matrix if same else front.matrix[np.ix_(take, take)]
    if not np.allclose(copy.turn, np.eye(3), rtol=0.0, atol=1e-14):
        matrix = _turned(matrix, copy.turn, len(matrix) // 3 if vectors else n)
    flat = places.ravel()
    planes = {number: _unknowns(flat[one]), number + 1: _unknowns(flat[other])}
    return _Front(planes, numbers[kept], matrix)


def _turned(matrix: FloatArray, turn: FloatArray, n: int) -> FloatArray:
    """Turn the components of the first n nodes on both sides."""
    rows = (turn @ matrix[: 3 * n].reshape(n, 3, -1)).reshape(3 * n, -1)
    result = np.empty_like(matrix)
    result[: 3 * n, : 3 * n] = (rows[:, : 3 * n].reshape(-1, n, 3) @ turn.T).reshape(3 * n, -1)
    result[: 3 * n, 3 * n :] = rows[:, 3 * n :]
    result[3 * n :, : 3 * n] = rows[:, 3 * n :].T
    result[3 * n :, 3 * n :] = matrix[3 * n :, 3 * n :]
    return result


def _joined(fronts: list[_Front], inside: Iterable[Any], steps: list[Elimination]) -> _Front:
    """Sum of fronts without some of their planes; the step is added to those before."""
    planes = {key: plane for front in fronts for key, plane in front.planes.items()}
    eliminated = {key: planes.pop(key) for key in inside}
    sizes = [len(plane) for plane in (eliminated | planes).values()]
    at = dict(zip(eliminated | planes, np.cumsum([0, *sizes]).tolist(), strict=False))
    within, around = (
        np.concatenate([*some.values(), np.empty(0, dtype=np.int64)])
        for some in (eliminated, planes)
    )
    points = np.concatenate([front.points for front in fronts])
    n, m, first = len(within), len(around) + len(points), sum(sizes)
    inner, coupling, rest = np.zeros((n, n)), np.zeros((n, m)), np.zeros((m, m))
    for front in fronts:
        to = [*(at[key] for key in front.planes), first]
        first += len(front.points)
        own = [slice(a, b) for a, b in pairwise(front.starts)]
        for i, row in zip(to, own, strict=True):
            for j, column in zip(to, own, strict=True):
                # Below the diagonal inside, above it around: no more is read.
                if j <= i < n:
                    inner[_run(i, row), _run(j, column)] += front.matrix[row, column]
                elif i < n <= j:
                    coupling[_run(i, row), _run(j - n, column)] += front.matrix[row, column]
                elif n <= i <= j:
                    rest[_run(i - n, row), _run(j - n, column)] += front.matrix[row, column]
    count_elimination(n, m)
    factor = scipy.linalg.cholesky(inner, lower=True, check_finite=False)
    # In Fortran order both are transposed: from the right BLAS is faster, too.
    scipy.linalg.blas.dtrsm(1.0, factor, coupling.T, side=1, lower=1, trans_a=1, overwrite_b=1)
    _subtract_square(rest, coupling)
    nodes = coupling[:, : len(around)].copy()
    steps.append(Elimination(within, around, factor, nodes))
    return _Front(planes, points, rest)


def _run(start: int, like: slice) -> slice:
    """As many from a start on as another run has."""
    return slice(start, start + like.stop - like.start)


def _subtract_square(matrix: FloatArray, factor: FloatArray) -> None:
    """Subtract WᵀW from a symmetric matrix, by BLAS; both in C order."""
    if not len(matrix):  # no point is asked for
        return
    # The lower triangle in Fortran order is the upper one of the matrix.
    scipy.linalg.blas.dsyrk(-1.0, factor.T, beta=1.0, c=matrix.T, lower=1, overwrite_c=1)
    mirror(matrix)


class _Dissection:
    """Nested dissection of the elements of a column."""

    def __init__(self, block: ColumnBlock, length: int, wanted: BoolArray) -> None:
        n_1, _, n_3 = block.counts
        self.block, self.counts, p = block, (n_1, length, n_3), block.degree
        self.numbers = block.node_grid(length)
        self.points, self.wanted = block.point_grid(length), wanted
        self.steps: list[Elimination] = []
        # Twice the elements before a node in each direction, one more between planes of nodes: at
        # one place all have the same elements. Ends belong to the last ones, but for the planes.
        places = []
        for axis, count in enumerate(self.counts):
            k = np.arange(count * p + 1)
            place = 2 * (k // p) + (k % p > 0)
            places.append(place if axis == 1 else np.clip(place, 1, 2 * count - 1))
        self.places: IntArray = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)
        #: Elements so far that differ by more than a shift: their nodes from the first on, [mm].
        self.shapes: list[tuple[FloatArray, FloatArray]] = []

    def condensed(self, planes: IntArray) -> tuple[tuple[Elimination, ...], _Front]:
        """Eliminations, and what remains on both planes of nodes and the points."""
        front = self._visit((0, 0, 0), self.counts)
        size, numbers = 3 * self.numbers.size, np.flatnonzero(self.wanted)
        unknowns = np.concatenate([*front.planes.values(), size + front.points])
        order = np.concatenate([_unknowns(planes), size + numbers])
        where = np.argsort(unknowns)
        take = where[np.searchsorted(unknowns, order, sorter=where)]
        matrix = front.matrix[np.ix_(take, take)]
        one, other = (_unknowns(plane) for plane in planes.reshape(2, -1))
        return tuple(self.steps), _Front({0: one, 1: other}, numbers, matrix)

    def _visit(self, low: tuple[int, ...], high: tuple[int, ...]) -> _Front:
        """Condensed stiffness of a box of elements, without what no element outside has."""
        sizes = [b - a for a, b in zip(low, high, strict=True)]
        axis = int(np.argmax(sizes))
        if sizes[axis] == 1:
            fronts = [self._element(low)]
        else:
            middle = low[axis] + sizes[axis] // 2
            lower = tuple(middle if k == axis else h for k, h in enumerate(high))
            upper = tuple(middle if k == axis else a for k, a in enumerate(low))
            fronts = [self._visit(low, lower), self._visit(upper, high)]
        keys = dict.fromkeys(key for front in fronts for key in front.planes)
        inside = [
            key
            for key in keys
            if all(2 * a < k < 2 * b for a, k, b in zip(low, key, high, strict=True))
        ]
        return _joined(fronts, inside, self.steps)

    def _element(self, at: tuple[int, ...]) -> _Front:
        """Stiffness of an element, with its points."""
        p, block = self.block.degree, self.block
        window = tuple(slice(k * p, (k + 1) * p + 1) for k in at)
        keys, part = np.unique(self.places[window].reshape(-1, 3), axis=0, return_inverse=True)
        order = np.argsort(part, kind="stable")
        nodes = self.numbers[window].ravel()[order]
        runs = np.split(nodes, np.cumsum(np.bincount(part))[:-1])
        planes = {tuple(key): _unknowns(run) for key, run in zip(keys.tolist(), runs, strict=True)}
        faces = [face for face, end in ((0, 0), (1, self.counts[2] - 1)) if at[2] == end]
        on_quad = self.points[faces, at[0], at[1]].ravel()
        numbers = on_quad[self.wanted[on_quad]]
        n, take = 3 * len(nodes), _unknowns(order)
        matrix = np.zeros((n + len(numbers),) * 2)
        matrix[:n, :n] = self._stiffness(block.nodes[window].reshape(-1, 3))[np.ix_(take, take)]
        # Points and nodes of the block, which begins with this column.
        points = block.point_grid(block.counts[1])[:, :, : self.counts[1]].ravel()
        rows = block.rows[points[numbers]]
        places = np.empty(rows.shape[1] // 3, dtype=np.int64)
        places[block.node_grid(block.counts[1])[window].ravel()[order]] = np.arange(len(nodes))
        entry = csr_array(rows).tocoo()
        columns = 3 * places[entry.col // 3] + entry.col % 3
        matrix[n + entry.row, columns] = entry.data
        matrix[columns, n + entry.row] = entry.data
        return _Front(planes, numbers, matrix)

    def _stiffness(self, nodes: FloatArray) -> FloatArray:
        """Stiffness of an element (n, 3) [mm]: the same one of elements that differ by a shift."""
        shape, size = nodes - nodes[0], np.ptp(nodes, axis=0).max()
        for known, stiffness in self.shapes:
            if np.abs(shape - known).max() <= _SHIFTED * size:
                return stiffness
        stiffness = self.block.stiffness(nodes[None])[0]
        self.shapes.append((shape, stiffness))
        return stiffness
