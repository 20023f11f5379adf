"""`tubelock mbd`: the rigid-block answer to a scene, as data, files and text."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.spatial  # noqa: F401 - what matches facets, loaded before the clock runs

from geometry.assembly import Assembly
from geometry.files.mesh_io import assembly_mesh, interface_surface, write_hex_mesh, write_surface
from geometry.loads import with_body_wrenches
from geometry.mesh import FloatArray
from mbd import Measures, analyse, block_measures, block_wrenches, measures
from validation.build.blocks import BuiltScene, build_scene, build_weight
from validation.run.rigid.answer import RigidAnswer, spent
from validation.run.rigid.further import further_answers
from validation.scene.read import DeformableScene, SceneFile


@dataclass(frozen=True, kw_only=True)
class RigidRun(RigidAnswer):
    """The rigid answer to blocks with hexahedra."""

    scene: DeformableScene
    assembly: Assembly

    @cached_property
    def contact_pressures(self) -> FloatArray:
        """Pressures of that answer, (n_contacts,) [MPa]."""
        return self.normal_forces / self.assembly.interfaces.areas[self.result.contact_index]

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
        found = None if self.measures is None else dataclasses.asdict(self.measures)
        supported = self.result.supported_classification.mechanism
        return super().json() | {"mechanism_as_supported": str(supported), "measures": found}


def run_rigid(file: SceneFile) -> RigidRun:
    """Build and analyse a scene."""
    return analyse_rigid(build_scene(file))


def analyse_rigid(built: BuiltScene) -> RigidRun:
    """Analyse a built scene."""
    scene, assembly = built.scene, built.assembly
    live = block_wrenches(assembly, built.load)
    weight = build_weight(scene, assembly)
    load = built.load if weight is None else with_body_wrenches(built.load, weight)
    result = analyse(assembly, load, norm=scene.rigid.norm, solver=scene.rigid.solver)
    dead = np.zeros_like(live) if weight is None else weight
    further = further_answers(assembly, load.fixed, (dead, live), scene.rigid)
    building = {"build": built.cpu_seconds, "total": built.cpu_seconds}
    return RigidRun(
        name=built.name,
        scene=scene,
        assembly=assembly,
        load=load,
        result=result,
        further=further,
        cpu_seconds=spent(building, result, further),
    )


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


def write_mechanism(run: RigidRun, path: Path) -> None:
    """Write all blocks with the mechanism's first-order displacement as `.vtu`."""
    displacement = mechanism_displacements(run)
    if displacement is None:
        raise ValueError("a locked assembly has no mechanism to write")
    mesh, owner = assembly_mesh(run.assembly)
    write_hex_mesh(
        path,
        mesh,
        point_data={"mechanism": displacement},
        cell_data={
            "block": owner.astype(np.int32),
            "layer": run.assembly.layer[owner].astype(np.int32),
        },
    )


def write_pressures(run: RigidRun, path: Path) -> None:
    """Write the contact facets with pressures, forces, normals and blocks as `.vtu`."""
    index = run.result.contact_index
    interfaces = run.assembly.interfaces
    write_surface(
        path,
        interface_surface(run.assembly, index),
        {
            "contact_pressure": run.contact_pressures,
            "contact_force": run.contact_pressures * interfaces.areas[index],
            "traction": run.carried.forces / interfaces.areas[index, None],
            "area": interfaces.areas[index],
            "normal": interfaces.normals[index],
            "block_m": interfaces.block_m[index].astype(np.int32),
            "block_s": interfaces.block_s[index].astype(np.int32),
            "layer_m": run.assembly.layer[interfaces.block_m[index]].astype(np.int32),
            "layer_s": run.assembly.layer[interfaces.block_s[index]].astype(np.int32),
        },
    )
