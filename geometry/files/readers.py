"""Readers of formats of surfaces that meshio does not read, or not all of, by suffix."""

from __future__ import annotations

from pathlib import Path

from geometry.errors import unreadable
from geometry.files.named_surfaces import NamedSurface
from geometry.mesh import MeshError

#: Suffixes of the formats.
READ = (".json", ".glb", ".gltf", ".3mf", ".3dm", ".off")
#: Suffixes of files that say in which unit they are, beside STEP; read in mm.
OWN_UNITS = {".glb", ".gltf", ".3mf", ".3dm"}


def read_named(path: Path) -> list[NamedSurface]:
    """Surfaces of a file of one of the formats in `READ`, without those in `left_out`.

    Raises
    ------
    MeshError
        As the readers; the file is not there, or nothing of it is a block.
    """
    why = unreadable(path)
    if why is not None:
        raise MeshError(f"{path}: {why}; expected a file of surfaces")
    every = _every(path)
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
    return _words(_every(path)) if path.suffix.lower() in READ else []


def _every(path: Path) -> list[NamedSurface]:
    """Surfaces of a file by the reader of its format, which is imported when one is read."""
    match path.suffix.lower():
        case ".json":
            from geometry.files.formats.compas_json import read_compas as read
        case ".glb" | ".gltf":
            from geometry.files.formats.gltf import read_scene_graph as read
        case ".3mf":
            from geometry.files.formats.three_mf import read_3mf as read
        case ".3dm":
            from geometry.files.formats.rhino import read_rhino as read
        case _:
            from geometry.files.formats.off import read_off as read
    return read(path)


def _words(surfaces: list[NamedSurface]) -> list[str]:
    return [f"{one.name} ({one.left_out})" for one in surfaces if one.left_out]
