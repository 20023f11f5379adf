"""Pictures of assemblies of rigid blocks: what is built, contact pressures, mechanisms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.assembly import Assembly
from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray
from validation.output.pictures.bodies import (
    EYE,
    FROM_ABOVE,
    FROM_BELOW,
    PressedFacets,
    block_surfaces,
    coloured_blocks,
    colours_of_blocks,
    far_side,
    interface_facets,
    is_tube,
    load_arrows,
    outlines,
)
from validation.output.pictures.canvas import Part, Pixels, Surface, View
from validation.output.pictures.gallery import (
    BLUE,
    GREY,
    ORANGE,
    PRESSURE_MAP,
    VERMILION,
    Panel,
    Scale,
    fill_axes,
    gallery,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from validation.run.rigid.answer import RigidAnswer, RigidRun


def draw_assembly(assembly: Assembly, load: LoadCase, path: Path, *, title: str) -> None:
    """Draw blocks, fixed frame, and load: from outside, and with the near side removed."""
    from matplotlib.patches import Patch

    released = assembly.fixed & ~load.fixed
    colours = colours_of_blocks(assembly, load.fixed)
    colours = [ORANGE if released[b] else colour for b, colour in enumerate(colours)]

    tube = is_tube(assembly)

    def outside(block: int) -> Sequence[str]:
        """Of blocks between others, a tube shows the outer face alone."""
        shape = assembly.shape(block)
        return ("outer",) if tube and not assembly.fixed[block] else tuple(shape.faces)

    def view(blocks: IntArray, direction: tuple[float, float, float]) -> View:
        shown = blocks.tolist()
        whole = len(shown) == assembly.n_blocks
        parts: list[Part] = [
            block_surfaces(assembly, shown, colours, seen=outside if whole else None),
            outlines(assembly, shown),
            load_arrows(assembly, load, shown),
        ]
        return View(parts, direction)

    everything = np.arange(assembly.n_blocks)
    far = np.flatnonzero(far_side(assembly, assembly.centroids))
    behind = EYE if tube else (-EYE[0], -EYE[1], EYE[2])
    second = "near side removed" if tube else "from the other side"
    legend = [Patch(color=BLUE, label="free blocks")]
    if load.fixed.any():
        legend.append(Patch(color=GREY, label="held blocks"))
    if released.any():
        legend.append(Patch(color=ORANGE, label="frame, released"))
    legend.append(Patch(color=VERMILION, label="load"))
    gallery(
        [
            [Panel("from outside", view(everything, EYE))],
            [Panel(second, view(far, behind))],
        ],
        title,
        path,
        height=9.0,
        legend=legend,
    )


# ---------------------------------------------------------------------------------------------
# Contact pressures


def pressure_title(run: RigidRun) -> str:
    """Scene, load, class and measures of a rigid result."""
    measures = run.measures
    text = f"{run.name}: {run.scene.load_words}; {run.carried.words}"
    if measures is not None:
        text += (
            f"\nmean of block maxima {measures.p_max:.3g} MPa, effective mean "
            f"{measures.p_eff:.3g} MPa, effective elements {measures.effective_count_percent:.1f} %"
        )
    return text


def draw_pressures(run: RigidRun, path: Path) -> None:
    """Draw the contact pressures of a rigid result in equilibrium."""
    facets = interface_facets(run.assembly, run.result.contact_index, run.contact_pressures)
    draw_pressed_facets(facets, path, title=pressure_title(run))


def draw_pressed_facets(facets: PressedFacets, path: Path, *, title: str) -> None:
    """Draw contact pressures: the tube cut open, and the middle layer's faces, seen and unrolled.

    Only faces that can meet another block are shown, as in the paper's figures.
    """
    assembly = facets.assembly
    scale = facets.scale
    far = np.flatnonzero(far_side(assembly, facets.corners.mean(axis=1)))
    behind = np.flatnonzero(far_side(assembly, assembly.centroids))
    whole = View([facets.surface(far, scale), facets.outlines(behind.tolist())], EYE)
    tube = is_tube(assembly)
    columns = [[Panel("tube cut open" if tube else "joints of the wall", whole)]]
    columns.append(
        [
            ring_panel(facets, layer, side, scale, _middle(assembly))
            for layer, side in _joints(assembly)
        ]
    )
    if tube:
        columns.append(
            [unrolled_panel(facets, layer, side, scale) for layer, side in _joints(assembly)]
        )
    gallery(columns, title, path, height=9.0, scale=scale)


def _middle(assembly: Assembly) -> int:
    return assembly.n_layers // 2 + 1


def _joints(assembly: Assembly) -> list[tuple[int, str]]:
    """Layer below each joint of the middle layer, and which of its faces lie there."""
    layer = _middle(assembly)
    return [(layer, "top"), (layer - 1, "bottom")]


def ring_panel(facets: PressedFacets, lower: int, side: str, scale: Scale, layer: int) -> Panel:
    """One joint of a layer as the eye sees it: top faces from above, bottom faces from below."""
    blocks = np.flatnonzero(facets.assembly.layer == layer).tolist()
    parts: list[Part] = [
        facets.surface(facets.between(lower), scale),
        facets.outlines(blocks),
    ]
    top = side == "top"
    words = f"layer {layer}, {side} faces from {'above' if top else 'below'}"
    return Panel(words, View(parts, FROM_ABOVE if top else FROM_BELOW))


def unrolled_panel(
    facets: PressedFacets, lower: int, side: str, scale: Scale, *, title: str | None = None
) -> Panel:
    """One joint of a tube over angle and radius, so that nothing hides."""
    rows = facets.between(lower)
    return Panel(
        f"{side} faces, unrolled" if title is None else title,
        plot=lambda axes: draw_unrolled(axes, facets, rows, scale),
        shape=2.6,
    )


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


def draw_unrolled(axes: Axes, facets: PressedFacets, rows: IntArray, scale: Scale) -> None:
    """Draw facets over angle and radius, and where one pair of blocks ends."""
    draw_flat(
        axes,
        unrolled_corners(facets.assembly, facets.corners[rows]),
        scale.of(facets.pressures[rows]),
        facets.block_m[rows] * facets.assembly.n_blocks + facets.block_s[rows],
    )


def draw_flat(axes: Axes, flat: FloatArray, shades: Pixels, pair: IntArray) -> None:
    """Draw coloured facets over angle and radius.

    Parameters
    ----------
    flat
        Corners by angle [°] and radius [mm], (n, 4, 2).
    shades
        Colours, (n, 3).
    pair
        Number of the joint that a facet belongs to, (n,): lines part them.
    """
    axes.set_xticks(range(-180, 181, 60))
    axes.set_xlabel("angle [°]", fontsize=9)
    axes.set_ylabel("radius [mm]", fontsize=9)
    axes.tick_params(labelsize=8.5)
    axes.set_xlim(-180, 180)
    if not len(flat):
        return
    low, high = float(flat[..., 1].min()), float(flat[..., 1].max())
    # A facet that crosses the cut shows on both sides.
    turns = np.array([[0.0, 0.0], [360.0, 0.0], [-360.0, 0.0]])
    turned = (flat + turns[:, None, None]).reshape(-1, 4, 2)
    shown = (turned[..., 0].max(axis=1) > -180.0) & (turned[..., 0].min(axis=1) < 180.0)
    turned[..., 0] = np.clip(turned[..., 0], -180.0, 180.0)
    # Angles as long as the map is wide: the view has the shape of the axes.
    x = turned[shown, :, 0] * (axes.bbox.width / axes.bbox.height) * (high - low) / 360.0
    points = np.stack([x, turned[shown, :, 1], np.zeros_like(x)], axis=2).reshape(-1, 3)
    quads = np.arange(len(points)).reshape(-1, 4)
    part = Surface(points, quads, np.tile(shades, (3, 1))[shown], lit=False)
    view = View([part], (0.0, 0.0, 1.0), margin=0.0)
    fill_axes(axes, view)
    axes.set_ylim(low, high)
    _draw_joint_lines(axes, flat, pair)


def _draw_joint_lines(axes: Axes, flat: FloatArray, pair: IntArray) -> None:
    """Draw the edges that facets of one pair of blocks do not share among themselves."""
    from matplotlib.collections import LineCollection

    ends = np.stack([flat, np.roll(flat, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    place = np.round(1e4 * ends).astype(np.int64)
    corner = np.sort(place[..., 0] * 2**31 + place[..., 1], axis=1).astype(np.uint64)
    # One number for both ends and the pair: equal edges are those that are shared.
    odd = np.uint64(0x9E3779B97F4A7C15)
    edge = (corner[:, 0] * odd + corner[:, 1]) * odd + np.repeat(pair, 4).astype(np.uint64)
    _, which, count = np.unique(edge, return_inverse=True, return_counts=True)
    alone = ends[count[which] == 1]
    axes.add_collection(LineCollection(list(alone), colors="#303030", linewidths=0.8))


# ---------------------------------------------------------------------------------------------
# Mechanisms


def draw_mechanism(run: RigidRun, path: Path) -> None:
    """Draw the certified mechanism: blocks moved along it, coloured by how far they move."""
    from validation.run.rigid.answer import mechanism_displacements

    assembly = run.assembly
    displacement = mechanism_displacements(run)
    if displacement is None:
        raise ValueError("a locked assembly has no mechanism to draw")
    length = 0.3 * assembly.characteristic_length
    counts = [assembly.shape(block).mesh.n_nodes for block in range(assembly.n_blocks)]
    moves = np.split(displacement, np.cumsum(counts)[:-1])
    scale = Scale("displacement / largest displacement [–]", PRESSURE_MAP, 0.0, 1.0, (0.0, 1.0))

    def moved(block: int) -> FloatArray:
        return assembly.nodes(block) + length * moves[block]

    def size(block: int) -> FloatArray:
        return np.asarray(np.linalg.norm(moves[block], axis=1))

    blocks = range(assembly.n_blocks)
    faces = tuple(dict.fromkeys(face for shape in assembly.shapes for face in shape.faces))
    parts: list[Part] = [
        coloured_blocks(assembly, blocks, size, scale, nodes=moved, faces=faces, lit=True),
        outlines(assembly, blocks, nodes=moved),
    ]
    draw_motion(run, View(parts, EYE), length, path, height=8.0, scale=scale)


def draw_motion(run: RigidAnswer, view: View, length: float, path: Path, **options: Any) -> None:
    """Draw a certified mechanism whose largest motion is as long [mm]; options of `gallery`."""
    driven = run.carried.mechanism is not None
    words = "the load drives it" if driven else "the load does not drive it"
    gallery(
        [[Panel(f"first-order motion, drawn {length:.3g} mm at its largest", view)]],
        f"{run.name}: {run.scene.load_words}; {run.carried.words}; a mechanism exists, {words}",
        path,
        **options,
    )
