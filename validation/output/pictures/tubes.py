"""Pictures of deformable blocks: stresses, displacements, contact pressures, sections of tubes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fem.element.lagrange import lobatto_points
from fem.element.stress import von_mises
from geometry.families.hexagon_block import EDGE_NAMES
from geometry.mesh import FloatArray, structured_quads
from validation.output.pictures.assemblies import draw_pressed_facets
from validation.output.pictures.bodies import (
    FROM_ABOVE,
    PressedFacets,
    above_and_below,
    coloured_blocks,
    eye,
    middle_layer,
    outlines,
)
from validation.output.pictures.canvas import Direction, Lines, Part, Surface, View
from validation.output.pictures.gallery import Mark, Panel, gallery
from validation.output.pictures.scales import (
    MOTION_MAP,
    PALE,
    STRESS_MAP,
    Scale,
    drawing_scale,
    scale_from_zero,
    symmetric_scale,
)
from validation.output.pictures.sections import Section, section
from validation.scene.family import RoundScene

if TYPE_CHECKING:
    from fem.solution import Solution
    from geometry.answer import Answer

#: Faces of a tube's blocks that are seen from outside when blocks have moved.
_SHELL = ("outer", "inner", "left", "right", *EDGE_NAMES)


@dataclass(frozen=True)
class Stress:
    """A stress that pictures show; what is made of principal stresses is one more line below."""

    symbol: str
    of: Callable[[FloatArray], FloatArray]
    """Its values (n,) from σ₁ ≥ σ₂ ≥ σ₃, (n, 3) [MPa]."""
    extreme: Literal["largest", "smallest"]
    """Which of its values is marked."""
    measure: str
    """Name of that value among the measures of a run: at points inside the elements."""
    colours: str = STRESS_MAP
    """Map of its colours, symmetric about zero but for stresses without a sign."""

    @property
    def sign(self) -> float:
        """1 where the largest value counts, −1 where the smallest does."""
        return 1.0 if self.extreme == "largest" else -1.0


STRESSES = (
    Stress("σ₁", lambda principal: principal[:, 0], "largest", "sigma_1_max"),
    Stress("σ₃", lambda principal: principal[:, 2], "smallest", "sigma_3_min"),
)
#: The stress that is drawn beside them on request.
MISES = Stress("von Mises stress", von_mises, "largest", "mises_max", MOTION_MAP)


def stresses_of(answer: Answer) -> tuple[Stress, ...]:
    """Stresses that the pictures of a run show."""
    return (*STRESSES, MISES) if answer.case.scene.pictures.mises else STRESSES


def blocks_view(
    solution: Solution,
    values: Callable[[int], FloatArray],
    scale: Scale,
    faces: Sequence[str],
    direction: Direction,
    *,
    factor: float = 0.0,
) -> View:
    """Named faces of all deformable blocks, moved by a factor of their displacement."""
    assembly, deformable = (
        solution.deformable.drawn,
        solution.deformable.deformable_blocks.tolist(),
    )

    def nodes(block: int) -> FloatArray:
        return solution.deformable.positions(block) + factor * solution.displacement(block)

    parts: list[Part] = [
        coloured_blocks(assembly, deformable, values, scale, nodes=nodes, faces=faces)
    ]
    rigid = np.flatnonzero(solution.deformable.group_of < 0).tolist()
    # Single bodies show their edges, and where they were.
    edged = rigid if solution.deformable.meets else deformable
    parts.append(outlines(assembly, edged, opacity=0.6))
    return View(parts, direction)


# ---------------------------------------------------------------------------------------------
# Stresses and displacements


def _moved(solution: Solution, block: int) -> FloatArray:
    return np.asarray(np.linalg.norm(solution.displacement(block), axis=1))


def all_faces(solution: Solution) -> tuple[str, ...]:
    """Names of all faces of the deformable blocks."""
    assembly = solution.deformable.drawn
    shapes = (assembly.shape(b) for b in solution.deformable.deformable_blocks.tolist())
    return tuple(dict.fromkeys(face for shape in shapes for face in shape.faces))


def _stress(solution: Solution, stress: Stress, block: int) -> FloatArray:
    return stress.of(solution.principal(block))


def stress_scale(solution: Solution, stress: Stress = STRESSES[0]) -> Scale:
    """Colours of a stress, with what it reaches anywhere in the blocks."""
    blocks = solution.deformable.deformable_blocks.tolist()
    values = [_stress(solution, stress, b) for b in blocks]
    return _scale(stress, values)


def _scale(stress: Stress, values: Sequence[FloatArray]) -> Scale:
    """Colours of a stress, from its values."""
    scale = symmetric_scale(f"{stress.symbol} [MPa]", stress.colours, values)
    return replace(scale, diverging=stress.colours == STRESS_MAP)


def extreme(answer: Answer, stress: Stress) -> Mark:
    """Where a stress is extreme at a node, and words for it and for what the tables give."""
    best, place, words = -np.inf, np.zeros(3), ""
    for block in answer.details.deformable.deformable_blocks.tolist():
        values = stress.sign * _stress(answer.details, stress, block)
        node = int(values.argmax())
        if values[node] > best:
            best = float(values[node])
            place = answer.details.deformable.positions(block)[node]
            joint = _joint(answer.details, block, node)
            words = f"node: {stress.sign * best:.3g}, block {block}{joint}"
    inside = answer[stress.measure].value
    return Mark(place, f"{words}\nintegration point: {inside:.3g}".replace("-", "−"))


def _joint(solution: Solution, block: int, node: int) -> str:
    """Say that a node lies in a joint, and whether no look from outside shows it."""
    shape = solution.deformable.drawn.shape(block)
    if not np.isin(node, shape.contact_quads):
        return ""
    free = [quads for face, quads in shape.faces.items() if face not in shape.contact_faces]
    seen = any(np.isin(node, quads) for quads in free)
    return ", at the edge of a joint" if seen else ", hidden in a joint"


def _is_tube(answer: Answer) -> bool:
    """Whether the blocks stand round an axis, with inner and outer faces."""
    return isinstance(answer.case.scene, RoundScene)


def draw_stresses(answer: Answer, path: Path) -> None:
    """Draw stresses and the displacement, and the first stress on the faces that meet others.

    Of a tube the outer surface, and the joints of the middle layer; of other blocks all surfaces.
    """
    solution, tube = answer.details, _is_tube(answer)
    direction = eye(solution.deformable.drawn)
    faces = ("outer",) if tube else all_faces(solution)
    columns = []
    for stress in stresses_of(answer):
        scale, values = stress_scale(solution, stress), partial(_stress, solution, stress)
        words = f"{stress.symbol}{', outer surface' if tube else ''}"
        view, mark = blocks_view(solution, values, scale, faces, direction), extreme(answer, stress)
        columns.append([Panel(words, view, scale=scale, mark=mark)])
    moved = _SHELL if tube else all_faces(solution)
    columns.append([moved_panel(solution, moved, direction)])
    joints = _joint_panels(answer) if solution.deformable.meets else []
    columns += [joints] if tube else [[panel] for panel in joints]
    widest = 16.0 + 4.0 * (len(columns) - (4 if tube else 5))
    gallery(columns, answer.title, path, height=7.5 if tube else 5.5, widest=max(16.0, widest))


def moved_panel(solution: Solution, faces: Sequence[str], direction: Direction) -> Panel:
    """The deformed shape, coloured by the displacement."""
    blocks, factor = solution.deformable.deformable_blocks.tolist(), drawing_scale(solution)
    scale = scale_from_zero("|u| [mm]", MOTION_MAP, [_moved(solution, b) for b in blocks])
    view = blocks_view(solution, partial(_moved, solution), scale, faces, direction, factor=factor)
    return Panel(f"deformed shape,\nscale factor {factor:g}", view, scale=scale)


def _joint_panels(answer: Answer) -> list[Panel]:
    """Draw the first stress on the faces that meet other blocks, from above and from below."""
    assembly, stress = answer.details.deformable.drawn, STRESSES[0]
    scale = stress_scale(answer.details, stress)
    blocks, where = answer.details.deformable.deformable_blocks, "in the joints"
    if _is_tube(answer):
        layer = middle_layer(assembly)
        blocks, where = blocks[assembly.layer[blocks] == layer], f"in the joints of layer {layer}"
    names = tuple(dict.fromkeys(f for s in assembly.shapes for f in s.contact_faces))
    values, shown = partial(_stress, answer.details, stress), blocks.tolist()
    # Two faces lie on each other in a joint: the eye sees the one that looks at it.
    parts: list[Part] = [
        coloured_blocks(
            assembly,
            shown,
            values,
            scale,
            nodes=answer.details.deformable.positions,
            faces=names,
            two_sided=False,
        ),
        outlines(assembly, shown, nodes=answer.details.deformable.positions, opacity=0.5),
    ]
    direction = FROM_ABOVE if _is_tube(answer) else eye(assembly)
    top, bottom = above_and_below(parts, direction, title=f"{stress.symbol} {where}", scale=scale)
    if _is_tube(answer):
        return [replace(top, scale=None), bottom]
    return [top, replace(bottom, mark=extreme(answer, stress))]


def draw_displacement(answer: Answer, path: Path) -> None:
    """Draw the displacement of a tube, seen along the x axis."""
    panel = moved_panel(answer.details, (*_SHELL, "top", "bottom"), (1.0, 0.0, 0.0))
    title = f"{answer.title}\ndisplacement magnitude, view along x"
    gallery([[replace(panel, scale=None)]], title, path, height=8.5, scale=panel.scale)


# ---------------------------------------------------------------------------------------------
# Sections


def section_heights(solution: Solution) -> tuple[float, ...]:
    """Heights of the paper's sections through the middle layer: 10 and 20 mm from its ends."""
    assembly = solution.deformable.drawn
    layer = middle_layer(assembly)
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


