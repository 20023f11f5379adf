"""Pictures of assemblies of blocks: what is built, contact pressures, mechanisms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from geometry.answer import Answer, is_round
from geometry.assembly import Assembly
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray
from validation.output.pictures.bodies import (
    EYE,
    PressedFacets,
    above_and_below,
    block_legend,
    blocks,
    eye,
    far_side,
    load_arrows,
    rigid_facets,
    steep,
    turn_colours,
    turned_about_z,
    with_labels,
)
from validation.output.pictures.canvas import Direction, Lines, Part, Pixels, Polygons, View
from validation.output.pictures.gallery import Numbers, Panel, gallery, round_numbers
from validation.output.pictures.scales import MOTION_MAP, ORANGE, VERMILION, Scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Width over height of unrolled joints.
_UNROLLED = 2.6
#: Joints smaller than this share of the assembly are drawn without outlines of the blocks.
_SMALL = 0.2
#: Distance of side joints in their picture, in wall thicknesses.
_APART = 1.6
#: Part of the largest force of a facet that is round-off, and of all force that is most of it.
_ROUND_OFF, _MOST = 1e-9, 0.9


def draw_assembly(
    assembly: Assembly, load: LoadCase, *, title: str, weight: Sequence[float] | None = None
) -> Figure:
    """Draw blocks, fixed blocks, and load: from outside, and with the near side removed."""
    from matplotlib.patches import Patch

    released = assembly.fixed & ~load.fixed
    usual, tube = turn_colours(assembly, load.fixed), is_round(assembly)

    def panel(title: str, shown: list[int], direction: Direction) -> Panel:
        parts = blocks(assembly, lambda b: ORANGE if released[b] else usual(b), only=shown)
        parts.append(load_arrows(assembly, load, shown))
        drawn = Panel(title, View(parts, direction, weight=weight))
        return with_labels(drawn, assembly, shown)

    far = np.flatnonzero(far_side(assembly, assembly.centroids)).tolist()
    behind = EYE if tube else (-EYE[0], -EYE[1], EYE[2])
    second = "near side removed" if tube else "from the other side"
    legend = block_legend("fixed blocks" if load.fixed.any() else "")
    if released.any():
        legend.append(Patch(color=ORANGE, label="end ring, released"))
    if load.facet_forces.any():
        legend.append(Patch(color=VERMILION, label="load"))
    columns = [
        [panel("from outside", list(range(assembly.n_blocks)), EYE)],
        [panel(second, far, behind)],
    ]
    return gallery(columns, title, height=9.0, legend=legend)


# ---------------------------------------------------------------------------------------------
# Contact pressures


def pressure_title(run: Answer) -> str:
    """Title of a rigid answer, the largest pressure and how many facets press."""
    text = run.title
    peak = run.measures.get("p_max_facet")
    if peak is not None:
        force = np.maximum(run.details.contact_forces, 0.0)
        text += f"\nlargest mean pressure of a facet {peak.value:.3g} MPa; {pressing_words(force)}"
    return text


def pressing_words(force: FloatArray) -> str:
    """Share of contact facets that press with forces (n_facets,) [N], and of those that matter."""
    pressing = force > _ROUND_OFF * force.max()
    carried = np.cumsum(np.sort(force)[::-1])
    most = int(np.searchsorted(carried, _MOST * carried[-1])) + 1
    return (
        f"{100 * pressing.mean():.1f} % of the contact facets press, {100 * most / len(force):.1f} "
        f"% carry {100 * _MOST:.0f} % of the force"
    )


def draw_pressures(run: Answer) -> Figure:
    """Draw the contact pressures of a rigid result in equilibrium."""
    title, weight = pressure_title(run), run.problem.gravity
    return draw_pressed_facets(rigid_facets(run), title=title, weight=weight)


def draw_pressed_facets(
    facets: PressedFacets, *, title: str, weight: Sequence[float] | None = None
) -> Figure:
    """Draw contact pressures on faces that can meet another block, as in the paper's figures.

    The far half of a tube is removed; the joints of the layer of the largest pressure are drawn in
    3-D and unrolled. Other assemblies are drawn from above and from below, with all joints.
    """
    assembly, scale, towards = facets.assembly, facets.scale, facets.side
    if not is_round(assembly):
        parts: list[Part] = [facets.surface(np.arange(len(facets.pressures)), scale)]
        nodes = np.concatenate([facets.nodes(b) for b in range(assembly.n_blocks)])
        extent = np.ptp(facets.corners.reshape(-1, 3), axis=0).max(initial=0.0)
        if not 0.0 < extent < _SMALL * np.ptp(nodes, axis=0).max():
            # Nobody would see small joints among outlines of the blocks.
            parts += facets.outlines(range(assembly.n_blocks))
        panels = above_and_below(parts, towards, title="all joints")
        return gallery([[p] for p in panels], title, height=6.0, scale=scale)
    behind = turned_about_z(towards, np.pi)
    shown = np.flatnonzero(far_side(assembly, facets.corners.mean(axis=1), behind))
    near = np.flatnonzero(far_side(assembly, assembly.centroids, behind)).tolist()
    parts = [facets.surface(shown, scale), *facets.outlines(near)]
    layer = facets.governing[1]
    joints = {"top": layer, "bottom": layer - 1}
    unrolled = [unrolled_panel(facets, lower, side, scale) for side, lower in joints.items()]
    if len(beside := facets.within(layer)):
        if facets.pressures[beside].max() > _ROUND_OFF * scale.high:
            unrolled.append(side_joints_panel(facets, layer, scale))
        else:
            title += f"; side joints of layer {layer}: open"
    columns = [
        [Panel("tube, far half removed", View(parts, towards, weight=weight))],
        ring_panels(facets, scale, layer, towards),
        unrolled,
    ]
    return gallery(columns, title, height=9.5, scale=scale)


def ring_panels(
    facets: PressedFacets, scale: Scale, layer: int, towards: Direction = EYE
) -> list[Panel]:
    """Both joints of a layer as an eye sees them: top faces from above, bottom ones from below."""
    edges = facets.outlines(np.flatnonzero(facets.assembly.layer == layer).tolist())
    where = f"layer {layer} of {facets.assembly.n_layers}"
    return [
        Panel(
            f"{where}:\n{words}",
            View([facets.surface(facets.between(lower), scale), *edges], steep(towards, sign)),
        )
        for words, lower, sign in (
            ("top faces from above", layer, 1.0),
            ("bottom faces from below", layer - 1, -1.0),
        )
    ]


def unrolled_panel(
    facets: PressedFacets, lower: int, side: str, scale: Scale, *, title: str | None = None
) -> Panel:
    """One joint of a tube over angle and radius, so that nothing hides."""
    rows = facets.between(lower)
    flat = unrolled_corners(facets.assembly, facets.corners[rows])
    # A facet that crosses the cut shows on both sides.
    turned = np.concatenate([flat + np.array([turn, 0.0]) for turn in (0.0, 360.0, -360.0)])
    seen = (turned[..., 0].max(axis=1) > -180.0) & (turned[..., 0].min(axis=1) < 180.0)
    ticks = {f"{angle}".replace("-", "−"): float(angle) for angle in range(-180, 181, 60)}
    return flat_panel(
        f"{side} faces, unrolled" if title is None else title,
        turned[seen],
        shades=scale.of(facets.pressures[rows][np.tile(np.arange(len(rows)), 3)[seen]]),
        pair=facets.pair(np.tile(rows, 3)[seen]),
        span=(-180.0, 180.0),
        numbers=Numbers("angle from x towards y [°]", "radius [mm]", ticks, {}),
    )


def side_joints_panel(facets: PressedFacets, layer: int, scale: Scale) -> Panel:
    """Joints between the blocks of a layer of a tube beside each other, over radius and height."""
    rows = facets.within(layer)
    flat, middles = side_by_side(facets, rows)
    margin = 0.05 * float(np.ptp(flat[..., 0]))
    return flat_panel(
        f"side joints of layer {layer}, unrolled",
        flat,
        shades=scale.of(facets.pressures[rows]),
        pair=facets.pair(rows),
        span=(float(flat[..., 0].min()) - margin, float(flat[..., 0].max()) + margin),
        numbers=Numbers(
            "joint at this angle; inner edge at the left",
            "z [mm]",
            {f"{angle}°".replace("-", "−"): place for angle, place in middles.items()},
            {},
        ),
    )


def flat_panel(
    title: str,
    flat: FloatArray,
    *,
    shades: Pixels,
    pair: IntArray,
    span: tuple[float, float],
    numbers: Numbers,
) -> Panel:
    """Coloured facets in a plane, lines where one pair of blocks ends, and numbers round them.

    Parameters
    ----------
    flat
        Corners, (n, n_corners, 2): upwards in millimetres.
    shades
        Colours, (n, 3).
    pair
        Number of the joint that a facet belongs to, (n,): lines part them.
    span
        Both ends of what is shown across.
    numbers
        Ticks across; those upwards are round numbers.
    """
    heights = flat[..., 1] if len(flat) else np.array([0.0, 1.0])
    low, high = float(heights.min()), float(heights.max())
    # Width over height of the view is what is asked for, whatever the units across.
    stretch = _UNROLLED * (high - low) / (span[1] - span[0])

    def placed(points: FloatArray, height: float) -> FloatArray:
        return np.insert(points.reshape(-1, 2) * (stretch, 1.0), 2, height, axis=1)

    faces = Polygons(
        placed(flat, 0.0), np.arange(flat[..., 0].size).reshape(flat.shape[:2]), shades, lit=False
    )
    ends = _joint_edges(flat, pair)
    lines = Lines(placed(ends, 0.0), np.arange(2 * len(ends)).reshape(-1, 2))
    window = np.array([span[0] * stretch, low]), np.array([span[1] * stretch, high])
    return Panel(
        title,
        View([faces, lines], (0.0, 0.0, 1.0), margin=0.0, window=window),
        numbers=replace(
            numbers,
            ticks_across={w: stretch * place for w, place in numbers.ticks_across.items()},
            ticks_up=round_numbers(low, high),
        ),
    )


def side_by_side(facets: PressedFacets, rows: IntArray) -> tuple[FloatArray, dict[int, float]]:
    """Place the joints of some facets beside each other.

    Returns
    -------
    tuple[FloatArray, dict[int, float]]
        Corners over a place that grows with the radius, and height, (n, 4, 2) [mm]; the middle of
        each joint [mm] by its angle [°].
    """
    flat = unrolled_corners(facets.assembly, facets.corners[rows])
    angle, radius = flat[..., 0], flat[..., 1]
    _, joint = np.unique(facets.pair(rows), return_inverse=True)
    # Angles of a joint across ±180° have one mean where they count from its first facet.
    first = angle[np.unique(joint, return_index=True)[1], 0][joint][:, None]
    turned = angle - 360.0 * np.round((angle - first) / 360.0)
    mean = np.bincount(joint, turned.mean(axis=1)) / np.bincount(joint)
    means = np.asarray(np.round(np.where(mean > 180.0, mean - 360.0, mean)))
    place = np.argsort(np.argsort(means, kind="stable"), kind="stable")
    low, high = float(radius.min()), float(radius.max())
    step = _APART * (high - low)
    height = (facets.corners[rows] - facets.assembly.origin) @ facets.assembly.axis
    x = radius - low + (step * place[joint])[:, None]
    middles = {
        int(m): step * int(k) + 0.5 * (high - low) for m, k in zip(means, place, strict=True)
    }
    return np.stack([x, height], axis=2), middles


def unrolled_corners(assembly: Assembly, corners: FloatArray) -> FloatArray:
    """Angle [°] and radius [mm] of facet corners about the tube's axis, (n, 4, 2).

    The angle counts from the x axis, −180 to 180; a facet that crosses ±180 goes on beyond.
    """
    axis = assembly.axis
    helper = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = helper - (helper @ axis) * axis
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    arm = corners - assembly.origin
    x, y = arm @ first, arm @ second
    angle = np.degrees(np.arctan2(y, x))
    angle -= 360.0 * np.round((angle - angle[:, :1]) / 360.0)
    return np.stack([angle, np.hypot(x, y)], axis=2)


def _joint_edges(flat: FloatArray, pair: IntArray) -> FloatArray:
    """Edges that facets of one pair of blocks do not share among themselves, (n, 2, 2)."""
    ends = np.stack([flat, np.roll(flat, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    place = np.round(1e4 * ends).astype(np.int64)
    corner = np.sort(place[..., 0] * 2**31 + place[..., 1], axis=1).astype(np.uint64)
    # One number for both ends and the pair: equal edges are those that are shared.
    odd = np.uint64(0x9E3779B97F4A7C15)
    edge = (corner[:, 0] * odd + corner[:, 1]) * odd + np.repeat(pair, flat.shape[1]).astype(
        np.uint64
    )
    _, which, count = np.unique(edge, return_inverse=True, return_counts=True)
    return np.asarray(ends[count[which] == 1])


# ---------------------------------------------------------------------------------------------
# Mechanisms


def draw_mechanism(run: Answer) -> Figure:
    """Draw the certified mechanism: blocks moved along it, coloured by how far they move."""
    assembly = run.details.blocks
    length = 0.3 * assembly.characteristic_length
    last = np.flatnonzero(np.diff(run.block_of_point)) + 1
    moves = np.split(run.fields["mechanism"], last)
    places = np.split(run.points + length * run.fields["mechanism"], last)
    label, still = "displacement / largest displacement [–]", "does not move"
    scale = Scale(label, MOTION_MAP, 0.0, 1.0, (0.0, 1.0), nothing=still)

    def shade(block: int) -> Pixels:
        return scale.of(np.linalg.norm(moves[block], axis=1))

    parts = blocks(assembly, shade, places.__getitem__)
    view = View(parts, eye(assembly), weight=run.problem.gravity)
    words = "a motion that the load does not drive"
    if run.details.driven is not None:
        words = "the motion that the load drives"
    elif run.details.moving is not None:
        words = "how blocks move that do not come to rest (not proved)"
    panel = Panel(f"first-order motion, largest displacement drawn {length:.3g} mm", view)
    return gallery([[panel]], f"{run.title}; {words}", height=7.0, scale=scale)
