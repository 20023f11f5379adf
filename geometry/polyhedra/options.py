"""Closed choices that scenes name; light to import."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class ContactPlacement(StrEnum):
    """Where contact points lie."""

    VERTICES = "vertices"
    """At the corners of each patch's convex hull: exact for flat faces (default)."""
    CENTROIDS = "centroids"
    """At the centroid of each clipped polygon: for finely meshed curved faces."""


@dataclass(frozen=True)
class DetectionOptions:
    """Tolerances of contact detection."""

    tolerance: float | None = None
    """Largest gap and largest overlap of touching facets [mm]; by default 1e-4 of a block."""
    angle: float | None = None
    """Largest angle between facing facets [°]; by default 5, and more on curved faces: by the
    angle between neighbouring facets."""
    placement: ContactPlacement = ContactPlacement.VERTICES


class CubeArrangement(StrEnum):
    """How a layer of cubes lies."""

    HEXAGONAL = "hexagonal"
    """Space diagonals upright, hexagonal middle sections."""
    SQUARE = "square"
    """Faces upright, as paving: nothing interlocks."""
