"""Closed choices that scenes name, and names of contacts without area; light to import."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Gt, Le

from geometry.parts.options import Length, Options

#: An edge that crosses an edge …
CROSSING_EDGES = -1
#: … and a corner that stands on a face, in place of the patch of a contact without area.
STANDING_CORNER = -2


class ContactPlacement(StrEnum):
    """Where contact points lie."""

    VERTICES = "vertices"
    """At the corners of each patch's convex hull: exact for flat faces (default)."""
    CENTROIDS = "centroids"
    """At the centroid of each clipped polygon: for finely meshed curved faces."""


@dataclass(frozen=True)
class DetectionOptions(Options):
    """Contact detection of meshes that do not match."""

    tolerance: Length | None = None
    """Largest gap or overlap of touching facets [mm]; by default 1e-4 of a block."""
    angle: Annotated[float, Gt(0), Le(60)] | None = None
    """Largest angle between facing facets [°]; by default 5, on curved faces more by the angle
    between neighbouring facets."""
    points: ContactPlacement = ContactPlacement.VERTICES
    """``vertices``: exact for flat faces; ``centroids``: for finely meshed curved faces."""


class CubeArrangement(StrEnum):
    """How a layer of cubes lies."""

    HEXAGONAL = "hexagonal"
    """Space diagonals upright, hexagonal middle sections."""
    SQUARE = "square"
    """Faces upright, as paving: nothing interlocks."""
