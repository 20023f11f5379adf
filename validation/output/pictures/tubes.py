"""Pictures of deformable blocks: stresses, displacements, contact pressures, sections of tubes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.element.lagrange import lobatto_points
from geometry.assembly import Assembly
from geometry.families.hexagon_block import EDGE_NAMES
from geometry.mesh import FloatArray, structured_quads
from validation.output.pictures.assemblies import draw_pressed_facets
from validation.output.pictures.bodies import (
    EYE,
    FROM_ABOVE,
    FROM_BELOW,
    PressedFacets,
    coloured_blocks,
    is_tube,
    outlines,
)
from validation.output.pictures.canvas import Direction, Part, View
from validation.output.pictures.gallery import (
    MOTION_MAP,
    STRESS_MAP,
    Panel,
    Scale,
    gallery,
    marked,
    scale_from_zero,
    symmetric_scale,
)
from validation.output.pictures.sections import section

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from validation.output.pictures.drawn import DrawnState

#: Faces of a tube's blocks that are seen from outside when blocks have moved.
_SHELL = ("outer", "inner", "left", "right", *EDGE_NAMES)
_SYMBOLS = ("σ₁", "σ₂", "σ₃")


def eye(assembly: Assembly) -> Direction:
    """Direction from which all blocks are seen: against the assembly's smallest extent."""
    if is_tube(assembly):
        return EYE
    points = np.concatenate([assembly.nodes(b) for b in range(assembly.n_blocks)])
    extent = np.ptp(points, axis=0)
    if extent[1] < 0.5 * min(extent[0], extent[2]):
        return (0.9, 2.4, 0.9)
    if extent[2] < 0.5 * min(extent[0], extent[1]):
        return (0.9, -1.2, 2.4)
    return EYE


def blocks_view(
    run: DrawnState,
    values: Callable[[int], FloatArray],
    scale: Scale,
    faces: Sequence[str],
    direction: Direction,
    *,
    factor: float = 0.0,
) -> View:
    """Named faces of all deformable blocks, moved by a factor of their displacement."""
    assembly, deformable = run.drawn, run.deformable.deformable_blocks.tolist()

    def nodes(block: int) -> FloatArray:
        return run.positions(block) + factor * run.displacement(block)

    parts: list[Part] = [
        coloured_blocks(assembly, deformable, values, scale, nodes=nodes, faces=faces)
    ]
    rigid = np.flatnonzero(run.deformable.group_of < 0).tolist()
    # Single bodies show their edges, and where they were.
    edged = rigid if run.meets else deformable
    parts.append(outlines(assembly, edged, opacity=0.6))
    return View(parts, direction)


# ---------------------------------------------------------------------------------------------
# Stresses and displacements


def _principal(run: DrawnState, component: int, block: int) -> FloatArray:
    return run.principal(block)[:, component]


def _moved(run: DrawnState, block: int) -> FloatArray:
    return np.asarray(np.linalg.norm(run.displacement(block), axis=1))


def all_faces(run: DrawnState) -> tuple[str, ...]:
    """Names of all faces of the deformable blocks."""
    assembly = run.drawn
    shapes = (assembly.shape(b) for b in run.deformable.deformable_blocks.tolist())
    return tuple(dict.fromkeys(face for shape in shapes for face in shape.faces))


def stress_scale(run: DrawnState, component: int) -> Scale:
    """Colours of a principal stress, with what it reaches anywhere in the blocks."""
    blocks = run.deformable.deformable_blocks.tolist()
    values = [_principal(run, component, b) for b in blocks]
    return symmetric_scale(f"{_SYMBOLS[component]} [MPa]", STRESS_MAP, values)


def extreme(run: DrawnState, component: int) -> tuple[FloatArray, str]:
    """Where σ₁ is largest, or σ₃ smallest, and words for it."""
    sign = 1.0 if component == 0 else -1.0
    best, place, words = -np.inf, np.zeros(3), ""
    for block in run.deformable.deformable_blocks.tolist():
        values = sign * _principal(run, component, block)
        node = int(values.argmax())
        if values[node] > best:
            best = float(values[node])
            place = run.positions(block)[node]
            kind = "largest" if component == 0 else "smallest"
            value = f"{sign * best:.3g}".replace("-", "−")
            words = f"○ {kind}: {value} in block {block}{_joint(run, block, node)}"
    inside = run.measures["sigma_1_max" if component == 0 else "sigma_3_min"].value
    if sign * inside > best:
        words += f"; {inside:.3g} inside".replace("-", "−")
    return place, words


def _joint(run: DrawnState, block: int, node: int) -> str:
    """Say that a node lies in a joint, which no look from outside shows."""
    shape = run.drawn.shape(block)
    return ", in a joint" if np.isin(node, shape.contact_quads) else ""


