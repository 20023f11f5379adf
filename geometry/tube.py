"""Tubes of Sine Blocks: L free layers between two flat-trimmed, fixed frame layers."""

from __future__ import annotations

import numpy as np

from geometry.assembly import Assembly, AssemblyError
from geometry.mesh import FloatArray
from geometry.sine_block import (
    SineBlockDivisions,
    SineBlockParameters,
    bottom_frame_block,
    sine_block,
    top_frame_block,
)


def axial_rotations(angles: FloatArray) -> FloatArray:
    """Rotations about the z axis by ``angles`` (n,) [rad]: (n, 3, 3)."""
    rotation = np.zeros((len(angles), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(angles)
    rotation[:, 1, 0] = np.sin(angles)
    rotation[:, 0, 1] = -rotation[:, 1, 0]
    rotation[:, 2, 2] = 1.0
    return rotation


def sine_tube(block: SineBlockParameters, divisions: SineBlockDivisions, layers: int) -> Assembly:
    """Assemble n blocks in each of L free layers and two frame layers of half height.

    Layer k occupies z in [(k - 1) h, k h]; odd layers are turned towards larger θ by ⌊f⌋
    waves. Blocks are numbered layer by layer, n blocks in each, towards larger θ.

    Parameters
    ----------
    block, divisions
        Shape [mm] and element counts of the free block.
    layers
        L, at least 1.

    Raises
    ------
    AssemblyError, BlockParameterError
        When no such tube exists.
    """
    if layers < 1:
        raise AssemblyError(f"assembly.layers: got {layers}, expected at least 1 free layer")
    shapes = (
        sine_block(block, divisions),
        bottom_frame_block(block, divisions),
        top_frame_block(block, divisions),
    )
    n = block.blocks_per_layer
    layer = np.repeat(np.arange(layers + 2), n)
    angle = np.tile(np.arange(n) * block.block_angle, layers + 2)
    angle = angle + np.where(layer % 2 == 1, block.layer_turn, 0.0)
    elevation = np.where(layer == 0, 0.0, (layer - 1) * block.height)
    return Assembly(
        name="sine-tube",
        shapes=shapes,
        shape_of=np.where(layer == 0, 1, np.where(layer == layers + 1, 2, 0)),
        rotations=axial_rotations(angle),
        translations=np.column_stack([np.zeros((len(layer), 2)), elevation]),
        layer=layer,
        fixed=(layer == 0) | (layer == layers + 1),
    )
