"""Supports of rigid blocks along single directions: what they hold, and with which forces.

A support without friction holds the points of a region along its directions from both sides. It
adds no contact: it takes motions (δt, ℓ δθ) from its block. The equations of all analyses are
those of the motions that are left; the wrench that they leave unbalanced is that of the supports.
"""

from __future__ import annotations

import numpy as np

from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray
from geometry.parts.balance import Reactions, of_supports, outward_thrust
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import HeldFace, region_points

#: Singular values of the held motions below this fraction of the largest are round-off: points
#: may lie off their plane by a millionth of a block.
_RANK = 1e-5
#: Parts of what is projected below this fraction of it are round-off.
_ROUND_OFF = 1e-12


class RigidSupportError(RefusedError):
    """A support that rigid blocks do not have."""


class Guide(HeldFace):
    """A support that its block moves along the displacement by any amount, without force."""

    @property
    def moves(self) -> bool:
        """Whether its motion is prescribed: only the direction is."""
        return False


def check_supports(held: tuple[HeldFace, ...]) -> None:
    """Reject springs and supports that move."""
    for support in held:
        if support.spring is not None:
            raise RigidSupportError(
                f"support {support.title}: got springs; the rigid-block analysis has no "
                "stiffness: hold the directions fast, or use the static solver"
            )
        if support.moves:
            raise RigidSupportError(
                f"support {support.title}: got a support that moves; the rigid-block analysis is "
                "of blocks in their place: remove the motion, or use the static solver"
            )


def free_motions(
    assembly: AnyBlocks, held: tuple[HeldFace, ...], blocks: IntArray, length: float
) -> FloatArray | None:
    """Projectors on the motions (δt, ℓ δθ) that supports leave to some blocks.

    Returns
    -------
    FloatArray | None
        (n, 6, 6); None where no support holds any of the blocks.

    Raises
    ------
    RigidSupportError
        As `check_supports`.
    """
    check_supports(held)
    result = None
    for block in sorted({support.block for support in held} & set(blocks.tolist())):
        if result is None:
            result = np.tile(np.eye(6), (len(blocks), 1, 1))
        rows = [_unit_wrenches(assembly, s, length) for s in held if s.block == block]
        _, size, right = np.linalg.svd(np.concatenate(rows), full_matrices=False)
        taken = right[size > _RANK * size[0]]
        result[blocks == block] -= taken.T @ taken
    return result


def _unit_wrenches(assembly: AnyBlocks, support: HeldFace, length: float) -> FloatArray:
    """Wrenches (F, M/ℓ) of unit forces along its directions at all points, (n_axes · n, 6)."""
    arm = region_points(assembly, support.block, support.face) - assembly.centroids[support.block]
    parts = [
        np.hstack([np.broadcast_to(axis, arm.shape), np.cross(arm, axis) / length])
        for axis in support.axes
    ]
    result = np.concatenate(parts)
    if isinstance(support, Guide):
        assert support.displacement is not None
        way = np.repeat(support.axes @ support.displacement, len(arm))
        result -= np.outer(way, way @ result) / float(way @ way)
    return result


def admissible(motions: FloatArray | None, rows: FloatArray) -> FloatArray:
    """Part of some rows (n_rows, …) that supports leave, m for each of the (n_free, m, m)."""
    if motions is None:
        return rows
    blocks = rows.reshape(*motions.shape[:2], -1)
    left = np.asarray(motions @ blocks).reshape(rows.shape)
    # A load that supports take leaves round-off, which would be a load of its own.
    return np.where(np.abs(left) > _ROUND_OFF * np.linalg.norm(rows), left, 0.0)


def support_wrenches(
    assembly: AnyBlocks, load: LoadCase, on_blocks: FloatArray
) -> tuple[Reactions, FloatArray]:
    """Resultants of supports by name, and force and moment of all of them on each block.

    Where several supports hold the same motion of a block the forces of least squares are given.

    Parameters
    ----------
    assembly, load
        What is held.
    on_blocks
        Force and moment of loads and contacts about each block's mass centroid, (n_blocks, 6) [N,
        N mm].

    Returns
    -------
    tuple[Reactions, FloatArray]
        Supports of one name are one; wrenches about mass centroids, (n_blocks, 6) [N, N mm].
    """
    length, result = assembly.characteristic_length, dict[str, FloatArray]()
    scale, total = np.repeat([1.0, 1.0 / length], 3), np.zeros_like(on_blocks)
    places: dict[str, list[FloatArray]] = {}
    on_block: dict[str, list[FloatArray]] = {}
    for block in dict.fromkeys(support.block for support in load.held):
        mine = [support for support in load.held if support.block == block]
        rows = [_unit_wrenches(assembly, support, length) for support in mine]
        needed = -on_blocks[block] * scale
        forces = np.linalg.lstsq(np.concatenate(rows).T, needed, rcond=_RANK)[0]
        start = 0
        for support, unit in zip(mine, rows, strict=True):
            wrench = unit.T @ forces[start : start + len(unit)] / scale
            total[block] += wrench
            on_block.setdefault(support.title, []).append(wrench[:3].copy())
            wrench[3:] += np.cross(assembly.centroids[block], wrench[:3])
            result[support.title] = result.get(support.title, np.zeros(6)) + wrench
            places.setdefault(support.title, []).append(
                region_points(assembly, block, support.face)
            )
            start += len(unit)
    middles = {name: np.concatenate(parts).mean(axis=0) for name, parts in places.items()}
    outward = {
        name: outward_thrust(
            np.array([part.mean(axis=0) for part in parts]), np.array(on_block[name])
        )
        for name, parts in places.items()
    }
    return of_supports(result, middles, outward), total
