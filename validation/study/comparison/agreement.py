"""How alike two contact pressure fields on the same facets are, as the paper compares them."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.mesh import FloatArray, IntArray
from geometry.parts.measures import effective_facets

#: Relative differences of pressures below this are round-off of the solvers (residual 1e-8).
_UNIFORM = 1e-6


def _correlation(a: FloatArray, b: FloatArray, area: FloatArray) -> float:
    weight = area / area.sum()
    da, db = a - weight @ a, b - weight @ b
    spread_a, spread_b = float(np.sqrt(weight @ da**2)), float(np.sqrt(weight @ db**2))
    uniform_a = spread_a <= _UNIFORM * abs(float(weight @ a))
    uniform_b = spread_b <= _UNIFORM * abs(float(weight @ b))
    if uniform_a or uniform_b:
        return 1.0 if uniform_a and uniform_b else 0.0
    return float(weight @ (da * db)) / (spread_a * spread_b)


def agreement(
    faces: str,
    reference: FloatArray,
    other: FloatArray,
    *,
    centroids: FloatArray,
    areas: FloatArray,
    block: IntArray,
) -> dict[str, Any]:
    """Compare two pressure fields, (n,) [MPa], on the same facets.

    Their centroids are (n, 3) [mm], their areas (n,) [mm²]; ``block`` is the block whose peak is
    looked for on each, (n,). ``faces`` are ``all``, in a tube also ``top`` and ``bottom`` of the
    middle layer.

    Returns
    -------
    dict[str, Any]
        ``correlation``: area-weighted Pearson correlation of the pressures; two uniform fields: 1,
        one: 0. ``overlap``: shared area of the effective contact regions over their union.
        ``peaks_found``: mean over blocks of the reference's largest pressure within two facets of
        the other's peak, over its largest of all: one where the peaks coincide, several equal peaks
        counting as one. ``force_ratio``: total contact force of the other over the reference's.
    """
    union = shared = 0.0
    hits = []
    for number in np.unique(block):
        mine = block == number
        a, b = effective_facets(reference[mine]), effective_facets(other[mine])
        union += float(areas[mine][a | b].sum())
        shared += float(areas[mine][a & b].sum())
        highest = float(reference[mine].max())
        if highest > 0:
            away = np.linalg.norm(centroids[mine] - centroids[mine][other[mine].argmax()], axis=1)
            near = away <= 2 * np.sqrt(areas[mine].max())
            hits.append(float(reference[mine][near].max()) / highest)
    total = float(areas @ reference)
    return {
        "faces": faces,
        "correlation": _correlation(reference, other, areas),
        "overlap": shared / union if union > 0 else 1.0,
        "peaks_found": float(np.mean(hits)) if hits else 1.0,
        "force_ratio": float(areas @ other) / total if total > 0 else 1.0,
    }
