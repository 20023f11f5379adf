"""Surfaces of OFF files: points and polygons, with comments; colours and normals are passed over.

meshio reads neither comments after the first lines nor polygons, and trimesh cuts these into fans.
Format: Geomview manual, section 4.2.5 (Object File Format), as text.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from geometry.files.named_surfaces import NamedSurface, by_corners
from geometry.mesh import MeshError

#: Keyword of a file; coordinates come first in each line of points.
_KEYWORD = re.compile(r"(ST)?C?N?OFF")


def read_off(path: Path) -> list[NamedSurface]:
    """Surface of a file, with one line for each point and each face.

    Raises
    ------
    MeshError
        Naming the line that cannot be read.
    """
    text = path.read_text("utf-8", errors="replace")
    lines = [(k, line.partition("#")[0].split()) for k, line in enumerate(text.splitlines(), 1)]
    rows = [(k, words) for k, words in lines if words]
    if not rows or not _KEYWORD.fullmatch(rows[0][1][0]):
        raise MeshError(f"{path}: got no line OFF at its start; expected an OFF file as text")
    rows[0][1].pop(0)  # the numbers may stand behind the keyword
    (number, first), *rest = [(k, words) for k, words in rows if words] or [(1, [])]
    try:
        n_points, n_faces = int(first[0]), int(first[1])
        if len(rest) < n_points + n_faces:
            raise ValueError(
                f"{len(rest)} lines follow for {n_points} points and {n_faces} faces: the file is "
                "cut short"
            )
        vertices = np.empty((n_points, 3))
        corners = []
        for k, (line, words) in enumerate(rest[: n_points + n_faces]):
            number = line
            if k < n_points:
                vertices[k] = [float(word) for word in words[:3]]
            else:
                corners.append(_face(words, n_points))
    except IndexError:
        raise MeshError(f"{path}: line {number}: got fewer numbers than expected") from None
    except ValueError as error:
        raise MeshError(f"{path}: line {number}: cannot be read ({error})") from None
    return [NamedSurface("", vertices, by_corners(iter(corners)))]


def _face(words: list[str], n_points: int) -> list[int]:
    """Corners of a face, behind their number."""
    size = int(words[0])
    face = [int(word) for word in words[1 : 1 + size]]
    if len(face) < max(size, 3):
        raise ValueError(f"a face of {len(face)} corners")
    if not 0 <= min(face) <= max(face) < n_points:
        raise ValueError(f"there are {n_points} points, counted from 0")
    return face
