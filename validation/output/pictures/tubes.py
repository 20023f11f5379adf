"""Pictures of deformable blocks: stresses, displacements, contact pressures, sections of tubes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fem.element.functions import lobatto_points
from fem.element.material import von_mises
from fem.stresses.recovery import principal_of
from geometry.answer import is_round
from geometry.mesh import FloatArray, structured_quads
from validation.output.pictures.assemblies import draw_pressed_facets
from validation.output.pictures.bodies import (
    PressedFacets,
    above_and_below,
    blocks,
    eye,
    quarter,
    steep,
)
from validation.output.pictures.canvas import Direction, Part, View
from validation.output.pictures.gallery import Panel, gallery
from validation.output.pictures.scales import (
    MISES_MAP,
    MOTION_MAP,
    OUTWARD_MAP,
    STRESS_MAP,
    Scale,
    drawing_scale,
    scale_from_zero,
    symmetric_scale,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fem.state import State
    from geometry.answer import Answer


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
MISES = Stress("von Mises stress", von_mises, "largest", "mises_max", MISES_MAP)


def stresses_of(answer: Answer) -> tuple[Stress, ...]:
    """Stresses that the pictures of a run show."""
    return (*STRESSES, MISES) if answer.case.pictures.mises else STRESSES


def moved_blocks(
    solution: State, values: Callable[[int], FloatArray], scale: Scale, **options: Any
) -> list[Part]:
    """Deformable blocks in the colours of a quantity at their nodes, moved by ``factor`` times u.

    Other options are those of `blocks`.
    """
    deformable, factor = solution.whole, options.pop("factor", 0.0)
    # Of a closed surface what looks away is hidden.
    usual = {"edges": 0.0, "two_sided": options.get("faces") is not None}
    options = {"only": deformable.deformable_blocks.tolist(), **usual, **options}

    def places(block: int) -> FloatArray:
        return deformable.positions(block) + factor * solution.displacement_of(block)

    return blocks(deformable.drawn, lambda b: scale.of(values(b)), places, lit=False, **options)


def _around(solution: State) -> list[Part]:
    """Edges of the blocks that do not deform; single bodies show their own, where they were."""
    deformable = solution.whole
    rigid = np.flatnonzero(deformable.body_number < 0).tolist()
    edged = rigid if deformable.meets else deformable.deformable_blocks.tolist()
    return blocks(deformable.drawn, None, only=edged, edges=0.6)


# ---------------------------------------------------------------------------------------------
# Stresses and displacements


def _moved(solution: State, block: int) -> FloatArray:
    return np.asarray(np.linalg.norm(solution.displacement_of(block), axis=1))


def _stress(solution: State, stress: Stress, block: int) -> FloatArray:
    return stress.of(principal_of(solution, block))


def stress_scale(solution: State, stress: Stress = STRESSES[0]) -> Scale:
    """Colours of a stress, with what it reaches anywhere in the blocks."""
    blocks = solution.whole.deformable_blocks.tolist()
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
    meets = np.isin(node, answer.details.whole.drawn.shape(block).contact_quads)
    words = (
        f"node: {stress.sign * values[node]:.3g}, block {block}{', in a joint' if meets else ''}\n"
        f"integration point: {table.value:.3g}"
    )
    return answer.details.whole.positions(block)[node], words.replace("-", "−")


def draw_stresses(answer: Answer) -> Figure:
    """Draw stresses, and the first one on the faces that meet others; from where contacts are seen.

    Of a tube the outer surface, and the joints of a layer; of other blocks all surfaces, and the
    displacement.
    """
    solution, tube = answer.details, is_round(answer.details.whole.drawn)
    meets = solution.whole.meets
    direction = run_facets(answer).side if meets else eye(solution.whole.drawn)
    columns, around = [], _around(solution)
    for stress in stresses_of(answer):
        scale, values = stress_scale(solution, stress), partial(_stress, solution, stress)
        words = f"{stress.symbol}{', outer surface' if tube else ''}"
        faces, edges = ("outer",) if tube else None, 0.35 if meets else 0.0
        parts = moved_blocks(solution, values, scale, faces=faces, edges=edges)
        view = View([*parts, *around], direction)
        columns.append([Panel(words, view, scale=scale, note=extreme(answer, stress)[1])])
    if not tube:
        columns.append([moved_panel(solution, direction, around)])
    joints = _joint_panels(answer, direction) if meets else []
    columns += [joints] if tube else [[panel] for panel in joints]
    widest = 16.0 + 4.0 * (len(columns) - (4 if tube else 5))
    return gallery(columns, answer.title, height=7.5 if tube else 5.5, widest=max(16.0, widest))


def moved_panel(
    solution: State, direction: Direction, around: Sequence[Part] | None = None
) -> Panel:
    """The deformed shape, coloured by the displacement, and what is ``around`` it."""
    shown, factor = solution.whole.deformable_blocks.tolist(), drawing_scale(solution)
    scale = scale_from_zero("|u| [mm]", MOTION_MAP, [_moved(solution, b) for b in shown])
    parts = moved_blocks(solution, partial(_moved, solution), scale, factor=factor)
    view = View([*parts, *(_around(solution) if around is None else around)], direction)
    return Panel(f"deformed shape,\nscale factor {factor:g}", view, scale=scale)


def _joint_panels(answer: Answer, direction: Direction) -> list[Panel]:
    """Draw the first stress on the faces that meet other blocks, from above and from below.

    Of a tube those of the layer in which it is extreme.
    """
    solution, stress = answer.details, STRESSES[0]
    assembly, shown = solution.whole.drawn, solution.whole.deformable_blocks
    scale, where, tube = stress_scale(solution, stress), "in the joints", is_round(assembly)
    if tube:
        layer = answer[stress.measure].place["layer"]  # type: ignore[index]
        shown, where = shown[assembly.layer[shown] == layer], f"in the joints\nof layer {layer}"
        direction = steep(direction, 1.0)
    names = tuple(dict.fromkeys(f for s in assembly.shapes for f in s.contact_faces))
    # Two faces lie on each other in a joint: the eye sees the one that looks at it.
    options = {"only": shown.tolist(), "faces": names, "two_sided": False, "edges": 0.5}
    parts = moved_blocks(solution, partial(_stress, solution, stress), scale, **options)
    top, bottom = above_and_below(parts, direction, title=f"{stress.symbol} {where}", scale=scale)
    return [replace(top, scale=None), bottom] if tube else [top, bottom]


def draw_displacement(answer: Answer) -> Figure:
    """Draw the displacement of a tube and its radial part, from the side where it is largest."""
    solution, around = answer.details, _around(answer.details)
    assembly = solution.whole.drawn
    place: Any = answer["max_displacement"].place
    along = quarter((1.0, 0.0, 0.0), np.array(place["position"]) - assembly.origin)

    def outward(block: int) -> FloatArray:
        arms = solution.whole.positions(block) - assembly.origin
        arms -= (arms @ assembly.axis)[:, None] * assembly.axis
        sizes = np.maximum(np.linalg.norm(arms, axis=1), 1e-300)
        return np.einsum("ij,ij->i", solution.displacement_of(block), arms) / sizes

    every = [outward(block) for block in solution.whole.deformable_blocks.tolist()]
    scale = symmetric_scale("outward [mm]", OUTWARD_MAP, every)
    factor = drawing_scale(solution)
    parts = moved_blocks(solution, outward, scale, factor=factor)
    view = View([*parts, *around], along)
    columns = [
        [moved_panel(solution, along, around)],
        [Panel(f"radial displacement,\nscale factor {factor:g}", view, scale=scale)],
    ]
    return gallery(columns, f"{answer.title}; displacement", height=8.5)


# ---------------------------------------------------------------------------------------------
# Contact


def run_facets(answer: Answer) -> PressedFacets:
    """Contact facets of a run where they ended, those of higher degree in pieces."""
    body_number = answer.details.whole.body_number

    def nodes(block: int) -> FloatArray:
        placed = answer.details.whole.positions(block)
        return placed + answer.details.displacement_of(block) if body_number[block] >= 0 else placed

    result = answer.details.contact_state
    owner, corners, pressures = np.arange(result.n_facets), result.corners, result.pressures
    if result.corner_overclosures is not None and result.corner_overclosures.shape[1] > 4:
        corners, pressures = _pieces(answer.details, nodes, result.corner_overclosures)
        owner = np.repeat(owner, len(pressures) // result.n_facets)
    return PressedFacets(
        assembly=answer.details.whole.drawn,
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
    surfaces = solution.whole.surfaces
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
    law = solution.whole.contact.law.on(surfaces.block_m, surfaces.block_s)
    pressures = law.pressure(overclosures @ _linear(line, looks).T)
    return corners, pressures[:, quads].mean(axis=2).ravel()


def _linear(line: FloatArray, ends: FloatArray) -> FloatArray:
    """Values on the grid of a line from those on a coarser one, linear between; (n², m²)."""
    weights = np.stack([np.interp(line, ends, one) for one in np.eye(len(ends))], axis=1)
    return np.asarray(np.kron(weights, weights), dtype=np.float64)


def draw_contact(answer: Answer) -> Figure:
    """Draw the contact pressures as those of rigid blocks are drawn."""
    return draw_pressed_facets(run_facets(answer), title=f"{answer.title}; contact pressure")