def draw_sections(answer: Answer, path: Path) -> None:
    """Draw stresses in four sections through the middle layer, as the paper's figures."""
    cuts = {z: section(answer.details, z) for z in section_heights(answer.details)}
    stresses = stresses_of(answer)
    scales = [_scale(one, [one.of(cut.values) for cut in cuts.values()]) for one in stresses]
    columns = [
        [
            Panel(
                f"{stress.symbol}, z = {z:.4g} mm",
                _section_view(cut, stress.of(cut.values), scale),
            )
            for stress, scale in zip(stresses, scales, strict=True)
        ]
        for z, cut in cuts.items()
    ]
    layer = middle_layer(answer.details.deformable.drawn)
    title = f"{answer.title}: sections through layer {layer} (mid-height)"
    if any(len(cut.rigid) for cut in cuts.values()):
        title += "; grey: fixed blocks"
    gallery(columns, title, path, height=7.5, widest=18.0, scale=scales)


def _section_view(cut: Section, values: FloatArray, scale: Scale) -> View:
    """A section from above in the colours of a stress; blocks without stresses are pale."""
    places = np.insert(cut.points, 2, 0.0, axis=1)
    borders = np.insert(cut.borders.reshape(-1, 2), 2, 0.0, axis=1)
    return View(
        [
            Surface(places, cut.triangles, scale.of(values), lit=False),
            Surface(places, cut.rigid, PALE, lit=False),
            Lines(borders, np.arange(len(borders)).reshape(-1, 2)),
        ],
        (0.0, 0.0, 1.0),
    )


