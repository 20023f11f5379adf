"""The paper's block, as a notebook states it."""

from __future__ import annotations

SHAPE = {
    "height": 200,
    "amplitude": 20,
    "frequency": 1.5,
    "blocks_per_layer": 4,
    "inner_radius": 120,
    "thickness": 40,
}
