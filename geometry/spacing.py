"""Blocks moved apart: where each one goes."""

from __future__ import annotations

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from geometry.placed_blocks import AssemblyError


def spacing_offsets(assembly: Assembly, spacing: float) -> FloatArray:
    """Translations that move touching blocks apart.

    Layers move apart along the axis by the spacing. Within a layer, blocks move across the
    axis so that the mean gap between each two neighbours is the spacing, with translations of
    least norm: outward in a ring, sideways in a wall. Frame blocks move with their layer, images
    of a periodic cell as what they are images of.

    Blocks of neighbouring layers thereby slip against each other, so where their common face
    is inclined the gap measured along the normal is less or more than the spacing.

    Parameters
    ----------
    assembly
        Conforming blocks.
    spacing
        [mm]; a negative one presses the blocks into each other.

    Returns
    -------
    FloatArray
        (n_blocks, 3) [mm].

    Raises
    ------
    AssemblyError
        A spacing that is not finite.
    """
    if not np.isfinite(spacing):
        raise AssemblyError(f"contact.spacing: got {spacing}, expected a finite length in mm")
    if spacing == 0.0:
        return np.zeros((assembly.n_blocks, 3))
    opening = _opening_of_layers(assembly)[assembly.originals]
    return spacing * (np.outer(assembly.layer, assembly.axis) + opening)


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
