"""What a run was asked, in words: for titles, tables and data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from geometry.loads import named_load


def load_words(scene: Any) -> str:
    """Say what loads the blocks of a scene, with its size."""
    load: Any = getattr(scene, "load", None)
    if isinstance(load, dict):
        parts = [_face_load_words(face, found) for face, found in load.items()]
    elif hasattr(load, "case"):
        layer = "" if load.layer is None else f" (layer {load.layer})"
        case = named_load(load.case)
        printed = ", as printed" if case.force_as_printed and load.as_printed else ""
        parts = [f"{case.words} {load.pressure:g} MPa{layer}{printed}"]
    elif hasattr(load, "pressure"):
        parts = [f"pressure {load.pressure:g} MPa on top"]
    else:
        parts = _body_load_words(load)
    effects: Any = getattr(scene, "effects", None)
    if effects is not None and effects.gravity is not None:
        parts.append(f"weight {_vector(effects.gravity)} mm/s²")
    return " + ".join(parts) or "no load"


def _face_load_words(face: str, load: Any) -> str:
    if load.pressure is not None:
        return f"pressure {load.pressure:g} MPa on {face}"
    return f"traction {_vector(load.traction)} MPa on {face}"


def _body_load_words(load: Any) -> list[str]:
    """Say what a load of free-form blocks is made of."""
    if load is None:
        return []
    parts = []
    if load.gravity is not None:
        parts.append(f"weight {_vector(load.gravity)} mm/s²")
    if load.acceleration is not None:
        parts.append(f"acceleration {_vector(load.acceleration)} mm/s²")
    if load.forces:
        count = len(load.forces)
        parts.append(f"{count} force{'s' if count > 1 else ''} on single blocks")
    return parts


def _vector(values: Sequence[float]) -> str:
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"
