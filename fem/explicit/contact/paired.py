"""Face-to-face contact as one more force of the explicit step.

The formulation is that of `fem.contact.surfaces`, the loops are in
`fem.explicit.contact.paired_kernel`.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from fem.contact.friction import slip_sides
from fem.contact.normals import ContactNormals
from fem.contact.search import SearchedPoints
from fem.element.functions import FACET_CORNERS
from fem.explicit.body import LaneBody
from fem.explicit.contact.alike_pairs import WIDEST, AlikePairs, alike_pairs, unit_widths
from fem.explicit.contact.contact import BlockContact
from fem.explicit.contact.paired_kernel import (
    NEVER,
    Collection,
    Rubbing,
    UnitArrays,
    UnitWork,
    collect_forces,
    contact_forces,
)
from fem.explicit.kernels import PARALLEL
from fem.explicit.kernels.layout import LaneArray, aligned_zeros
from fem.explicit.step import Loop
from fem.explicit.timed import TimedSystem
from geometry.mesh import FloatArray, IntArray


class FaceContact(BlockContact):
    """Contact on the conforming interfaces of an assembly."""

    begins_with_loads = True

    def __init__(self, stated: TimedSystem, bodies: tuple[LaneBody, ...]) -> None:
        super().__init__(stated)
        self._pairs = alike_pairs(stated.system, stated.copy_of)
        self._blocks = [
            pairs.blocks[start : start + width]
            for pairs in self._pairs
            for start, width in _unit_slices(pairs.n_pairs)
        ]
        self._data = _unit_arrays(self._pairs, bodies)
        # Alike pairs have one law.
        first = np.array([pairs.blocks[0] for pairs in self._pairs])[self._data.units[:, 0]]
        self._set_constants(first[:, 0], first[:, 1])
        self._work = _unit_work(self._data)
        self._widths = _compiled_widths(self._data)
        self._normals = (
            _reference_normals(self._pairs)
            if stated.system.whole.contact.normals is ContactNormals.REFERENCE
            else None
        )
        self._rubbing: Rubbing | None = None
        if self._rubs:
            lost = aligned_zeros((8 * len(self._data.units),))
            self._rubbing = Rubbing(_no_slip(self._data, self._work), lost)
        self._calls: list[Callable[[], None]] = []
        self._collections = _collections(self._data, len(self._work.force) // 2, bodies)

    def add_force(self, loop: Loop) -> None:
        """Add contact forces at the current positions to the applied forces."""
        self._calls = self._calls or self._bound(loop)
        for call in self._calls:
            call()

    def _bound(self, loop: Loop) -> list[Callable[[], None]]:
        """Compiled loops with their arguments: the arrays of a run stay where they are."""
        parallel = loop.kernels is PARALLEL
        displacements = tuple(body.now.displacement.ravel() for body in loop.bodies)
        constants = self._constants, self._normals, self._rubbing, *self._widths
        forces = contact_forces.form(parallel=parallel)
        calls = [forces.bound(self._data, displacements, self._work, *constants)]
        collect = collect_forces.form(parallel=parallel)
        for body, result in zip(loop.bodies, self._collections, strict=True):
            applied, loads = body.now.applied_force, body.now.loads
            if result is not None and applied is not None:
                begin = None if loads is None else loads.force.ravel()
                arrays = self._data, self._work, body.lanes, begin, applied.ravel()
                calls.append(collect.bound(result, *arrays))
        return calls

    def energy(self) -> float:
        """Energy stored at the last force evaluation [N mm]."""
        total = 0.0
        for unit in range(len(self._data.units)):
            gap, weights = self.unit_gaps(unit)
            total += float((weights * self._law.one(unit).stored_energy(-gap)).sum())
            total += self._stick_energy(unit)
        return total

    def touched_points(self) -> float:
        """Points of all pairs of facets."""
        return float(sum(4 * pairs.n_facets * pairs.n_pairs for pairs in self._pairs))

    def unit_gaps(self, unit: int) -> tuple[FloatArray, FloatArray]:
        """Gaps of one unit, (n_facets, 4, real lanes) [mm], and weights (n_facets, 4, 1)."""
        kind, width, real, _, _, point, *_ = self._data.units[unit]
        first, last = self._data.alike[kind, 1], self._data.alike[kind + 1, 1]
        n = last - first
        gap = self._work.gap[point : point + 4 * n * width].reshape(n, 4, width)[:, :, :real]
        return gap + self._clearance, self._data.weights[first:last, :, None]

    def contact(self, moved: FloatArray) -> tuple[SearchedPoints | None, FloatArray | None]:
        """Friction of the facets that are computed; no search has found them."""
        if self._rubbing is None:
            return None, None
        return None, self._friction(moved, self._slips(self._rubbing.slip))

    def _slips(self, history: FloatArray) -> FloatArray:
        """Elastic slips of all pairs, facets and points along `slip_sides`, (n, 4, 2) [mm]."""
        slips = []
        for kind, width, real, _, _, point, *_ in self._data.units:
            n = int(self._data.alike[kind + 1, 1] - self._data.alike[kind, 1])
            slip = history[4 * point : 4 * (point + 4 * n * width)].reshape(n, 4, 4, width)
            slips.append(slip[:, :, :2, :real].transpose(3, 0, 1, 2).reshape(-1, 4, 2))
        return np.concatenate(slips)

    def _friction(self, moved: FloatArray, slips: FloatArray) -> FloatArray:
        points, pairs = self._stated.system.points, self._pairs
        facets = np.concatenate([alike.facets.ravel() for alike in pairs])
        begins = np.concatenate([alike.begins.reshape(-1, 4) for alike in pairs])
        masters = np.concatenate([np.repeat(p.blocks[:, 0], p.n_facets) for p in pairs])
        tangents = points.frame(points.moved(moved)).tangents[facets]
        # Corners of the loops begin elsewhere, and the other way where blocks have changed places.
        turn = 0.25 * np.einsum("fcj,ck->fjk", FACET_CORNERS[begins], FACET_CORNERS)
        tangents = np.take_along_axis(tangents, begins[:, :, None, None], axis=1)
        sides = slip_sides(np.einsum("fjk,fpji->fpki", turn, tangents))
        traction = np.einsum("fpk,fpki->fpi", slips, sides)
        sign = np.where(masters == points.block_m[facets], -1.0, 1.0) * self._stated.stick
        result = np.empty((points.n_facets, 4, 3))
        result[facets[:, None], begins] = sign[:, None, None] * traction
        return result

    def _deepest(self) -> tuple[int, float, int, int]:
        gaps = [self.unit_gaps(unit)[0].min(axis=(0, 1)) for unit in range(len(self._data.units))]
        unit = self._law.stiffest(np.array([-gap.min() for gap in gaps]))
        m, s = self._blocks[unit][gaps[unit].argmin()].tolist()
        return unit, float(gaps[unit].min()), m, s

    def dissipation(self) -> float:
        """Energy dissipated by friction up to the last force evaluation [N mm]."""
        if self._rubbing is None:
            return 0.0
        lost = self._rubbing.lost.reshape(-1, 8)
        real = np.arange(8) < self._data.units[:, 2:3]
        return float(lost[real].sum())

    def arrays(self) -> dict[str, LaneArray]:
        """Arrays that evolve, by name: slip and dissipation; other forces follow positions."""
        if self._rubbing is None:
            return {}
        # The lanes of a unit are those of the processor: a checkpoint of another one does not fit.
        return {f"slip of {WIDEST} lanes": self._rubbing.slip, "dissipated": self._rubbing.lost}

    def _stick_energy(self, unit: int) -> float:
        """Energy of the elastic slip of one unit [N mm]."""
        if self._rubbing is None:
            return 0.0
        kind, width, real, _, _, point, *_ = self._data.units[unit]
        first, last = self._data.alike[kind, 1], self._data.alike[kind + 1, 1]
        n = last - first
        slip = self._rubbing.slip[4 * point : 4 * (point + 4 * n * width)].reshape(n, 4, 4, width)
        square = (slip[:, :, :2, :real] ** 2).sum(axis=(2, 3))
        weights = self._data.weights[first:last]
        return 0.5 * self._stated.stick * float((weights * square).sum())


def _no_slip(data: UnitArrays, work: UnitWork) -> FloatArray:
    """History of points that have not touched yet, flat [facet][point][4][lane]."""
    slip = aligned_zeros((4 * len(work.gap),))
    kinds, width, point = data.units[:, 0], data.units[:, 1], data.units[:, 5]
    facets = np.diff(data.alike[:, 1])[kinds]
    for n, w, start in zip(facets, width, point, strict=True):
        slip[4 * start : 4 * (start + 4 * n * w)].reshape(n, 4, 4, w)[:, :, 2] = NEVER
    return slip


def _unit_arrays(pairs: tuple[AlikePairs, ...], bodies: tuple[LaneBody, ...]) -> UnitArrays:
    """Cut alike pairs into units and number their arrays."""
    ordered = [_in_row_order(result, bodies) for result in pairs]
    units, copies, exists = [], [], []
    alike = np.zeros((len(pairs) + 1, 4), dtype=np.int64)
    lane = node_scalar = point_scalar = 0
    for kind, result in enumerate(pairs):
        alike[kind, 2:] = np.maximum(result.bodies, 0)
        alike[kind + 1, :2] = alike[kind, :2] + (len(result.nodes), result.n_facets)
        for start, width in _unit_slices(result.n_pairs):
            real = min(width, result.n_pairs - start)
            chosen = np.minimum(start + np.arange(width), result.n_pairs - 1)
            first = _first_copies(result, chosen, bodies)
            units.append((kind, width, real, lane, node_scalar, point_scalar, *first))
            copies.append(result.copies[chosen])
            exists.append(np.arange(width) < real)
            lane += width
            node_scalar += 3 * width * len(result.nodes)
            point_scalar += 4 * width * result.n_facets
    kinds = [kind for kind, *_ in units]
    facets = [width * pairs[kind].n_facets for kind, width, *_ in units]
    places = [_place(p, rows, bodies) for p, (rows, _, _) in zip(pairs, ordered, strict=True)]
    order, shares = shared_out(np.array(facets), np.array(places)[kinds], numba.get_num_threads())
    return UnitArrays(
        units=np.array(units, dtype=np.int64).reshape(-1, 8),
        order=order,
        shares=shares,
        alike=alike,
        rows=np.concatenate([rows for rows, _, _ in ordered]),
        offset=np.concatenate([f.offset[o] for f, (_, o, _) in zip(pairs, ordered, strict=True)]),
        mean=np.concatenate([f.mean[o] for f, (_, o, _) in zip(pairs, ordered, strict=True)]),
        real=np.concatenate(exists).astype(np.float64),
        rotation=np.array([result.rotation for result in pairs]),
        corners=np.concatenate([corners for _, _, corners in ordered]),
        weights=np.concatenate([result.weights for result in pairs]),
        copies=np.ascontiguousarray(np.concatenate(copies).T),
        lanes=np.array([body.lanes for body in bodies], dtype=np.int64),
    )


def _place(pairs: AlikePairs, rows: IntArray, bodies: tuple[LaneBody, ...]) -> float:
    """Where in their bodies the rows of alike pairs are on average, from 0 to 1."""
    place = rows / [bodies[max(body, 0)].n_rows for body in pairs.bodies]
    return float(place[rows >= 0].mean())


def shared_out(work: IntArray, place: FloatArray, threads: int) -> tuple[IntArray, IntArray]:
    """Order of the units and where each thread begins, (n_threads + 1,), with about the same work.

    Threads move the rows of a body in its order too: a unit is for the thread that moves most of
    its rows. To write what another core has read takes long.
    """
    order = np.argsort(place, kind="stable")
    done = np.cumsum(work[order]) - 0.5 * work[order]
    shares = np.searchsorted(done, np.linspace(0.0, work.sum(), threads + 1))
    return order, shares.astype(np.int64)


def _compiled_widths(data: UnitArrays) -> tuple[int | None, int | None, int | None]:
    """`WIDEST`, 4 and 1 where units are so wide; None, which compiles no loops for it, elsewhere.

    Where the widest are 4 wide, one loop is enough.
    """
    there = set(data.units[:, 1].tolist())
    wide, four, one = (width if width in there else None for width in (WIDEST, 4, 1))
    return wide, None if WIDEST == 4 else four, one


def _unit_slices(n_pairs: int) -> list[tuple[int, int]]:
    """First pair and width of the units of alike pairs."""
    widths = unit_widths(n_pairs)
    return list(zip(np.cumsum([0, *widths[:-1]]).tolist(), widths, strict=True))


def _in_row_order(
    pairs: AlikePairs, bodies: tuple[LaneBody, ...]
) -> tuple[IntArray, IntArray, IntArray]:
    """Order the node pairs as the rows of a body lie in memory.

    Returns
    -------
    tuple[IntArray, IntArray, IntArray]
        Rows (n_nodes, 2), the order (n_nodes,), and the corners in the new numbering.
    """
    rows = _rows(pairs, bodies)
    order = np.lexsort((rows[:, 1], rows[:, 0]))
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return rows[order], order, number[pairs.corners]


def _first_copies(
    pairs: AlikePairs, chosen: IntArray, bodies: tuple[LaneBody, ...]
) -> tuple[int, int]:
    """First copy of each side where a vector of lanes holds copies that follow each other.

    Padded lanes may run on into copies that exist or into padding of the bodies, whose forces
    they leave alone; -1 where lanes must be fetched one by one.
    """
    real = len(np.unique(chosen))
    first = []
    for side, body in enumerate(pairs.bodies):
        copies = pairs.copies[chosen[:real], side]
        follows = bool((np.diff(copies) == 1).all())
        fits = body >= 0 and copies[0] + len(chosen) <= bodies[body].lanes
        first.append(int(copies[0]) if follows and fits else -1)
    return first[0], first[1]


def _rows(pairs: AlikePairs, bodies: tuple[LaneBody, ...]) -> IntArray:
    """Body rows of the node pairs, (n_nodes, 2); -1 for rigid blocks."""
    rows = np.full(pairs.nodes.shape, -1, dtype=np.int64)
    for side, body in enumerate(pairs.bodies):
        if body >= 0:
            rows[:, side] = bodies[body].rows.row[pairs.nodes[:, side]]
    return rows


def _unit_work(data: UnitArrays) -> UnitWork:
    kinds, width = data.units[:, 0], data.units[:, 1]
    nodes = 3 * width * np.diff(data.alike[:, 0])[kinds]
    points = 4 * width * np.diff(data.alike[:, 1])[kinds]
    return UnitWork(
        force=aligned_zeros((2 * int(nodes.sum()),)),
        gap=aligned_zeros((int(points.sum()),)),
        scratch=aligned_zeros((numba.get_num_threads(), 4, int(nodes.max(initial=0)))),
    )


def _reference_normals(pairs: tuple[AlikePairs, ...]) -> FloatArray:
    vectors = np.concatenate([result.area_vectors() for result in pairs])
    return vectors / np.linalg.norm(vectors, axis=2, keepdims=True)


def _collections(
    data: UnitArrays, one_side: int, bodies: tuple[LaneBody, ...]
) -> tuple[Collection | None, ...]:
    """List for each applied row of each body what acts on it; ``one_side`` counts its forces."""
    rows, entries, bodies_of = [], [], []
    for unit, (kind, width, _, lane, start, _, *copies) in enumerate(data.units):
        first, last = data.alike[kind, 0], data.alike[kind + 1, 0]
        at = start + 3 * width * np.arange(last - first)
        for side in (0, 1):
            row = data.rows[first:last, side]
            moves = row >= 0
            rows.append(row[moves])
            entry = [unit, side * one_side, copies[side], lane + side * data.copies.shape[1]]
            entries.append((np.array(entry) + np.outer(at, [0, 1, 0, 0]))[moves])
            bodies_of.append(np.full(int(moves.sum()), data.alike[kind, 2 + side]))
    row, every, of = np.concatenate(rows), np.concatenate(entries), np.concatenate(bodies_of)
    result: list[Collection | None] = []
    for number, body in enumerate(bodies):
        members = of == number
        if body.applied_row is None:
            result.append(None)
            continue
        # The pieces of all other loops: what a thread has written it goes on with.
        pieces = np.searchsorted(np.flatnonzero(body.applied_row >= 0), body.rows.chunks)
        applied = body.applied_row[row[members]].astype(np.int64)
        order = np.argsort(applied, kind="stable")
        pointer = np.searchsorted(applied[order], np.arange(body.n_applied + 1))
        result.append(
            Collection(np.unique(pieces), pointer.astype(np.int64), every[members][order])
        )
    return tuple(result)
