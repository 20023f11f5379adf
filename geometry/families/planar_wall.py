"""Planar walls of wavy blocks: the planar Sine Block PSB and osteomorphic blocks.

Rows are stacked along z, blocks lie side by side along x, y points out of the wall. The row below,
the row above and the first and last block of each row are fixed. Every joint conforms.

Sources: section "Sine Block" of the paper, before its cylinder map; Dyskin, Estrin, Pasternak,
Khor, Kanel-Belov, "Fracture resistant structures based on topological interlocking with
non-planar contacts", Adv. Eng. Mater. 5 (2003), for blocks whose faces are saddles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Gt

from geometry.assembly import Assembly
from geometry.block import Block, mapped_block
from geometry.families.sine_block import LEAST_REACHED, check_shift
from geometry.mesh import FloatArray
from geometry.parts.options import Count, Divisions, Length, NonNegative, Options
from geometry.parts.placed import AssemblyError

#: Height of a joint above its mean plane at (x from the block's middle, y from the inner face).
Profile = Callable[[FloatArray, FloatArray], FloatArray]

_FACES = {"u-": "left", "u+": "right", "v-": "inner", "v+": "outer", "w-": "bottom", "w+": "top"}


@dataclass(frozen=True)
class _Wall(Options):
    """Planar wall: free blocks within a fixed ring."""

    width: Length
    """Along the wall, x [mm]."""
    thickness: Length
    """t, out of the wall, y [mm]."""
    height: Length
    """h, distance of the rows, z [mm]."""
    amplitude: NonNegative
    """a, of the joints; of waves that on the outer face [mm]."""
    _: KW_ONLY
    columns: Count
    """Free blocks in a row."""
    layers: Count
    """Free rows."""
    divisions: Divisions
    """Elements of a block along x, y, z."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.amplitude >= self.height / 2:
            raise AssemblyError(
                f"amplitude: got {self.amplitude:g} mm, expected 0 or more and less than "
                f"half of `height` ({self.height / 2:g} mm): the frame blocks are cut there"
            )


def _block(
    name: str,
    outline: _Wall,
    divisions: Divisions,
    ends: tuple[tuple[float, Profile], tuple[float, Profile]],
    parts: tuple[int, int, int],
) -> Block:
    x1 = outline.width * np.linspace(-0.5, 0.5, divisions[0] + 1)
    y1 = outline.thickness * np.linspace(0.0, 1.0, divisions[1] + 1)
    w1 = np.linspace(0.0, 1.0, divisions[2] + 1)
    return mapped_block(
        name,
        (x1, y1, w1),
        partial(_shape, ends),
        _FACES,
        ("bottom", "top", "left", "right"),
        directions=("along", "across", "upward"),
        parts=parts,
    )


def _shape(
    ends: tuple[tuple[float, Profile], tuple[float, Profile]], parameters: FloatArray
) -> FloatArray:
    """Points of x, y and the part w of the height, (m, 3) to (m, 3) [mm]."""
    x, y, w = parameters.T
    (low, bottom), (high, top) = ends
    z = (1 - w) * (low + bottom(x, y)) + w * (high + top(x, y))
    return np.column_stack([x, y, z])


