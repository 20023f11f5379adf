"""Refuse scenes that no machine at hand can hold: by a count, before anything is built."""

from __future__ import annotations

import math
import os
from typing import Any

from pydantic import BaseModel

from validation.scene.polyhedra import MeshScene

#: Least memory of what is built, whatever the method: nodes and corners of an element, an outer
#: facet of each block with its contact, a triangulated block with its contacts [bytes]. Measured
#: with tubes and planar walls of 56 to 484 blocks and with layers, arches and walls of 400 to 1000.
_ELEMENT, _FACET, _BLOCK = 100.0, 100.0, 70e3
#: Least memory of deformable blocks: each element's state in an explicit run; of a static one, the
#: forces between each two outer facets of one block, which its solver keeps [bytes]. Measured with
#: tubes of 960 and 4032 elements a block: 0.09 and 0.48 GB.
_STATE, _FACET_PAIR = 200.0, 72.0
#: Least memory of the factor of one static body: for each element, so much times the cube root of
#: their number (nested dissection), in slender bodies for each element across [bytes]. Measured
#: with 3840 and 12960 elements: 0.22 and 1.14 GB.
_FACTOR, _BAND = 2000.0, 72.0
#: Part of the machine's memory that a scene may need.
_SHARE = 0.8


def too_large(scene: BaseModel) -> str | None:
    """One line on a scene that does not fit the memory of this machine; None where it may.

    What is counted is a lower bound: a scene that passes may still be too much for a method.
    """
    blocks, elements, facets = _counts(scene)
    each = facets * _FACET if facets else _BLOCK
    return _refused(scene, elements * _ELEMENT + blocks * each)


def too_large_to_deform(scene: BaseModel, *, static: bool) -> str | None:
    """As `too_large`, of a scene whose blocks deform: in a static run, or in an explicit one."""
    blocks, elements, facets = _counts(scene)
    need = blocks * elements * _STATE
    if static and blocks > 1.0:
        need = facets * facets * _FACET_PAIR
    elif static and elements:
        across = elements / max(_divisions(scene))
        need = elements * min(_FACTOR * elements ** (1.0 / 3.0), _BAND * across)
    return _refused(scene, need)


def _refused(scene: BaseModel, need: float) -> str | None:
    """One line on a scene that needs so many bytes, where the machine has fewer."""
    there = machine_memory()
    if there is None or need <= _SHARE * there:
        return None
    blocks, elements, facets = _counts(scene)
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


def machine_memory() -> int | None:
    """Bytes of the machine, None where it does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _counts(scene: Any) -> tuple[float, float, float]:
    """Blocks, elements and outer facets of a block; no facets for triangulated blocks."""
    fem: Any = getattr(scene, "fem", None)
    around = [n * (1 if fem is None else fem.degree) for n in _divisions(scene)]
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
