"""Refuse scenes that no machine at hand can hold: by a count, before anything is built."""

from __future__ import annotations

import math
import os
from typing import Any

from pydantic import BaseModel

from validation.scene.polyhedra import MeshScene

#: Least memory of what is built, whatever the method: nodes and corners of an element, an outer
#: facet with its contact, a triangulated block [bytes].
_ELEMENT, _FACET, _BLOCK = 100.0, 300.0, 20e3
#: Part of the machine's memory that a scene may need.
_SHARE = 0.8


def too_large(scene: BaseModel) -> str | None:
    """One line on a scene that does not fit the memory of this machine; None where it may.

    What is counted is a lower bound: a scene that passes may still be too much for a method.
    """
    there = _machine_memory()
    blocks, elements, facets = _counts(scene)
    need = elements * _ELEMENT + blocks * (facets * _FACET + _BLOCK)
    if there is None or need <= _SHARE * there:
        return None
    what = f"{_short(blocks)} blocks"
    remedy = "fewer of them (assembly)"
    if facets:
        what += f" with {_short(elements)} elements and {_short(facets)} outer facets each"
        remedy = "fewer elements (mesh)" if facets > blocks else "fewer blocks (assembly)"
    return (
        f"{what} need at least {_short(need / 2**30)} GB of memory, and this machine has "
        f"{there / 2**30:.0f} GB; take {remedy}"
    )


def _short(number: float) -> str:
    return f"{number:.0f}" if number < 1e6 else f"{number:.2g}"


def _float(count: int) -> float:
    """A count of any size; beyond double precision it is infinite."""
    try:
        return float(count)
    except OverflowError:
        return math.inf


def _machine_memory() -> int | None:
    """Bytes of the machine, None where it does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _counts(scene: Any) -> tuple[float, float, float]:
    """Blocks, elements and outer facets of a block; no facets for triangulated blocks."""
    around = _divisions(scene)
    elements = math.prod(around)
    facets = 2.0 * sum(elements / n for n in around) if around else 0.0
    return _blocks(scene), elements if around else 0.0, facets


def _divisions(scene: Any) -> list[float]:
    """Elements of a block in three directions."""
    mesh: Any = getattr(scene, "mesh", None)
    if isinstance(scene, MeshScene):
        return [_float(scene.mesh.divisions)] * 3
    if hasattr(mesh, "around"):
        return [_float(mesh.around), _float(mesh.radial), _float(mesh.axial)]
    if hasattr(mesh, "edge"):
        return [3.0 * mesh.edge, _float(mesh.edge), _float(mesh.radial)]
    if hasattr(mesh, "divisions"):
        return [_float(n) for n in mesh.divisions]
    boxes: Any = getattr(scene.block, "boxes", None)
    if boxes:
        return [_float(max(box.divisions[axis] for box in boxes)) for axis in range(3)]
    return []


def _blocks(scene: Any) -> float:
    """Blocks of an assembly, the frame's too."""
    assembly: Any = getattr(scene, "assembly", None)
    counts = {
        name: _float(getattr(assembly, name))
        for name in ("layers", "columns", "rows", "rings", "voussoirs", "copies")
        if isinstance(getattr(assembly, name, None), int)
    }
    if "rings" in counts:
        return 3.0 * (counts["rings"] + 1.0) ** 2
    each = _float(getattr(scene.block, "blocks_per_layer", 1))
    return each * math.prod(n + 2.0 for n in counts.values())
