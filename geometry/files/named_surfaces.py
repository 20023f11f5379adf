"""Surfaces under the names that files give them, and what their readers share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geometry.mesh import FloatArray, IntArray, MeshError

#: Millimetres in the units that files state by name.
_MILLIMETRES = {
    "millimeters": 1.0,
    "millimeter": 1.0,
    "centimeters": 10.0,
    "centimeter": 10.0,
    "meters": 1000.0,
    "meter": 1000.0,
    "inches": 25.4,
    "inch": 25.4,
    "feet": 304.8,
    "foot": 304.8,
    "micron": 1e-3,
}
#: Rotation of a file whose y axis points up into one whose z axis does, (3, 3).
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: Objects within objects that a file may have: more are a circle.
DEEPEST = 64


@dataclass(frozen=True)
class NamedSurface:
    """Faces that a file puts together."""

    name: str
    """Empty where the file has none."""
    points: FloatArray
    """(n_points, 3), in the unit of the file."""
    faces: tuple[IntArray, ...]
    """Polygons with the same number of corners together, (n_faces, n_corners) each."""
    held: bool = False
    """Whether the file says that it is a support."""
    left_out: str = ""
    """Why the file says that it is no block; empty where it is one."""


def by_corners(faces: Iterator[list[int]]) -> tuple[IntArray, ...]:
    """Polygons with the same number of corners together."""
    groups: dict[int, list[list[int]]] = {}
    for face in faces:
        groups.setdefault(len(face), []).append(face)
    return tuple(np.array(group, dtype=np.int64) for group in groups.values())


def moved_surface(surface: NamedSurface, matrix: FloatArray) -> NamedSurface:
    """The same surface, moved by a matrix (4, 4)."""
    return replace(surface, points=surface.points @ matrix[:3, :3].T + matrix[:3, 3])


def unused_name(name: str, used: dict[str, int]) -> str:
    """Return the name, with a number where it was used before."""
    used[name] = used.get(name, 0) + 1
    return name if used[name] == 1 else f"{name} {used[name]}"


def millimetres_of(path: Path, unit: str) -> float:
    """Millimetres in a unit that a file states."""
    try:
        return _MILLIMETRES[unit.lower()]
    except KeyError:
        raise MeshError(
            f"{path}: its unit is {unit}; expected one of {', '.join(sorted(_MILLIMETRES))}: "
            "set it in the program that made it"
        ) from None
