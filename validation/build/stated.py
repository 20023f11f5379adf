"""The scene of a problem that was made in Python, where its blocks were made from parameters.

Studies vary the keys of a scene. What a scene cannot state, they cannot vary: a problem is accepted
where the scene that is read off it states the very same problem.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, fields
from math import isfinite
from typing import Any

import numpy as np

from fem.assembly.deformable import Frames
from fem.assembly.statement import Problem
from fem.contact.law import LAWS
from fem.contact.pair_laws import PairLaws
from fem.element.hexahedron import ElementType
from geometry.families.hexagon_block import HexagonBlockParameters
from geometry.families.sine_block import SineBlockParameters
from geometry.families.tube import TubeParameters
from validation.build.deformable import scene_problem
from validation.errors import InputError
from validation.scene.read import DeformableScene, check_scene

_FAMILIES = {SineBlockParameters: "sine", HexagonBlockParameters: "hexagon"}


def stated_scene(problem: Problem) -> dict[str, Any]:
    """Data of the scene that states a problem."""
    data = {key: value for key, value in _sections(problem).items() if value}
    scene = check_scene(data, "problem")
    assert isinstance(scene, DeformableScene)
    for name in _differences(problem, scene_problem(scene, "problem")):
        raise InputError(
            f"problem: {name}: no scene states it, and studies vary the keys of a scene; expected "
            "a problem whose parts a scene has, or load_scene"
        )
    return data


def _sections(problem: Problem) -> dict[str, Any]:
    made = problem.blocks.parameters
    if not isinstance(made, TubeParameters):
        raise InputError(
            "problem: its blocks were not made from parameters that could be varied; expected "
            "blocks of geometry.tube, or load_scene"
        )
    turn = {"turn": made.turn} if isinstance(made.block, SineBlockParameters) else {}
    return {
        "block": {"type": _FAMILIES[type(made.block)], **asdict(made.block)},
        "assembly": {"layers": made.layers, **turn},
        "mesh": asdict(made.divisions),
        "load": _load(problem),
        "material": asdict(problem.materials[0]),
        "materials": _materials(problem),
        "contact": _contact(problem),
        "effects": dict(_effects(problem)),
        "fem": _elements(problem),
    }


def _materials(problem: Problem) -> dict[str, Any]:
    """Sections of materials other than that of the first block, with their blocks."""
    of = problem.materials
    return {
        f"material-{number}": asdict(material)
        | {"blocks": [k for k, own in enumerate(of) if own == material]}
        for number, material in enumerate(dict.fromkeys(of), start=1)
        if material != of[0]
    }


def _load(problem: Problem) -> dict[str, Any]:
    case = problem.load_case
    (load,) = case.faces[:1] or (None,)
    result: dict[str, Any] = {"case": case.name, "pressure": getattr(load, "pressure", 0.0)}
    if case.name in ("beam", "shaft") and load is not None:
        result["layer"] = int(problem.blocks.layer[load.blocks].max())
    return result | ({"as_printed": True} if case.without_couple else {})


def _law(law: object) -> dict[str, Any]:
    """Keys of a contact law."""
    name = next((name for name, kind in LAWS.items() if type(law) is kind), None)
    if name is None:
        raise InputError(
            f"problem: law: got a {type(law).__name__}, which no scene states; expected "
            f"{' or '.join(kind.__name__ for kind in LAWS.values())}"
        )
    kind = LAWS[name]
    given = {kind.keys.get(c.name, c.name): getattr(law, c.name) for c in fields(kind)}
    return {"law": name} | {key: value for key, value in given.items() if isfinite(value)}


def _contact(problem: Problem) -> dict[str, Any]:
    law, friction = problem.law, problem.coulomb
    pairs: dict[tuple[int, int], dict[str, Any]] = {}
    for a, b, value in () if friction is None else friction.of_pairs:
        pairs[min(a, b), max(a, b)] = {"friction": value}
    if isinstance(law, PairLaws):
        for a, b, own in law.of_pairs:
            pairs.setdefault((min(a, b), max(a, b)), {}).update(_law(own))
        law = law.default
    listed = [{"between": list(ends), **stated} for ends, stated in pairs.items()]
    gaps = {"clearance": problem.clearance, "spacing": problem.spacing}
    return {**_law(law), **gaps, **({"pairs": listed} if listed else {})}


def _effects(problem: Problem) -> Iterator[tuple[str, Any]]:
    if problem.coulomb is not None:
        constants = asdict(problem.coulomb)
        yield "friction", {key: constants[key] for key in ("coefficient", "stick_stiffness")}
    if problem.acceleration is not None:
        yield "gravity", problem.acceleration.tolist()
    for name in ("finite_sliding", "finite_rotation"):
        if getattr(problem, name):
            yield name, True
    if problem.frames is Frames.DEFORMABLE:
        yield "elastic_frame", True


def _elements(problem: Problem) -> dict[str, Any]:
    if problem.degree > 1:
        return {"degree": problem.degree}
    default = problem.element is ElementType.INCOMPATIBLE
    return {} if default else {"element": str(problem.element)}


def _differences(ours: Problem, theirs: Problem) -> Iterator[str]:
    """Parts in which two problems differ."""
    shapes = zip(ours.blocks.shapes, theirs.blocks.shapes, strict=True)
    if not all(np.array_equal(a.mesh.nodes, b.mesh.nodes) for a, b in shapes):
        yield "blocks"
    if not np.array_equal(ours.load_case.facet_forces, theirs.load_case.facet_forces):
        yield "load"
    for part in fields(Problem):
        if part.name in ("blocks", "load", "material", "friction", "gravity", "check_units"):
            continue
        if getattr(ours, part.name) != getattr(theirs, part.name):
            yield part.name
    if ours.materials != theirs.materials:
        yield "material"
    if ours.coulomb != theirs.coulomb:
        yield "friction"
