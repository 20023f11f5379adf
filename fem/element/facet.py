"""Bilinear quadrilateral facets: shape functions, the 2 × 2 Gauss rule, areas.

Corners are counter-clockwise seen from outside.
"""

from __future__ import annotations

import math

import numpy as np

from geometry.mesh import FloatArray, IntArray

#: Natural coordinates of the four corners of a facet, (4, 2).
FACET_CORNERS: FloatArray = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)

#: The 2 × 2 Gauss points of a facet, all of weight one, in the order of the corners; (4, 2).
FACET_POINTS: FloatArray = FACET_CORNERS / math.sqrt(3.0)


def bilinear(xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (..., 4) and slopes (..., 4, 2) at natural coordinates (..., 2)."""
    factor = 1.0 + xi[..., None, :] * FACET_CORNERS
    slopes = 0.25 * FACET_CORNERS * factor[..., ::-1]
    return 0.25 * factor.prod(axis=-1), slopes


#: Bilinear shape functions at the Gauss points, (4 points, 4 corners), and their derivatives,
#: (4, 4, 2).
FACET_VALUES, FACET_SLOPES = bilinear(FACET_POINTS)


def facet_area_vectors(nodes: FloatArray, quads: IntArray) -> FloatArray:
    """Vector area per natural area, dx/dr × dx/ds, at the Gauss points of each facet.

    Returns
    -------
    FloatArray
        (..., n_facets, 4 points, 3) [mm²]; their sum over the points is the exact vector area
        of the facet, whatever its warp.
    """
    tangents = np.einsum("pak,...fai->...fpki", FACET_SLOPES, nodes[..., quads, :])
    return np.cross(tangents[..., 0, :], tangents[..., 1, :])


def facet_areas(nodes: FloatArray, quads: IntArray) -> FloatArray:
    """Areas by the 2 × 2 rule, (..., n_facets) [mm²]."""
    return np.linalg.norm(facet_area_vectors(nodes, quads), axis=-1).sum(axis=-1)
