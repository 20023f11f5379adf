"""Tubes: L free layers of blocks between two flat-trimmed, fixed frame layers.

And what a long tube repeats: a periodic cell of two layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly
from geometry.block import Block
from geometry.families.hexagon_block import (
    HexagonBlock,
    HexagonBlockDivisions,
    bottom_hexagon_frame,
    hexagon_block,
    top_hexagon_frame,
)
from geometry.families.sine_block import (
    LayerTurn,
    SineBlock,
    SineBlockDivisions,
    bottom_frame_block,
    check_conforming,
    sine_block,
    top_frame_block,
    waves_of_turn,
)
from geometry.mesh import FloatArray
from geometry.parts.options import Count, Options
from geometry.parts.placed import AssemblyError, check_size


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


@dataclass(frozen=True)
class SineTube(Options):
    """Tube of n Sine Blocks in each of L free layers and two frame layers of half height.

    Layer k occupies z in [(k - 1) h, k h]; odd layers are turned towards larger θ. Blocks are
    numbered layer by layer, n blocks in each, towards larger θ.
    """

    block: SineBlock
    """Shape of the free block [mm]."""
    divisions: SineBlockDivisions
    """Its elements."""
    layers: Count
    """Free layers L, without the two end rings."""
    turn: LayerTurn | float = LayerTurn.HALF_BLOCK
    """Offset (stagger) of every second layer: ``half block`` (⌊f⌋ waves, the whole number nearest
    to half a block), ``one wave`` (the paper's parameter study) or a number of waves. At f = 2 the
    default more than halves the pressures; at f = 1 and 1.5 both are the same."""

    @property
    def parts(self) -> tuple[int, int, int]:
        """Equal parts of a block around, across and up: its waves."""
        return self.block.waves_per_block, 1, 1

    def build(self) -> Assembly:
        """Place the blocks of all layers.

        Raises
        ------
        BlockParameterError
            When no such tube exists.
        """
        block, angle = self.block, self._angle()
        shapes = (
            sine_block(block, self.divisions),
            bottom_frame_block(block, self.divisions),
            top_frame_block(block, self.divisions),
        )
        elevation = np.concatenate([[0.0], block.height * np.arange(self.layers + 1)])
        return _tube("sine-tube", shapes, block.blocks_per_layer, angle, elevation)

    def cell(self) -> Assembly:
        """Two layers that a long tube repeats, and the images that they meet.

        They are layers 1 and 2; layer 3 is the image of layer 1, two heights up.

        Raises
        ------
        BlockParameterError
            When no such tube exists.
        """
        block, angle = self.block, self._angle()
        shape = sine_block(block, self.divisions)
        elevation = block.height * np.arange(3, dtype=np.float64)
        return _cell("sine-cell", shape, block.blocks_per_layer, angle, elevation)

    def _angle(self) -> float:
        """Angle of the odd layers [rad], after rejecting turns and meshes that do not fit."""
        waves = waves_of_turn(self.block, self.turn)
        check_conforming(self.block, self.divisions, waves)
        return waves * self.block.block_angle / self.block.waves_per_block


@dataclass(frozen=True)
class HexagonTube(Options):
    """Tube of n hexagon-based blocks in each of L free layers, two frame layers cut in half.

    Layer k is centred at z = 1.5 r_c k; odd layers are turned towards larger θ by half a block.
    The frame layers are cut flat at their middles. Blocks are numbered as in `SineTube`.
    """

    block: HexagonBlock
    """Shape of the free block [mm]."""
    divisions: HexagonBlockDivisions
    """Its elements."""
    layers: Count
    """Free layers L, without the two end rings."""

    def build(self) -> Assembly:
        """Place the blocks of all layers."""
        block = self.block
        shapes = (
            hexagon_block(block, self.divisions),
            bottom_hexagon_frame(block, self.divisions),
            top_hexagon_frame(block, self.divisions),
        )
        elevation = block.layer_pitch * np.arange(self.layers + 2, dtype=np.float64)
        n = block.blocks_per_layer
        return _tube("hexagon-tube", shapes, n, block.block_angle / 2, elevation)

    def cell(self) -> Assembly:
        """Two layers that a long tube repeats, and their images; see `SineTube.cell`."""
        block = self.block
        elevation = block.layer_pitch * np.arange(1, 4, dtype=np.float64)
        shape = hexagon_block(block, self.divisions)
        n = block.blocks_per_layer
        return _cell("hexagon-cell", shape, n, block.block_angle / 2, elevation)


def tube(
    block: SineBlock | HexagonBlock,
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
    if not isinstance(block, SineBlock | HexagonBlock):
        raise AssemblyError(
            f"block: got {type(block).__name__}, expected a SineBlock or a HexagonBlock"
        )
    expected = 3 if isinstance(block, SineBlock) else 2
    divisions: object = mesh
    counted = isinstance(divisions, Sequence) and all(map(is_count, divisions))
    if not counted or len(mesh) != expected:
        raise AssemblyError(
            f"mesh: got {mesh!r}, expected {expected} numbers of elements, at least 1 each, such "
            f"as {(24, 2, 4)[:expected]}"
        )
    if isinstance(block, HexagonBlock) and turn != LayerTurn.HALF_BLOCK:
        raise AssemblyError(f"turn: got {turn}, but hexagon-based blocks turn by half a block")
    if isinstance(block, SineBlock):
        built = SineTube(block, SineBlockDivisions(*mesh), layers, turn).build()
    else:
        built = HexagonTube(block, HexagonBlockDivisions(*mesh), layers).build()
    check_size(built)
    return built


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
