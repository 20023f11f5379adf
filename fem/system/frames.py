"""How fixed blocks are modelled."""

from __future__ import annotations

from enum import StrEnum


class Frames(StrEnum):
    """How the blocks that the load case holds are modelled."""

    RIGID = "rigid"
    """They do not move or deform."""
    DEFORMABLE = "deformable"
    """They deform and are held at their outer faces."""
