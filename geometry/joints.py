"""Joints between blocks whose facets do not match corner on corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray


@dataclass(frozen=True)
class UnmatchedJoint:
    """Two blocks that touch where their facets do not all match."""

    block_m: int
    """One block."""
    block_s: int
    """The other one."""
    touching: float
    """Area on which they touch [mm²]."""
    matched: float
    """Area of it on which facets match corner on corner [mm²]."""
    toward: FloatArray
    """Direction in which the face of block m looks, (3,)."""

    def __str__(self) -> str:
        """Say which blocks, which face, and how much of it matches."""
        return (
            f"the meshes of blocks {self.block_m} and {self.block_s} do not match: facets meet "
            f"corner on corner on {self.matched:.4g} of the {self.touching:.4g} mm² on which the "
            f"blocks touch (face of block {self.block_m} that looks along "
            f"{np.round(self.toward, 3).tolist()})"
        )


def matched_area(assembly: Assembly, block_m: int, block_s: int) -> float:
    """Area of the facets of two blocks that coincide corner on corner [mm²]."""
    found = assembly.interfaces
    meets = (found.block_m == block_m) & (found.block_s == block_s)
    return float(found.areas[meets].sum())


def between_layers(assembly: Assembly, contacts: IntArray, lower: int) -> IntArray:
    """Rows of ``contacts``, places in the interfaces, between a layer and the next one, (n,)."""
    found = assembly.interfaces
    return facets_between(assembly.layer, found.block_m[contacts], found.block_s[contacts], lower)


def facets_between(layer: IntArray, block_m: IntArray, block_s: IntArray, lower: int) -> IntArray:
    """Facets that lie between a layer and the next one, (n,).

    Parameters
    ----------
    layer
        Of each block, (n_blocks,).
    block_m, block_s
        Both blocks of each facet, (n_facets,).
    lower
        The lower layer.
    """
    m, s = layer[block_m], layer[block_s]
    return np.flatnonzero((np.minimum(m, s) == lower) & (np.maximum(m, s) == lower + 1))
