"""The rigid answer: what all scenes have in common, and that to blocks with hexahedra."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.spatial  # noqa: F401 - what matches facets, loaded before the clock runs

from geometry.assembly import AnyBlocks, Assembly
from geometry.loads import LoadCase, with_body_wrenches
from geometry.measures import JointResultants, joint_resultants
from geometry.mesh import FloatArray
from mbd import (
    Measures,
    Mechanism,
    RigidResult,
    block_measures,
    block_wrenches,
    measures,
    rigid_result,
)
from mbd.answer import certificate_report, placed_motion
from mbd.margin import held_against
from validation.build.blocks import BuiltScene, build_scene, build_weight
from validation.run.rigid.first_rows import (
    joint_extremes,
    largest_facet_pressure,
    ring_pressure,
    total_reaction,
)
from validation.run.rigid.further import (
    Further,
    further_answers,
    further_json,
)
from validation.scene.family import AssemblyScene, RoundScene
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import DeformableScene, SceneFile

#: Units of numbers in JSON.
UNITS = {
    "length": "mm",
    "force": "N",
    "moment": "N mm",
    "pressure": "MPa",
    "rotation": "rad",
    "mechanism": "rows of the free blocks: displacement (3), rotation in rad times rotation_length "
    "in mm (3), to any scale",
}


@dataclass(frozen=True)
class Carried:
    """The contact forces of the answer that was asked for: with friction, if it was asked."""

    holds: bool
    """Whether they balance the load."""
    forces: FloatArray
    """On block s of each contact, zero where nothing holds; (n_contacts, 3) [N]."""
    words: str
    """The answer as a headline says it."""
    mechanism: FloatArray | None
    """What the load drives, (n_rows,), where it is not carried."""

    def normal_forces(self, normals: FloatArray) -> FloatArray:
        """Part along the normals of the contacts, (n_contacts,) [N]."""
        return np.maximum(np.einsum("ni,ni->n", self.forces, normals), 0.0)


@dataclass(frozen=True, kw_only=True)
class RigidAnswer(ABC):
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
        result = rigid_result(assembly, load, norm=scene.rigid.norm, solver=scene.rigid.solver)
        further = further_answers(assembly, load.fixed, wrenches, scene.rigid)
        seconds = {"build": 0.0} | result.cpu_seconds | built
        seconds["total"] += result.cpu_seconds["total"]
        if further is not None:
            seconds["friction and limits"] = further.cpu_seconds
            seconds["total"] += further.cpu_seconds
        return cls(result=result, further=further, cpu_seconds=seconds, **stated)

    @cached_property
    def carried(self) -> Carried:
        """Contact forces of the answer that was asked for."""
        result, further, normals = self.result, self.further, self._normals
        if further is None or further.friction is None:
            holds = result.equilibrium.holds
            forces = result.contact_forces[:, None] * normals * holds
            return Carried(holds, forces, str(result.mechanism), result.equilibrium.mechanism)
        asked = further.friction
        verdict = "carried" if asked.holds else "not carried"
        if not asked.holds and asked.mechanism is None:
            verdict = "undecided"
        words = f"{verdict} with friction μ = {self.scene.rigid.friction:g}"
        if asked.holds:
            words += f" (without: {result.mechanism})"
        given = further.friction_forces
        forces = np.zeros_like(normals) if given is None else given
        return Carried(asked.holds, forces, words, asked.mechanism)

    @property
    def normal_forces(self) -> FloatArray:
        """Normal part of those forces, (n_contacts,) [N]."""
        return self.carried.normal_forces(self._normals)

    @property
    def _normals(self) -> FloatArray:
        normals: FloatArray = self.assembly.interfaces.normals[self.result.contact_index]
        return normals

    @cached_property
    def held(self) -> dict[str, bool] | None:
        """Which pushes beside the load are held; None where the class or friction says it all."""
        asked = self.further is not None and self.further.friction is not None
        if asked or self.result.supported_classification.locked:
            return None
        return held_against(self.assembly, self.load) if self.result.equilibrium.holds else None

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the forces between each two blocks."""
        return joint_resultants(
            self.assembly.interfaces, self.result.contact_index, self.carried.forces
        )

    @property
    @abstractmethod
    def largest_pressure(self) -> dict[str, Any] | None:
        """Largest mean pressure over one facet or flat patch; None where none has an area."""

    @cached_property
    def first_measures(self) -> dict[str, dict[str, Any]]:
        """What acts at one place, by name (`validation.run.rigid.first_rows`).

        Nothing where no forces hold the load.
        """
        if not self.carried.holds:
            return {}
        index = self.result.contact_index
        reaction = total_reaction(self.assembly, index, self.carried.forces, self.load.fixed)
        peak = self.largest_pressure
        found = {} if peak is None else {"p_max_facet": peak}
        return found | joint_extremes(self.joints) | {"total_reaction": reaction}

    @cached_property
    def motion(self) -> FloatArray | None:
        """(δt [mm], δθ [rad]) of each block under the certified mechanism, (n_blocks, 6).

        None if locked, or where friction was asked for and holds the blocks. Prefers the mechanism
        that the load drives; blocks held by the certificate's supports stay.
        """
        driven = self.carried.mechanism
        if self.carried.holds and self.scene.rigid.friction is not None:
            return None
        certificate = self.result.classification.certificate
        if driven is not None:
            return placed_motion(self.assembly, driven, ~self.load.fixed)
        if isinstance(certificate, Mechanism):
            motion = certificate.virtual_displacement
            return placed_motion(self.assembly, motion, ~self.assembly.fixed)
        return None

    def json(self) -> dict[str, Any]:
        """Return the answer as plain data, numbers in full precision."""
        result = self.result
        return {
            "scene": self.name,
            "mechanism": str(result.mechanism),
            "certificate": certificate_report(result.classification),
            "equilibrium": {
                "holds": result.equilibrium.holds,
                "residual": result.equilibrium.residual,
                "iterations": result.equilibrium.iterations,
                "status": result.equilibrium.status,
            },
            "held_against": self.held,
            "answer": self.carried.words,
            "carried": self.carried.holds,
            "measures": self.first_measures or None,
            "joints": self.joints.as_json() if self.carried.holds else [],
            "units": UNITS,
            "rotation_length": self.assembly.characteristic_length,
            "free_blocks": np.flatnonzero(~self.load.fixed).tolist(),
            "n_blocks": result.n_blocks,
            "n_contacts": result.n_contacts,
            **further_json(self.further),
            "cpu_seconds": self.cpu_seconds,
        }