def _flat(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.zeros(np.broadcast(x, y).shape)


def _check_sampled(wall: _Wall, profile: Profile) -> None:
    """Reject elements whose corners meet a joint only near its zeros: the wall would be plain."""
    x = np.linspace(-0.5, 0.5, wall.divisions[0] + 1) * wall.width
    y = np.linspace(0.0, wall.thickness, wall.divisions[1] + 1)
    reached = float(np.abs(profile(x[:, None], y)).max())
    if reached < LEAST_REACHED * wall.amplitude:
        raise AssemblyError(
            f"divisions: got {list(wall.divisions)}; the corners of the elements meet the "
            f"joint near its zeros, and the blocks would have an amplitude of {reached:.3g} mm for "
            f"{wall.amplitude:g} mm; expected more elements along x or y"
        )


def _built(
    name: str,
    wall: _Wall,
    profiles: tuple[Profile, Profile],
    *,
    offset: float,
    parts: tuple[int, int, int],
) -> Assembly:
    """Stack rows whose blocks have joints ``profiles`` (below, above), odd rows moved by offset.

    The offset is a whole number of equal ``parts`` of a block.
    """
    below, above = profiles
    _check_sampled(wall, above)
    h, divisions, columns, layers = wall.height, wall.divisions, wall.columns, wall.layers
    half = (divisions[0], divisions[1], max(1, round(divisions[2] / 2)))
    shapes = (
        _block(name, wall, divisions, ((0.0, below), (h, above)), parts),
        _block("bottom-frame", wall, half, ((-h / 2, _flat), (0.0, above)), parts),
        _block("top-frame", wall, half, ((0.0, below), (h / 2, _flat)), parts),
    )
    column, layer = (i.ravel() for i in np.meshgrid(np.arange(columns + 2), np.arange(layers + 2)))
    x = (column - 0.5 * (columns + 1)) * wall.width + np.where(layer % 2 == 1, offset, 0.0)
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
        unmatched=(),
    )


@dataclass(frozen=True)
class PlanarSineWall(_Wall):
    """Planar wall of PSB, the Sine Block before its cylinder map.

    Joints are A(y) sin(2π 2f u + π s), A(y) = a y/t, u in [0, 1]. As in the tube a block carries 2f
    waves and odd rows are moved by ⌊f⌋ of them.
    """

    frequency: Annotated[float, Gt(0)]
    """f, number of sine waves over half of the block; 2f is a whole number."""
    shift: float = 0.0
    """s, phase in units of π."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_shift(self.shift)
        waves = round(2 * self.frequency)
        if waves < 1 or abs(waves - 2 * self.frequency) > 1e-12:
            raise AssemblyError(
                f"frequency: got {self.frequency}, expected 0.5, 1, 1.5, …: whole waves per block"
            )
        if (int(self.frequency) * self.divisions[0]) % waves:
            raise AssemblyError(
                f"divisions: got {self.divisions[0]} elements along x; rows are moved by "
                f"{int(self.frequency)}/{waves} of a block: choose a multiple of {waves}"
            )

    @property
    def parts(self) -> tuple[int, int, int]:
        """Equal parts of a block: its waves."""
        return round(2 * self.frequency), 1, 1

    def build(self) -> Assembly:
        """Stack the rows."""
        waves, profiles = self.parts[0], (self._joint, self._joint)
        offset = int(self.frequency) * self.width / waves
        return _built("planar-sine", self, profiles, offset=offset, parts=self.parts)

    def _joint(self, x: FloatArray, y: FloatArray) -> FloatArray:
        u = x / self.width + 0.5
        amplitude = self.amplitude * y / self.thickness
        return amplitude * np.sin(2 * np.pi * self.parts[0] * u + np.pi * self.shift)


@dataclass(frozen=True)
class OsteomorphicWall(_Wall):
    """Planar wall of osteomorphic blocks: bricks whose bed joints are saddles.

    Joints are a cos(2π x/w) sin(π y/t), thick where x = 0. Odd rows are moved by half a block,
    where the joint's sign is the opposite.
    """

    parts: ClassVar = (2, 2, 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.divisions[0] % 2:
            raise AssemblyError(
                f"divisions: got {self.divisions[0]} elements along x; rows are moved by half "
                f"a block: try {self.divisions[0] + 1}"
            )

    def build(self) -> Assembly:
        """Stack the rows."""
        profiles = (self._below, self._above)
        return _built("osteomorphic", self, profiles, offset=self.width / 2, parts=self.parts)

    def _above(self, x: FloatArray, y: FloatArray) -> FloatArray:
        wave = np.cos(2 * np.pi * x / self.width) * np.sin(np.pi * y / self.thickness)
        return self.amplitude * wave

    def _below(self, x: FloatArray, y: FloatArray) -> FloatArray:
        return -self._above(x, y)
