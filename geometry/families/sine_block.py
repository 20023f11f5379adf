"""The Sine Block TSB(h, a, f, s, n, r_i, t) and its flat-trimmed frame blocks.

Source: section "Sine Block" of the paper. What the paper leaves open was settled so:

- its ℓ, the chord of the angle π/n, is *half* a block, so a block spans 2π/n and carries
  2 f waves;
- with u in [0, 1] across the block, every horizontal plane of the brick is displaced by
  A(r) sin(2π 2f u + π s), A(r) = a (r - r_i)/t;
- the cylinder map is θ = θ_left + 2π u/n, r = r_i + y, so nodes lie on true circles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from geometry.block import Block, mapped_block
from geometry.errors import RefusedError, is_number
from geometry.mesh import FloatArray
from geometry.parts.options import Count, Length, NonNegative, Options

#: Grid directions (radial, around, axial) are right-handed in this order.
_FACE_NAMES = {
    "u-": "inner",
    "u+": "outer",
    "v-": "left",
    "v+": "right",
    "w-": "bottom",
    "w+": "top",
}


#: Part of the amplitude that corners of elements must reach; four corners a wave reach 0.707.
LEAST_REACHED = 0.7
#: A shift [π] whose float still has ten digits of its phase.
LARGEST_SHIFT = 1000.0


class BlockParameterError(RefusedError):
    """Parameters that describe no block: what was got, what is expected, what to do."""


@dataclass(frozen=True, kw_only=True)
class SineBlock(Options):
    """The seven parameters of TSB(h, a, f, s, n, r_i, t).

    Raises
    ------
    BlockParameterError, OptionError
        For parameters that describe no block.
    """

    height: Length
    """h [mm]"""
    amplitude: NonNegative
    """a, at the outer radius [mm]; zero gives a plain cylindrical brick."""
    frequency: Annotated[float, Gt(0)]
    """f, number of sine waves over half of the block; 2f is a whole number."""
    shift: float = 0.0
    """s, phase in units of π; 0.5 is the Cosine Block."""
    blocks_per_layer: Annotated[int, Ge(2)]
    """n"""
    inner_radius: Length
    """r_i [mm]"""
    thickness: Length
    """t [mm]"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_shift(self.shift)
        waves = 2 * self.frequency
        if round(waves) < 1 or abs(waves - round(waves)) > 1e-12:
            near = (max(np.floor(waves), 1) / 2, np.ceil(waves) / 2)
            remedy = " or ".join(dict.fromkeys(f"{frequency:g}" for frequency in near))
            raise BlockParameterError(
                f"frequency: got {self.frequency}, so a block would carry {waves:g} waves "
                "and its neighbours would not be congruent; expected 2 f whole: try "
                f"{remedy}"
            )
        if self.amplitude >= self.height / 2:
            raise BlockParameterError(
                f"amplitude: got {self.amplitude:g} mm, which cuts through the frame blocks "
                f"(flat at half height, {self.height / 2:g} mm); expected less than half of "
                "`height`: lower the amplitude or raise the height"
            )

    @property
    def waves_per_block(self) -> int:
        """Whole number of sine waves across one block, 2f."""
        return round(2 * self.frequency)

    @property
    def steepest_slope(self) -> float:
        """Slope of a wave where it passes zero at the outer radius, 2f n a / r_o [-]."""
        return self.waves_per_block * self.blocks_per_layer * self.amplitude / self.outer_radius

    @property
    def outer_radius(self) -> float:
        """r_o = r_i + t [mm]."""
        return self.inner_radius + self.thickness

    @property
    def block_angle(self) -> float:
        """Angle spanned by one block, 2π/n [rad]."""
        return 2 * np.pi / self.blocks_per_layer


class LayerTurn(StrEnum):
    """By how much every second layer is turned, in words."""

    HALF_BLOCK = "half block"
    """The whole number ⌊f⌋ of waves nearest to half a block: as a bond of bricks, and best."""
    ONE_WAVE = "one wave"
    """One wave at every frequency, as the paper's parameter study was made."""


