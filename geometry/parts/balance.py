"""Balance of blocks, and the resultants of what holds an assembly, from the table of its joints.

All methods use the same two sums. A joint acts on block s with its force and moment about its
centroid, and on block m with the opposite. What is left of a block's joints, loads, weight and
supports shows whether the printed forces are those of the solution.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.mesh import FloatArray, IntArray
from geometry.parts.measures import JointResultants, Resultants
from geometry.parts.rows import Row, number

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

    @property
    def thrusts(self) -> FloatArray:
        """Size of the horizontal part, across z, (n,) [N]."""
        return np.linalg.norm(self.forces - np.outer(self.forces @ _UP, _UP), axis=1)

    def as_json(self) -> dict[str, dict[str, Any]]:
        """Return plain data by name: force [N], moment about the origin [N mm], point, thrust."""
        moments = self.moments + np.cross(self.centroids, self.forces)
        return {
            name: {
                "force": self.forces[k].tolist(),
                "moment": moments[k].tolist(),
                "point": self.points[k].tolist(),
                "horizontal": float(self.thrusts[k]),
            }
            for k, name in enumerate(self.names)
        }


def of_supports(wrenches: Mapping[str, FloatArray], middles: Mapping[str, FloatArray]) -> Reactions:
    """Reactions of named supports.

    From force and moment about the origin (6,) [N, N mm] of each, and the middle of its region
    (3,) [mm].
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
    )


def of_fixed_blocks(assembly: AnyBlocks, joints: JointResultants, fixed: IntArray) -> Reactions:
    """Forces of fixed blocks (n,) on the others, those that touch none left out."""
    held = np.zeros(assembly.n_blocks, dtype=np.bool_)
    held[fixed] = True
    names, rows = [], []
    for block in fixed.tolist():
        ours = (joints.block_m == block) & ~held[joints.block_s]
        theirs = (joints.block_s == block) & ~held[joints.block_m]
        at = np.flatnonzero(ours | theirs)
        if not len(at):
            continue
        sign = np.where(ours, 1.0, -1.0)[at, None]
        area, force = joints.areas[at], sign * joints.forces[at]
        share = area / area.sum() if area.any() else np.full(len(at), 1.0 / len(at))
        middle = share @ joints.centroids[at]
        normal = share @ (sign * joints.normals[at])
        moment = sign * joints.moments[at] + np.cross(joints.centroids[at] - middle, force)
        size = float(np.linalg.norm(normal))
        total = force.sum(axis=0), moment.sum(axis=0)
        if len(at) > 1 or not size:  # no plane: the nearest point to the middle
            size, normal = float(np.linalg.norm(total[0])) or 1.0, total[0]
        rows.append((float(area.sum()), middle, normal / size, *total))
        names.append(f"block {assembly.named(block)}")
    none = (np.zeros(0), *(np.zeros((0, 3)) for _ in range(4)))
    area, *vectors = (np.array(v) for v in zip(*rows, strict=True)) if rows else none
    centroids, normals, forces, moments = vectors
    return Reactions(
        names=tuple(names),
        areas=area,
        centroids=centroids,
        normals=normals,
        forces=forces,
        moments=moments,
    )


def together(one: Reactions, two: Reactions) -> Reactions:
    """Rows of both."""
    values = {
        name: np.concatenate([getattr(one, name), getattr(two, name)])
        for name in ("areas", "centroids", "normals", "forces", "moments")
    }
    return replace(one, names=(*one.names, *two.names), **values)


def reaction_rows(reactions: Mapping[str, Mapping[str, Any]], most: int = 6) -> list[Row]:
    """Name, force, point of action and horizontal part, of the largest ``most``.

    Parts below a billionth of the largest force are printed as zero.
    """
    size = {name: float(np.linalg.norm(one["force"])) for name, one in reactions.items()}
    largest = max(size.values(), default=0.0)
    chosen = sorted(size, key=lambda name: -round(size[name] / (largest or 1.0), 6))[:most]

    def shown(values: Sequence[float], least: float) -> str:
        return ", ".join(number(0.0 if abs(v) <= least else v) for v in values)

    rows = []
    for name in (name for name in reactions if name in chosen):
        one, words = reactions[name], ""
        if size[name] > 1e-9 * largest:
            words = f" at ({shown(one['point'], 1e-6)}) mm, horizontal thrust "
            words += f"{shown([one['horizontal']], 1e-9 * largest)} N"
        words = f"{name}: ({shown(one['force'], 1e-9 * largest)}) N{words}"
        rows.append(Row("reactions", words, size[name], "N"))
    left = len(reactions) - len(rows)
    return [*rows, Row("reactions", f"{left} more, in the report")] if left else rows
