"""The rigid answer: what all scenes have in common, and that to blocks with hexahedra."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.spatial  # noqa: F401 - what matches facets, loaded before the clock runs

from geometry.answer import Answer, Measure
from geometry.assembly import AnyBlocks, Assembly
from geometry.loads import LoadCase, with_body_wrenches
from geometry.measures import JointResultants, SectionForces, facet_measures
from geometry.mesh import FloatArray
from mbd import RigidResult, block_wrenches, rigid_result
from mbd.answer import Carried, answer_of, without_friction
from mbd.margin import held_against, held_by_load
from validation.build.blocks import BuiltScene, build_scene, build_weight
from validation.build.materials import compressive_strength
from validation.build.pairs import friction_of_pairs, stated_pairs
from validation.build.sections import scene_planes
from validation.build.supports import stated_load
from validation.case import Case
from validation.errors import named
from validation.run.rigid.further import Further, further_answers, further_json
from validation.run.stages import tell
from validation.scene.family import AssemblyScene, RoundScene
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import DeformableScene

#: Load cases that put the ring of a tube under pressure: the loaded face, and what the ring gets.
_RINGS = {"pipe": ("inner", "tension"), "tunnel": ("outer", "compression")}
_OPPOSITE = {"tension": "compression", "compression": "tension"}


@dataclass(frozen=True, kw_only=True)
class RigidAnswer:
    """A scene, what was built from it, and the rigid-block result."""

    name: str
    scene: AssemblyScene | PolyhedralScene
    assembly: AnyBlocks
    load: LoadCase
    result: RigidResult
    further: Further | None
    """Friction, collapse load, margin, where the scene asks for them."""
    cpu_seconds: dict[str, float]
    """CPU time of each stage, building and checks included [s]."""
    weighs_alone: bool = False
    """Whether the load is weight and nothing else."""

    @classmethod
    def to(
        cls,
        wrenches: tuple[FloatArray, FloatArray],
        built: dict[str, float],
        **stated: Any,
    ) -> Self:
        """Answer what is stated, its name, scene, assembly and load and more.

        Wrenches are dead and live load of each block, (n_blocks, 6); ``built`` is the CPU time of
        building them [s].
        """
        scene, assembly, load = (stated[name] for name in ("scene", "assembly", "load"))
        tell(f"{int((~load.fixed).sum())} free blocks: equilibrium and mechanisms")
        result = rigid_result(assembly, load, norm=scene.rigid.norm, solver=scene.rigid.solver)
        with named(stated["name"]):
            rubbing = scene.rigid.friction is not None
            of_pairs = friction_of_pairs(scene, assembly) if rubbing else ()
        further = further_answers(
            assembly,
            load,
            wrenches,
            scene.rigid,
            of_pairs,
            frictionless=result.equilibrium.holds,
        )
        seconds = {"build": 0.0} | result.cpu_seconds | built
        seconds["total"] += result.cpu_seconds["total"]
        if further is not None:
            if further.squeeze is not None and further.squeeze.needed:
                gap = scene.contact.clearance
                further = replace(further, interference=max(0.0, -gap))
            seconds["friction and limits"] = further.cpu_seconds
            seconds["total"] += further.cpu_seconds
        alone = bool(np.any(wrenches[0])) and not np.any(wrenches[1])
        run = cls(result=result, further=further, cpu_seconds=seconds, weighs_alone=alone, **stated)
        _ = run.sections  # what it reads of the scene
        return run

    @cached_property
    def carried(self) -> Carried:
        """Contact forces of the answer that was asked for: with friction, if it was asked."""
        result, further = self.result, self.further
        if further is None or further.friction is None:
            return without_friction(self.assembly, result)
        requested, coefficient = further.friction, self.scene.rigid.friction
        index, found = result.contact_index, self.assembly.interfaces
        given = further.friction_forces
        forces = np.zeros((len(index), 3)) if given is None else given
        normal = np.maximum(np.einsum("ni,ni->n", forces, found.normals[index]), 0.0)
        others = ", others between pairs" if stated_pairs(self.scene) else ""
        words = further.friction_words(self.assembly.named, f"μ = {coefficient:g}{others}")
        measured = None
        if requested.holds:
            words += f" (without: {result.mechanism})"
        if requested.holds and not further.held_by_squeeze and normal.any():
            measured = facet_measures(self.assembly, index, normal / found.areas[index])[1]
        return Carried(
            holds=requested.holds,
            forces=forces,
            normal_forces=normal,
            measures=measured,
            words=words,
            mechanism=requested.mechanism,
            friction=coefficient,
            by_load=not further.held_by_squeeze,
            counted=further.counted,
        )

    @cached_property
    def answer(self) -> Answer:
        """The answer that does not depend on the scene; its report says more of it."""
        result = answer_of(
            self.assembly, self.load, self.result, carried=self.carried, beside=self._beside
        )
        return replace(result, measures={**result.measures, **self._crushing(result)})

    def _crushing(self, found: Answer) -> dict[str, Measure]:
        """Factor of all loads at which the largest mean pressure of a facet is the strength.

        Rigid contact forces are proportional to the loads. Nothing without a strength.
        """
        with named(self.name):
            strength = compressive_strength(self.scene)
        peak = found.measures.get("p_max_facet")
        if strength is None or peak is None or peak.place is None or not peak.value > 0.0:
            return {}
        place = {**peak.place, "stress": "p_max_facet"}
        return {"crushing_factor": Measure(strength / peak.value, "times the load", place=place)}

    def _beside(self) -> dict[str, Any]:
        """What the report says of the scene and of what it asks further."""
        return {
            "scene": self.name,
            "load": self.scene.load_words,
            "held_against": self.held,
            "held_by_load": list(self.held_by_load),
            **({} if self.sections is None else {"sections": self.sections.as_json()}),
            **further_json(self.further),
            "cpu_seconds": self.cpu_seconds,
        }

    @cached_property
    def sections(self) -> SectionForces | None:
        """Forces through the planes of the scene; None where it has none, or nothing is carried."""
        with named(self.name):
            cut = scene_planes(self.scene, self.assembly)
            if cut is None or not self.carried.shown or self.answer.cut is None:
                return None
            return self.answer.cut(cut)

    @cached_property
    def held(self) -> dict[str, bool] | None:
        """Which pushes beside the load are held; None where the class or friction says it all."""
        requested = self.further is not None and self.further.friction is not None
        if requested or self.result.supported_classification.locked:
            return None
        balance = self.result.equilibrium
        if not balance.holds:
            return None
        return held_against(self.assembly, self.load, self.result.norm, balance)

    @cached_property
    def held_by_load(self) -> tuple[str, ...]:
        """Pushes of `held` that nothing but the load resists."""
        return () if self.held is None else held_by_load(self.assembly, self.load, self.held)

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the forces between each two blocks."""
        return self.carried.joints(self.assembly, self.result.contact_index)