def draw_stresses(run: DrawnState, path: Path) -> None:
    """Draw σ₁, σ₃ and the displacement, and σ₁ on the faces that meet other blocks.

    Of a tube the outer surface, and the joints of the middle layer; of other blocks all surfaces.
    """
    assembly, tube = run.drawn, run.is_tube
    direction, faces = eye(assembly), ("outer",) if tube else all_faces(run)
    columns = []
    for component in (0, 2):
        scale, values = stress_scale(run, component), partial(_principal, run, component)
        words = f"{_SYMBOLS[component]}{', outer surface' if tube else ''}"
        panel = Panel(words, blocks_view(run, values, scale, faces, direction), scale=scale)
        columns.append([marked(scale, panel, *extreme(run, component))])
    blocks = run.deformable.deformable_blocks.tolist()
    size = scale_from_zero("|u| [mm]", MOTION_MAP, [_moved(run, b) for b in blocks])
    shell = _SHELL if tube else all_faces(run)
    moved = blocks_view(run, partial(_moved, run), size, shell, direction, factor=run.drawing_scale)
    columns.append([Panel(f"moved × {run.drawing_scale:g}", moved, scale=size)])
    joints = _joint_panels(run) if run.meets else []
    columns += [joints] if tube else [[panel] for panel in joints]
    gallery(columns, run.title, path, height=7.5 if tube else 5.5)


def _joint_panels(run: DrawnState) -> list[Panel]:
    """σ₁ on the faces that meet other blocks, from above and from below."""
    assembly, scale = run.drawn, stress_scale(run, 0)
    blocks = run.deformable.deformable_blocks
    where = "joints"
    if run.is_tube:
        layer = assembly.n_layers // 2 + 1
        blocks, where = blocks[assembly.layer[blocks] == layer], f"joints of layer {layer}"
    names = tuple(dict.fromkeys(f for s in assembly.shapes for f in s.contact_faces))
    values, shown = partial(_principal, run, 0), blocks.tolist()
    # Two faces lie on each other in a joint: the eye sees the one that looks at it.
    surface = coloured_blocks(
        assembly, shown, values, scale, nodes=run.positions, faces=names, two_sided=False
    )
    edges = outlines(assembly, shown, nodes=run.positions, opacity=0.5)
    x, y, z = eye(assembly)
    above, below = (FROM_ABOVE, FROM_BELOW) if run.is_tube else ((x, y, z), (x, y, -z))
    title = f"σ₁ in the {where}, from above"
    top, bottom = View([surface, edges], above), View([surface, edges], below)
    if run.is_tube:
        return [Panel(title, top), Panel("from below", bottom, scale=scale)]
    return [
        Panel(title, top, scale=scale),
        marked(scale, Panel("from below", bottom), *extreme(run, 0)),
    ]


def draw_displacement(run: DrawnState, path: Path) -> None:
    """Draw the displacement of a tube in the zy-plane."""
    blocks = run.deformable.deformable_blocks.tolist()
    scale = scale_from_zero("|u| [mm]", MOTION_MAP, [_moved(run, b) for b in blocks])
    faces, factor = (*_SHELL, "top", "bottom"), run.drawing_scale
    view = blocks_view(run, partial(_moved, run), scale, faces, (1.0, 0.0, 0.0), factor=factor)
    title = f"{run.title}\ndisplacement in the zy-plane"
    gallery([[Panel(f"drawn × {factor:g}", view)]], title, path, height=8.5, scale=scale)


# ---------------------------------------------------------------------------------------------
# Sections


def section_heights(run: DrawnState) -> tuple[float, ...]:
    """Heights of the paper's sections through the middle layer: 10 and 20 mm from its ends."""
    assembly = run.drawn
    layer = assembly.n_layers // 2 + 1
    # Where a layer begins depends on the tube: layers of hexagons reach into each other.
    centres = (assembly.centroids @ assembly.axis)[assembly.layer == layer]
    middle = round(float(centres.mean()), 6)
    low, high = middle - 0.5 * _pitch(assembly), middle + 0.5 * _pitch(assembly)
    return (low + 10.0, low + 20.0, high - 20.0, high - 10.0)


def _pitch(assembly: Any) -> float:
    """Distance of the layers along the axis [mm]."""
    centres = assembly.centroids @ assembly.axis
    free = np.unique(assembly.layer[~assembly.fixed])
    if len(free) > 1:
        means = [centres[assembly.layer == k].mean() for k in free]
        return float(np.mean(np.diff(means)))
    block = int(assembly.free_blocks[0])
    along = assembly.nodes(block) @ assembly.axis
    inner = np.unique(assembly.shape(block).faces["inner"])
    return float(np.ptp(along[inner]))


