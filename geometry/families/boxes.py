"""Assemblies of boxes with known answers: bricks between two fixed rows, a column of boxes.

Bricks slide out of the wall, so nothing is locked; a pressure on one side activates that mechanism;
a pressure from above is carried with the same pressure in every joint. In a column every joint that
is covered wholly carries the pressure on its top, and the overclosure of the joint follows from the
contact law alone, whether or not the meshes match there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar

import numpy as np

from geometry.assembly import Assembly, matched_area
from geometry.block import Block, box_block
from geometry.parts.options import Count, Divisions, Options, Size
from geometry.parts.placed import AssemblyError, UnmatchedJoint

_FACES = {"y-": "inner", "y+": "outer", "x-": "left", "x+": "right", "z-": "bottom", "z+": "top"}


def brick(size: tuple[float, float, float], divisions: tuple[int, int, int]) -> Block:
    """Brick [0, size] whose faces are named like a tube block's, y pointing outward."""
    contact = ("bottom", "top", "left", "right")
    return box_block(size, divisions, name="brick", contact_faces=contact, face_names=_FACES)


@dataclass(frozen=True)
class BrickStack(Options):
    """Stack of plain bricks, with a fixed row below and one above."""

    size: Size
    """Length (x), depth (y, out of the wall) and height (z) of a brick [mm]."""
    divisions: Divisions
    """Elements of a brick along x, y, z."""
    _: KW_ONLY
    columns: Count = 1
    """Bricks side by side."""
    layers: Count
    """Free rows."""

    parts: ClassVar = (2, 1, 1)

    def build(self) -> Assembly:
        """Stack the rows."""
        size, rows = self.size, np.arange(self.layers + 2)
        column, layer = (i.ravel() for i in np.meshgrid(np.arange(self.columns), rows))
        places = [column * size[0], np.zeros(len(column)), (layer - 1.0) * size[2]]
        return Assembly(
            name="brick-stack",
            shapes=(brick(size, self.divisions),),
            shape_of=np.zeros(len(layer), dtype=np.int64),
            rotations=np.tile(np.eye(3), (len(layer), 1, 1)),
            translations=np.column_stack(places),
            layer=layer,
            fixed=(layer == 0) | (layer == self.layers + 1),
            unmatched_allowed=True,
            unmatched=(),
        )


@dataclass(frozen=True)
class SeparateBoxes(Options):
    """Boxes [0, size] side by side along y, half a box apart: blocks that do not meet."""

    size: Size
    """Edge lengths along x, y, z [mm]."""
    divisions: Divisions
    """Elements along x, y, z."""
    copies: Count = 1
    """Uncoupled copies side by side; congruent blocks share one stiffness."""

    def build(self) -> Assembly:
        """Place the copies."""
        n = self.copies
        places = np.zeros((n, 3))
        places[:, 1] = 1.5 * self.size[1] * np.arange(n)
        return Assembly(
            name="boxes",
            shapes=(box_block(self.size, self.divisions),),
            shape_of=np.zeros(n, dtype=np.int64),
            rotations=np.tile(np.eye(3), (n, 1, 1)),
            translations=places,
            layer=np.zeros(n, dtype=np.int64),
            fixed=np.zeros(n, dtype=np.bool_),
            unmatched_allowed=True,
            unmatched=(),
        )


#: Part of a joint's area that may be missing from its matched facets: rounding.
_AREA_TOLERANCE = 1e-9


@dataclass(frozen=True)
class ColumnBox(Options):
    """One box of a column."""

    size: Size
    """Along x, y, z [mm]."""
    divisions: Divisions
    """Elements along x, y, z."""


def box_column(boxes: Sequence[ColumnBox]) -> Assembly:
    """Stack boxes along z, centred on the z axis, the first one on z = 0 and held.

    Equal boxes share one shape. Box k is block k and layer k.

    Parameters
    ----------
    boxes
        From the bottom up, at least two.
    """
    if len(boxes) < 2:
        raise AssemblyError(f"boxes: got {len(boxes)}, expected at least 2 boxes that meet")
    kinds: dict[ColumnBox, int] = {}
    for box in boxes:
        kinds.setdefault(box, len(kinds))
    size = np.array([box.size for box in boxes])
    bottom = np.concatenate([[0.0], np.cumsum(size[:-1, 2])])
    n = len(boxes)
    column = Assembly(
        name="box-column",
        shapes=tuple(_shape(box, number) for box, number in kinds.items()),
        shape_of=np.array([kinds[box] for box in boxes], dtype=np.int64),
        rotations=np.tile(np.eye(3), (n, 1, 1)),
        translations=np.column_stack([-0.5 * size[:, :2], bottom]),
        layer=np.arange(n, dtype=np.int64),
        fixed=np.arange(n) == 0,
        unmatched_allowed=True,
    )
    return replace(column, unmatched=_unmatched(column))


def _shape(box: ColumnBox, number: int) -> Block:
    return box_block(box.size, box.divisions, name=f"box-{number}", contact_faces=("z-", "z+"))


def _unmatched(column: Assembly) -> tuple[UnmatchedJoint, ...]:
    """Joints where the facets of the two boxes do not match, from the bottom up."""
    joints = []
    for below in range(column.n_blocks - 1):
        pair = (below, below + 1)
        width, depth = np.min([np.ptp(column.nodes(b), axis=0)[:2] for b in pair], axis=0)
        joint, matched = float(width * depth), matched_area(column, *pair)
        if matched < (1.0 - _AREA_TOLERANCE) * joint:
            joints.append(UnmatchedJoint(*pair, joint, matched, np.array([0.0, 0.0, 1.0])))
    return tuple(joints)
