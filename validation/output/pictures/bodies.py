"""Blocks, their edges, contact facets and loads as parts of a view."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geometry.assembly import Assembly
from geometry.block import Block
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray
from geometry.parts.contact_mesh import interface_surface
from geometry.parts.measures import facets_between, first_largest
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.assembly import PolyhedralAssembly
from validation.output.pictures.canvas import (
    Direction,
    Lines,
    Part,
    Pixels,
    Surface,
    View,
    merged,
    rgb,
)
from validation.output.pictures.gallery import Panel
from validation.output.pictures.scales import (
    BLUE,
    GREY,
    SKY,
    VERMILION,
    Scale,
    pressure_scale,
)
from validation.output.pictures.style import look

#: The eye is outside, a little above the horizontal.
EYE: Direction = (2.4, -1.6, 0.9)
#: Blocks that are no tube are seen from the side, a little above; flat panels from above.
FROM_THE_SIDE: Direction = (1.0, -1.9, 1.5)
FROM_ABOVE: Direction = (0.9, -1.2, 2.4)

#: A value by less above those that are drawn is not said: three digits are.
_SHOWN = 1.005
#: Pixels along the longer side of the picture that finds visible bodies, and the part of it
#: that a body's visible part is to be wide and high.
_PROBE, _SEEN_OF_BODY = 700, 0.02
#: Sides of an arrow.
_SIDES = 10

Places = Callable[[int], FloatArray]


def is_tube(assembly: Assembly) -> bool:
    """Whether blocks stand round the axis, so that one side hides the other."""
    return not assembly.unmatched_allowed


def far_side(
    assembly: Assembly, points: FloatArray, towards: Direction = EYE
) -> npt.NDArray[np.bool_]:
    """Whether points lie on the side of the tube's axis away from an eye; all do in a wall."""
    if not is_tube(assembly):
        return np.ones(len(points), dtype=bool)
    arm = (points - assembly.origin)[:, :2]
    return np.asarray(arm @ np.array(towards[:2]) < 1e-6 * assembly.characteristic_length)


