"""Planar walls of wavy blocks: the planar Sine Block PSB and osteomorphic blocks.

Rows are stacked along z, blocks lie side by side along x, y points out of the wall. The row below,
the row above and the first and last block of each row are fixed. Every joint conforms.

Sources: section "Sine Block" of the paper, before its cylinder map; Dyskin, Estrin, Pasternak,
Khor, Kanel-Belov, "Fracture resistant structures based on topological interlocking with
non-planar contacts", Adv. Eng. Mater. 5 (2003), for blocks whose faces are saddles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.assembly import (
    Assembly,
    AssemblyError,
    require_counts,
    require_divisions,
    require_length,
)
from geometry.block import Block, mapped_block
from geometry.families.sine_block import LEAST_REACHED, check_shift
from geometry.mesh import FloatArray

#: Height of a joint above its mean plane at (x from the block's middle, y from the inner face).
Profile = Callable[[FloatArray, FloatArray], FloatArray]

_FACES = {"u-": "left", "u+": "right", "v-": "inner", "v+": "outer", "w-": "bottom", "w+": "top"}


@dataclass(frozen=True)
class WallBlock:
    """Outline of a wall's blocks."""

    width: float
    """Along the wall, x [mm]."""
    thickness: float
    """Out of the wall, y [mm]."""
    height: float
    """Distance of the rows, z [mm]."""
    amplitude: float
    """Of the joints [mm]."""


def check_wall(
    block: WallBlock, divisions: tuple[int, int, int], columns: int, layers: int
) -> None:
    """Reject what describes no wall."""
    for name in ("width", "thickness", "height"):
        require_length(name, getattr(block, name))
    if not 0 <= block.amplitude < block.height / 2:
        raise AssemblyError(
            f"block.amplitude: got {block.amplitude:g} mm, expected 0 or more and less than half "
            f"of block.height ({block.height / 2:g} mm): the frame blocks are cut there"
        )
    require_divisions(divisions)
    require_counts(columns=columns, layers=layers)


def _block(
    name: str,
    outline: WallBlock,
    divisions: tuple[int, int, int],
    ends: tuple[tuple[float, Profile], tuple[float, Profile]],
    parts: tuple[int, int, int],
) -> Block:
    bottom, top = ends
    x1 = outline.width * np.linspace(-0.5, 0.5, divisions[0] + 1)
    y1 = outline.thickness * np.linspace(0.0, 1.0, divisions[1] + 1)
    w1 = np.linspace(0.0, 1.0, divisions[2] + 1)

    def shape(parameters: FloatArray) -> FloatArray:
        x, y, w = parameters.T
        z = (1 - w) * (bottom[0] + bottom[1](x, y)) + w * (top[0] + top[1](x, y))
        return np.column_stack([x, y, z])

    return mapped_block(
        name,
        (x1, y1, w1),
        shape,
        _FACES,
        ("bottom", "top", "left", "right"),
        directions=("along", "across", "upward"),
        parts=parts,
    )


