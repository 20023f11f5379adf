"""The hexagon-based block THB(n, r_i, t), reconstructed, and its flat-trimmed frame blocks.

The paper cites this block and prints only its name and three parameters. The reading used here
reproduces the printed numbers:

- unrolled on the inner cylinder (x = r_i θ) the block is a regular hexagon of circumradius r_c,
  √3 r_c = 2π r_i/n, two edges parallel to the tube axis, layers 1.5 r_c apart and turned by half
  a block;
- on the outer face edges 0, 2, 4 bulge out to the circumscribed circle and edges 1, 3, 5 bulge in
  by the mirrored arc; on the inner face the opposite; linear in between, so the middle section is
  the straight hexagon. Opposite edges have opposite parity: translated copies fit together.

Edge k runs from vertex k to vertex k + 1; vertex 0 is the lower right one, vertices are numbered
counter-clockwise seen from outside the tube, so edge 0 is the right-hand one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from annotated_types import Ge

from geometry.block import Block, Charts, Curve, Lines
from geometry.families.sine_block import BlockParameterError
from geometry.mesh import (
    FloatArray,
    HexMesh,
    IntArray,
    check_mesh,
    grid_points,
    structured_quads,
)
from geometry.parts.options import Count, Length, Options

#: Names of the six sides, edge by edge.
EDGE_NAMES = tuple(f"edge{k}" for k in range(6))
#: Kites (one for each vertex) of the whole hexagon and of the halves above and below its middle.
_WHOLE, _UPPER, _LOWER = (0, 1, 2, 3, 4, 5), (1, 2, 3), (4, 5, 0)


@dataclass(frozen=True)
class HexagonBlock(Options):
    """The three parameters of THB(n, r_i, t)."""

    blocks_per_layer: Annotated[int, Ge(2)]
    """n"""
    inner_radius: Length
    """r_i [mm]"""
    thickness: Length
    """t [mm]"""

    @property
    def block_angle(self) -> float:
        """Angle spanned by one block between its two straight edges, 2π/n [rad]."""
        return 2 * np.pi / self.blocks_per_layer

    @property
    def circumradius(self) -> float:
        """r_c of the unrolled hexagon [mm]."""
        return float(self.inner_radius * self.block_angle / np.sqrt(3.0))

    @property
    def layer_pitch(self) -> float:
        """Distance of neighbouring layers, 1.5 r_c [mm]."""
        return 1.5 * self.circumradius


@dataclass(frozen=True)
class HexagonBlockDivisions(Options):
    """Elements along each edge of the hexagon and through the thickness."""

    edge: Annotated[int, Ge(2)]
    """Elements along each edge of the hexagon; even, so that it can be cut in the middle."""
    radial: Count

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.edge % 2:
            raise BlockParameterError(
                f"edge: got {self.edge}, expected an even number of elements along each "
                f"edge of the hexagon: try {self.edge - 1} or {self.edge + 1}"
            )


def _vertex(k: int) -> FloatArray:
    """Vertex k of the unit hexagon, (2,); 0 is the lower right one."""
    angle = np.pi / 3 * (k - 0.5)
    return np.array([np.cos(angle), np.sin(angle)])


def _edge_points(k: int, u: FloatArray, bulge: FloatArray) -> FloatArray:
    """Points of edge k of the unit hexagon, u in [0, 1] along it; (..., 2).

    ``bulge`` 1 is the arc of the circumscribed circle on even edges, its mirror image on odd ones.
    """
    start, end = _vertex(k), _vertex(k + 1)
    chord = start + u[..., None] * (end - start)
    normal = 0.5 * (start + end) / np.linalg.norm(0.5 * (start + end))
    half_chord = 2 * u - 1
    offset = np.sqrt(1.0 - 0.25 * half_chord**2) - np.sqrt(0.75)
    sign = 1.0 if k % 2 == 0 else -1.0
    return chord + sign * (bulge * offset)[..., None] * normal


def _kite(k: int, a: FloatArray, b: FloatArray, bulge: FloatArray) -> FloatArray:
    """Points of the kite at vertex k, (..., 2), by transfinite interpolation.

    ``a`` runs from the centre along the middle of edge k, ``b`` along the middle of edge k - 1;
    sides through the centre (the origin) are straight.
    """
    after = _edge_points(k, 0.5 * (1.0 - b), bulge)  # middle of edge k to vertex k
    before = _edge_points(k - 1, 0.5 + 0.5 * a, bulge)  # middle of edge k - 1 to vertex k
    return b[..., None] * before + a[..., None] * after - (a * b)[..., None] * _vertex(k)


def _wall(segments: IntArray, n_r: int, n_plane: int) -> IntArray:
    """Facets over boundary segments (n, 2) that run counter-clockwise: outward, (n n_r, 4)."""
    base = np.concatenate([segments, segments[:, ::-1] + n_plane], axis=1)
    quads = base + n_plane * np.arange(n_r)[:, None, None]
    return quads.reshape(-1, 4)


def _segments(line: IntArray) -> IntArray:
    return np.column_stack([line[:-1], line[1:]])


def _side_faces(
    number: dict[int, IntArray], n_r: int, n_plane: int, flat: str | None
) -> dict[str, IntArray]:
    """Facets of the edges and of the flat cut, if there is one."""
    faces = {}
    for edge in range(6):
        following = (edge + 1) % 6
        halves = []
        if edge in number:
            halves.append(_segments(number[edge][-1, ::-1]))
        if following in number:
            halves.append(_segments(number[following][:, -1]))
        if halves:
            faces[EDGE_NAMES[edge]] = _wall(np.concatenate(halves), n_r, n_plane)
    if flat is not None:
        first, *_, last = number
        cut = [_segments(number[last][::-1, 0]), _segments(number[first][0])]
        faces[flat] = _wall(np.concatenate(cut), n_r, n_plane)
    return faces


def _build(
    block: HexagonBlock,
    divisions: HexagonBlockDivisions,
    kites: tuple[int, ...],
    *,
    name: str,
    flat: str | None = None,
) -> Block:
    """Mesh some kites; ``flat`` names the cut through the middle, if there is one."""
    s = np.linspace(0.0, 1.0, divisions.edge // 2 + 1)
    y = np.linspace(0.0, 1.0, divisions.radial + 1)
    return _on_lines(block, kites, name, flat, (s, s, y))


def _on_lines(
    block: HexagonBlock,
    kites: tuple[int, ...],
    name: str,
    flat: str | None,
    lines: Lines,
) -> Block:
    """Mesh some kites with lines along both sides of a kite, the same ones, and across the wall."""
    s, _, y = lines
    m, n_r = len(s) - 1, len(y) - 1
    # Kites share nodes: found on the straight middle section, whose nodes are 0.4 of a line's
    # distance apart or more (the offset keeps round-off away from the edges of the rounding
    # intervals).
    fine = round(1.0 / float(np.diff(s).min()))
    a, b = np.meshgrid(s, s, indexing="ij")
    straight = np.concatenate([_kite(k, a, b, np.zeros_like(a)).reshape(-1, 2) for k in kites])
    key = np.round(straight * (100 * fine) + 1 / np.pi).astype(np.int64)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    n_plane = len(first)
    number = dict(zip(kites, inverse.reshape(len(kites), m + 1, m + 1), strict=True))

    shape = partial(_shape, block)
    in_plane = grid_points(np.array(kites, dtype=np.float64), s, s)
    nodes = shape(np.column_stack([np.tile(in_plane[first], (n_r + 1, 1)), np.repeat(y, n_plane)]))
    # Seen from outside, a points to edge k and b to edge k - 1: (b, a, r) is right-handed.
    of_kite = (m + 1) ** 2 * np.arange(len(kites))[:, None, None]
    corners = (of_kite + structured_quads(m)[:, [0, 3, 2, 1]]).reshape(-1, 4)
    quads = inverse.ravel()[corners]
    layers = n_plane * np.arange(n_r)[:, None, None]
    elements = np.concatenate([quads + layers, quads + layers + n_plane], axis=2).reshape(-1, 8)
    mesh = HexMesh(nodes, elements)
    check_mesh(mesh, name)
    sides = _side_faces(number, n_r, n_plane, flat)
    faces = {"inner": quads[:, ::-1], "outer": quads + n_r * n_plane, **sides}
    contact_faces = tuple(edge for edge in EDGE_NAMES if edge in sides)
    curve = Curve(partial(_corner_parameters, in_plane[corners], y), shape)
    numbers = np.arange(len(elements)).reshape(n_r, len(kites), m, m).transpose(1, 2, 3, 0)
    charts = Charts(
        ("along", "along", "across"),
        (1, 1, 1),
        lines,
        numbers,
        partial(_on_lines, block, kites, name, flat),
        natural=(1, 0, 2),
    )
    return Block(name, mesh, faces, contact_faces, curve, charts)


def _shape(block: HexagonBlock, parameters: FloatArray) -> FloatArray:
    """Points of kite, a, b and y, (m, 4) to (m, 3) [mm]."""
    kite, a, b, y = parameters.T
    points = np.empty((len(y), 3))
    for k in np.unique(np.rint(kite)).astype(np.int64).tolist():
        members = np.rint(kite) == k
        plane = _kite(k, a[members], b[members], 2 * y[members] - 1)
        x, points[members, 2] = (block.circumradius * plane).T
        r = block.inner_radius + block.thickness * y[members]
        theta = x / block.inner_radius
        points[members, :2] = np.column_stack([r * np.cos(theta), r * np.sin(theta)])
    return points


def _corner_parameters(quads: FloatArray, y: FloatArray) -> FloatArray:
    """Kite, a, b and y of the corners of every element, (n_elements, 8, 4).

    Of quads (n_quads, 4, 3) swept across the wall, y at the ends of elements.
    """
    parameters = np.empty((len(y) - 1, len(quads), 8, 4))
    parameters[..., :3] = np.concatenate([quads, quads], axis=1)
    parameters[:, :, :4, 3] = y[:-1, None, None]
    parameters[:, :, 4:, 3] = y[1:, None, None]
    return parameters.reshape(-1, 8, 4)


def hexagon_block(block: HexagonBlock, divisions: HexagonBlockDivisions) -> Block:
    """Build the free block, centred on the x axis (θ = 0) and on z = 0.

    Returns
    -------
    Block
        Faces ``inner``, ``outer`` (curved) and ``edge0`` … ``edge5``, which can meet neighbours.

    Raises
    ------
    BlockParameterError
        For parameters that describe no block.
    """
    return _build(block, divisions, _WHOLE, name="hexagon-block")


def bottom_hexagon_frame(block: HexagonBlock, divisions: HexagonBlockDivisions) -> Block:
    """Build the frame block below the first layer: the upper half, flat at z = 0 (``bottom``)."""
    return _build(block, divisions, _UPPER, name="bottom-frame", flat="bottom")


def top_hexagon_frame(block: HexagonBlock, divisions: HexagonBlockDivisions) -> Block:
    """Build the frame block above the last layer: the lower half, flat at z = 0 (``top``)."""
    return _build(block, divisions, _LOWER, name="top-frame", flat="top")
