"""Surfaces of 3MF files.

Format: 3MF Consortium, core specification 1.3 and production extension.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from geometry.files.named_surfaces import (
    DEEPEST,
    NamedSurface,
    by_corners,
    millimetres_of,
    moved_surface,
    unused_name,
)
from geometry.mesh import FloatArray, MeshError

#: What stands before every name in a 3MF file.
_3MF = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
#: Attribute of the production extension: the model file of an object.
_3MF_PATH = "{http://schemas.microsoft.com/3dmanufacturing/production/2015/06}path"


def read_3mf(path: Path) -> list[NamedSurface]:
    """Surfaces of the build items of a 3MF file, in their order [mm].

    Raises
    ------
    MeshError
        A file that cannot be read, or that builds nothing.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            models = {
                f"/{name.lstrip('/')}": ElementTree.fromstring(archive.read(name))
                for name in archive.namelist()
                if name.lower().endswith(".model")
            }
        start = next(name for name in models if "3dmodel.model" in name.lower())
        objects = {
            (name, one.attrib["id"]): one
            for name, model in models.items()
            for one in model.iter(f"{_3MF}object")
        }
        scale = millimetres_of(path, models[start].attrib.get("unit", "millimeter"))
        used: dict[str, int] = {}
        result = [
            replace(surface, name=unused_name(surface.name, used))
            for item in models[start].iterfind(f"{_3MF}build/{_3MF}item")
            for surface in _3mf_surfaces(objects, start, item, scale * np.eye(4))
        ]
    except MeshError:
        raise
    except Exception as error:  # whatever a broken archive, broken XML or missing numbers raise
        raise MeshError(f"{path}: cannot be read as 3MF ({error!r})") from None
    if not result:
        raise MeshError(f"{path}: builds no mesh; expected build items of objects with triangles")
    return result


def _3mf_surfaces(
    objects: Mapping[tuple[str, str], ElementTree.Element],
    model: str,
    item: ElementTree.Element,
    above: FloatArray,
    depth: int = 0,
) -> Iterator[NamedSurface]:
    """Meshes of an item or a component, moved by the matrices of all above it (4, 4)."""
    if depth > DEEPEST:
        raise ValueError("its components contain each other")
    model = item.attrib.get(_3MF_PATH, model)
    one, matrix = objects[model, item.attrib["objectid"]], np.eye(4)
    if "transform" in item.attrib:
        numbers = [float(word) for word in item.attrib["transform"].split()]
        matrix[:3] = np.reshape(numbers, (4, 3)).T
    for part in one.iterfind(f"{_3MF}components/{_3MF}component"):
        yield from _3mf_surfaces(objects, model, part, above @ matrix, depth + 1)
    mesh = one.find(f"{_3MF}mesh")
    if mesh is None:
        return
    kind = one.attrib.get("type", "model")
    points = [[float(v.attrib[x]) for x in "xyz"] for v in mesh.iter(f"{_3MF}vertex")]
    faces = [[int(t.attrib[k]) for k in ("v1", "v2", "v3")] for t in mesh.iter(f"{_3MF}triangle")]
    surface = NamedSurface(
        one.attrib.get("name") or f"object {one.attrib['id']}",
        np.array(points).reshape(-1, 3),
        by_corners(iter(faces)),
        left_out="" if kind == "model" else f"its type is {kind}",
    )
    if faces and not 0 <= np.min(faces) <= np.max(faces) < len(points):
        raise ValueError(f"a triangle of {surface.name} names a vertex that is not there")
    yield moved_surface(surface, above @ matrix)
