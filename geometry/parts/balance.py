"""Balance of blocks, and the resultants of what holds an assembly, from the table of its joints.

All methods use the same two sums. A joint acts on block s with its force and moment about its
centroid, and on block m with the opposite. What is left of a block's joints, loads, weight and
supports shows whether the printed forces are those of the solution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from geometry.mesh import FloatArray, IntArray
from geometry.parts.measures import JointResultants, Resultants
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, finite, number

#: Part of the forces on a block below which supports have taken all of them.
_TAKEN = 1e-9
#: Part of the size of an assembly by which supports of a ring may lie apart from it.
_RING = 1e-3
#: Direction that is vertical where thrusts are horizontal.
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Imbalance:
    """Largest force and moment that the printed forces leave on one block."""

    force: float
    """Over the largest joint force, or what acts on one block where that is larger [-]."""
    moment: float
    """Over the same force times the characteristic length of the blocks [-]."""
    block: int
    """Block of the larger one."""

    @property
    def largest(self) -> float:
        """The larger one [-]."""
        return max(self.force, self.moment)

    def as_json(self) -> dict[str, float | int]:
        """Return it as plain data."""
        return {"force": self.force, "moment": self.moment, "block": self.block}


def joint_wrenches(assembly: AnyBlocks, joints: JointResultants, centres: FloatArray) -> FloatArray:
    """Force and moment of the joints of each block about its centre, (n_blocks, 6) [N, N mm].

    What joints do to periodic images counts for their originals. Centres are (n_blocks, 3) [mm].
    """
    result, originals = np.zeros((assembly.n_blocks, 6)), assembly.originals
    alike = np.zeros_like(joints.forces) if joints.couples is None else joints.couples
    for blocks, sign in ((joints.block_m, -1.0), (joints.block_s, 1.0)):
        moment = joints.moments + np.cross(joints.centroids - centres[blocks], joints.forces)
        back = assembly.rotations[originals[blocks]] @ assembly.rotations[blocks].swapaxes(1, 2)
        force, moment = (
            np.einsum("jik,jk->ji", back, v) for v in (sign * joints.forces, sign * moment + alike)
        )
        np.add.at(result, originals[blocks], np.hstack([force, moment]))
    return result


def imbalance(
    assembly: AnyBlocks,
    joints: JointResultants,
    *,
    acting: FloatArray,
    others: FloatArray,
    centres: FloatArray,
    free: IntArray,
) -> Imbalance:
    """Measure what joints and other forces leave of a balance.

    Parameters
    ----------
    assembly
        The blocks.
    joints
        Their joints.
    acting
        Sizes of the loads at the points of each block and of its weight, summed, (n_blocks,) [N]:
        not their resultant, which is zero where they balance each other.
    others
        Force and moment about its centre of everything but joints on each block, (n_blocks, 6) [N,
        N mm]: loads and supports; of deformable blocks less what stress and inertia take.
    centres
        (n_blocks, 3) [mm].
    free
        Blocks to be balanced, (n,).
    """
    if not len(free):
        return Imbalance(0.0, 0.0, -1)
    left = (joint_wrenches(assembly, joints, centres) + others)[free]
    size = max(np.linalg.norm(joints.forces, axis=1).max(initial=0.0), acting[free].max()) or 1.0
    parts = np.stack([np.linalg.norm(left[:, :3], axis=1), np.linalg.norm(left[:, 3:], axis=1)])
    parts /= size * np.array([[1.0], [assembly.characteristic_length]])
    block = int(free[parts.max(axis=0).argmax()])
    return Imbalance(float(parts[0].max()), float(parts[1].max()), block)


@dataclass(frozen=True, kw_only=True)
class Reactions(Resultants):
    """Resultants of what holds an assembly, one row for each fixed block and named support.

    Forces act on the blocks that are held. `Resultants.points` is where they act: of a fixed block
    on its joints, of a support the nearest point to the middle of its region.
    """

    names: tuple[str, ...]
    """Of the supports; numbers of fixed blocks, with their names."""
    outward: FloatArray
    """Sum of the horizontal parts with which the blocks push a support away from its middle, of
    supports that close on themselves; nan of others; (n,) [N]."""

    @property
    def thrusts(self) -> FloatArray:
        """Horizontal part, across z, of all together or outwards, the larger one, (n,) [N]."""
        resultant = np.linalg.norm(self.forces - np.outer(self.forces @ _UP, _UP), axis=1)
        return np.where(np.abs(self.outward) > resultant, self.outward, resultant)

    def as_json(self) -> dict[str, dict[str, Any]]:
        """Return plain data by name: force [N], moment about the origin [N mm], point, thrust."""
        moments = self.moments + np.cross(self.centroids, self.forces)
        return {
            name: {
                "force": self.forces[k].tolist(),
                "moment": moments[k].tolist(),
                "point": self.points[k].tolist(),
                "horizontal": float(self.thrusts[k]),
                "outward": finite(self.outward[k]),
                **self._in_ring(k),
            }
            for k, name in enumerate(self.names)
        }

    @cached_property
    def rings(self) -> tuple[IntArray, ...]:
        """Supports of each ring: three or more at one height and distance from their middle."""
        level = self.centroids[:, 2], self._size * _RING
        _, levels = np.unique(np.round(level[0] / (level[1] or 1.0)), return_inverse=True)
        result = []
        for one in range(levels.max(initial=-1) + 1):
            here = np.flatnonzero(levels == one)
            arms = np.linalg.norm(self._arms(here), axis=1)
            closed = np.isfinite(outward_thrust(self.centroids[here], self.forces[here]))
            if closed and np.ptp(arms) <= level[1]:
                result.append(here)
        return tuple(result)

    @property
    def _size(self) -> float:
        """Largest distance of two supports along an axis [mm]."""
        return float(np.ptp(self.centroids, axis=0).max()) if len(self.centroids) else 0.0

    def _arms(self, ring: IntArray) -> FloatArray:
        """Horizontal part from the middle of some supports to each of them, (n, 2) [mm]."""
        at: FloatArray = self.centroids[ring, :2]
        return at - at.mean(axis=0)

    def _in_ring(self, support: int) -> dict[str, Any]:
        """Number of its ring, and the horizontal part away from its middle; empty: in none."""
        for which, ring in enumerate(self.rings):
            if support in ring:
                arm = self._arms(ring)[ring == support][0]
                radial = -float(self.forces[support, :2] @ arm / np.linalg.norm(arm))
                return {"ring": which, "radial": radial}
        return {}


def outward_thrust(points: FloatArray, forces: FloatArray) -> float:
    """Sum of the horizontal parts of thrusts at points that lead away from their middle [N].

    ``forces`` (n, 3) are those on the blocks, opposite to the thrusts; nan where the points (n, 3)
    do not surround their middle: then the thrust has one direction.
    """
    if len(points) < 3:
        return np.nan
    arms = (points - points.mean(axis=0))[:, :2]
    size = np.linalg.norm(arms, axis=1)
    away = size > 1e-6 * size.max(initial=0.0)
    angles = np.sort(np.arctan2(*arms[away].T[::-1]))
    gaps = np.diff(angles, append=angles[:1] + 2.0 * np.pi)
    if not len(gaps) or gaps.max() > (1.0 - 1e-6) * np.pi:
        return np.nan
    return -float(np.sum(forces[away, :2] * arms[away] / size[away, None]))


def of_supports(
    wrenches: Mapping[str, FloatArray],
    middles: Mapping[str, FloatArray],
    outward: Mapping[str, float] | None = None,
) -> Reactions:
    """Reactions of named supports.

    From force and moment about the origin (6,) [N, N mm] of each, the middle of its region (3,)
    [mm], and its outward thrust [N], if that is known.
    """
    rows = np.array([wrenches[name] for name in wrenches]).reshape(-1, 6)
    at = np.array([middles[name] for name in wrenches]).reshape(-1, 3)
    size = np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    return Reactions(
        names=tuple(wrenches),
        areas=np.zeros(len(rows)),
        centroids=at,
        normals=np.divide(rows[:, :3], size, out=np.zeros((len(rows), 3)), where=size > 0.0),
        forces=rows[:, :3],
        moments=rows[:, 3:] - np.cross(at, rows[:, :3]),
        outward=np.array([(outward or {}).get(name, np.nan) for name in wrenches]),
    )


def of_fixed_blocks(
    assembly: AnyBlocks,
    joints: JointResultants,
    fixed: IntArray,
    others: FloatArray | None = None,
) -> Reactions:
    """What holds fixed blocks (n,), against their joints with the rest and all else that acts.

    Parameters
    ----------
    assembly, joints
        The blocks and their joints.
    fixed
        Numbers of the fixed blocks, (n,). Those that touch none and on which nothing else acts are
        left out, and those that their supports hold.
    others
        Force and moment of loads and supports on each block about its mass centroid, (n_blocks, 6)
        [N, N mm]; None: nothing acts.
    """
    held = np.zeros(assembly.n_blocks, dtype=np.bool_)
    held[fixed] = True
    names, rows = [], []
    for block in fixed.tolist():
        ours = (joints.block_m == block) & ~held[joints.block_s]
        theirs = (joints.block_s == block) & ~held[joints.block_m]
        at = np.flatnonzero(ours | theirs)
        acting = np.zeros(6) if others is None else others[block]
        if not (len(at) or acting.any()):
            continue
        sign = np.where(ours, 1.0, -1.0)[at, None]
        area, force = joints.areas[at], sign * joints.forces[at]
        share = area / area.sum() if area.any() else np.full(len(at), 1.0 / max(len(at), 1))
        middle = share @ joints.centroids[at] if len(at) else assembly.centroids[block]
        normal = share @ (sign * joints.normals[at])
        moment = sign * joints.moments[at] + np.cross(joints.centroids[at] - middle, force)
        arm = assembly.centroids[block] - middle
        total = (
            force.sum(axis=0) - acting[:3],
            moment.sum(axis=0) - acting[3:] - np.cross(arm, acting[:3]),
        )
        size = float(np.linalg.norm(force, axis=1).sum() + np.linalg.norm(acting[:3]))
        if acting.any() and np.linalg.norm(total[0]) <= _TAKEN * size:
            continue
        size = float(np.linalg.norm(normal))
        if len(at) != 1 or acting.any() or not size:  # no plane: the nearest point to the middle
            size, normal = float(np.linalg.norm(total[0])) or 1.0, total[0]
        pushed = outward_thrust(joints.centroids[at], force)
        rows.append((float(area.sum()), pushed, middle, normal / size, *total))
        names.append(f"block {assembly.named(block)}")
    none = (np.zeros(0), np.zeros(0), *(np.zeros((0, 3)) for _ in range(4)))
    area, thrusts, *vectors = (np.array(v) for v in zip(*rows, strict=True)) if rows else none
    centroids, normals, forces, moments = vectors
    return Reactions(
        names=tuple(names),
        areas=area,
        centroids=centroids,
        normals=normals,
        forces=forces,
        moments=moments,
        outward=thrusts,
    )


def together(one: Reactions, two: Reactions) -> Reactions:
    """Rows of both."""
    values = {
        name: np.concatenate([getattr(one, name), getattr(two, name)])
        for name in ("areas", "centroids", "normals", "forces", "moments", "outward")
    }
    return replace(one, names=(*one.names, *two.names), **values)


def reaction_rows(reactions: Mapping[str, Mapping[str, Any]], most: int = 6) -> list[Row]:
    """Name, force, point of action and horizontal part, of the largest ``most``.

    The supports of a ring share a row: their sum, and the radial thrust of each, largest first.
    Parts below a billionth of the largest force are printed as zero.
    """
    size = {name: float(np.linalg.norm(one["force"])) for name, one in reactions.items()}
    largest = max(size.values(), default=0.0)
    alone = [name for name, one in reactions.items() if "ring" not in one]
    chosen = sorted(alone, key=lambda name: -round(size[name] / (largest or 1.0), 6))[:most]

    def shown(values: Iterable[float], least: float = 1e-9 * largest) -> str:
        return ", ".join(number(0.0 if abs(v) <= least else v) for v in values)

    rows = []
    for ring in dict.fromkeys(one["ring"] for one in reactions.values() if "ring" in one):
        names = [name for name, one in reactions.items() if one.get("ring") == ring]
        rows.append(_ring_row({name: reactions[name] for name in names}, shown))
    for name in (name for name in alone if name in chosen):
        one, words = reactions[name], ""
        if size[name] > 1e-9 * largest:
            words = f" at ({shown(one['point'], 1e-6)}) mm, horizontal thrust "
            words += f"{shown([abs(one['horizontal'])])} N"
            if one["outward"] == one["horizontal"]:
                way = "outward" if one["outward"] > 0.0 else "inward"
                words += f" {way}, summed around the support"
        words = f"{name}: ({shown(one['force'])}) N{words}"
        rows.append(Row("reactions", words, size[name], "N"))
    left = len(alone) - len(chosen)
    return [*rows, Row("reactions", f"{left} more, in the report")] if left else rows


def balance_rows(report: Mapping[str, Any]) -> list[Row]:
    """What the printed forces leave of the balance of a block; none where it is not reported."""
    if "imbalance" not in report:
        return []
    left = report["imbalance"]
    words = f"force {left['force']:.1e}, moment {left['moment']:.1e} of the largest joint force"
    return [Row("largest imbalance of a block", words, max(left["force"], left["moment"]))]


def _ring_row(
    ring: Mapping[str, Mapping[str, Any]], shown: Callable[[Iterable[float]], str]
) -> Row:
    """Row of the supports of a ring."""
    order = sorted(ring, key=lambda name: -round(abs(ring[name]["radial"]), 6))
    each = [shown([ring[name]["radial"]]) for name in order]
    names = [name.removeprefix("block ") for name in order]
    total = np.sum([one["force"] for one in ring.values()], axis=0)
    words = f"{len(names)} supports of a ring: sum ({shown(total)}) N, radial thrust outward "
    if len(set(each)) == 1:
        words += f"{each[0]} N each (blocks {', '.join(names)})"
    else:
        words += ", ".join(f"{value} N ({name})" for name, value in zip(names, each, strict=True))
    return Row("reactions", words, float(np.linalg.norm(total)), "N")
