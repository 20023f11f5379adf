"""A roller or a ball on a plane body, in half-spaces' proportions: what Hertz presses together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from geometry.assembly import Assembly
from geometry.block import Block
from geometry.families.round_bodies import Plan, quarter_disc, round_ended, strip
from geometry.mesh import boundary_quads
from geometry.parts.options import Count, Length, Options
from geometry.parts.placed import AssemblyError, UnmatchedJoint

#: The round body ends so far from its axis, in its radius.
_TRIMMED = 0.8
#: Half width and depth of the plane body, in the radius of the other one.
_WIDE, _DEEP = 2.0, 4.0
#: Edge of the plane body's elements over that of the round one: no facets match.
_UNLIKE = 1.25


@dataclass(frozen=True)
class Indenter(Options):
    """A round body (block 1) above a plane one (block 0), tip at the origin.

    Faces of both: ``end``, where they can touch, ``base``, the plane on the far side, and the cuts,
    ``y-`` and ``y+`` of a slice, ``x-`` and ``y-`` of a quarter. No block is fixed.
    """

    type: Literal["roller", "ball"]
    """A slice of a roller along y, or a quarter of a ball between the planes x = 0 and y = 0."""
    radius: Length
    """[mm]"""
    contact: Length
    """Half width or radius of the contact that is expected [mm]: elements are equal there."""
    elements: Count = 6
    """Elements of the round body over the expected contact; those of the plane one are larger by a
    quarter."""
    thickness: Length = 1.0
    """Of a slice of a roller, along y, one element [mm]; a ball has none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.contact > 0.5 * self.radius:
            raise AssemblyError(
                f"contact: got {self.contact:g} mm for a radius of {self.radius:g} mm; "
                "expected at most half of it"
            )

    def build(self) -> Assembly:
        """Place both bodies tip on plane."""
        round_cell = self.contact / self.elements
        lower = _body(self, "plane", _UNLIKE * round_cell, _WIDE, _DEEP)
        upper = _body(self, self.type, round_cell, _TRIMMED, 1.0, round_end=True)
        ball = self.type == "ball"
        # Axis and place of the cuts in the frame of each body, the lower one turned over.
        names = ("x-", "y-") if ball else ("y-", "y+")
        places = ((0, 0.0), (1, 0.0)) if ball else ((1, 0.0), (1, self.thickness))
        lower = _with_cuts(lower, dict(zip(names, places[::-1], strict=True)))
        upper = _with_cuts(upper, dict(zip(names, places, strict=True)))
        turn = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]) if ball else np.diag([1.0, -1, -1])
        return Assembly(
            name=f"{self.type}-on-plane",
            shapes=(lower, upper),
            shape_of=np.arange(2),
            rotations=np.stack([turn, np.eye(3)]),
            translations=np.array([[0.0, 0.0 if ball else self.thickness, 0.0], [0.0, 0.0, 0.0]]),
            layer=np.arange(2),
            fixed=np.zeros(2, dtype=np.bool_),
            unmatched_allowed=True,
            # They touch in a line or a point.
            unmatched=(UnmatchedJoint(0, 1, 0.0, 0.0, np.array([0.0, 0.0, 1.0])),),
        )


def _with_cuts(body: Block, cuts: dict[str, tuple[int, float]]) -> Block:
    """Name the facets on planes of one coordinate."""
    outer = boundary_quads(body.mesh)
    faces = dict(body.faces)
    for name, (axis, at) in cuts.items():
        near = np.abs(body.mesh.nodes[:, axis] - at) < 1e-9 * body.mesh.nodes.max()
        faces[name] = outer[near[outer].all(axis=1)]
    return replace(body, faces=faces)


def _body(
    shape: Indenter, name: str, cell: float, wide: float, deep: float, *, round_end: bool = False
) -> Block:
    """One body, its tip or plane at the origin, above z = 0."""
    length = wide * shape.radius
    plan: Plan = (
        quarter_disc(cell, shape.contact, length)
        if shape.type == "ball"
        else strip(cell, shape.contact, length, thickness=shape.thickness)
    )
    radius = shape.radius if round_end else math.inf
    return round_ended(
        name, plan, cell=cell, contact=shape.contact, depth=deep * shape.radius, radius=radius
    )
