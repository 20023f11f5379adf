"""`tubelock mbd` for triangulated blocks: the rigid answer as data, text and files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from geometry.measures import JointResultants, joint_resultants
from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.facet_contact import CROSSING_EDGES, STANDING_CORNER, ContactPolygons
from mbd import Classification, classify, contact_jacobian, generalized_force
from mbd.answer import certificate_report
from validation.build.own_blocks import refuse_two_weights
from validation.build.polyhedra import BodyLoads, build_body_loads, build_polyhedra
from validation.run.rigid.answer import RigidAnswer
from validation.run.rigid.first_rows import measure
from validation.run.stages import stages
from validation.scene.polyhedra import STRAIGHT_EDGES, BodyLoadSection, PolyhedralScene
from validation.scene.read import SceneFile


@dataclass(frozen=True, kw_only=True)
class PolyhedralRun(RigidAnswer):
    """The rigid answer to triangulated blocks."""

    scene: PolyhedralScene
    assembly: PolyhedralAssembly
    loads: BodyLoads
    faces: Classification | None = None
    """Class by the contacts that have an area alone, with its certificate; None where all have."""

    @property
    def patch_pressures(self) -> FloatArray:
        """Mean pressure of each patch; zero where nothing holds; (n_patches,) [MPa]."""
        return self._of_patches(self.normal_forces) / self.assembly.interfaces.patches.areas

    @property
    def patch_tractions(self) -> FloatArray:
        """Mean traction on block s of each patch, (n_patches, 3) [MPa]."""
        areas = self.assembly.interfaces.patches.areas
        return self._of_patches(self.carried.forces) / areas[:, None]

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the forces between each two blocks."""
        index, found = self.result.contact_index, self.assembly.interfaces
        pairs = np.unique(np.column_stack([found.block_m[index], found.block_s[index]]), axis=0)
        centroids = _joint_centroids(self.assembly, pairs)
        return joint_resultants(found, index, self.carried.forces, centroids)

    def json(self) -> dict[str, Any]:
        """Return the answer as plain data, numbers in full precision."""
        interfaces = self.assembly.interfaces
        faces = None
        if self.faces is not None:
            certificate = certificate_report(self.faces)
            faces = {"mechanism": str(self.faces.mechanism), "certificate": certificate}
        return super().json() | {
            "interlocked": self.result.classification.locked,
            "largest_contact_force": self._largest(self.normal_forces),
            "largest_patch_pressure": self._largest(self.patch_pressures),
            "n_patches": len(interfaces.patches.areas),
            "n_points_without_area": sum(self.bare_contacts.values()),
            "n_crossing_edges": self.bare_contacts[CROSSING_EDGES],
            "n_standing_corners": self.bare_contacts[STANDING_CORNER],
            "by_faces_alone": faces,
            "contact_area": float(interfaces.patches.areas.sum()),
            "tolerance": self.assembly.tolerance,
            **({"edges": STRAIGHT_EDGES} if self.straightened else {}),
        }

    @property
    def largest_pressure(self) -> dict[str, Any] | None:
        """Largest mean pressure of a patch, and where; None where none has an area."""
        patches = self.assembly.interfaces.patches
        if not len(patches.areas):
            return None
        worst = int(np.argmax(self.patch_pressures))
        place = {
            "blocks": [int(patches.block_m[worst]), int(patches.block_s[worst])],
            "layer": None,
            "face": None,
            "position": patch_centroids(self.assembly.interfaces.polygons)[worst].tolist(),
        }
        found = measure(float(self.patch_pressures[worst]), "MPa", place)
        return found | {"facet_area": float(patches.areas[worst])}

    @property
    def bare_contacts(self) -> dict[int, int]:
        """Number of contacts without area of each kind."""
        patch = self.assembly.interfaces.patch
        return {kind: int((patch == kind).sum()) for kind in (CROSSING_EDGES, STANDING_CORNER)}

    @property
    def straightened(self) -> bool:
        """Whether files have nodes between corners, which rigid blocks have no use for."""
        return any(shape.straightened for shape in self.assembly.shapes)

    def _largest(self, values: FloatArray) -> float | None:
        """Largest of some values, where forces hold the load; else there is none."""
        return float(values.max(initial=0.0)) if self.carried.holds else None

    def _of_patches(self, values: FloatArray) -> FloatArray:
        """Sum of what acts at the contacts of each patch."""
        interfaces = self.assembly.interfaces
        total = np.zeros((len(interfaces.patches.areas), *values.shape[1:]))
        patch = interfaces.patch[self.result.contact_index]
        flat = patch >= 0
        np.add.at(total, patch[flat], values[flat])
        return total