# ---------------------------------------------------------------------------------------------
# Blocks with hexahedra


@dataclass(frozen=True, kw_only=True)
class RigidRun(RigidAnswer):
    """The rigid answer to blocks with hexahedra."""

    scene: DeformableScene
    assembly: Assembly

    def _beside(self) -> dict[str, Any]:
        return super()._beside() | {"ring_pressure": ring_pressure(self.scene)}


def ring_pressure(scene: object) -> dict[str, Any] | None:
    """Mean hoop stress p·r/t of a closed ring, by hand; None but for tubes under pressure."""
    if not isinstance(scene, RoundScene) or scene.load.case not in _RINGS:
        return None
    face, sense = _RINGS[scene.load.case]
    pressure, thickness = scene.load.pressure, scene.thickness
    radius = float(scene.block.inner_radius)  # type: ignore[attr-defined]
    radius += thickness * (face == "outer")
    return {
        "value": abs(pressure) * radius / thickness,
        "unit": "MPa",
        "radius": radius,
        "sense": sense if pressure >= 0.0 else _OPPOSITE[sense],
    }


def run_rigid(file: Case) -> RigidRun:
    """Build and rigid_result a scene."""
    return analyse_rigid(build_scene(file))


def analyse_rigid(built: BuiltScene) -> RigidRun:
    """Analyse a built scene."""
    scene, assembly = built.scene, built.assembly
    live = block_wrenches(assembly, built.load)
    weight = build_weight(scene, assembly)
    load = built.load if weight is None else with_body_wrenches(built.load, weight)
    dead = np.zeros_like(live) if weight is None else weight
    building = {"build": built.cpu_seconds, "total": built.cpu_seconds}
    stated = {"name": built.name, "scene": scene, "assembly": assembly, "load": load}
    return RigidRun.to((dead, live), building, **stated)


@dataclass
class SharedTubes:
    """Tubes built so far, by what their blocks are."""

    _built: dict[str, BuiltScene] = field(default_factory=dict)

    def run(self, file: Case) -> RigidRun:
        """Build the blocks of a scene, unless another scene has the same, and rigid_result them.

        The CPU time of building is that of the first of them: what the scene alone would take.
        """
        scene = file.scene
        if not isinstance(scene, RoundScene):
            return analyse_rigid(build_scene(file))
        sections = (scene.block, scene.assembly, scene.mesh)
        key = "\n".join(section.model_dump_json() for section in sections)
        if key not in self._built:
            built = build_scene(file)
            start = time.process_time()
            _ = built.assembly.interfaces  # found once and kept
            seconds = built.cpu_seconds + time.process_time() - start
            self._built[key] = replace(built, cpu_seconds=seconds)
        known = self._built[key]
        load = stated_load(scene, known.assembly, scene.build_load(known.assembly))
        return analyse_rigid(replace(known, name=file.name, scene=scene, load=load))