def _flat(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.zeros(np.broadcast(x, y).shape)


def _check_sampled(outline: WallBlock, divisions: tuple[int, int, int], profile: Profile) -> None:
    """Reject elements whose corners meet a joint only near its zeros: the wall would be plain."""
    x = np.linspace(-0.5, 0.5, divisions[0] + 1) * outline.width
    y = np.linspace(0.0, outline.thickness, divisions[1] + 1)
    reached = float(np.abs(profile(x[:, None], y)).max())
    if reached < LEAST_REACHED * outline.amplitude:
        raise AssemblyError(
            f"mesh.divisions: got {list(divisions)}; the corners of the elements meet the joint "
            f"near its zeros, and the blocks would have an amplitude of {reached:.3g} mm for "
            f"{outline.amplitude:g} mm; expected more elements along x or y"
        )


def _wall(
    name: str,
    outline: WallBlock,
    divisions: tuple[int, int, int],
    profiles: tuple[Profile, Profile],
    *,
    offset: float,
    parts: tuple[int, int, int],
    columns: int,
    layers: int,
) -> Assembly:
    """Stack rows whose blocks have joints ``profiles`` (below, above), odd rows moved by offset.

    The offset is a whole number of equal ``parts`` of a block.
    """
    below, above = profiles
    _check_sampled(outline, divisions, above)
    h = outline.height
    half = (divisions[0], divisions[1], max(1, round(divisions[2] / 2)))
    shapes = (
        _block(name, outline, divisions, ((0.0, below), (h, above)), parts),
        _block("bottom-frame", outline, half, ((-h / 2, _flat), (0.0, above)), parts),
        _block("top-frame", outline, half, ((0.0, below), (h / 2, _flat)), parts),
    )
    column, layer = (i.ravel() for i in np.meshgrid(np.arange(columns + 2), np.arange(layers + 2)))
    x = (column - 0.5 * (columns + 1)) * outline.width + np.where(layer % 2 == 1, offset, 0.0)
    z = np.where(layer == 0, 0.0, (layer - 1) * h)
    frame = (layer == 0) | (layer == layers + 1)
    return Assembly(
        name=f"{name}-wall",
        shapes=shapes,
        shape_of=np.where(layer == 0, 1, np.where(layer == layers + 1, 2, 0)),
        rotations=np.tile(np.eye(3), (len(layer), 1, 1)),
        translations=np.column_stack([x, np.zeros(len(x)), z]),
        layer=layer,
        fixed=frame | (column == 0) | (column == columns + 1),
        unmatched_allowed=True,
    )


def planar_sine_wall(
    block: WallBlock,
    frequency: float,
    shift: float,
    divisions: tuple[int, int, int],
    *,
    columns: int,
    layers: int,
) -> Assembly:
    """Build a planar assembly of PSB: joints A(y) sin(2π 2f u + π s), A(y) = a y/t, u in [0, 1].

    As in the tube a block carries 2f waves and odd rows are moved by ⌊f⌋ of them.

    Parameters
    ----------
    block
        Outline [mm]; the amplitude is that of the outer face.
    frequency, shift
        f (2f whole) and s, in units of π.
    divisions
        Elements of a block along x, y, z.
    columns, layers
        Free blocks in a row, free rows.
    """
    check_wall(block, divisions, columns, layers)
    check_shift(shift)
    waves = round(2 * frequency)
    if waves < 1 or abs(waves - 2 * frequency) > 1e-12:
        raise AssemblyError(
            f"block.frequency: got {frequency}, expected 0.5, 1, 1.5, …: whole waves per block"
        )
    if (int(frequency) * divisions[0]) % waves:
        raise AssemblyError(
            f"mesh.divisions: got {divisions[0]} elements along x; rows are moved by "
            f"{int(frequency)}/{waves} of a block: choose a multiple of {waves}"
        )

    def profile(x: FloatArray, y: FloatArray) -> FloatArray:
        u = x / block.width + 0.5
        amplitude = block.amplitude * y / block.thickness
        return amplitude * np.sin(2 * np.pi * waves * u + np.pi * shift)

    return _wall(
        "planar-sine",
        block,
        divisions,
        (profile, profile),
        offset=int(frequency) * block.width / waves,
        parts=(waves, 1, 1),
        columns=columns,
        layers=layers,
    )


def osteomorphic_wall(
    block: WallBlock, divisions: tuple[int, int, int], *, columns: int, layers: int
) -> Assembly:
    """Build a wall of osteomorphic blocks: joints a cos(2π x/w) sin(π y/t), thick where x = 0.

    Odd rows are moved by half a block, where the joint's sign is the opposite.

    Parameters
    ----------
    block
        Outline [mm].
    divisions
        Elements of a block along x (even), y, z.
    columns, layers
        Free blocks in a row, free rows.
    """
    check_wall(block, divisions, columns, layers)
    if divisions[0] % 2:
        raise AssemblyError(
            f"mesh.divisions: got {divisions[0]} elements along x; rows are moved by half a "
            f"block: try {divisions[0] + 1}"
        )

    def above(x: FloatArray, y: FloatArray) -> FloatArray:
        wave = np.cos(2 * np.pi * x / block.width) * np.sin(np.pi * y / block.thickness)
        return block.amplitude * wave

    def below(x: FloatArray, y: FloatArray) -> FloatArray:
        return -above(x, y)

    return _wall(
        "osteomorphic",
        block,
        divisions,
        (below, above),
        offset=block.width / 2,
        parts=(2, 2, 1),
        columns=columns,
        layers=layers,
    )