def _joint_centroids(assembly: PolyhedralAssembly, pairs: IntArray) -> FloatArray:
    """Centroid of the contact area of each pair of blocks, (n_pairs, 3) [mm].

    Pairs that only touch at points get the mean of those.
    """
    found, n = assembly.interfaces, assembly.n_blocks
    middles, areas, owner = polygon_centroids(found.polygons)
    keys = pairs[:, 0] * n + pairs[:, 1]
    patch = found.polygons.patch[owner]
    of_area = found.patches.block_m[patch] * n + found.patches.block_s[patch]
    bare = found.patch < 0
    of_point = (found.block_m * n + found.block_s)[bare]
    only = ~np.isin(of_point, of_area)
    key = np.concatenate([of_area, of_point[only]])
    points = np.concatenate([middles, found.centroids[bare][only]])
    weight = np.concatenate([areas, np.ones(int(only.sum()))])
    known = np.isin(key, keys)
    row = np.searchsorted(keys, key[known])
    total = np.zeros((len(keys), 3))
    np.add.at(total, row, weight[known, None] * points[known])
    return total / np.bincount(row, weights=weight[known], minlength=len(keys))[:, None]


def run_polyhedra(file: SceneFile, scene: PolyhedralScene) -> PolyhedralRun:
    """Build, check and analyse a scene of triangulated blocks.

    Raises
    ------
    InputError
        When it describes nothing that can be meant.
    """
    with stages() as watch:
        assembly = build_polyhedra(scene, file.folder)
        loads = build_body_loads(_body_load(file.name, scene), assembly)
        watch.lap("build")
    run = PolyhedralRun.to(
        (loads.dead, loads.live),
        watch.seconds(),
        name=file.name,
        scene=scene,
        assembly=assembly,
        load=loads.load_case(assembly),
        loads=loads,
    )
    if not sum(run.bare_contacts.values()):
        return run
    with stages() as watch:
        faces = class_by_faces(run)
        watch.lap("faces alone")
    spent, before = watch.seconds(), dict(run.cpu_seconds)
    total = before.pop("total") + spent.pop("total")
    seconds = before | spent | {"total": total}
    return replace(run, faces=faces, cpu_seconds=seconds)


def class_by_faces(run: PolyhedralRun) -> Classification:
    """Mechanism class where blocks press on each other's faces alone, all held blocks fixed.

    Edges that cross and corners that stand have no area: a chamfer removes them, and no finite
    pressure acts there.
    """
    bare = run.assembly.with_faces_alone()
    contacts = contact_jacobian(bare)
    force = generalized_force(bare, run.load, contacts.free_blocks, contacts.length)
    return classify(contacts.jacobian, force)


def _body_load(name: str, scene: PolyhedralScene) -> BodyLoadSection:
    """Loads on whole blocks; scenes may state the weight among the effects."""
    if scene.effects.gravity is None:
        return scene.load
    refuse_two_weights(scene, name)
    stated: dict[str, Any] = {"gravity": scene.effects.gravity}
    if "material" in scene.model_fields_set or "density" not in scene.load.model_fields_set:
        stated["density"] = scene.material.density
    return scene.load.changed(stated)


def polygon_centroids(polygons: ContactPolygons) -> tuple[FloatArray, FloatArray, IntArray]:
    """Centroid and area of each triangle of the contact polygons, and the polygon it is of."""
    triangles, owner = polygon_triangles(polygons)
    p = polygons.corners[triangles]
    areas = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    return p.mean(axis=1), areas, owner


def patch_centroids(polygons: ContactPolygons) -> FloatArray:
    """Centroid of each patch, (n_patches, 3) [mm]."""
    middles, areas, owner = polygon_centroids(polygons)
    patch = polygons.patch[owner]
    total = np.zeros((int(polygons.patch.max(initial=-1)) + 1, 3))
    np.add.at(total, patch, areas[:, None] * middles)
    return total / np.bincount(patch, weights=areas)[:, None]


def contact_triangles(run: PolyhedralRun) -> tuple[IntArray, IntArray]:
    """Contact polygons as fans: places of their corners, (n, 3), and the polygon of each, (n,)."""
    return polygon_triangles(run.assembly.interfaces.polygons)


def polygon_triangles(polygons: ContactPolygons) -> tuple[IntArray, IntArray]:
    """Contact polygons as fans: places of their corners, (n, 3), and the polygon of each, (n,)."""
    count = np.diff(polygons.start)
    fans, owner = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for k in range(1, int(count.max(initial=2)) - 1):
        has = np.flatnonzero(count > k + 1)
        first = polygons.start[:-1][has]
        fans.append(np.column_stack([first, first + k, first + k + 1]))
        owner.append(has)
    return np.concatenate(fans), np.concatenate(owner)


def mechanism_motion(run: PolyhedralRun) -> FloatArray | None:
    """`RigidAnswer.motion`, scaled: the farthest-moving centroid or corner moves by about 1."""
    moving, assembly = run.motion, run.assembly
    if moving is None:
        return None
    largest = max(
        float(np.linalg.norm(moving[b, :3] + np.cross(moving[b, 3:], arm), axis=1).max())
        for b in range(assembly.n_blocks)
        for arm in [assembly.points(b) - assembly.centroids[b]]
    )
    return moving / largest
