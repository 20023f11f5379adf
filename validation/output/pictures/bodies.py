"""Blocks, their edges, contact facets and loads as parts of a view."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geometry.answer import Answer, is_round
from geometry.assembly import Assembly
from geometry.block import Block
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray
from geometry.parts.measures import facets_between, first_largest
from geometry.parts.placed import AnyBlocks
from validation.output.pictures.canvas import (
    Direction,
    Lines,
    Part,
    Pixels,
    Polygons,
    View,
    merged,
    rgb,
)
from validation.output.pictures.gallery import Panel, pictures_section
from validation.output.pictures.scales import (
    BLUE,
    GREY,
    SKY,
    VERMILION,
    Scale,
    pressure_scale,
)

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


def far_side(
    assembly: Assembly, points: FloatArray, towards: Direction = EYE
) -> npt.NDArray[np.bool_]:
    """Whether points lie on the side of the tube's axis away from an eye; all do in a wall."""
    if not is_round(assembly):
        return np.ones(len(points), dtype=bool)
    arm = (points - assembly.origin)[:, :2]
    return np.asarray(arm @ np.array(towards[:2]) < 1e-6 * assembly.characteristic_length)


def turned_about_z(direction: Direction, angle: float) -> Direction:
    """Turn a direction about the z axis by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, z = direction
    return (float(cosine * x - sine * y), float(sine * x + cosine * y), z)


def quarter(direction: Direction, arm: FloatArray) -> Direction:
    """Turn a direction by quarters about the z axis until it is nearest to that of an arm (3,)."""
    angle = np.arctan2(arm[1], arm[0]) - np.arctan2(direction[1], direction[0])
    return turned_about_z(direction, 0.5 * np.pi * float(np.round(angle / (0.5 * np.pi))))


def eye(assembly: AnyBlocks, before: FloatArray | None = None) -> Direction:
    """Direction from which all blocks are seen, the same for the pictures of all methods.

    Of a tube, `EYE` or, turned by quarters, the one that has a point (3,) [mm] most in front. Flat
    panels are seen from farther above than other blocks.
    """
    if isinstance(assembly, Assembly) and is_round(assembly):
        return EYE if before is None else quarter(EYE, before - assembly.origin)
    placed = [
        assembly.place(b, _points(assembly.shapes[k])) for b, k in enumerate(assembly.shape_of)
    ]
    return side_of(np.concatenate(placed))


def side_of(points: FloatArray) -> Direction:
    """Direction from which points (n, 3) [mm] that are no tube are seen."""
    extent = np.ptp(points, axis=0)
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
    low, high = np.minimum(*ends.T), np.maximum(*ends.T)
    edge = low * (len(points) + 1) + high
    order = np.argsort(edge, kind="stable")
    same = np.diff(edge[order]) == 0
    # Edges with more than two polygons belong to no closed surface.
    pair = np.flatnonzero(same & ~np.append(False, same[:-1]) & ~np.append(same[1:], False))
    one, other = owner[order[pair]], owner[order[pair + 1]]
    least = np.full(len(pair), angle)
    if group is not None:
        least = np.where(group[one] == group[other], 2.0, 0.25) * angle
    turned = np.einsum("ij,ij->i", normal[one], normal[other]) < np.cos(np.radians(least))
    return np.asarray(ends[order[pair[turned]]])


def turn_colours(
    assembly: AnyBlocks, fixed: npt.NDArray[np.bool_] | None = None
) -> Callable[[int], str]:
    """Colours of blocks: fixed ones grey, the others in turns of two blues, layer after layer."""
    grey = assembly.fixed if fixed is None else fixed
    turn = np.arange(assembly.n_blocks)
    if isinstance(assembly, Assembly):
        layer = assembly.layer
        turn = np.array([np.sum(layer[:b] == layer[b]) for b in turn], dtype=np.int64) + layer
    return lambda block: GREY if grey[block] else (BLUE, SKY)[int(turn[block]) % 2]


def block_legend(fixed: str = "fixed blocks", free: str = "free blocks") -> list[Any]:
    """Return what the colours of blocks mean, for a legend of matplotlib."""
    from matplotlib.patches import Patch

    words = {free: BLUE, fixed: GREY}
    return [Patch(color=colour, label=name) for name, colour in words.items() if name]


def with_labels(panel: Panel, assembly: AnyBlocks, shown: Sequence[int]) -> Panel:
    """Panel with the number or name of some blocks, where the scene asks for one on them."""
    named = pictures_section().labels
    if named == "none":
        return panel
    names = assembly.names or [
        shape.name for shape in map(assembly.shape, range(assembly.n_blocks))
    ]
    bodies = [blocks(assembly, lambda _: GREY, only=[b], edges=0.0)[0] for b in shown]
    words = [str(b) if named == "numbers" else names[b] for b in shown]
    parts = [(s.points, s.polygons) for s in bodies if isinstance(s, Polygons)]
    return labelled(panel, words, parts)


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
    probe = View([Polygons(points, polygons, shades, lit=False)], view.direction, margin=0.0)
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


#: Nodes that faces or edges of a shape use, and these by their places among those.
_Used = tuple[IntArray, IntArray]


def _used(parts: Sequence[IntArray]) -> _Used | None:
    if not sum(map(len, parts)):
        return None
    used, places = np.unique(np.concatenate(parts), return_inverse=True)
    return used, places.reshape(-1, parts[0].shape[1])


def _faces(shape: Any) -> dict[str, IntArray]:
    """Polygons of the faces of a shape by name; of a polyhedron its triangles."""
    return shape.faces if isinstance(shape, Block) else {"surface": shape.triangles}


def _points(shape: Any) -> FloatArray:
    return np.asarray(shape.mesh.nodes if isinstance(shape, Block) else shape.points)


def edges_of(shape: Any) -> IntArray:
    """Edges between the faces of a shape, both ends of each, (n, 2)."""
    if not isinstance(shape, Block):
        return sharp_edges(shape.points, shape.triangles, angle=25.0)
    polygons = np.concatenate(list(shape.faces.values()))
    group = np.repeat(np.arange(len(shape.faces)), [len(quads) for quads in shape.faces.values()])
    return sharp_edges(shape.mesh.nodes, polygons, group=group)


def blocks(
    assembly: AnyBlocks,
    colour: Callable[[int], str | Pixels] | None,
    places: Places | None = None,
    *,
    only: Sequence[int] | None = None,
    faces: Sequence[str] | None = None,
    edges: float = 1.0,
    **options: Any,
) -> list[Part]:
    """Blocks of any kind, where they stand or moved: their faces, and their edges over them.

    Parameters
    ----------
    colour
        Of a block, or of each of its nodes, (n_nodes, 3); None: edges alone.
    places
        Where the nodes of a block are drawn, (n_nodes, 3) [mm]; by default where it stands.
    only
        Blocks to draw; by default all.
    faces
        Names; those that a shape does not have are left out. By default all.
    edges
        How much of what is behind them edges hide; zero: none are drawn.
    options
        Of `Polygons`.
    """
    known: dict[int, tuple[_Used | None, _Used | None]] = {}
    skins, lines, shades = [], [], []
    for block in range(assembly.n_blocks) if only is None else only:
        shape, number = assembly.shape(block), int(assembly.shape_of[block])
        if number not in known:
            named = _faces(shape)
            shown = [named[name] for name in (faces or named) if name in named]
            known[number] = (
                _used(shown) if colour else None,
                _used([edges_of(shape)]) if edges else None,
            )
        skin, line = known[number]
        at = assembly.place(block, _points(shape)) if places is None else places(block)
        if skin and colour:
            skins.append((at[skin[0]], skin[1]))
            shade = colour(block)
            each = np.tile(rgb(shade), (len(at), 1)) if isinstance(shade, str) else shade
            shades.append(each[skin[0]])
        if line:
            lines.append((at[line[0]], line[1]))
    parts: list[Part] = []
    if skins:
        surface = merged(skins, skins[0][1].shape[1])
        parts.append(Polygons(*surface, np.concatenate(shades), **options))
    if lines:
        parts.append(Lines(*merged(lines, 2), opacity=edges))
    return parts


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
        return replace(scale, note=f"mean of a drawn facet; at a point max. {self.largest:.3g}")

    @property
    def governing(self) -> tuple[FloatArray, int]:
        """Middle of the facet with the largest pressure, (3,) [mm], and a free layer it is at."""
        if not len(self.pressures):
            return self.assembly.origin + np.array(EYE), middle_layer(self.assembly)
        worst = first_largest(self.pressures)
        layers = self.assembly.layer[[self.block_m[worst], self.block_s[worst]]]
        layer = int(np.clip(layers.min(), 1, self.assembly.n_layers))
        return self.corners[worst].mean(axis=0), layer

    @property
    def side(self) -> Direction:
        """The side that pictures look from: of a tube, where its largest pressure is."""
        return eye(self.assembly, self.governing[0])

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

    def surface(self, rows: IntArray, scale: Scale) -> Polygons:
        """Some facets in the colours of their pressures."""
        quads = np.arange(4 * len(rows)).reshape(-1, 4)
        shades = scale.of(self.pressures[rows])
        return Polygons(self.corners[rows].reshape(-1, 3), quads, shades, lit=False)

    def outlines(self, only: Sequence[int]) -> list[Part]:
        """Edges of some blocks, seen through."""
        return blocks(self.assembly, None, self.nodes, only=only, edges=0.5)


def rigid_facets(answer: Answer) -> PressedFacets:
    """Contact facets of rigid blocks in equilibrium, before any displacement."""
    assembly, result = answer.details.blocks, answer.contacts
    return PressedFacets(
        assembly=assembly,
        block_m=result["blocks"][:, 0],
        block_s=result["blocks"][:, 1],
        corners=result["corners"],
        pressures=result["pressure"],
        nodes=assembly.nodes,
    )


# ---------------------------------------------------------------------------------------------
# Loads


def load_arrows(assembly: Assembly, load: LoadCase, shown: Sequence[int]) -> Polygons:
    """Arrows on a sample of the loaded facets of some blocks, along the force."""
    force = load.facet_forces
    size = np.linalg.norm(force, axis=1)
    pushed = np.flatnonzero((size > 0) & np.isin(load.block, list(shown)))
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


def arrows(start: FloatArray, along: FloatArray, colour: str) -> Polygons:
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
    return Polygons(points.reshape(-1, 3), every.reshape(-1, 4), colour, lit=False)
