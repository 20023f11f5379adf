"""Pictures of deformable blocks: stresses, displacements, contact pressures, sections of tubes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fem.element.functions import lobatto_points
from fem.element.stress import von_mises
from geometry.answer import is_round
from geometry.families.hexagon_block import EDGE_NAMES
from geometry.mesh import FloatArray, structured_quads
from validation.output.pictures.assemblies import draw_pressed_facets
from validation.output.pictures.bodies import (
    PressedFacets,
    above_and_below,
    eye,
    outlines,
    quarter,
    steep,
    surfaces,
)
from validation.output.pictures.canvas import Direction, Part, View
from validation.output.pictures.gallery import Panel, gallery
from validation.output.pictures.scales import (
    MOTION_MAP,
    STRESS_MAP,
    Scale,
    drawing_scale,
    scale_from_zero,
    symmetric_scale,
)

if TYPE_CHECKING:
    from fem.state import State
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
    return (*STRESSES, MISES) if answer.case.pictures.mises else STRESSES


def blocks_view(
    solution: State,
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
        return solution.deformable.positions(block) + factor * solution.displacement_of(block)

    parts: list[Part] = [
        surfaces(
            assembly,
            deformable,
            lambda block: scale.of(values(block)),
            nodes=nodes,
            faces=faces,
            lit=False,
        )
    ]
    rigid = np.flatnonzero(solution.deformable.group_of < 0).tolist()
    # Single bodies show their edges, and where they were.
    edged = rigid if solution.deformable.meets else deformable
    parts.append(outlines(assembly, edged, opacity=0.6))
    return View(parts, direction)


# ---------------------------------------------------------------------------------------------
# Stresses and displacements


def _moved(solution: State, block: int) -> FloatArray:
    return np.asarray(np.linalg.norm(solution.displacement_of(block), axis=1))


def all_faces(solution: State) -> tuple[str, ...]:
    """Names of all faces of the deformable blocks."""
    assembly = solution.deformable.drawn
    shapes = (assembly.shape(b) for b in solution.deformable.deformable_blocks.tolist())
    return tuple(dict.fromkeys(face for shape in shapes for face in shape.faces))


def _stress(solution: State, stress: Stress, block: int) -> FloatArray:
    return stress.of(solution.principal(block))


def stress_scale(solution: State, stress: Stress = STRESSES[0]) -> Scale:
    """Colours of a stress, with what it reaches anywhere in the blocks."""
    blocks = solution.deformable.deformable_blocks.tolist()
    values = [_stress(solution, stress, b) for b in blocks]
    return _scale(stress, values)


def _scale(stress: Stress, values: Sequence[FloatArray]) -> Scale:
    """Colours of a stress, from its values."""
    scale = symmetric_scale(f"{stress.symbol} [MPa]", stress.colours, values)
    return replace(scale, diverging=stress.colours == STRESS_MAP)


def extreme(answer: Answer, stress: Stress) -> tuple[FloatArray, str]:
    """The node at which a stress is extreme in the block that the tables name: place, (3,) [mm].

    Beside it the words that stand below the colours.
    """
    table = answer[stress.measure]
    assert table.place is not None
    (block,) = table.place["blocks"]
    values = stress.sign * _stress(answer.details, stress, block)
    node = int(values.argmax())
    meets = np.isin(node, answer.details.deformable.drawn.shape(block).contact_quads)
    words = (
        f"node: {stress.sign * values[node]:.3g}, block {block}{', in a joint' if meets else ''}\n"
        f"integration point: {table.value:.3g}"
    )
    return answer.details.deformable.positions(block)[node], words.replace("-", "−")


def draw_stresses(answer: Answer, path: Path) -> None:
    """Draw stresses and the displacement, and the first stress on the faces that meet others.

    Of a tube the outer surface, and the joints of the middle layer; of other blocks all surfaces.
    """
    solution, tube = answer.details, is_round(answer.details.deformable.drawn)
    direction = eye(solution.deformable.drawn, extreme(answer, STRESSES[0])[0])
    faces = ("outer",) if tube else all_faces(solution)
    columns = []
    for stress in stresses_of(answer):
        scale, values = stress_scale(solution, stress), partial(_stress, solution, stress)
        words = f"{stress.symbol}{', outer surface' if tube else ''}"
        view = blocks_view(solution, values, scale, faces, direction)
        columns.append([Panel(words, view, scale=scale, note=extreme(answer, stress)[1])])
    moved = _SHELL if tube else all_faces(solution)
    columns.append([moved_panel(solution, moved, direction)])
    joints = _joint_panels(answer, direction) if solution.deformable.meets else []
    columns += [joints] if tube else [[panel] for panel in joints]
    widest = 16.0 + 4.0 * (len(columns) - (4 if tube else 5))
    gallery(columns, answer.title, path, height=7.5 if tube else 5.5, widest=max(16.0, widest))


def moved_panel(solution: State, faces: Sequence[str], direction: Direction) -> Panel:
    """The deformed shape, coloured by the displacement."""
    blocks, factor = solution.deformable.deformable_blocks.tolist(), drawing_scale(solution)
    scale = scale_from_zero("|u| [mm]", MOTION_MAP, [_moved(solution, b) for b in blocks])
    view = blocks_view(solution, partial(_moved, solution), scale, faces, direction, factor=factor)
    return Panel(f"deformed shape,\nscale factor {factor:g}", view, scale=scale)


def _joint_panels(answer: Answer, direction: Direction) -> list[Panel]:
    """Draw the first stress on the faces that meet other blocks, from above and from below.

    Of a tube those of the layer in which it is extreme.
    """
    assembly, stress = answer.details.deformable.drawn, STRESSES[0]
    tube = is_round(assembly)
    scale = stress_scale(answer.details, stress)
    blocks, where = answer.details.deformable.deformable_blocks, "in the joints"
    if tube:
        layer = answer[stress.measure].place["layer"]  # type: ignore[index]
        blocks, where = blocks[assembly.layer[blocks] == layer], f"in the joints of layer {layer}"
        direction = steep(direction, 1.0)
    names = tuple(dict.fromkeys(f for s in assembly.shapes for f in s.contact_faces))
    values, shown = partial(_stress, answer.details, stress), blocks.tolist()
    nodes = answer.details.deformable.positions
    # Two faces lie on each other in a joint: the eye sees the one that looks at it.
    parts: list[Part] = [
        surfaces(
            assembly,
            shown,
            lambda block: scale.of(values(block)),
            nodes=nodes,
            faces=names,
            lit=False,
            two_sided=False,
        ),
        outlines(assembly, shown, nodes=nodes, opacity=0.5),
    ]
    top, bottom = above_and_below(parts, direction, title=f"{stress.symbol} {where}", scale=scale)
    return [replace(top, scale=None), bottom] if tube else [top, bottom]


def draw_displacement(answer: Answer, path: Path) -> None:
    """Draw the displacement of a tube and its radial part, from the side where it is largest."""
    solution, faces = answer.details, (*_SHELL, "top", "bottom")
    assembly = solution.deformable.drawn
    place: Any = answer["max_displacement"].place
    along = quarter((1.0, 0.0, 0.0), np.array(place["position"]) - assembly.origin)

    def outward(block: int) -> FloatArray:
        arms = solution.deformable.positions(block) - assembly.origin
        arms -= (arms @ assembly.axis)[:, None] * assembly.axis
        sizes = np.maximum(np.linalg.norm(arms, axis=1), 1e-300)
        return np.einsum("ij,ij->i", solution.displacement_of(block), arms) / sizes

    every = [outward(block) for block in solution.deformable.deformable_blocks.tolist()]
    scale = symmetric_scale("outward [mm]", STRESS_MAP, every)
    factor = drawing_scale(solution)
    view = blocks_view(solution, outward, scale, faces, along, factor=factor)
    columns = [
        [moved_panel(solution, faces, along)],
        [Panel(f"radial displacement,\nscale factor {factor:g}", view, scale=scale)],
    ]
    gallery(columns, f"{answer.title}: displacement", path, height=8.5)


# ---------------------------------------------------------------------------------------------
# Contact


def run_facets(answer: Answer) -> PressedFacets:
    """Contact facets of a run where they ended, those of higher degree in pieces."""
    group_of = answer.details.deformable.group_of

    def nodes(block: int) -> FloatArray:
        placed = answer.details.deformable.positions(block)
        return placed + answer.details.displacement_of(block) if group_of[block] >= 0 else placed

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
    solution: State, nodes: Callable[[int], FloatArray], overclosures: FloatArray
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
