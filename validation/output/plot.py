"""One field of an answer as a matplotlib figure, which is returned and never blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geometry.answer import UNITS, Answer
from geometry.mesh import HEX_FACES, FloatArray, IntArray
from validation.errors import InputError
from validation.output.pictures.assemblies import flat_panel
from validation.output.pictures.bodies import eye, side_of
from validation.output.pictures.canvas import Pixels, Polygons, View
from validation.output.pictures.gallery import Numbers, Panel, gallery, round_numbers
from validation.output.pictures.scales import (
    MISES_MAP,
    MOTION_MAP,
    OUTWARD_MAP,
    PRESSURE_MAP,
    STRESS_MAP,
    Scale,
    scale_from_zero,
    symmetric_scale,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Fields that are parts of others: their component.
_PARTS = {"sigma_1": 0, "sigma_2": 1, "sigma_3": 2}
#: Colours of fields that have some of their own.
_MAPS = {"pressure": PRESSURE_MAP, "mises": MISES_MAP}


def plot(answer: Answer, field: str, *, layer: int | None = None, unrolled: bool = False) -> Figure:
    """Draw a field of an answer on the surfaces of its blocks, or a pressure on contact facets.

    Parameters
    ----------
    answer
        Of any solver.
    field
        ``pressure`` or another number of the contacts, of their ``force`` and ``slip`` the size;
        ``sigma_1`` to ``sigma_3``, ``mises``; of ``displacement`` and ``mechanism`` the size.
    layer
        Layer of blocks to draw; None: all.
    unrolled
        Whether facets of a tube lie side by side, the angle about its axis to the right and the
        height upwards.
    """
    if field in answer.contacts and field in _of_facets(answer):
        corners, values = _of_contacts(answer, field, layer)
    else:
        corners, values = _of_blocks(answer, field, layer)
    if not len(corners):
        first, last = answer.layer_of_point.min(), answer.layer_of_point.max()
        known = last if first == last else f"one of {first} to {last}"
        raise InputError(f"plot: layer: got {layer}, which has nothing to draw; expected {known}")
    scale = _scale(field, values)
    words = field if layer is None else f"{field}, layer {layer}"
    if unrolled:
        panel = _unrolled(words, corners, scale.of(values))
    else:
        faces = np.arange(corners.shape[0] * corners.shape[1]).reshape(corners.shape[:2])
        drawn = Polygons(corners.reshape(-1, 3), faces, scale.of(values), lit=False)
        direction = side_of(answer.points) if answer.problem is None else eye(answer.problem.blocks)
        panel = Panel(words, View([drawn], direction))
    return gallery([[panel]], answer.title, scale=scale)


def _scale(field: str, values: FloatArray) -> Scale:
    """Colours as in the pictures of commands; of what they do not draw those of sizes."""
    label = f"{field} [{UNITS.get('principal_stress' if field in _PARTS else field, '-')}]"
    if field in _PARTS:
        return symmetric_scale(label, STRESS_MAP, [values])
    if field == "gap":  # open joints and closed ones
        return symmetric_scale(label, OUTWARD_MAP, [values])
    nothing = "open joint" if field == "pressure" else ""
    return scale_from_zero(label, _MAPS.get(field, MOTION_MAP), [values], nothing=nothing)


def _unrolled(title: str, corners: FloatArray, shades: Pixels) -> Panel:
    """Faces of a tube about the vertical axis, laid side by side."""
    middle = corners.reshape(-1, 3)[:, :2].mean(axis=0)
    angle = np.arctan2(corners[..., 1] - middle[1], corners[..., 0] - middle[0])
    # Corners of a face lie beside its first one, also where the angle jumps.
    angle = angle[:, :1] + np.angle(np.exp(1j * (angle - angle[:, :1])))
    flat = np.stack([np.degrees(angle), corners[..., 2]], axis=-1)
    low, high = float(flat[..., 0].min()), float(flat[..., 0].max())
    numbers = Numbers("angle from x towards y [°]", "z [mm]", round_numbers(low, high), {})
    pair = np.zeros(len(flat), dtype=np.int64)
    return flat_panel(title, flat, shades=shades, pair=pair, span=(low, high), numbers=numbers)


def _of_contacts(answer: Answer, field: str, layer: int | None) -> tuple[FloatArray, FloatArray]:
    """Corners of contact facets and the value of each."""
    result = answer.contacts
    if "corners" not in result:
        raise InputError(f"plot: {answer.title} has contact points, no facets; expected a field")
    shown = np.ones(len(result[field]), dtype=np.bool_)
    if layer is not None:
        shown = (result["layer"] == layer).any(axis=1)
    values = result[field][shown].astype(np.float64)
    return result["corners"][shown], values if values.ndim == 1 else np.linalg.norm(values, axis=1)


def _of_facets(answer: Answer) -> list[str]:
    """Numbers of contact facets, and vectors that have a size."""
    result = answer.contacts
    return [name for name in result if result[name].ndim == 1 or name in {"force", "slip"}]


def _of_blocks(answer: Answer, field: str, layer: int | None) -> tuple[FloatArray, FloatArray]:
    """Corners of the faces of blocks and the mean value of each."""
    if field in _PARTS and "principal_stress" in answer.fields:
        values = answer.fields["principal_stress"][:, _PARTS[field]]
    elif field in answer.fields:
        values = answer.fields[field]
        values = values if values.ndim == 1 else np.linalg.norm(values, axis=1)
    else:
        parts = list(_PARTS) if "principal_stress" in answer.fields else []
        known = ", ".join((*answer.fields, *parts, *_of_facets(answer)))
        raise InputError(f"plot: got {field!r}; expected one of {known}")
    faces = _outside(answer.cells)
    if layer is not None:
        faces = faces[answer.layer_of_point[faces[:, 0]] == layer]
    return answer.points[faces], values[faces].mean(axis=1)


def _outside(cells: IntArray) -> IntArray:
    """Faces that no second hexahedron shares, (n, 4); of triangles all, (n, 3)."""
    if cells.shape[1] == 3:
        return cells
    faces = cells[:, HEX_FACES].reshape(-1, 4)
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(faces[np.sort(first[count == 1])])
