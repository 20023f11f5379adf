"""Which normals measure gaps."""

from __future__ import annotations

from enum import StrEnum


class ContactNormals(StrEnum):
    """Which normals measure the gap."""

    CURRENT = "current"
    """Of the deformed surfaces."""
    REFERENCE = "reference"
    """Of the undeformed surfaces: the gap is linear in the displacement."""
