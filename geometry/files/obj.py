"""Wavefront OBJ as modelling programs write it: points and faces; the rest is for pictures.

meshio's reader knows neither indices that count backwards nor points with colours behind them.
Format: Wavefront Advanced Visualizer manual, appendix B1 (object files).
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from geometry.errors import unreadable
from geometry.mesh import FloatArray, IntArray, MeshError


def read_obj(path: Path) -> tuple[FloatArray, list[IntArray]]:
    """Points and faces of a file, faces with the same number of corners together.

    Parameters
    ----------
    path
        The file: ``v x y z …`` and ``f a/… b/… c/… …``, where a negative index counts back from
        the last point before the line. Texture coordinates, normals, groups, materials, lines
        and the like are passed over.

    Returns
    -------
    FloatArray
        (n_points, 3).
    list[IntArray]
        (n_faces, n_corners) each.

    Raises
    ------
    MeshError
        Naming the line that cannot be read.
    """
    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected an OBJ file")
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ")
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror})") from None
    points, faces = _plain(text.splitlines()) or _any(path, text.splitlines())
    last = max(int(group.max()) for group in faces)
    if last >= len(points):
        raise MeshError(
            f"{path}: a face names point {last + 1}, but there are {len(points)} points"
        )
    return points, faces


def _plain(lines: list[str]) -> tuple[FloatArray, list[IntArray]] | None:
    """What most files hold, in a third of the time: points, and faces all of as many points.

    None where anything is written in another way, or cannot be read: `_any` says what.
    """
    points = [line for line in lines if line.startswith("v ")]
    faces = [line[2:] for line in lines if line.startswith("f ")]
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
    return vertices, [corners - 1]


def _any(path: Path, lines: list[str]) -> tuple[FloatArray, list[IntArray]]:
    """Line by line."""
    points: list[list[float]] = []
    faces: dict[int, list[list[int]]] = {}
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
        except ValueError as error:
            raise MeshError(f"{path}: line {number}: got {line.strip()!r} ({error})") from None
    if not faces:
        raise MeshError(f"{path}: got no faces; expected triangles or polygons")
    return np.array(points), [np.array(group, dtype=np.int64) for group in faces.values()]


def _position(word: str, known: int) -> int:
    """Point of a corner ``point/texture/normal``, counted from zero."""
    index = int(word.partition("/")[0])
    if index == 0 or index < -known:
        raise ValueError(f"no point {index}: points are counted from 1, or back from -1")
    return index - 1 if index > 0 else known + index