def waves_of_turn(block: SineBlock, turn: LayerTurn | float) -> int:
    """Return the whole number of waves by which every second layer is turned.

    Only after whole waves do the faces of two layers meet.

    Parameters
    ----------
    block
        Its frequency says how many waves a block has.
    turn
        In words, or a number of waves from 0 (joints in line) to less than a block's 2f.
    """
    waves = block.waves_per_block
    if turn is LayerTurn.HALF_BLOCK:
        return int(block.frequency)
    if turn is LayerTurn.ONE_WAVE:
        return 1 % waves
    if not np.isfinite(turn):
        raise BlockParameterError(f"turn: got {turn}, expected a whole number of waves")
    if turn != round(turn):
        # z of the two faces differ by a [sin(x + 2π turn) - sin x], at most 2 a |sin π turn|.
        depth = 2 * block.amplitude * abs(np.sin(np.pi * turn))
        raise BlockParameterError(
            f"turn: got {turn:g} waves, after which the blocks of two layers would cut "
            f"into each other by up to {depth:.3g} mm; expected a whole number of waves: try "
            f"{_whole_turns(turn, waves)}"
        )
    if not 0 <= turn < waves:
        raise BlockParameterError(
            f"turn: got {turn:g} waves of a block that has {waves}; expected 0 to "
            f"{waves - 1}: {round(turn) % waves} is the same tube"
        )
    return round(turn)


def _whole_turns(turn: float, waves: int) -> str:
    """Name the whole numbers of waves next to a turn, of those that a block has."""
    near = sorted({int(np.floor(turn)) % waves, int(np.ceil(turn)) % waves})
    return " or ".join(str(k) for k in near)


@dataclass(frozen=True)
class SineBlockDivisions(Options):
    """Elements of one block in each direction."""

    around: Count
    radial: Count
    axial: Count
    radial_grading: Annotated[float, Ge(1e-3), Le(1e3)] = 1.0
    """Mesh bias: element length at the inner over that at the outer face; 1: uniform."""

    @property
    def radial_positions(self) -> FloatArray:
        """Places of the nodes across the wall, 0 inside to 1 outside, (radial + 1,).

        One smooth map of equal steps, (1 - g⁻ˣ) / (1 - g⁻¹): twice as many elements nest.
        """
        equal = np.linspace(0.0, 1.0, self.radial + 1)
        if self.radial_grading == 1.0:
            return equal
        rate = np.log(self.radial_grading)
        graded: FloatArray = np.expm1(-rate * equal) / np.expm1(-rate)
        graded[-1] = 1.0
        return graded

    @property
    def frame_axial(self) -> int:
        """Elements in the half-height frame blocks: the same size, at least one."""
        return max(1, round(self.axial / 2))


def check_shift(shift: float) -> None:
    """Reject a shift of waves that is no number, or so large that its float has no phase left."""
    if not is_number(shift) or abs(shift) > LARGEST_SHIFT:
        raise BlockParameterError(
            f"shift: got {shift}; expected a number between -{LARGEST_SHIFT:g} and "
            f"{LARGEST_SHIFT:g}: waves repeat after a shift of 2"
        )


#: The block of the paper's tables.
TSB1 = SineBlock(
    height=200.0,
    amplitude=20.0,
    frequency=1.5,
    blocks_per_layer=4,
    inner_radius=120.0,
    thickness=40.0,
)