def turned(direction: Direction, angle: float) -> Direction:
    """Turn a direction about the z axis by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, z = direction
    return (float(cosine * x - sine * y), float(sine * x + cosine * y), z)


def quarter(direction: Direction, arm: FloatArray) -> Direction:
    """Turn a direction by quarters about the z axis until it is nearest to that of an arm (3,)."""
    angle = np.arctan2(arm[1], arm[0]) - np.arctan2(direction[1], direction[0])
    return turned(direction, 0.5 * np.pi * float(np.round(angle / (0.5 * np.pi))))


def eye(assembly: AnyBlocks, before: FloatArray | None = None) -> Direction:
    """Direction from which all blocks are seen, the same for the pictures of all methods.

    Of a tube, `EYE` or, turned by quarters, the one that has a point (3,) [mm] most in front. Flat
    panels are seen from farther above than other blocks.
    """
    if isinstance(assembly, Assembly) and is_tube(assembly):
        return EYE if before is None else quarter(EYE, before - assembly.origin)
    shapes = [s.mesh.nodes if isinstance(s, Block) else s.points for s in assembly.shapes]
    placed = [assembly.place(b, shapes[k]) for b, k in enumerate(assembly.shape_of)]
    extent = np.ptp(np.concatenate(placed), axis=0)
    return FROM_ABOVE if extent[2] < 0.5 * min(extent[0], extent[1]) else FROM_THE_SIDE


def steep(direction: Direction, sign: float) -> Direction:
    """The same side seen from far above, or from far below where the sign is negative."""
    return (direction[0], direction[1], sign * 1.1 * float(np.hypot(*direction[:2])))


def above_and_below(
    parts: Sequence[Part], direction: Direction, *, title: str = "", scale: Scale | None = None
) -> list[Panel]:
    """Two views of what would hide itself: from above with a title, and from below."""
    x, y, z = direction
    first = f"{title}, from above" if title else "from above"
    return [
        Panel(first, View(parts, (x, y, abs(z))), scale=scale),
        Panel("from below", View(parts, (x, y, -abs(z))), scale=scale),
    ]


def middle_layer(assembly: Assembly) -> int:
    """Return the layer at mid-height, or the one above it."""
    return assembly.n_layers // 2 + 1


# ---------------------------------------------------------------------------------------------
# Blocks


def sharp_edges(
    points: FloatArray, polygons: IntArray, *, angle: float = 40.0, group: IntArray | None = None
) -> IntArray:
    """Edges of a closed surface where two polygons meet at more than an angle.

    Parameters
    ----------
    points
        (n_points, 3)
    polygons
        (n_polygons, n_corners), all oriented alike.
    angle
        Between their normals [°].
    group
        Face that each polygon belongs to, (n_polygons,): edges between two faces count beyond a
        quarter of the angle, edges within a coarsely meshed one only beyond twice the angle.

    Returns
    -------
    IntArray
        Both ends of each edge, (n, 2).
    """
    corners = points[polygons]
    normal = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    ends = np.stack([polygons, np.roll(polygons, -1, axis=1)], axis=2).reshape(-1, 2)
    owner = np.repeat(np.arange(len(polygons)), polygons.shape[1])
    low, high = ends.min(axis=1), ends.max(axis=1)
    _, first, which, count = np.unique(
        low * (len(points) + 1) + high, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.argsort(which, kind="stable")
    start = np.cumsum(count) - count
    # Edges with more than two polygons belong to no closed surface.
    pair = np.flatnonzero(count == 2)
    one, other = owner[order[start[pair]]], owner[order[start[pair] + 1]]
    least = np.full(len(pair), angle)
    if group is not None:
        least = np.where(group[one] == group[other], 2.0, 0.25) * angle
    turned = np.einsum("ij,ij->i", normal[one], normal[other]) < np.cos(np.radians(least))
    return np.asarray(ends[first[pair[turned]]])


def block_edges(shape: Block) -> IntArray:
    """Edges between the faces of a shape, both ends of each, (n, 2)."""
    polygons = np.concatenate(list(shape.faces.values()))
    group = np.repeat(np.arange(len(shape.faces)), [len(quads) for quads in shape.faces.values()])
    return sharp_edges(shape.mesh.nodes, polygons, group=group)


def colours_of_blocks(fixed: npt.NDArray[np.bool_], turn: IntArray) -> list[str]:
    """Fixed blocks grey, the others in turns of two blues."""
    return [GREY if f else (BLUE, SKY)[k % 2] for f, k in zip(fixed, turn.tolist(), strict=True)]


def turns(assembly: Assembly) -> IntArray:
    """Number of each block in its layer, beginning with that of the layer, (n_blocks,)."""
    order = [np.sum(assembly.layer[:b] == assembly.layer[b]) for b in range(assembly.n_blocks)]
    return np.array(order, dtype=np.int64) + assembly.layer


def block_legend(fixed: str = "fixed blocks", free: str = "free blocks") -> list[Any]:
    """Return what the colours of blocks mean, for a legend of matplotlib."""
    from matplotlib.patches import Patch

    words = {free: BLUE, fixed: GREY}
    return [Patch(color=colour, label=name) for name, colour in words.items() if name]


def with_labels(panel: Panel, assembly: AnyBlocks, blocks: Sequence[int]) -> Panel:
    """Panel with the number or name of some blocks, where the scene asks for one on them."""
    named = look().labels
    if named == "none":
        return panel
    names = assembly.names or [
        shape.name for shape in map(assembly.shape, range(assembly.n_blocks))
    ]
    bodies = [surfaces(assembly, [b], lambda _: GREY) for b in blocks]
    words = [str(b) if named == "numbers" else names[b] for b in blocks]
    return labelled(panel, words, [(s.points, s.polygons) for s in bodies])


def labelled(
    panel: Panel, names: Sequence[str], parts: Sequence[tuple[FloatArray, IntArray]]
) -> Panel:
    """Panel with the names of those bodies that its view shows, each in the middle of what is seen.

    Bodies are points (n, 3) [mm] and polygons, all of one number of corners.
    """
    view = panel.view
    if view is None or not names:
        return panel
    number = np.repeat(np.arange(1, len(parts) + 1), [len(polygons) for _, polygons in parts])
    shades = np.stack([number >> 16, number >> 8, number], axis=1).astype(np.uint8)
    points, polygons = merged(parts, parts[0][1].shape[1])
    probe = View([Surface(points, polygons, shades, lit=False)], view.direction, margin=0.0)
    shape = np.array(probe.size)
    wide, high = np.maximum((_PROBE * shape / shape.max()).astype(int), 1).tolist()
    seen = probe.render(wide, high).astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])
    corner = np.array(view.place(probe.axes.T @ probe.corner))
    result = []
    for k, name in enumerate(names, start=1):
        rows, columns = np.nonzero(seen == k)
        if len(rows) and min(np.ptp(rows), np.ptp(columns)) > _SEEN_OF_BODY * _PROBE:
            middle = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
            place = np.array([columns[middle] + 0.5, high - rows[middle] - 0.5])
            result.append((name, corner + place * shape / (wide, high)))
    return replace(panel, labels=result)


def _used(parts: Iterable[IntArray]) -> tuple[IntArray, IntArray]:
    """Nodes that some faces or edges use, and these by their places among those."""
    cells = np.concatenate(list(parts))
    used, places = np.unique(cells, return_inverse=True)
    return used, places.reshape(cells.shape)


def reference(shape: Any) -> tuple[FloatArray, dict[str, IntArray]]:
    """Points of a shape, and the polygons of its faces by name; triangles of a polyhedron."""
    if isinstance(shape, Block):
        return shape.mesh.nodes, shape.faces
    return shape.points, {"surface": shape.triangles}


def surfaces(
    assembly: AnyBlocks,
    blocks: Sequence[int],
    shade: Callable[[int], str | Pixels],
    *,
    faces: Sequence[str] | None = None,
    nodes: Places | None = None,
    **options: Any,
) -> Surface:
    """Surfaces of some blocks as one part; ``options`` are those of `Surface`.

    Parameters
    ----------
    shade
        Colour of a block, or of each of its nodes, (n_nodes, 3).
    faces
        Names; those that a shape does not have are left out. By default all.
    nodes
        Where the nodes of a block are drawn, (n_nodes, 3) [mm]; by default where it stands.
    """
    bodies, shades = [], [np.zeros((0, 3), dtype=np.uint8)]
    known: dict[int, tuple[FloatArray, IntArray, IntArray] | None] = {}
    for block in blocks:
        shape = int(assembly.shape_of[block])
        if shape not in known:
            points, named = reference(assembly.shape(block))
            shown = [named[name] for name in (faces or named) if name in named]
            known[shape] = (points, *_used(shown)) if shown else None
        if (what := known[shape]) is None:
            continue
        points, used, corners = what
        placed = assembly.place(block, points[used]) if nodes is None else nodes(block)[used]
        bodies.append((placed, corners))
        colour = shade(block)
        one = np.tile(rgb(colour), (len(used), 1)) if isinstance(colour, str) else colour[used]
        shades.append(one)
    n_corners = bodies[0][1].shape[1] if bodies else 4
    return Surface(*merged(bodies, n_corners), np.concatenate(shades), **options)


def outlines(
    assembly: AnyBlocks,
    blocks: Sequence[int],
    *,
    nodes: Places | None = None,
    width: float = 2.0,
    opacity: float = 1.0,
) -> Lines:
    """Sharp edges of some blocks, as assembled or with the nodes given."""
    if isinstance(assembly, PolyhedralAssembly):
        return _outlines_of_triangles(assembly, blocks, nodes, width, opacity)
    shapes = set(assembly.shape_of[list(blocks)].tolist())
    edges = {number: block_edges(assembly.shapes[number]) for number in sorted(shapes)}
    bodies = []
    for block in blocks:
        used, ends = _used([edges[int(assembly.shape_of[block])]])
        if nodes is None:
            placed = assembly.place(block, assembly.shape(block).mesh.nodes[used])
        else:
            placed = nodes(block)[used]
        bodies.append((placed, ends))
    return Lines(*merged(bodies, 2), width=width, opacity=opacity)


def _outlines_of_triangles(
    assembly: PolyhedralAssembly,
    blocks: Sequence[int],
    nodes: Places | None,
    width: float,
    opacity: float,
) -> Lines:
    """The same of triangulated blocks, found at once for all of them."""
    shapes = [assembly.shape(block) for block in blocks]
    points, triangles = merged([(shape.points, shape.triangles) for shape in shapes], 3)
    used, ends = _used([sharp_edges(points, triangles, angle=25.0)])
    places = [(assembly.points if nodes is None else nodes)(block) for block in blocks]
    return Lines(np.concatenate(places)[used], ends, width=width, opacity=opacity)


# ---------------------------------------------------------------------------------------------
# Contact


@dataclass(frozen=True)
class PressedFacets:
    """Contact facets and the pressures on them, of rigid or deformable blocks."""

    assembly: Assembly
    """The blocks."""
    block_m: IntArray
    """One block of each facet, (n,)."""
    block_s: IntArray
    """The other, (n,)."""
    corners: FloatArray
    """(n, 4, 3) [mm]"""
    pressures: FloatArray
    """(n,) [MPa]"""
    nodes: Places
    """Nodes of a block where these facets are, (n_nodes, 3) [mm]."""
    largest: float | None = None
    """Largest pressure at a point, which means over facets miss [MPa]; None: not known."""

    @property
    def scale(self) -> Scale:
        """Colours of the pressures, with what they reach at a point."""
        every = np.arange(len(self.pressures))
        scale = pressure_scale("contact pressure [MPa]", self.pressures, self.pair(every))
        if self.largest is None or self.largest <= scale.high * _SHOWN:
            return scale
        return replace(scale, note=f"at a point max. {self.largest:.3g}")

    @property
    def governing(self) -> tuple[FloatArray, int]:
        """Middle of the facet with the largest pressure, (3,) [mm], and a free layer it is at."""
        if not len(self.pressures):
            return self.assembly.origin + np.array(EYE), middle_layer(self.assembly)
        worst = first_largest(self.pressures)
        layers = self.assembly.layer[[self.block_m[worst], self.block_s[worst]]]
        layer = int(np.clip(layers.min(), 1, self.assembly.n_layers))
        return self.corners[worst].mean(axis=0), layer

    def between(self, lower: int) -> IntArray:
        """Facets between a layer and the next one, (n,)."""
        return facets_between(self.assembly.layer, self.block_m, self.block_s, lower)

    def within(self, layer: int) -> IntArray:
        """Facets between blocks of one layer, (n,)."""
        of = self.assembly.layer
        return np.flatnonzero((of[self.block_m] == layer) & (of[self.block_s] == layer))

    def pair(self, rows: IntArray) -> IntArray:
        """One number for the two blocks of each of some facets, (n,)."""
        return self.block_m[rows] * self.assembly.n_blocks + self.block_s[rows]

    def surface(self, rows: IntArray, scale: Scale) -> Surface:
        """Some facets in the colours of their pressures."""
        quads = np.arange(4 * len(rows)).reshape(-1, 4)
        shades = scale.of(self.pressures[rows])
        return Surface(self.corners[rows].reshape(-1, 3), quads, shades, lit=False)

    def outlines(self, blocks: Sequence[int]) -> Lines:
        """Edges of some blocks, seen through."""
        return outlines(self.assembly, blocks, nodes=self.nodes, opacity=0.5)


def interface_facets(
    assembly: Assembly, contacts: IntArray, pressures: FloatArray
) -> PressedFacets:
    """Facets of an assembly that match, before any displacement.

    Contacts are positions in its interfaces, (n,); each has a pressure, (n,) [MPa].
    """
    result = assembly.interfaces
    return PressedFacets(
        assembly=assembly,
        block_m=result.block_m[contacts],
        block_s=result.block_s[contacts],
        corners=interface_surface(assembly, contacts).nodes.reshape(-1, 4, 3),
        pressures=pressures,
        nodes=assembly.nodes,
    )


# ---------------------------------------------------------------------------------------------
# Loads


def load_arrows(assembly: Assembly, load: LoadCase, blocks: Sequence[int]) -> Surface:
    """Arrows on a sample of the loaded facets of some blocks, along the force."""
    force = load.facet_forces
    size = np.linalg.norm(force, axis=1)
    pushed = np.flatnonzero((size > 0) & np.isin(load.block, list(blocks)))
    # One arrow in each cell of a grid.
    cell = np.floor(load.centroids[pushed] / (0.45 * assembly.characteristic_length))
    x, y, z = (cell - cell.min(axis=0, initial=0.0)).astype(np.int64).T
    _, first = np.unique((x << 42) + (y << 21) + z, return_index=True)
    chosen = pushed[first]
    direction = force[chosen] / size[chosen, None]
    length = 0.5 * assembly.characteristic_length
    into_body = np.einsum("ij,ij->i", direction, load.area_vectors[chosen]) < 0
    start = load.centroids[chosen] - np.where(into_body, length, 0.0)[:, None] * direction
    return arrows(start, length * direction, VERMILION)


def arrows(start: FloatArray, along: FloatArray, colour: str) -> Surface:
    """Arrows from points along vectors, (n, 3) each [mm]."""
    turn = 2 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    # Rings of shaft and tip in the arrow's own frame: radius, and place along it.
    rings = [(0.05, 0.0), (0.05, 0.75), (0.1, 0.75), (0.0, 1.0)]
    own = np.concatenate(
        [np.column_stack([radius * circle, np.full(_SIDES, at)]) for radius, at in rings]
    )
    k = np.arange(_SIDES)
    after = (k + 1) % _SIDES
    quads = np.concatenate(
        [
            np.column_stack(
                [r * _SIDES + k, r * _SIDES + after, (r + 1) * _SIDES + after, (r + 1) * _SIDES + k]
            )
            for r in range(len(rings) - 1)
        ]
    )
    length = np.linalg.norm(along, axis=1, keepdims=True)
    axis = along / np.maximum(length, 1e-300)
    helper = np.where(np.abs(axis[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, axis)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    frame = np.stack([first, np.cross(axis, first), axis], axis=1)
    points = start[:, None] + length[:, None] * np.einsum("pk,nki->npi", own, frame)
    every = quads[None] + len(own) * np.arange(len(start))[:, None, None]
    return Surface(points.reshape(-1, 3), every.reshape(-1, 4), colour, lit=False)
