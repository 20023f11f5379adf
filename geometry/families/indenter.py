"""A roller or a ball on a plane body, in half-spaces' proportions: what Hertz presses together.

Bodies with a round end are graded hexahedra: a plan, the strip of a roller or the quarter disc of a
ball, is swept from the round end (its tip at the origin, the body above) to a plane base. Elements
are of equal size where bodies touch and grow by a constant factor beyond.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from geometry.assembly import Assembly
from geometry.block import Block
from geometry.mesh import FloatArray, HexMesh, boundary_quads, check_mesh, structured_quads
from geometry.parts.options import Count, Length, Options
from geometry.parts.placed import AssemblyError, UnmatchedJoint

#: Equal elements reach so far beyond the contact, in its radius, across and in depth.
_EQUAL_ACROSS, _EQUAL_DEEP = 1.2, 0.3
#: Facets can meet the other body so far out, in the radius of the contact.
_MEETS = 1.25
#: Factor from one element to the next beyond, across and in depth.
_GROWTH_ACROSS, _GROWTH_DEEP = 1.35, 1.25
#: Middle square of a quarter disc over the equal elements, and its far corner over its side: its
#: angle is near 120° then, as three elements meet there.
_SQUARE, _CORNER = 0.5, 0.8


class Plan(NamedTuple):
    """Facets that are swept, and how far their nodes are from the axis of the round end.

    Nodes (n, 2) [mm], counter-clockwise quads (n_quads, 4), and the distance of each node from the
    axis along which the end is round, (n,) [mm].
    """

    nodes: np.ndarray
    quads: np.ndarray
    tip: np.ndarray


def graded(cell: float, equal: float, length: float, growth: float) -> np.ndarray:
    """Ends of elements from 0 to ``length``: equal ones to ``equal``, growing ones beyond [mm]."""
    first = np.linspace(0.0, equal, max(1, round(equal / cell)) + 1)
    count = 1
    while equal + cell * sum(growth ** (k + 1) for k in range(count)) < length:
        count += 1
    sizes = growth ** np.arange(1.0, count + 1)
    beyond = equal + (length - equal) * np.cumsum(sizes) / sizes.sum()
    return np.concatenate([first, beyond])


def strip(cell: float, contact: float, length: float, *, thickness: float) -> Plan:
    """Plan of a roller or a slab, one element thick, from -length to length."""
    half = graded(cell, _EQUAL_ACROSS * contact, length, _GROWTH_ACROSS)
    x = np.concatenate([-half[:0:-1], half])
    n = len(x)
    nodes = np.column_stack([np.tile(x, 2), np.repeat([0.0, thickness], n)])
    k = np.arange(n - 1)
    return Plan(nodes, np.column_stack([k, k + 1, n + k + 1, n + k]), np.abs(nodes[:, 0]))


def _quarter_circle(n: int) -> FloatArray:
    """Points of the unit circle from the x axis to the y axis, (2n + 1, 2)."""
    angle = 0.25 * np.pi * np.arange(2 * n + 1) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    circle[0, 1] = circle[-1, 0] = 0.0
    return circle


def quarter_disc(cell: float, contact: float, length: float) -> Plan:
    """Plan of a quarter of a ball: a square in the middle, rings of elements round it."""
    equal = _EQUAL_ACROSS * contact
    side = _SQUARE * equal
    n = max(2, round(side / cell))
    u, v = (part.ravel() / n for part in np.indices((n + 1, n + 1)))
    inward = (1.0 - _CORNER) * (u * v)[:, None]
    nodes = [side * (np.column_stack([u, v]) - inward)]
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = [structured_quads(n)]
    before = np.concatenate([number[n], number[:n, n][::-1]])
    rim = nodes[0][before]
    circle = _quarter_circle(n)
    inner = max(1, round((equal - side) / cell))
    radii = graded(cell, equal, length, _GROWTH_ACROSS)
    rings = [rim + k / inner * (equal * circle - rim) for k in range(1, inner + 1)]
    rings += [radius * circle for radius in radii[radii > equal * (1.0 + 1e-9)]]
    for ring in rings:
        after = sum(map(len, nodes)) + np.arange(2 * n + 1)
        nodes.append(ring)
        quads.append(np.column_stack([before[:-1], after[:-1], after[1:], before[1:]]))
        before = after
    points = np.concatenate(nodes)
    return Plan(points, np.concatenate(quads), np.linalg.norm(points, axis=1))


def round_ended(
    name: str, plan: Plan, *, cell: float, contact: float, depth: float, radius: float = np.inf
) -> Block:
    """Sweep a plan from an end of a radius, plane where that is infinite, to a plane base.

    Elements have the edge ``cell`` at the tip, ``contact`` is the radius of the contact that is
    meant and ``depth`` the way from the tip to the base [mm]. The block has the faces ``end``
    (where it can touch) and ``base``.
    """
    curved = np.isfinite(radius)
    sag = radius - np.sqrt(radius**2 - plan.tip**2) if curved else np.zeros(len(plan.tip))
    share = graded(cell, _EQUAL_DEEP * contact, depth, _GROWTH_DEEP) / depth
    heights = sag + share[:, None] * (depth - sag)
    n = len(plan.nodes)
    nodes = np.column_stack([np.tile(plan.nodes, (len(share), 1)), heights.ravel()])
    first = n * np.arange(len(share) - 1)[:, None, None]
    columns = np.concatenate([first + plan.quads, first + n + plan.quads], axis=2)
    mesh = HexMesh(nodes, columns.reshape(-1, 8))
    check_mesh(mesh, name)
    outer = boundary_quads(mesh)
    near = plan.tip[outer % n].mean(axis=1) < _MEETS * contact
    ends = {
        "end": outer[(outer < n).all(axis=1) & near],
        "base": outer[(outer >= len(nodes) - n).all(axis=1)],
    }
    return Block(name, mesh, ends, contact_faces=("end",))


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
