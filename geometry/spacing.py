"""Initial clearance made by spacing the blocks: where each block goes."""

from __future__ import annotations

import numpy as np

from geometry.assembly import Assembly, AssemblyError
from geometry.mesh import FloatArray


def clearance_offsets(assembly: Assembly, clearance: float) -> FloatArray:
    """Translations that open the gaps between touching blocks by a clearance.

    Layers move apart along the axis by the clearance. Within a layer, blocks move across the
    axis so that the mean gap between each two neighbours is the clearance, with translations of
    least norm: outward in a ring, sideways in a wall. Frame blocks move with their layer.

    Blocks of neighbouring layers thereby slip against each other, so where their common face
    is inclined the gap measured along the normal is less or more than the clearance.

    Parameters
    ----------
    assembly
        Conforming blocks.
    clearance
        [mm]; a negative one presses the blocks into each other.

    Returns
    -------
    FloatArray
        (n_blocks, 3) [mm].

    Raises
    ------
    AssemblyError
        A clearance that is not finite.
    """
    if not np.isfinite(clearance):
        raise AssemblyError(
            f"contact.initial_clearance: got {clearance}, expected a finite length in mm"
        )
    if clearance == 0.0:
        return np.zeros((assembly.n_blocks, 3))
    offsets = np.outer(assembly.layer, assembly.axis) + _opening_of_layers(assembly)
    return clearance * offsets


def _opening_of_layers(assembly: Assembly) -> FloatArray:
    """Translations across the axis that open neighbours within a layer by one; (n_blocks, 3)."""
    found = assembly.interfaces
    first = found.pair_start[:-1]
    m, s = found.block_m[first], found.block_s[first]
    normal = np.add.reduceat(found.areas[:, None] * found.normals, first, axis=0)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal -= np.outer(normal @ assembly.axis, assembly.axis)
    inside = np.flatnonzero(assembly.layer[m] == assembly.layer[s])
    opening = np.zeros((assembly.n_blocks, 3))
    for layer in np.unique(assembly.layer[m[inside]]):
        pairs = inside[assembly.layer[m[inside]] == layer]
        blocks = np.flatnonzero(assembly.layer == layer)
        rates = np.zeros((len(pairs), len(blocks), 3))
        row = np.arange(len(pairs))
        rates[row, np.searchsorted(blocks, m[pairs])] -= normal[pairs]
        rates[row, np.searchsorted(blocks, s[pairs])] += normal[pairs]
        least = np.linalg.lstsq(rates.reshape(len(pairs), -1), np.ones(len(pairs)))[0]
        opening[blocks] = least.reshape(-1, 3)
    return opening
