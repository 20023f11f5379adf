"""Readers of formats of surfaces that meshio does not read, or not all of, by suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from geometry.errors import unreadable
from geometry.files.compas_json import read_compas
from geometry.files.gltf import read_scene_graph
from geometry.files.named_surfaces import NamedSurface
from geometry.files.off import read_off
from geometry.files.rhino import read_rhino
from geometry.files.three_mf import read_3mf
from geometry.mesh import MeshError

#: By suffix.
READERS: Mapping[str, Callable[[Path], list[NamedSurface]]] = {
    ".json": read_compas,
    ".glb": read_scene_graph,
    ".gltf": read_scene_graph,
    ".3mf": read_3mf,
    ".3dm": read_rhino,
    ".off": read_off,
}
#: Suffixes of files that say in which unit they are, beside STEP; read in mm.
OWN_UNITS = {".glb", ".gltf", ".3mf", ".3dm"}


def read_named(path: Path) -> list[NamedSurface]:
    """Surfaces of a file of one of the formats in `READERS`, without those in `left_out`.

    Raises
    ------
    MeshError
        As the readers; the file is not there, or nothing of it is a block.
    """
    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected a file of surfaces")
    every = READERS[path.suffix.lower()](path)
    result = [one for one in every if not one.left_out]
    if not result:
        raise MeshError(f"{path}: got no block; left out: {', '.join(_words(every))}")
    return result


def left_out(path: Path) -> list[str]:
    """Objects that a file says are no blocks, and why: hidden, on a layer that is off, a support.

    Raises
    ------
    MeshError
        As `read_named`.
    """
    reader = READERS.get(path.suffix.lower())
    return [] if reader is None else _words(reader(path))


def _words(surfaces: list[NamedSurface]) -> list[str]:
    return [f"{one.name} ({one.left_out})" for one in surfaces if one.left_out]