def draw_sections(run: DrawnState, path: Path) -> None:
    """Draw σ₁ and σ₃ in four sections through the middle layer, as the paper's figures."""
    heights = section_heights(run)
    cuts = [section(run, z) for z in heights]
    scales = {
        component: symmetric_scale(
            f"{_SYMBOLS[component]} [MPa]", STRESS_MAP, [c.values[:, component] for c in cuts]
        )
        for component in (0, 2)
    }

    def plot(axes: Axes, number: int, component: int) -> None:
        from matplotlib.collections import LineCollection
        from matplotlib.ticker import MaxNLocator
        from matplotlib.tri import Triangulation

        cut, scale = cuts[number], scales[component]
        axes.set_aspect("equal")
        if len(cut.triangles):
            mesh = Triangulation(cut.points[:, 0], cut.points[:, 1], cut.triangles)
            drawn = axes.tripcolor(
                mesh,
                cut.values[:, component],
                cmap=scale.colours,
                vmin=scale.low,
                vmax=scale.high,
                shading="gouraud",
            )
            drawn.set_rasterized(True)
            axes.add_collection(LineCollection(list(cut.borders), colors="black", linewidths=0.7))
        # The numbers at its ends would meet those of the other axis and the title.
        axes.yaxis.set_major_locator(MaxNLocator(6, prune="both"))
        axes.set_xlabel("x [mm]", fontsize=9)
        axes.set_ylabel("y [mm]", fontsize=9)
        axes.tick_params(labelsize=8)

    columns = [
        [
            Panel(
                f"{_SYMBOLS[component]}, z = {z:.4g} mm",
                plot=partial(plot, number=number, component=component),
                scale=scales[component],
            )
            for component in (0, 2)
        ]
        for number, z in enumerate(heights)
    ]
    layer = run.drawn.n_layers // 2 + 1
    gallery(columns, f"{run.title}: sections through layer {layer}", path, height=8.5)


# ---------------------------------------------------------------------------------------------
# Contact


def run_facets(run: DrawnState) -> PressedFacets:
    """Contact facets of a run where they ended, those of higher degree in pieces."""
    group_of = run.deformable.group_of

    def nodes(block: int) -> FloatArray:
        placed = run.positions(block)
        return placed + run.displacement(block) if group_of[block] >= 0 else placed

    found = run.contact_state
    owner, corners, pressures = np.arange(found.n_facets), found.corners, found.pressures
    if found.corner_overclosures is not None and found.corner_overclosures.shape[1] > 4:
        corners, pressures = _pieces(run, nodes, found.corner_overclosures)
        owner = np.repeat(owner, len(pressures) // found.n_facets)
    return PressedFacets(
        assembly=run.drawn,
        block_m=found.block_m[owner],
        block_s=found.block_s[owner],
        corners=corners,
        pressures=pressures,
        nodes=nodes,
        largest=run.measures["p_max_point"].value,
    )


def _pieces(
    run: DrawnState, nodes: Callable[[int], FloatArray], overclosures: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Cut facets of higher degree where they are drawn: between nodes, and at equal parts of that.

    Returns
    -------
    tuple[FloatArray, FloatArray]
        Corners, (n, 4, 3) [mm], and mean pressures, (n,) [MPa]; facet after facet.
    """
    surfaces = run.deformable.surfaces
    places = np.empty((*surfaces.quads_m.shape, 3))
    for block in np.unique(surfaces.block_m).tolist():
        mine = surfaces.block_m == block
        places[mine] = nodes(block)[surfaces.quads_m[mine]]
    ends = lobatto_points(math.isqrt(places.shape[1]) - 1)
    looks = np.linspace(-1.0, 1.0, math.isqrt(overclosures.shape[1]))
    parts = math.ceil(len(looks) / len(ends))
    line = np.interp(np.arange(parts * (len(ends) - 1) + 1) / parts, np.arange(len(ends)), ends)
    quads = structured_quads(len(line) - 1)
    corners = (_linear(line, ends) @ places)[:, quads].reshape(-1, 4, 3)
    pressures = run.deformable.contact.law.pressure(overclosures @ _linear(line, looks).T)
    return corners, pressures[:, quads].mean(axis=2).ravel()


def _linear(line: FloatArray, ends: FloatArray) -> FloatArray:
    """Values on the grid of a line from those on a coarser one, linear between; (n², m²)."""
    weights = np.stack([np.interp(line, ends, one) for one in np.eye(len(ends))], axis=1)
    return np.asarray(np.kron(weights, weights), dtype=np.float64)


def draw_contact(run: DrawnState, path: Path) -> None:
    """Draw the contact pressures: of a tube as those of rigid blocks are drawn, else all joints."""
    facets, title = run_facets(run), f"{run.title}: contact pressure"
    if run.is_tube:
        draw_pressed_facets(facets, path, title=title)
        return
    assembly = run.drawn
    scale = facets.scale
    parts: list[Part] = [
        facets.surface(np.arange(len(facets.pressures)), scale),
        facets.outlines(range(assembly.n_blocks)),
    ]
    x, y, z = eye(assembly)
    columns = [
        [Panel("from above", View(parts, (x, y, z)))],
        [Panel("from below", View(parts, (x, y, -z)))],
    ]
    gallery(columns, title, path, height=5.5, scale=scale)
