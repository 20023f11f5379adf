"""The least propping of blocks that do not stand.

Props push up, or along the normals of a centering, at corners of faces that look down and are free.
Their least sum of vertical parts is a cone program beside the forces of the joints. That sum is
unique, its shares are not: of all that have it, those are taken whose squares, of the forces of
props on each block and of the joints, have the least sum. They do not depend on how blocks are
numbered.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.placed import AnyBlocks
from mbd.building.sweeps import Sweeps
from mbd.contacts.jacobian import RigidContacts
from mbd.options import Along
from mbd.programs import Cones, least
from mbd.system import RigidSystem

#: Props below this part of the weight that is placed are none.
NO_PROP = 1e-6
#: By which the sum of props may miss the least one, over the weight: shares are sought within.
_LOOSE = 1e-8
#: Faces whose normal points down by more than this can be propped (cosine).
_DOWN = 0.05
#: Faces of which joints cover more than this part are not free.
_COVERED = 0.99


def least_propping(
    system: RigidSystem, sweeps: Sweeps, may: BoolArray, direction: Along
) -> tuple[FloatArray, FloatArray] | None:
    """Forces of the joints (n_contacts, 3), and props about centroids (n_blocks, 6) [N, N mm].

    ``may``: which blocks may be propped, (n_blocks,). None: nothing balances the weight.
    """
    owner, along, wrenches = _unit_props(system.blocks, sweeps, may, direction)
    if not len(owner):
        return None
    columns = _columns(system.contacts, owner, wrenches)
    found = _least(system, columns, along, owner)
    if found is None:
        return None
    forces, sizes = found
    props = np.zeros((system.blocks.n_blocks, 6))
    np.add.at(props, owner, sizes[:, None] * wrenches)
    return forces, props


def _unit_props(
    blocks: AnyBlocks, sweeps: Sweeps, may: BoolArray, direction: Along
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Block, direction (n, 3) and wrench about the block's centroid (n, 6) of each prop."""
    covered, owner, ways, wrenches = _covered(blocks, sweeps), [], [], []
    for block in np.flatnonzero(may).tolist():
        shape = sweeps.shapes[int(blocks.shape_of[block])]
        normals = shape.plane_normals @ blocks.rotations[block].T
        share = covered.get(block, np.zeros(len(normals))) / shape.plane_areas
        planes = np.flatnonzero((normals[:, 2] < -_DOWN) & (share < _COVERED))
        places = [
            (corner, plane)
            for plane in planes.tolist()
            for corner in np.unique(shape.triangles[shape.plane_of == plane]).tolist()
        ]
        corners, of = np.array(places, np.int64).reshape(-1, 2).T
        along = -normals[of]
        if direction is Along.UP:
            corners = np.unique(corners)
            along = np.tile([0.0, 0.0, 1.0], (len(corners), 1))
        arm = sweeps.points[block][corners] - blocks.centroids[block]
        owner += [block] * len(corners)
        ways.append(along)
        wrenches.append(np.hstack([along, np.cross(arm, along)]))
    none = np.zeros((0, 3))
    return (
        np.array(owner, np.int64),
        np.concatenate([none, *ways]),
        np.concatenate([np.zeros((0, 6)), *wrenches]),
    )


def _covered(blocks: AnyBlocks, sweeps: Sweeps) -> dict[int, FloatArray]:
    """Area of the joints on each plane of the blocks that touch others, by block."""
    found = blocks.interfaces
    result: dict[int, FloatArray] = {}
    for own, sign in ((found.block_m, 1.0), (found.block_s, -1.0)):
        for block in np.unique(own).tolist():
            shape = sweeps.shapes[int(blocks.shape_of[block])]
            normals = shape.plane_normals @ blocks.rotations[block].T
            at = np.flatnonzero(own == block)
            first = np.zeros(len(normals), np.int64)
            first[shape.plane_of[::-1]] = np.arange(len(shape.plane_of))[::-1]
            base = sweeps.points[block][shape.triangles[first, 0]]
            away = np.einsum("cpi,pi->cp", found.centroids[at][:, None] - base, normals)
            turned = 1.0 - (sign * found.normals[at]) @ normals.T
            plane = (np.abs(away) / blocks.characteristic_length + turned).argmin(axis=1)
            area = np.bincount(plane, found.areas[at], len(normals))
            result[block] = result.get(block, 0.0) + area
    return result


def _columns(contacts: RigidContacts, owner: IntArray, wrenches: FloatArray) -> sp.csc_array:
    """Wrenches (n, 6) of unit props in the rows of the free blocks, (n_rows, n)."""
    number_of = np.full(int(contacts.free_blocks.max()) + 1, -1)
    number_of[contacts.free_blocks] = np.arange(len(contacts.free_blocks))
    scaled = wrenches * np.repeat([1.0, 1.0 / contacts.length], 3)
    rows = 6 * number_of[owner][:, None] + np.arange(6)
    columns = np.repeat(np.arange(len(owner)), 6)
    shape = 6 * len(contacts.free_blocks), len(owner)
    result = sp.coo_array((scaled.ravel(), (rows.ravel(), columns)), shape).tocsc()
    motions = contacts.jacobian.motions
    if motions is not None:
        result = sp.block_diag([sp.csc_array(each) for each in motions], format="csc") @ result
    return result


def _least(
    system: RigidSystem, props: sp.csc_array, along: FloatArray, owner: IntArray
) -> tuple[FloatArray, FloatArray] | None:
    """Forces of the joints (n_contacts, 3) and props (n,) of least sum; None: nothing balances.

    Of all that have it, to `_LOOSE`, those of least squares: of the forces of props on each block,
    and of the joints as elsewhere.
    """
    import clarabel

    frictional, load = system.frictional, system.force
    n, k, size = 3 * frictional.n_contacts, len(along), float(np.linalg.norm(load))
    joints, kinds = frictional.cones
    rows: Any = sp.block_diag([joints, sp.eye_array(k + 1)]) if n else sp.eye_array(k + 1)
    cones = Cones(rows, [*kinds, clarabel.NonnegativeConeT(k + 1)])
    # The last unknown is what the sum misses of its limit.
    total = np.concatenate([np.zeros(n), along[:, 2], [1.0]])
    column = system.weights
    axis = 3 * owner[:, None] + np.arange(3)
    entries = along.ravel(), (axis.ravel(), np.repeat(np.arange(k), 3))
    of_block = sp.coo_array(entries, (int(axis.max()) + 1, k)).tocsc()
    squares = sp.block_diag(
        [sp.diags_array(np.repeat(column**-2.0, 3)), of_block.T @ of_block, sp.csc_array((1, 1))]
    )
    balance: Any = sp.hstack([frictional.matrix, props, sp.csc_array((len(load), 1))])
    limited: Any = sp.vstack([balance, sp.csc_array(total[None])])

    def solved(limit: float | None) -> FloatArray | None:
        """Unknowns of least sum, or of least squares within a limit of the sum."""
        if limit is None:
            x, _ = least(balance, -load / size, cones, cost=total)
        else:
            x, _ = least(limited, np.append(-load / size, limit), cones, squares=squares)
        x = np.concatenate([frictional.projected(x[:n].reshape(-1, 3)).ravel(), x[n:].clip(0.0)])
        return x if np.linalg.norm(balance @ x + load / size) <= NO_PROP else None

    lowest = solved(None)
    if lowest is None:
        return None
    shared = solved(float(total @ lowest) + _LOOSE)
    found = lowest if shared is None else shared
    return size * found[:n].reshape(-1, 3), size * found[n:-1]
