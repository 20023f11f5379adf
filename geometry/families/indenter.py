"""A roller or a ball on a plane body, in half-spaces' proportions: what Hertz presses together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from geometry.assembly import Assembly, AssemblyError
from geometry.block import Block
from geometry.families.round_bodies import Plan, quarter_disc, round_ended, strip
from geometry.mesh import boundary_quads

#: The round body ends so far from its axis, in its radius.
_TRIMMED = 0.8
#: Half width and depth of the plane body, in the radius of the other one.
_WIDE, _DEEP = 2.0, 4.0
#: Edge of the plane body's elements over that of the round one: no facets match.
_UNLIKE = 1.25


@dataclass(frozen=True)
class Indenter:
    """A round body above a plane one, tip at the origin; the plane body looks up along z."""

    body: Literal["roller", "ball"]
    """A slice of a roller along y, or a quarter of a ball between the planes x = 0 and y = 0."""
    radius: float
    """[mm]"""
    contact: float
    """Half width or radius of the contact that is expected: elements are equal there [mm]."""
    elements: int
    """Elements of the round body over it."""
    thickness: float = 1.0
    """Of the slice, one element along y [mm]; a ball has none."""


def indented(shape: Indenter) -> Assembly:
    """Place both bodies tip on plane: block 0 is the plane one, block 1 the round one.

    Faces of both: ``end``, where they can touch, ``base``, the plane on the far side, and the cuts,
    ``y-`` and ``y+`` of a slice, ``x-`` and ``y-`` of a quarter. No block is fixed.
    """
    lengths = shape.radius, shape.contact, shape.thickness
    if not (all(map(math.isfinite, lengths)) and min(lengths) > 0.0 and shape.elements > 0):
        raise AssemblyError(
            f"block: got lengths {list(lengths)} mm and {shape.elements} elements; expected "
            "positive ones"
        )
    if shape.contact > 0.5 * shape.radius:
        raise AssemblyError(
            f"block.contact: got {shape.contact:g} mm for a radius of {shape.radius:g} mm; "
            "expected at most half of it"
        )
    round_cell = shape.contact / shape.elements
    lower = _body(shape, "plane", _UNLIKE * round_cell, _WIDE, _DEEP)
    upper = _body(shape, shape.body, round_cell, _TRIMMED, 1.0, round_end=True)
    ball = shape.body == "ball"
    # Axis and place of the cuts in the frame of each body, the lower one turned over.
    names = ("x-", "y-") if ball else ("y-", "y+")
    places = ((0, 0.0), (1, 0.0)) if ball else ((1, 0.0), (1, shape.thickness))
    lower = _with_cuts(lower, dict(zip(names, places[::-1], strict=True)))
    upper = _with_cuts(upper, dict(zip(names, places, strict=True)))
    turn = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]) if ball else np.diag([1.0, -1, -1])
    return Assembly(
        name=f"{shape.body}-on-plane",
        shapes=(lower, upper),
        shape_of=np.arange(2),
        rotations=np.stack([turn, np.eye(3)]),
        translations=np.array([[0.0, 0.0 if ball else shape.thickness, 0.0], [0.0, 0.0, 0.0]]),
        layer=np.arange(2),
        fixed=np.zeros(2, dtype=np.bool_),
        unmatched_allowed=True,
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
        if shape.body == "ball"
        else strip(cell, shape.contact, length, thickness=shape.thickness)
    )
    radius = shape.radius if round_end else math.inf
    return round_ended(
        name, plan, cell=cell, contact=shape.contact, depth=deep * shape.radius, radius=radius
    )
