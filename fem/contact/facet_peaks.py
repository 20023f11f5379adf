"""Largest pressure of each contact facet, as far as its integration points resolve it.

Equilibrium fixes the pressures at integration points. Towards the edges of a facet the gap is
extrapolated, and the contact law is evaluated at the extrapolated gap. A steep law turns a small
extrapolation into a large factor: beyond `LARGEST_FACTOR` the pressure at the edge belongs to no
state that was solved, and the facet counts with its largest pressure at an integration point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fem.contact.law import ContactLaw
from geometry.mesh import BoolArray, FloatArray, IntArray

#: Largest pressure near an edge over that at the integration points of the same facet [-].
#: A factor e is an extrapolation of at most c0, the length over which the exponential law grows
#: by e. A linear pressure between two Gauss points reaches a factor of 1.37 along one edge and
#: 1.87 at a corner.
LARGEST_FACTOR = math.e


@dataclass(frozen=True)
class FacetPeaks:
    """Largest pressure of each facet, and where it is."""

    values: FloatArray
    """(n_facets,) [MPa]"""
    look: IntArray
    """Which point near the edges the value belongs to, where resolved; (n_facets,)."""
    point: IntArray
    """Integration point of the largest pressure, which the value belongs to elsewhere;
    (n_facets,)."""
    resolved: BoolArray
    """Whether the integration points resolve the pressure at the edges, (n_facets,)."""
    extrapolated: FloatArray
    """The law at the extrapolated gap, (n_facets,) [MPa]."""

    @property
    def all_resolved(self) -> bool:
        """Whether no facet that is not resolved can hold a larger pressure than the largest."""
        hidden = self.extrapolated[~self.resolved]
        return bool(hidden.max(initial=0.0) <= self.values.max(initial=0.0))


def facet_peaks(law: ContactLaw, at_looks: FloatArray, at_points: FloatArray) -> FacetPeaks:
    """Find the largest pressure of each facet.

    Parameters
    ----------
    law
        Contact law.
    at_looks
        Overclosures extrapolated to edges and corners, (n_facets, n_looks) [mm].
    at_points
        Overclosures at integration points, (n_facets, n_points) [mm].
    """
    look, point = at_looks.argmax(axis=1), at_points.argmax(axis=1)
    rows = np.arange(len(at_looks))
    with np.errstate(over="ignore"):
        extrapolated = law.pressure(at_looks[rows, look])
    inside = law.pressure(at_points[rows, point])
    resolved = extrapolated <= LARGEST_FACTOR * inside
    values = np.where(resolved, extrapolated, inside)
    return FacetPeaks(values, look, point, resolved, extrapolated)
