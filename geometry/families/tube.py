"""Tubes: L free layers of blocks between two flat-trimmed, fixed frame layers.

And what a long tube repeats: a periodic cell of two layers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.assembly import Assembly, AssemblyError, check_size
from geometry.block import Block
from geometry.families.hexagon_block import (
    HexagonBlockDivisions,
    HexagonBlockParameters,
    bottom_hexagon_frame,
    hexagon_block,
    top_hexagon_frame,
)
from geometry.families.sine_block import (
    LayerTurn,
    SineBlockDivisions,
    SineBlockParameters,
    bottom_frame_block,
    check_conforming,
    sine_block,
    top_frame_block,
    waves_of_turn,
)
from geometry.mesh import FloatArray


def is_count(value: object) -> bool:
    """Whether a value is a whole number from 1 on; truth is no number."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and int(value) >= 1


def axial_rotations(angles: FloatArray) -> FloatArray:
    """Rotations about the z axis by ``angles`` (n,) [rad]: (n, 3, 3)."""
    rotation = np.zeros((len(angles), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(angles)
    rotation[:, 1, 0] = np.sin(angles)
    rotation[:, 0, 1] = -rotation[:, 1, 0]
    rotation[:, 2, 2] = 1.0
    return rotation


def sine_tube(
    block: SineBlockParameters,
    divisions: SineBlockDivisions,
    layers: int,
    turn: LayerTurn | float = LayerTurn.HALF_BLOCK,
) -> Assembly:
    """Assemble n blocks in each of L free layers and two frame layers of half height.

    Layer k occupies z in [(k - 1) h, k h]; odd layers are turned towards larger θ. Blocks are
    numbered layer by layer, n blocks in each, towards larger θ.

    Parameters
    ----------
    block, divisions
        Shape [mm] and element counts of the free block.
    layers
        L, at least 1.
    turn
        Of the odd layers, in words or in waves (`waves_of_turn`).

    Raises
    ------
    AssemblyError, BlockParameterError
        When no such tube exists.
    """
    _check_layers(layers)
    angle = _turn_angle(block, divisions, turn)
    shapes = (
        sine_block(block, divisions),
        bottom_frame_block(block, divisions),
        top_frame_block(block, divisions),
    )
    elevation = np.concatenate([[0.0], block.height * np.arange(layers + 1)])
    return _tube("sine-tube", shapes, block.blocks_per_layer, angle, elevation)


def _turn_angle(
    block: SineBlockParameters, divisions: SineBlockDivisions, turn: LayerTurn | float
) -> float:
    """Angle of the odd layers [rad], after rejecting turns and meshes that do not fit."""
    waves = waves_of_turn(block, turn)
    check_conforming(block, divisions, waves)
    return waves * block.block_angle / block.waves_per_block


def hexagon_tube(
    block: HexagonBlockParameters, divisions: HexagonBlockDivisions, layers: int
) -> Assembly:
    """Assemble n hexagon-based blocks in each of L free layers and two frame layers cut in half.

    Layer k is centred at z = 1.5 r_c k; odd layers are turned towards larger θ by half a block.
    The frame layers are cut flat at their middles. Blocks are numbered as in `sine_tube`.

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
    _check_layers(layers)
    shapes = (
        hexagon_block(block, divisions),
        bottom_hexagon_frame(block, divisions),
        top_hexagon_frame(block, divisions),
    )
    elevation = block.layer_pitch * np.arange(layers + 2, dtype=np.float64)
    n = block.blocks_per_layer
    return _tube("hexagon-tube", shapes, n, block.block_angle / 2, elevation)


def tube(
    block: SineBlockParameters | HexagonBlockParameters,
    *,
    layers: int,
    mesh: tuple[int, ...],
    turn: LayerTurn | float = LayerTurn.HALF_BLOCK,
) -> Assembly:
    """Assemble a tube, its frame layers included.

    Parameters
    ----------
    block
        Shape [mm].
    layers
        Free layers L, at least 1.
    mesh
        Elements of one block: around, radial, axial for Sine Blocks; along an edge and radial for
        hexagon-based ones.
    turn
        Of every second layer of Sine Blocks, in words or in waves (`waves_of_turn`).

    Raises
    ------
    AssemblyError, BlockParameterError
        When no such tube exists, or its lengths cannot be millimetres.
    """
    if not isinstance(block, SineBlockParameters | HexagonBlockParameters):
        raise AssemblyError(
            f"block: got {type(block).__name__}, expected a SineBlock or a HexagonBlock"
        )
    expected = 3 if isinstance(block, SineBlockParameters) else 2
    divisions: object = mesh
    counted = isinstance(divisions, Sequence) and all(map(is_count, divisions))
    if not counted or len(mesh) != expected:
        raise AssemblyError(
            f"mesh: got {mesh!r}, expected {expected} numbers of elements, such as "
            f"{(24, 2, 4)[:expected]}"
        )
    if isinstance(block, HexagonBlockParameters) and turn != LayerTurn.HALF_BLOCK:
        raise AssemblyError(f"turn: got {turn}, but hexagon-based blocks turn by half a block")
    if isinstance(block, SineBlockParameters):
        built = sine_tube(block, SineBlockDivisions(*mesh), layers, turn)
    else:
        built = hexagon_tube(block, HexagonBlockDivisions(*mesh), layers)
    check_size(built)
    return built


def sine_cell(
    block: SineBlockParameters,
    divisions: SineBlockDivisions,
    turn: LayerTurn | float = LayerTurn.HALF_BLOCK,
) -> Assembly:
    """Two layers that a long tube of Sine Blocks repeats, and the images that they meet.

    Layers 1 and 2 are those of `sine_tube`, whose arguments these are; layer 3 is the image of
    layer 1, two heights up.

    Raises
    ------
    AssemblyError, BlockParameterError
        When no such tube exists.
    """
    angle = _turn_angle(block, divisions, turn)
    shape = sine_block(block, divisions)
    elevation = block.height * np.arange(3, dtype=np.float64)
    return _cell("sine-cell", shape, block.blocks_per_layer, angle, elevation)


def hexagon_cell(block: HexagonBlockParameters, divisions: HexagonBlockDivisions) -> Assembly:
    """Two layers that a long tube of hexagon-based blocks repeats; see `sine_cell`.

    Raises
    ------
    AssemblyError, BlockParameterError
        When no such tube exists.
    """
    elevation = block.layer_pitch * np.arange(1, 4, dtype=np.float64)
    shape = hexagon_block(block, divisions)
    n = block.blocks_per_layer
    return _cell("hexagon-cell", shape, n, block.block_angle / 2, elevation)


def _check_layers(layers: int) -> None:
    if not is_count(layers):
        raise AssemblyError(
            f"assembly.layers: got {layers!r}, expected a whole number of free layers, at least 1"
        )


def _tube(
    name: str,
    shapes: tuple[Block, Block, Block],
    n: int,
    turn: float,
    elevation: FloatArray,
) -> Assembly:
    """Place n blocks in each layer: shapes are (free, bottom frame, top frame)."""
    last = len(elevation) - 1
    layer = np.repeat(np.arange(last + 1), n)
    angle = np.tile(np.arange(n) * (2 * np.pi / n), last + 1)
    angle = angle + np.where(layer % 2 == 1, turn, 0.0)
    return Assembly(
        name=name,
        shapes=shapes,
        shape_of=np.where(layer == 0, 1, np.where(layer == last, 2, 0)),
        rotations=axial_rotations(angle),
        translations=np.column_stack([np.zeros((len(layer), 2)), elevation[layer]]),
        layer=layer,
        fixed=(layer == 0) | (layer == last),
    )


def _cell(name: str, shape: Block, n: int, turn: float, elevation: FloatArray) -> Assembly:
    """Place n blocks in layers 1, 2 and 3, the last the image of the first."""
    layer = np.repeat([1, 2, 3], n)
    angle = np.tile(np.arange(n) * (2 * np.pi / n), 3) + np.where(layer % 2 == 1, turn, 0.0)
    return Assembly(
        name=name,
        shapes=(shape,),
        shape_of=np.zeros(3 * n, dtype=np.int64),
        rotations=axial_rotations(angle),
        translations=np.column_stack([np.zeros((3 * n, 2)), elevation[layer - 1]]),
        layer=layer,
        fixed=layer == 3,
        image_of=np.concatenate([np.arange(2 * n), np.arange(n)]),
    )
