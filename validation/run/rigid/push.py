"""Rigid limit of a push: the largest force on the pushed block, by limit analysis of the faces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.polyhedra.assembly import PolyhedralAssembly
from mbd.push import PushLimit, push_limit
from validation.build.pairs import friction_of_pairs
from validation.build.polyhedra import build_body_loads, build_polyhedra
from validation.build.supports import stated_load
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import DeformableScene


def rigid_push(
    scene: PolyhedralScene, assembly: PolyhedralAssembly, load: LoadCase
) -> PushLimit | str | None:
    """Limit of the push of a scene on its blocks, supports and loads; None where it has none.

    Contacts have an area, as those of deformable blocks: edges and corners carry nothing. Friction
    is that of ``[rigid]``, else that of deformable blocks. Words say why there is no limit.
    """
    if scene.push is None:
        return None
    bare = assembly.with_faces_alone()
    friction = push_friction(scene)
    of_pairs = friction_of_pairs(scene, bare) if friction else ()
    try:
        return push_limit(bare, replace(load, assembly=bare), friction, of_pairs)
    except RefusedError as error:
        return f"none: {error}"


def rigid_limit(scene: DeformableScene) -> float | None:
    """Limit of the push of a scene with associated friction [N]; None where there is none."""
    if not isinstance(scene, PolyhedralScene) or scene.push is None:
        return None
    blocks = build_polyhedra(scene, Path())  # files of a checked scene have absolute names
    load = stated_load(scene, blocks, build_body_loads(scene, blocks).load_case(blocks))
    result = rigid_push(scene, blocks, load)
    return _finite(result.associated.factor) if isinstance(result, PushLimit) else None


def push_friction(scene: PolyhedralScene) -> float:
    """Coefficient of friction under which a block is pushed [-]."""
    if scene.rigid.friction is not None:
        return scene.rigid.friction
    return 0.0 if scene.effects.friction is None else scene.effects.friction.coefficient


def push_json(scene: PolyhedralScene, limit: PushLimit | str) -> dict[str, Any]:
    """The limit as plain data: forces in N; None where friction jams and there is no limit."""
    if isinstance(limit, str):
        return {"friction": push_friction(scene), "status": limit}
    most, slides = limit.associated, limit.sliding
    return {
        "friction": push_friction(scene),
        "associated": _finite(most.factor),
        "upper_bound": _finite(most.upper_bound),
        "certified": most.certified,
        "unbounded": bool(np.isinf(most.factor)),
        "non_associated": _finite(slides.factor) if slides.certified else None,
        "status": limit_words(limit),
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def limit_words(limit: PushLimit | str) -> str:
    """Force at which the block moves with associated friction, and without dilation."""
    if isinstance(limit, str):
        return limit
    most, slides = limit.associated, limit.sliding
    words = f"{most.factor:.5g} N with associated friction"
    if np.isinf(most.factor):
        words = "unbounded with associated friction: faces jam"
    elif not most.certified:
        words += " (not certified)"
    if slides.certified:
        words += f"; slides without dilation from {abs(slides.factor):.5g} N on"
        return f"{words} (friction pyramid)"
    return f"{words}; no certified state slides without dilation"
