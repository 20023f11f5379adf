"""3-D views of answers for pages: contact pressures, and stresses of deformable blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fem.state import State
from fem.stresses.recovery import principal_of
from geometry.answer import Answer, is_round
from geometry.assembly import Assembly
from validation.output.answer_files import is_meshed
from validation.output.pictures.bodies import (
    PressedFacets,
    blocks,
    eye,
    middle_layer,
    rigid_facets,
    turn_colours,
)
from validation.output.pictures.canvas import View
from validation.output.pictures.polyhedra import contact_parts
from validation.output.pictures.scales import Scale, drawing_scale
from validation.output.pictures.tubes import moved_blocks, stress_scale
from validation.output.pictures.view_3d import View3d, make_view

#: Layers on each side of the middle one that views of long tubes show.
_AROUND = 1


def pressed(facets: PressedFacets, layers: Sequence[int] | None = None) -> tuple[View, Scale]:
    """Contact facets in the colours of their pressures, of some layers or of all."""
    assembly, scale = facets.assembly, facets.scale
    some = _in_layers(assembly.layer, layers)
    rows = np.flatnonzero(np.isin(facets.block_m, some) | np.isin(facets.block_s, some))
    if layers is not None:  # colours of what is shown; the bar says how far others go
        shown = replace(facets, pressures=facets.pressures[rows]).scale
        scale = replace(shown, reached=scale.reached)
    parts = [facets.surface(rows, scale), *facets.outlines(some)]
    return View(parts, eye(assembly)), scale


def rigid_view(run: Answer, layers: Sequence[int] | None = None) -> tuple[View, Scale | None, str]:
    """Contact pressures of rigid blocks with their scale, or the blocks where none are carried.

    The last value says in words what is shown.
    """
    words = "faces that can meet another block, coloured by contact pressure"
    assembly, some, fixed = run.details.blocks, None, None
    if not is_meshed(run):
        parts, scale = contact_parts(run)
        if scale.reached[1] > 0.0:
            words = "contact interfaces, coloured by mean contact pressure"
            return View(parts, eye(assembly)), scale, words
    elif run.details.holds:
        view, scale = pressed(rigid_facets(run), layers)
        return view, scale, words
    else:
        some, fixed = _in_layers(assembly.layer, layers), run.details.load.fixed
    drawn = blocks(assembly, turn_colours(assembly, fixed), only=some)
    return View(drawn, eye(assembly)), None, "blocks; fixed ones grey"


def pressure_view(
    run: Answer, title: str, name: str, layers: Sequence[int] | None = None
) -> View3d:
    """Contact facets, coloured by pressure."""
    view, scale, words = rigid_view(run, layers)
    return make_view(name, title, f"Rigid blocks: {words}.", view, scale=scale)


def stressed(answer: Answer, layers: Sequence[int] | None = None) -> tuple[View, Scale]:
    """All faces of deformable blocks, coloured by σ₁, moved by exaggerated displacement."""
    solution: State = answer.details
    deformable = solution.whole
    scale, factor = stress_scale(solution), drawing_scale(solution)
    some = _in_layers(deformable.assembly.layer, layers)
    shown = np.intersect1d(deformable.deformable_blocks, some).tolist()
    parts = moved_blocks(
        solution, lambda b: principal_of(solution, b)[:, 0], scale, only=shown, factor=factor
    )
    return View(parts, eye(deformable.drawn)), scale


def stress_view(
    answer: Answer, title: str, name: str, layers: Sequence[int] | None = None
) -> View3d:
    """Stresses of deformable blocks to turn."""
    view, scale = stressed(answer, layers)
    return make_view(
        name,
        f"{title}, displacement scaled × {drawing_scale(answer.details):g}",
        "Deformable blocks: maximum principal stress σ₁; red is tension.",
        view,
        scale=scale,
    )


def middle_layers(assembly: Any) -> range | None:
    """Layers of a long tube that are large enough to see; None: all."""
    if (
        not (isinstance(assembly, Assembly) and is_round(assembly))
        or assembly.n_layers <= 2 * _AROUND + 1
    ):
        return None
    middle = middle_layer(assembly)
    return range(middle - _AROUND, middle + _AROUND + 1)


def layer_words(layers: Sequence[int] | None) -> str:
    """Layers that are shown, to follow other words; nothing where all are."""
    return "" if layers is None else f", layers {layers[0]} to {layers[-1]}"


def _in_layers(layer: np.ndarray, layers: Sequence[int] | None) -> list[int]:
    """Blocks of some layers, or all."""
    every = np.arange(len(layer))
    return (every if layers is None else every[np.isin(layer, list(layers))]).tolist()
