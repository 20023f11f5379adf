"""Wavefront OBJ as modelling programs write it: points, faces and objects; the rest is looks.

meshio's reader knows neither indices that count backwards nor points with colours behind them.
Format: Wavefront Advanced Visualizer manual, appendix B1 (object files).
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from geometry.errors import unreadable
from geometry.files.named_surfaces import NamedSurface
from geometry.mesh import FloatArray, IntArray, MeshError

#: Keywords of what an object consists of, faces and what is no surface.
_SHAPES = {"f", "l", "p", "curv", "curv2", "surf"}
#: Points, faces with the same number of corners together, and the line of each of those.
_Content = tuple[FloatArray, list[IntArray], list[IntArray]]


def read_obj(path: Path) -> list[NamedSurface]:
    """Surfaces of the objects of a file; of its groups where it has no objects.

    Parameters
    ----------
    path
        The file: ``v x y z …`` and ``f a/… b/… c/… …``, where a negative index counts back from
        the last point before the line, below ``o name`` or ``g name``. Texture coordinates,
        normals, materials, lines and the like are passed over.

    Returns
    -------
    list[NamedSurface]
        In the order of their first faces; a name that comes again goes on.

    Raises
    ------
    MeshError
        Naming the line that cannot be read.
    """
    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected an OBJ file")
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        text = text.replace("\\\n", " ").replace("\t", " ")
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror})") from None
    lines = text.splitlines()
    points, faces, at = _plain(lines) or _any(path, lines)
    last = max(int(group.max()) for group in faces)
    if last >= len(points):
        raise MeshError(
            f"{path}: a face names point {last + 1}, but there are {len(points)} points"
        )
    return _by_name(path, lines, points, faces, at)


def _check_end(path: Path, lines: list[str]) -> None:
    """Reject a file that ends with an object of points alone: it would be lost."""
    last = max((k for k, line in enumerate(lines) if line.startswith("o ")), default=len(lines))
    kinds = {line.split(None, 1)[0] for line in lines[last:] if line.strip()}
    if kinds and not kinds & _SHAPES:
        raise MeshError(
            f"{path}: line {last + 1}: {lines[last].strip()!r} has no faces before the end; "
            "expected some: the file is cut short"
        )


def _by_name(
    path: Path,
    lines: list[str],
    points: FloatArray,
    faces: list[IntArray],
    at: list[IntArray],
) -> list[NamedSurface]:
    """Faces of each object, or of each group, with the points that they use."""
    _check_end(path, lines)
    alone = ""
    for kind in ("o ", "g "):
        heads = [k for k, line in enumerate(lines) if line.startswith(kind)]
        names = ["", *(lines[k][2:].partition(" # ")[0].strip() for k in heads)]
        of_face = [np.searchsorted(heads, group) for group in at]
        used = list(dict.fromkeys(names[k] for k in np.unique(np.concatenate(of_face))))
        if len(used) > 1:
            break
        alone = alone or used[0]
    else:
        return [NamedSurface(alone, points, tuple(faces))]
    number = np.array([used.index(name) if name in used else -1 for name in names])
    surfaces = []
    for k, name in enumerate(used):
        groups = [group[number[of] == k] for group, of in zip(faces, of_face, strict=True)]
        groups = [group for group in groups if len(group)]
        there = np.unique(np.concatenate([group.ravel() for group in groups]))
        own = tuple(np.searchsorted(there, group) for group in groups)
        surfaces.append(NamedSurface(name, points[there], own))
    return surfaces


def _plain(lines: list[str]) -> _Content | None:
    """What most files hold, in a third of the time: points, and faces all of as many points.

    None where anything is written in another way, or cannot be read: `_any` says what.
    """
    points = [line for line in lines if line.startswith("v ")]
    at = np.array([k for k, line in enumerate(lines) if line.startswith("f ")], dtype=np.int64)
    faces = [lines[k][2:] for k in at]
    others = (line for line in lines if not line.startswith(("v ", "f ")))
    if not points or not faces or any(line.split(None, 1)[:1] in (["v"], ["f"]) for line in others):
        return None
    try:
        with warnings.catch_warnings(action="error"):
            vertices = np.loadtxt(points, usecols=(1, 2, 3), ndmin=2)
            corners = np.loadtxt(faces, dtype=np.int64, ndmin=2)
    except (ValueError, Warning):
        return None
    complete = len(vertices) == len(points) and len(corners) == len(faces)
    if not complete or corners.shape[1] < 3 or corners.min() < 1:
        return None
    return vertices, [corners - 1], [at]


def _any(path: Path, lines: list[str]) -> _Content:
    """Line by line."""
    points: list[list[float]] = []
    faces: dict[int, list[list[int]]] = {}
    at: dict[int, list[int]] = {}
    for number, line in enumerate(lines, start=1):
        kind, *words = line.partition("#")[0].split() or [""]
        try:
            if kind == "v":
                x, y, z = map(float, words[:3])
                points.append([x, y, z])
            elif kind == "f":
                face = [_position(word, len(points)) for word in words]
                if len(face) < 3:
                    raise ValueError("fewer than three corners")
                faces.setdefault(len(face), []).append(face)
                at.setdefault(len(face), []).append(number - 1)
        except ValueError as error:
            raise MeshError(f"{path}: line {number}: got {line.strip()!r} ({error})") from None
    if not faces:
        raise MeshError(f"{path}: got no faces; expected triangles or polygons")
    result, places = (
        [np.array(group, dtype=np.int64) for group in of.values()] for of in (faces, at)
    )
    return np.array(points), result, places


def _position(word: str, known: int) -> int:
    """Point of a corner ``point/texture/normal``, counted from zero."""
    index = int(word.partition("/")[0])
    if index == 0 or index < -known:
        raise ValueError(f"no point {index}: points are counted from 1, or back from -1")
    return index - 1 if index > 0 else known + index
