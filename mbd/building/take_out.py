"""Which block comes out, along which direction, and in which order all of them do.

The translations of a block whose neighbours stay are a cone: n·d >= 0 for all normals n of its
contacts. Along its rays, its middle and the axes the block is moved straight on until it meets
another one. Blocks of which none gets away alone may get away together: of two blocks, one blocks
the other along a direction where its own motion meets it, and the strong components of that
relation are the groups that move as one.

Reference: Wilson and Latombe, "Geometric reasoning about mechanical assembly", Artificial
Intelligence 71 (1994).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, finite, first_of, grouped, number
from geometry.polyhedra.separation import spread
from mbd.building.sweeps import Sweeps
from mbd.contacts.jacobian import contact_jacobian
from mbd.mechanism import Mechanism, classify

#: A direction is free where no gap closes by more than this part of the way [rad].
ANGLE = 1e-6
#: Normals and directions that differ by less are one.
_SAME = 1e-5
#: Different normals of one block at most: of curved faces those that are farthest apart.
_MOST_NORMALS = 64
#: Directions that are tried of one block at most.
_MOST_WAYS = 24
#: Pairs of so many normals of a block give directions of groups, and of these are tried at most.
_FEW_NORMALS, _MOST_DIRECTIONS = 12, 200
#: Blocks and steps that are printed at most.
_SHOWN = 12
_AXES = np.concatenate([np.eye(3)[2:], -np.eye(3)[2:], np.eye(3)[:2], -np.eye(3)[:2]])


def _distinct(vectors: FloatArray) -> FloatArray:
    """Unit vectors (n, 3) without those that are there twice, in their order."""
    keys = np.round(vectors / _SAME).astype(np.int64)
    _, first = np.unique(keys, axis=0, return_index=True)
    return vectors[np.sort(first)]


def _units(vectors: FloatArray) -> FloatArray:
    """Directions of vectors (n, 3), without those of length zero."""
    size = np.linalg.norm(vectors, axis=1)
    kept = size > _SAME
    return vectors[kept] / size[kept, None]


def _rays(normals: FloatArray) -> FloatArray:
    """Both ways along the lines of each two planes with normals (n, 3)."""
    i, j = np.triu_indices(len(normals), 1)
    rays = _units(np.cross(normals[i], normals[j]))
    return np.concatenate([rays, -rays])


def free_directions(normals: FloatArray) -> FloatArray:
    """Rays of the cone n·d >= 0, its middle, and axes in it; up first; (n_directions, 3).

    ``normals`` (n, 3): into the block. Empty where the block has no translation at all.
    """
    normals = _distinct(normals)
    if not len(normals):
        return _AXES.copy()
    few = normals if len(normals) <= _MOST_NORMALS else spread(normals, _MOST_NORMALS)
    rays = _rays(few)
    # In planes and on lines of the cone the axes are nearest to what a mason would try.
    flat = _units((_AXES[:, None] - (_AXES @ few.T)[:, :, None] * few).reshape(-1, 3))
    middle = _units(few.sum(axis=0)[None])
    tried = np.concatenate([_AXES, middle, few, rays, flat])
    allowed = (tried @ normals.T).min(axis=1) >= -ANGLE
    found = _distinct(tried[allowed])
    order = np.argsort(-np.round(found[:, 2], 6), kind="stable")
    return found[order][:_MOST_WAYS]


def direction_words(direction: FloatArray) -> str:
    """Name a unit vector (3,)."""
    most = int(np.abs(direction).argmax())
    if abs(direction[most]) >= 1.0 - _SAME:
        names = ("up", "down") if most == 2 else (f"+{'xyz'[most]}", f"-{'xyz'[most]}")
        return names[int(direction[most] < 0)]
    return f"({', '.join(f'{x:.3f}' for x in (np.round(direction, 3) + 0.0).tolist())})"


@dataclass(frozen=True)
class WayOut:
    """How far one block gets along a straight line, all others where they are."""

    blocks: tuple[int, ...]
    """The block; several that move as one."""
    direction: FloatArray | None
    """The best one, unit, (3,); None where no translation is free."""
    distance: float
    """Until it meets another block; infinite where it gets away [mm]."""
    clear_after: float
    """Until it has passed the blocks that it touched; nan where it does not get away [mm]."""
    met: tuple[int, ...]
    """Blocks that it meets first, or that hold it."""
    stops: frozenset[int] = frozenset()
    """Blocks that it touches, or meets along any direction that was tried."""
    turns: bool | None = None
    """Whether a small turn is free where no translation is; None: not asked."""

    @property
    def free(self) -> bool:
        """Whether it gets away."""
        return self.direction is not None and bool(np.isinf(self.distance))

    def words(self, named: Callable[[int], str]) -> str:
        """Direction and distance, or what holds it."""
        others = first_of(map(named, self.met), 4)
        if self.direction is None:
            turn = "; a small turn is free" if self.turns else ""
            return f"held by {others}{turn}"
        where = direction_words(self.direction)
        if self.free:
            verb = "comes out" if len(self.blocks) == 1 else "come out as one"
            return f"{verb} {where}, clear after {number(self.clear_after)} mm"
        return f"moves {where} by {number(self.distance)} mm, then meets {others}"

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "blocks": list(self.blocks),
            "direction": None if self.direction is None else self.direction.tolist(),
            "distance": finite(self.distance),
            "free": self.free,
            "clear_after": finite(self.clear_after),
            "met": list(self.met),
            "turns": self.turns,
        }


class Removal:
    """Ways out of the blocks of an assembly, some of which are there."""

    def __init__(self, blocks: AnyBlocks) -> None:
        self.blocks = blocks
        self.sweeps = Sweeps(blocks)
        found = blocks.interfaces
        own = np.concatenate([found.block_m, found.block_s])
        order = np.argsort(own, kind="stable")
        self._start = np.searchsorted(own[order], np.arange(blocks.n_blocks + 1))
        self._other = np.concatenate([found.block_s, found.block_m])[order]
        self._normals = np.concatenate([-found.normals, found.normals])[order]

    def touching(self, block: int, there: BoolArray) -> tuple[IntArray, FloatArray]:
        """Block and normal into ``block`` of its contacts with blocks that are there."""
        here = slice(self._start[block], self._start[block + 1])
        kept = there[self._other[here]]
        return self._other[here][kept], self._normals[here][kept]

    def way_out(self, group: Sequence[int], there: BoolArray) -> WayOut:
        """Move blocks as one out of those that are there, (n_blocks,), as far as they get."""
        moving, rest = np.array(group), there.copy()
        rest[moving] = False
        touching = [self.touching(block, rest) for block in group]
        touched = np.unique(np.concatenate([neighbours for neighbours, _ in touching]))
        ways = free_directions(np.concatenate([normals for _, normals in touching]))
        stops = set(touched.tolist())
        if not len(ways):
            met_first = tuple(touched.tolist())
            return WayOut(tuple(group), None, 0.0, np.nan, met_first, frozenset(stops))
        others, best = np.flatnonzero(rest), None
        for direction in ways:
            met = self.sweeps.along(direction, moving, others).min(axis=0)
            stops |= set(np.flatnonzero(np.isfinite(met)).tolist())
            distance = float(met.min(initial=np.inf))
            if best is None or distance > best[0]:
                best = distance, direction, met
            if np.isinf(distance):
                return WayOut(
                    tuple(group), direction, distance, self._clear(direction, group, rest), ()
                )
        assert best is not None
        distance, direction, met = best
        first = np.flatnonzero(met <= distance * (1.0 + 1e-9) + 1e-12)
        met_first = tuple(first.tolist())
        return WayOut(tuple(group), direction, distance, np.nan, met_first, frozenset(stops))

    def _clear(self, direction: FloatArray, group: Sequence[int], rest: BoolArray) -> float:
        """Way after which blocks have passed the ends of those of the rest that they touch."""
        return max(
            self.sweeps.clear_after(direction, block, np.unique(self.touching(block, rest)[0]))
            for block in group
        )

    def turns(self, block: int) -> bool:
        """Whether a block has any first-order motion while all others stay."""
        held = np.ones(self.blocks.n_blocks, np.bool_)
        held[block] = False
        contacts = contact_jacobian(self.blocks, held)
        found = classify(contacts.jacobian, np.zeros(contacts.jacobian.shape[0]))
        return isinstance(found.certificate, Mechanism)

    def _directions(self, there: BoolArray, stay: BoolArray) -> FloatArray:
        """Axes, and rays of the cones of blocks and of their few faces, (n_directions, 3)."""
        directions = [_AXES]
        for block in np.flatnonzero(there & ~stay).tolist():
            normals = _distinct(self.touching(block, there)[1])
            directions.append(free_directions(normals))
            if len(normals) <= _FEW_NORMALS:
                directions.append(_rays(normals))
        return _distinct(np.concatenate(directions))[:_MOST_DIRECTIONS]

    def _pressed(self, direction: FloatArray) -> BoolArray:
        """Whether a block that moves along a direction presses another, (n_blocks, n_blocks)."""
        found, n = self.blocks.interfaces, self.blocks.n_blocks
        result, closing = np.zeros((n, n), np.bool_), found.normals @ direction
        ahead, behind = closing > ANGLE, closing < -ANGLE
        result[found.block_m[ahead], found.block_s[ahead]] = True
        result[found.block_s[behind], found.block_m[behind]] = True
        return result

    @staticmethod
    def _open(blocked: BoolArray, stay: BoolArray) -> list[IntArray]:
        """Groups that move as one and are stopped by no other, the smallest first."""
        n, of = connected_components(csr_array(blocked.astype(np.int8)), connection="strong")
        row, column = np.nonzero(blocked)
        stopped = np.zeros(n, np.bool_)
        stopped[of[row][of[row] != of[column]]] = True
        stopped[of[stay]] = True
        groups = [np.flatnonzero(of == group) for group in np.flatnonzero(~stopped)]
        return sorted((g for g in groups if len(g) < len(of)), key=len)

    def group_out(self, there: BoolArray, stay: BoolArray) -> WayOut | None:
        """Find the smallest group that gets away as one from those that are there.

        ``stay``: blocks that do not move, (n_blocks,). None: no group has a straight way out.
        """
        placed = np.flatnonzero(there)
        best: tuple[IntArray, FloatArray] | None = None
        for direction in self._directions(there, stay):
            blocked = self._pressed(direction)[np.ix_(placed, placed)]
            groups = self._open(blocked, stay[placed])
            if not groups or (best and len(groups[0]) >= len(best[0])):
                continue
            # Those that contacts do not stop may still run into others on their way.
            met = np.isfinite(self.sweeps.along(direction, placed, placed, skip=blocked))
            groups = self._open(blocked | met[:, placed], stay[placed])
            if groups and (best is None or len(groups[0]) < len(best[0])):
                best = placed[groups[0]], direction
        if best is None:
            return None
        group, direction = best
        rest = there.copy()
        rest[group] = False
        members = group.tolist()
        return WayOut(tuple(members), direction, np.inf, self._clear(direction, members, rest), ())


def _more(title: str, n: int) -> list[Row]:
    """A row for those of so many that are not printed."""
    return [Row(title, f"{n - _SHOWN} more, in the report")] if n > _SHOWN else []


@dataclass(frozen=True)
class TakeOut:
    """Which block comes out, and the order in which all of it comes apart."""

    blocks: AnyBlocks = field(repr=False)
    each: tuple[WayOut, ...]
    """Every free block alone, all others where they are."""
    order: tuple[WayOut, ...]
    """Blocks and groups one after the other, until nothing more comes out."""
    left: tuple[int, ...]
    """Free blocks that do not come out; empty where all of it comes apart."""
    clearance: float
    """By which a block that moves is thinned [mm]."""

    @cached_property
    def assembly_order(self) -> tuple[tuple[int, ...], ...]:
        """The same in reverse: blocks and groups in the order in which they can be placed."""
        return tuple(way.blocks for way in reversed(self.order))

    @property
    def words(self) -> str:
        """Whether all of it comes apart."""
        n = len(self.each)
        if not self.left:
            groups = sum(len(way.blocks) > 1 for way in self.order)
            as_groups = f", {groups} times several as one" if groups else ""
            return f"all {n} free blocks come out one after the other{as_groups}"
        names = first_of(map(self.blocks.named, self.left), 6)
        return (
            f"no order by translations of one group at a time: {n - len(self.left)} of {n} free "
            f"blocks come out; {names} hold each other"
        )

    @property
    def rows(self) -> list[Row]:
        """The order, each block alone, and what the search is exact to."""
        named = self.blocks.named
        alone = sum(way.free for way in self.each)
        rows = [Row("come out alone", f"{alone} of {len(self.each)} free blocks", alone, "-")]
        rows += [
            Row("each block", f"{named(way.blocks[0])} {way.words(named)}")
            for way in self.each[:_SHOWN]
        ]
        rows += _more("each block", len(self.each))
        for step, way in enumerate(self.order[:_SHOWN], 1):
            who = ", ".join(map(named, way.blocks))
            rows.append(Row("order", f"{step}: {who} {way.words(named)}"))
        rows += _more("order", len(self.order))
        exact = (
            f"straight motions; directions to {ANGLE:g} rad, curved faces as their flat facets; "
            f"passages narrower than {number(self.clearance)} mm a side count as passed"
        )
        return grouped(
            verdict=[Row("take-out", self.words)], measures=rows, evidence=[Row("ways", exact)]
        )

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "words": self.words,
            "each": [way.as_json() for way in self.each],
            "order": [way.as_json() for way in self.order],
            "left": list(self.left),
            "clearance": self.clearance,
        }


def take_out(blocks: AnyBlocks, progress: Callable[[str], None] | None = None) -> TakeOut:
    """Find which block comes out by a straight motion, and an order in which all come out.

    Fixed blocks stay. Of blocks that could come out next, the highest does.
    """
    tell = progress or (lambda _: None)
    search, stay = Removal(blocks), blocks.fixed.copy()
    there = blocks.originals == np.arange(blocks.n_blocks)
    free = np.flatnonzero(there & ~stay).tolist()
    each = []
    for done, block in enumerate(free):
        tell(f"ways out: {done} of {len(free)} blocks")
        way = search.way_out([block], there)
        each.append(way if way.direction is not None else replace(way, turns=search.turns(block)))
    order, left = _order(search, there, stay, each, tell)
    return TakeOut(blocks, tuple(each), order, left, search.sweeps.clearance)


def _order(
    search: Removal,
    there: BoolArray,
    stay: BoolArray,
    each: Sequence[WayOut],
    tell: Callable[[str], None],
) -> tuple[tuple[WayOut, ...], tuple[int, ...]]:
    """Blocks one after the other, groups where none comes out alone; and what does not."""
    height = search.blocks.centroids[:, 2]
    known = {way.blocks[0]: way for way in each}
    there, order, groups = there.copy(), [], []
    n_free = len(known)

    def again(gone: Sequence[int]) -> None:
        """Ask those anew that were stopped by what is gone."""
        for block, way in known.items():
            if not way.free and not way.stops.isdisjoint(gone):
                known[block] = search.way_out([block], there)

    while known:
        tell(f"order: {n_free - len(known)} of {n_free} blocks are out")
        out = [block for block, way in known.items() if way.free]
        if out:
            block = max(out, key=lambda k: (round(float(height[k]), 6), -k))
            order.append(known.pop(block))
            there[block] = False
            again([block])
            continue
        way = search.group_out(there, stay)
        if way is None:
            break
        order.append(way)
        groups.append(way.blocks)
        for block in way.blocks:
            del known[block]
        there[list(way.blocks)] = False
        again(way.blocks)
    left = tuple(sorted(known))
    for group in groups:
        inside = np.zeros_like(there)
        inside[list(group)] = True
        first = np.zeros_like(stay)
        first[min(group, key=lambda k: (round(float(height[k]), 6), k))] = True
        ways = [search.way_out([block], inside) for block in group if not first[block]]
        apart, rest = _order(search, inside, first, ways, tell)
        order += apart
        left += rest
    return tuple(order), left
