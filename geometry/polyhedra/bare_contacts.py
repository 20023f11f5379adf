"""Contacts without area: what stands for their patch."""

from __future__ import annotations

#: An edge that crosses an edge …
CROSSING_EDGES = -1
#: … and a corner that stands on a face.
STANDING_CORNER = -2