def check_conforming(block: SineBlock, divisions: SineBlockDivisions, turned_waves: int) -> None:
    """Reject element counts with which layers turned by some waves do not meet node on node."""
    waves, around = block.waves_per_block, divisions.around
    if (turned_waves * around) % waves == 0:
        return
    step = waves // int(np.gcd(waves, turned_waves))
    near = [n for n in (around // step * step, (around // step + 1) * step) if n]
    turns = [k for k in range(1, waves) if (k * around) % waves == 0]
    nearest = min(turns, key=lambda k: abs(k - turned_waves), default=None)
    other = "" if nearest is None else f", or `turn` = {nearest}"
    raise BlockParameterError(
        f"around: got {around}; with {waves} waves per block the layers turn by "
        f"{turned_waves}/{waves} of a block and would not meet node on node; expected a multiple "
        f"of {step}: try {' or '.join(str(n) for n in near)}{other}"
    )


def check_divisions(block: SineBlock, divisions: SineBlockDivisions) -> None:
    """Reject element counts that mesh no block."""
    if divisions.around < 2 * block.waves_per_block and block.amplitude > 0:
        raise BlockParameterError(
            f"around: got {divisions.around} elements for {block.waves_per_block} waves; "
            f"expected at least two per wave: try {4 * block.waves_per_block} or more"
        )
    corners = np.linspace(0.0, 1.0, divisions.around + 1)
    outer = np.array(block.inner_radius + block.thickness)
    reached = float(np.abs(wave(block, corners, outer)).max())
    if reached < LEAST_REACHED * block.amplitude:
        raise BlockParameterError(
            f"around: got {divisions.around}; with `shift` = {block.shift:g} the corners "
            "of the elements meet the wave near its zeros, and the block would have an amplitude "
            f"of {reached:.3g} mm for {block.amplitude:g} mm; try {4 * block.waves_per_block} or "
            "more"
        )


def wave(block: SineBlock, u: FloatArray, r: FloatArray) -> FloatArray:
    """Axial displacement A(r) sin(2π 2f u + π s) of a horizontal plane [mm]."""
    amplitude = block.amplitude * (r - block.inner_radius) / block.thickness
    return amplitude * np.sin(2 * np.pi * block.waves_per_block * u + np.pi * block.shift)


def _build(
    block: SineBlock,
    divisions: SineBlockDivisions,
    *,
    bottom: float,
    top: float,
    wavy: tuple[float, float],
    name: str,
    contact_faces: tuple[str, ...],
) -> Block:
    """Mesh between z = bottom and z = top; ``wavy`` scales the wave at the two ends."""
    r1 = block.inner_radius + block.thickness * divisions.radial_positions
    u1 = np.linspace(0.0, 1.0, divisions.around + 1)
    w1 = np.linspace(0.0, 1.0, divisions.axial + 1)
    return mapped_block(
        name,
        (r1, u1, w1),
        partial(_shape, block, (bottom, top), wavy),
        _FACE_NAMES,
        contact_faces,
        directions=("across", "along", "upward"),
        parts=(1, block.waves_per_block, 1),
    )


def _shape(
    block: SineBlock,
    ends: tuple[float, float],
    wavy: tuple[float, float],
    parameters: FloatArray,
) -> FloatArray:
    """Points of r, u and w, (m, 3) to (m, 3) [mm]."""
    r, u, w = parameters.T
    theta = block.block_angle * (u - 0.5)
    weight = wavy[0] * (1 - w) + wavy[1] * w
    z = ends[0] * (1 - w) + ends[1] * w + weight * wave(block, u, r)
    return np.column_stack([r * np.cos(theta), r * np.sin(theta), z])


def sine_block(block: SineBlock, divisions: SineBlockDivisions) -> Block:
    """Build the free block, centred on the x axis (θ = 0), between z = 0 and z = h.

    Returns
    -------
    Block
        Faces ``inner``, ``outer`` (curved), ``left``, ``right`` (flat, radial) and ``bottom``,
        ``top`` (wavy); the last four can meet neighbours.
    """
    check_divisions(block, divisions)
    return _build(
        block,
        divisions,
        bottom=0.0,
        top=block.height,
        wavy=(1.0, 1.0),
        name="sine-block",
        contact_faces=("bottom", "top", "left", "right"),
    )


def bottom_frame_block(block: SineBlock, divisions: SineBlockDivisions) -> Block:
    """Build the frame block below the first layer: flat at z = -h/2, wavy at z = 0."""
    half = replace(divisions, axial=divisions.frame_axial)
    return _build(
        block,
        half,
        bottom=-block.height / 2,
        top=0.0,
        wavy=(0.0, 1.0),
        name="bottom-frame",
        contact_faces=("top", "left", "right"),
    )


def top_frame_block(block: SineBlock, divisions: SineBlockDivisions) -> Block:
    """Build the frame block above the last layer: wavy at z = 0, flat at z = h/2."""
    half = replace(divisions, axial=divisions.frame_axial)
    return _build(
        block,
        half,
        bottom=0.0,
        top=block.height / 2,
        wavy=(1.0, 0.0),
        name="top-frame",
        contact_faces=("bottom", "left", "right"),
    )
