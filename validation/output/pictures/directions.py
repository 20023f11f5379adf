"""Arrows along the principal stresses of deformable blocks: how forces flow.

Two arrows that point apart are tension, two that point at each other are compression; their length
is the size of the stress. Colours differ as well, by vermilion and blue.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from fem.element.stress import stress_tensor
from fem.stresses.ball_averages import one_of_each_cube
from geometry.mesh import FloatArray, IntArray, ReadOnlyArrays
from validation.output.pictures.bodies import (
    above_and_below,
    arrows,
    eye,
    outlines,
    surfaces,
)
from validation.output.pictures.canvas import Part
from validation.output.pictures.gallery import gallery
from validation.output.pictures.scales import BLUE, VERMILION
from validation.scene.family import RoundScene

if TYPE_CHECKING:
    from fem.state import State
    from geometry.answer import Answer

#: Places with arrows on all faces that are drawn, about.
_PLACES = 240
#: Stresses below this part of the largest have no arrows.
_LEAST = 0.1
#: Share of the places whose stress is shown by its length; arrows of the others are as long.
_SHOWN = 0.95
#: Length of the longest pair of arrows, and height of all above the surface, in their distance.
_LONGEST, _HEIGHT = 0.95, 0.12
#: Thickness of arrows over that of loads.
_THICK = 2.2
#: Arrows lie in the surface up to this cosine of their angle to its normal.
_FLAT = 0.8
#: Colour of the blocks.
_BODY = "#F2F2F2"


@dataclass(frozen=True)
class Crosses(ReadOnlyArrays):
    """Principal stresses at places on the surface of blocks."""

    points: FloatArray
    """(n, 3) [mm]"""
    normals: FloatArray
    """Outward, unit, (n, 3)."""
    values: FloatArray
    """σ₃ ≤ σ₂ ≤ σ₁, (n, 3) [MPa]."""
    directions: FloatArray
    """Unit vectors of these, (n, 3 stresses, 3)."""
    spacing: float
    """Distance of the places, about [mm]."""

    @property
    def longest(self) -> float:
        """Stress from which arrows are longest [MPa]: what few places exceed."""
        return float(np.quantile(np.abs(self.values).max(axis=1), _SHOWN)) or 1.0


def crosses(solution: State, faces: Sequence[str] | None) -> Crosses:
    """Sample principal stresses evenly on the surface of the blocks that deform.

    On named faces; None: on all, without those that touch other blocks.
    """
    assembly = solution.deformable.drawn
    points, vectors, stresses = [], [], []
    for block in solution.deformable.deformable_blocks.tolist():
        shape, whole = assembly.shape(block), solution.deformable
        shown = [f for f in shape.faces if f not in shape.contact_faces or not whole.meets]
        quads = [shape.faces[f] for f in (shown if faces is None else faces) if f in shape.faces]
        if not quads:
            continue
        result = solution.recovered[int(whole.group_of[block])].stress[int(whole.copy_of[block])]
        corners = whole.positions(block)[np.concatenate(quads)]
        points.append(corners.mean(axis=1))
        arms = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
        vectors.append(0.5 * np.cross(*arms))
        stresses.append(result[np.concatenate(quads)].mean(axis=1))
    at, area, stress = (np.concatenate(part) for part in (points, vectors, stresses))
    size = np.linalg.norm(area, axis=1)
    spacing = float(np.sqrt(size.sum() / _PLACES))
    chosen = _apart(at, spacing)
    values, directions = np.linalg.eigh(stress_tensor(stress[chosen]))
    return Crosses(
        points=at[chosen],
        normals=(area / size[:, None])[chosen],
        values=values,
        directions=np.swapaxes(directions, 1, 2),
        spacing=spacing,
    )


def _apart(points: FloatArray, spacing: float) -> IntArray:
    """Points of which no two lie nearer than a distance [mm], (n,)."""
    few = one_of_each_cube(points, 0.4 * spacing)
    tree, free = cKDTree(points[few]), np.ones(len(few), dtype=np.bool_)
    kept = []
    for k in range(len(few)):
        if free[k]:
            kept.append(few[k])
            free[tree.query_ball_point(points[few[k]], spacing)] = False
    return np.array(kept, dtype=np.int64)


def arrow_parts(found: Crosses) -> list[Part]:
    """Arrows of tension, then those of compression."""
    shares = np.clip(found.values / found.longest, -1.0, 1.0)
    parts: list[Part] = []
    for colour, chosen in ((VERMILION, shares > _LEAST), (BLUE, shares < -_LEAST)):
        place, which = np.nonzero(chosen)
        # Of those that point out of the surface one half would be hidden in the block.
        along_normal = np.einsum("kai,ki->ka", found.directions, found.normals)
        seen = np.abs(along_normal[place, which]) < _FLAT
        place, which = place[seen], which[seen]
        half = 0.5 * _LONGEST * found.spacing * np.abs(shares[place, which])
        along = half[:, None] * found.directions[place, which]
        middle = found.points[place] + _HEIGHT * found.spacing * found.normals[place]
        ends = np.concatenate([along, -along])
        start = np.concatenate([middle, middle])
        if colour == BLUE:
            start, ends = start + ends, -0.95 * ends
        parts.append(arrows(start, ends, colour, thick=_THICK))
    return parts


def draw_directions(answer: Answer, path: Path) -> None:
    """Draw arrows along the principal stresses on the surface of the blocks.

    Of a tube on its outer surface; of other blocks on all that do not touch others, from above and
    from below.
    """
    from matplotlib.patches import Patch

    solution, tube = answer.details, isinstance(answer.case.scene, RoundScene)
    assembly = solution.deformable.drawn
    result, blocks = crosses(solution, ("outer",) if tube else None), solution.deformable
    body = surfaces(assembly, range(assembly.n_blocks), lambda _: _BODY, lit=False)
    edges = outlines(assembly, blocks.deformable_blocks.tolist(), opacity=0.4)
    parts = [body, edges, *arrow_parts(result)]
    panels = above_and_below(parts, eye(assembly), title="surface")
    if tube:
        panels = [replace(panels[0], title="outer surface")]
    words = {"← → tension": VERMILION, "→ ← compression": BLUE}
    gallery(
        [[panel] for panel in panels],
        f"{answer.title}\nprincipal stresses: longest arrows {result.longest:.3g} MPa and more, "
        f"none below {_LEAST * result.longest:.2g} MPa",
        path,
        height=8.5 if tube else 6.0,
        legend=[Patch(color=colour, label=name) for name, colour in words.items()],
    )
