"""`tubelock mbd` for triangulated blocks: the rigid answer as data, text and files."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.load_case import LoadCase
from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from mbd import Mechanism, RigidResult, analyse
from validation.build.own_blocks import refuse_two_weights
from validation.build.polyhedra import BodyLoads, build_body_loads, build_polyhedra
from validation.run.further import Further, further_answers, further_json
from validation.run.rigid import certificate_json
from validation.scene.polyhedra import BodyLoadSection, MeshScene, PolyhedralScene
from validation.scene.read import SceneFile


@dataclass(frozen=True)
class PolyhedralRun:
    """A scene of triangulated blocks and the rigid answer."""

    name: str
    scene: PolyhedralScene
    assembly: PolyhedralAssembly
    loads: BodyLoads
    load: LoadCase
    result: RigidResult
    further: Further | None
    cpu_seconds: dict[str, float]
    """CPU time of each stage, building and checks included [s]."""

    @property
    def patch_forces(self) -> FloatArray:
        """Sum of the contact forces of each patch, (n_patches,) [N]."""
        interfaces = self.assembly.interfaces
        total = np.zeros(len(interfaces.patches.areas))
        patch = interfaces.patch[self.result.contact_index]
        flat = patch >= 0
        np.add.at(total, patch[flat], self.result.contact_forces[flat])
        return total

    @property
    def patch_pressures(self) -> FloatArray:
        """Mean pressure of each patch, (n_patches,) [MPa]."""
        pressures: FloatArray = self.patch_forces / self.assembly.interfaces.patches.areas
        return pressures


def run_polyhedra(file: SceneFile, scene: PolyhedralScene) -> PolyhedralRun:
    """Build, check and analyse a scene of triangulated blocks.

    Raises
    ------
    InputError
        When it describes nothing that can be meant.
    """
    start = time.process_time()
    assembly = build_polyhedra(scene, file.folder)
    loads = build_body_loads(_body_load(file.name, scene), assembly)
    load = loads.load_case(assembly)
    built = time.process_time() - start
    result = analyse(assembly, load, norm=scene.rigid.norm, solver=scene.rigid.solver)
    further = further_answers(assembly, load.fixed, (loads.dead, loads.live), scene.rigid)
    seconds = {"build": built, **result.cpu_seconds}
    extra = 0.0
    if further is not None:
        seconds["further"] = extra = further.cpu_seconds
    seconds["total"] = built + result.cpu_seconds["total"] + extra
    return PolyhedralRun(file.name, scene, assembly, loads, load, result, further, seconds)


def _body_load(name: str, scene: PolyhedralScene) -> BodyLoadSection:
    """Loads on whole blocks; own blocks may state their weight among the effects."""
    if not isinstance(scene, MeshScene) or scene.effects.gravity is None:
        return scene.load
    refuse_two_weights(scene, name)
    stated: dict[str, Any] = {"gravity": scene.effects.gravity}
    if scene.material is not None:
        stated["density"] = scene.material.density
    return scene.load.model_copy(update=stated)


def polyhedra_json(run: PolyhedralRun) -> dict[str, Any]:
    """Return the result as plain data, numbers in full precision."""
    result, interfaces = run.result, run.assembly.interfaces
    return {
        "scene": run.name,
        "mechanism": str(result.mechanism),
        "interlocked": result.classification.locked,
        "certificate": certificate_json(result),
        "equilibrium": {
            "holds": result.equilibrium.holds,
            "residual": result.equilibrium.residual,
            "iterations": result.equilibrium.iterations,
            "status": result.equilibrium.status,
        },
        "largest_contact_force": float(result.contact_forces.max(initial=0.0)),
        "largest_patch_pressure": float(run.patch_pressures.max(initial=0.0)),
        "n_blocks": result.n_blocks,
        "n_contacts": result.n_contacts,
        "n_patches": len(interfaces.patches.areas),
        "n_points_without_area": int((interfaces.patch < 0).sum()),
        "contact_area": float(interfaces.patches.areas.sum()),
        "tolerance": run.assembly.tolerance,
        **further_json(run.further),
        "cpu_seconds": run.cpu_seconds,
    }


def contact_triangles(run: PolyhedralRun) -> tuple[IntArray, IntArray]:
    """Contact polygons as fans: places of their corners, (n, 3), and the polygon of each, (n,)."""
    polygons = run.assembly.interfaces.polygons
    count = np.diff(polygons.start)
    fans, owner = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for k in range(1, int(count.max(initial=2)) - 1):
        has = np.flatnonzero(count > k + 1)
        first = polygons.start[:-1][has]
        fans.append(np.column_stack([first, first + k, first + k + 1]))
        owner.append(has)
    return np.concatenate(fans), np.concatenate(owner)


def mechanism_motion(run: PolyhedralRun) -> FloatArray | None:
    """(δt, δθ) of each block under the certified mechanism, (n_blocks, 6); None if locked.

    Prefers the mechanism that the load drives. Scaled so that the farthest-moving centroid or
    block corner moves by about 1.
    """
    result, assembly = run.result, run.assembly
    certificate = result.classification.certificate
    motion = result.equilibrium.mechanism
    if motion is None and isinstance(certificate, Mechanism):
        motion = certificate.virtual_displacement.ravel()
    if motion is None:
        return None
    moving = np.zeros((assembly.n_blocks, 6))
    moving[~run.load.fixed] = motion.reshape(-1, 6)
    moving[:, 3:] /= assembly.characteristic_length
    largest = max(
        float(np.linalg.norm(moving[b, :3] + np.cross(moving[b, 3:], arm), axis=1).max())
        for b in range(assembly.n_blocks)
        for arm in [assembly.points(b) - assembly.centroids[b]]
    )
    return moving / largest