# ---------------------------------------------------------------------------------------------
# Blocks with hexahedra


@dataclass(frozen=True, kw_only=True)
class RigidRun(RigidAnswer):
    """The rigid answer to blocks with hexahedra."""

    scene: DeformableScene
    assembly: Assembly

    @cached_property
    def contact_pressures(self) -> FloatArray:
        """Pressures of that answer, (n_contacts,) [MPa]."""
        return self.normal_forces / self.assembly.interfaces.areas[self.result.contact_index]

    @property
    def largest_pressure(self) -> dict[str, Any] | None:
        """Largest mean pressure over a facet, and where; None without contacts."""
        tube = isinstance(self.scene, RoundScene)
        index = self.result.contact_index
        return largest_facet_pressure(self.assembly, index, self.contact_pressures, tube=tube)

    @cached_property
    def measures(self) -> Measures | None:
        """The paper's measures of those pressures; None where nothing holds."""
        if self.further is None or self.further.friction is None:
            return self.result.measures
        if not self.carried.holds:
            return None
        index, found = self.result.contact_index, self.assembly.interfaces
        measured = self.result.measured_blocks
        of_blocks = block_measures(
            measured,
            found.block_m[index],
            found.block_s[index],
            self.contact_pressures,
            found.areas[index],
        )
        eligible, areas = self.assembly.eligible_facets(), self.assembly.eligible_areas()
        return measures(of_blocks, eligible[measured], areas[measured])

    def json(self) -> dict[str, Any]:
        """Return the answer as plain data, numbers in full precision."""
        found = None
        if self.measures is not None:
            found = self.first_measures | asdict(self.measures)
        return super().json() | {
            "mechanism_as_supported": str(self.result.supported_classification.mechanism),
            "measures": found,
            "ring_pressure": ring_pressure(self.scene),
        }


def run_rigid(file: SceneFile) -> RigidRun:
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


def mechanism_displacements(run: RigidRun) -> FloatArray | None:
    """First-order motion of every block's nodes, `RigidAnswer.motion`.

    Returns
    -------
    FloatArray | None
        Displacements of the nodes of `assembly_mesh`, largest 1, (n_nodes, 3); None without motion.
    """
    moving, assembly = run.motion, run.assembly
    if moving is None:
        return None
    arms = (assembly.nodes(b) - assembly.centroids[b] for b in range(assembly.n_blocks))
    parts = [m[:3] + np.cross(m[3:], arm) for m, arm in zip(moving, arms, strict=True)]
    displacement = np.concatenate(parts)
    largest = float(np.linalg.norm(displacement, axis=1).max())
    return displacement / largest


@dataclass
class SharedTubes:
    """Tubes built so far, by what their blocks are."""

    _built: dict[str, BuiltScene] = field(default_factory=dict)

    def run(self, file: SceneFile) -> RigidRun:
        """Build the blocks of a scene, unless another scene has the same, and rigid_result them.

        The CPU time of building is that of the first of them: what the scene alone would take.

        Raises
        ------
        InputError
            When it describes nothing that can be built.
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
        load = scene.build_load(known.assembly)
        return analyse_rigid(replace(known, name=file.name, scene=scene, load=load))