# ---------------------------------------------------------------------------------------------
# Contact


def run_facets(answer: Answer) -> PressedFacets:
    """Contact facets of a run where they ended, those of higher degree in pieces."""
    group_of = answer.details.deformable.group_of

    def nodes(block: int) -> FloatArray:
        placed = answer.details.deformable.positions(block)
        return placed + answer.details.displacement(block) if group_of[block] >= 0 else placed

    result = answer.details.contact_state
    owner, corners, pressures = np.arange(result.n_facets), result.corners, result.pressures
    if result.corner_overclosures is not None and result.corner_overclosures.shape[1] > 4:
        corners, pressures = _pieces(answer.details, nodes, result.corner_overclosures)
        owner = np.repeat(owner, len(pressures) // result.n_facets)
    return PressedFacets(
        assembly=answer.details.deformable.drawn,
        block_m=result.block_m[owner],
        block_s=result.block_s[owner],
        corners=corners,
        pressures=pressures,
        nodes=nodes,
        largest=answer["p_max_point"].value,
    )


def _pieces(
    solution: Solution, nodes: Callable[[int], FloatArray], overclosures: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Cut facets of higher degree where they are drawn: between nodes, and at equal parts of that.

    Returns
    -------
    tuple[FloatArray, FloatArray]
        Corners, (n, 4, 3) [mm], and mean pressures, (n,) [MPa]; facet after facet.
    """
    surfaces = solution.deformable.surfaces
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
    law = solution.deformable.contact.law.on(surfaces.block_m, surfaces.block_s)
    pressures = law.pressure(overclosures @ _linear(line, looks).T)
    return corners, pressures[:, quads].mean(axis=2).ravel()


def _linear(line: FloatArray, ends: FloatArray) -> FloatArray:
    """Values on the grid of a line from those on a coarser one, linear between; (n², m²)."""
    weights = np.stack([np.interp(line, ends, one) for one in np.eye(len(ends))], axis=1)
    return np.asarray(np.kron(weights, weights), dtype=np.float64)


def draw_contact(answer: Answer, path: Path) -> None:
    """Draw the contact pressures as those of rigid blocks are drawn."""
    draw_pressed_facets(run_facets(answer), path, title=f"{answer.title}: contact pressure")
