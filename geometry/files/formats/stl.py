"""STL as text, as CAD and mesh libraries write it: each ``solid NAME`` is a surface with a name.

meshio's reader stops at some writers' line breaks and joins solids. Binary files have neither.
Format: 3D Systems, StereoLithography Interface Specification (1989).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.files.named_surfaces import NamedSurface
from geometry.mesh import MeshError

#: Bytes in which a text shows itself: binary files may begin with "solid" too.
_HEAD = 1000


def is_text(path: Path) -> bool:
    """Whether a file is STL as text."""
    with path.open("rb") as file:
        head = file.read(_HEAD)
    return head.lstrip().lower().startswith(b"solid") and b"facet" in head.lower()


def read_stl_text(path: Path) -> list[NamedSurface]:
    """Surfaces of the solids of a file, in its order; corners are not merged.

    Raises
    ------
    MeshError
        Naming the line that cannot be read, or for a file that is cut short.
    """
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    names: list[str] = []
    corners: list[list[list[float]]] = []
    inside = False
    for number, line in enumerate(lines, start=1):
        kind, _, rest = line.strip().partition(" ")
        kind = kind.lower()
        if kind == "solid":
            names.append(rest.strip())
            corners.append([])
            inside = True
        elif kind == "endsolid":
            inside = False
        elif kind == "vertex" and inside:
            try:
                x, y, z = map(float, rest.split())
            except ValueError:
                raise MeshError(
                    f"{path}: line {number}: got {line.strip()!r}, expected vertex x y z"
                ) from None
            corners[-1].append([x, y, z])
    cut = next((k for k, points in enumerate(corners) if len(points) % 3), None)
    if inside or cut is not None:
        raise MeshError(f"{path}: a facet or a solid has no end: the file is cut short")
    result = [
        NamedSurface(name, np.array(points), (np.arange(len(points)).reshape(-1, 3),))
        for name, points in zip(names, corners, strict=True)
        if points
    ]
    if not result:
        raise MeshError(f"{path}: got no facets; expected a surface")
    return result if len(result) > 1 else [NamedSurface("", result[0].points, result[0].faces)]
