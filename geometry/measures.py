"""The paper's measures of a contact pressure field (section "Evaluation criteria and measures").

The printed "Effective contact area [%]" is a *count* of surface elements, 100 N_eff,j / k_b
averaged over the free blocks; that of K_j = ⌊N_eff,j⌋ whole elements and their area stand beside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.mesh import FloatArray, IntArray

#: Pressures below this fraction of the largest are round-off of the solver.
_ROUND_OFF = 1e-12


@dataclass(frozen=True)
class Measures:
    """Averages over the free blocks."""

    effective_count_percent: float
    """Mean of 100 K_j / k_b: whole elements counted [%]."""
    participation_percent: float
    """Mean of 100 N_eff,j / k_b, not rounded down: what the paper's tables print as effective
    contact area [%]."""
    effective_area_percent: float
    """Mean of 100 (area of the K_j elements) / (eligible area of the block) [%]."""
    p_eff: float
    """Effective mean contact pressure as the formula prints it: mean over blocks of the mean of
    the K_j largest [MPa]."""
    p_eff_pooled: float
    """The same pooled over blocks, as the printed tables have it: Σ_j Σ_{i≤K_j} p_ij / Σ_j K_j
    [MPa]."""
    p_max: float
    """Max–mean contact pressure: mean over the blocks of the block maxima [MPa]."""


@dataclass(frozen=True)
class BlockMeasures:
    """The same per block."""

    participation: IntArray
    """K_j = ⌊N_eff,j⌋, (n,)."""
    participation_ratio: FloatArray
    """N_eff,j = (Σ p)² / Σ p², (n,) [-]."""
    effective_area: FloatArray
    """Area of the K_j elements of largest pressure, (n,) [mm²]."""
    p_eff: FloatArray
    """Mean of the K_j largest pressures, (n,) [MPa]."""
    p_max: FloatArray
    """Largest pressure, (n,) [MPa]."""


def _block_measures(
    pressure: FloatArray, area: FloatArray
) -> tuple[int, float, float, float, float]:
    """K, N_eff, effective area, p_eff and p_max of one block (eq. participation ratio)."""
    largest = float(pressure.max(initial=0.0))
    if largest <= 0.0:
        return 0, 0.0, 0.0, 0.0, 0.0
    # Of shares of the largest: squares of the pressures may be no numbers of the machine.
    share = pressure / largest
    ratio = float(share.sum()) ** 2 / float(share @ share)
    # A uniform pressure has a whole participation ratio: the nudge keeps round-off from
    # taking the floor one lower.
    count = int(np.floor(ratio * (1 + 1e-9)))
    # Ties are ordered by area, so the result does not depend on the numbering.
    order = np.lexsort((-area, -np.round(share, 9)))[:count]
    return count, ratio, float(area[order].sum()), float(pressure[order].mean()), largest


def block_measures(
    blocks: IntArray,
    block_m: IntArray,
    block_s: IntArray,
    pressures: FloatArray,
    areas: FloatArray,
) -> BlockMeasures:
    """Measures of each block; a contact counts for both blocks that share it.

    Parameters
    ----------
    blocks
        Blocks to measure, (n,).
    block_m, block_s
        The two blocks of each contact, (n_contacts,).
    pressures, areas
        Contact pressures [MPa] and areas [mm²], (n_contacts,).
    """
    clean = np.where(pressures > _ROUND_OFF * pressures.max(initial=0.0), pressures, 0.0)
    owner = np.concatenate([block_m, block_s])
    contact = np.tile(np.arange(len(block_m)), 2)
    order = np.argsort(owner, kind="stable")
    contact, owner = contact[order], owner[order]
    first, last = np.searchsorted(owner, blocks), np.searchsorted(owner, blocks, side="right")
    rows = [
        _block_measures(clean[contact[i:j]], areas[contact[i:j]])
        for i, j in zip(first, last, strict=True)
    ]
    count, ratio, area, p_eff, p_max = (np.array(c) for c in zip(*rows, strict=True))
    return BlockMeasures(count.astype(np.int64), ratio, area, p_eff, p_max)


def measures(
    per_block: BlockMeasures, eligible_facets: IntArray | FloatArray, eligible_areas: FloatArray
) -> Measures:
    """Average over blocks.

    Parameters
    ----------
    per_block
        Result of `block_measures`.
    eligible_facets, eligible_areas
        k_b and the area of the surface that can meet a neighbour, (n,) and (n,) [mm²].
    """
    effective = int(per_block.participation.sum())
    pooled = float(per_block.participation @ per_block.p_eff) / effective if effective else 0.0
    return Measures(
        effective_count_percent=float(np.mean(100.0 * per_block.participation / eligible_facets)),
        participation_percent=float(
            np.mean(100.0 * per_block.participation_ratio / eligible_facets)
        ),
        effective_area_percent=float(np.mean(100.0 * per_block.effective_area / eligible_areas)),
        p_eff=float(per_block.p_eff.mean()),
        p_eff_pooled=pooled,
        p_max=float(per_block.p_max.mean()),
    )
