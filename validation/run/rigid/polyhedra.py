"""`tubelock mbd` for triangulated blocks: the rigid answer as data, text and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.facet_contact import CROSSING_EDGES, STANDING_CORNER
from mbd import Classification, block_wrenches, classify, contact_jacobian, generalized_force
from mbd.answer import certificate_report
from mbd.equilibrium import column_weights
from mbd.mechanism import Mechanism, MechanismClass, classify_opposed, judged
from mbd.push import PushLimit, at_rest
from validation.build.doubts import doubts
from validation.build.polyhedra import BodyLoads, build_body_loads, build_polyhedra
from validation.build.supports import stated_load
from validation.case import Case
from validation.run.rigid.answer import RigidAnswer, run_rigid
from validation.run.rigid.push import push_json, rigid_push
from validation.run.stages import stages, tell
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene


@dataclass(frozen=True, kw_only=True)
class PolyhedralRun(RigidAnswer):
    """The rigid answer to triangulated blocks."""

    scene: PolyhedralScene
    assembly: PolyhedralAssembly
    loads: BodyLoads
    faces: Classification | None = None
    """Class by the contacts that have an area alone, with its certificate; None where all have."""
    push: PushLimit | str | None = None
    """Limit of the force of `load.push`, by faces alone, or why there is none."""
    doubts: Mapping[str, str] = field(default_factory=dict)
    """What may be meant in another way, by the name of the row."""

    @cached_property
    def patch_pressures(self) -> FloatArray:
        """Mean pressure of each patch; zero where nothing holds; (n_patches,) [MPa]."""
        result, index = self.assembly.interfaces, self.result.contact_index
        return result.patch_pressures(index, self.carried.normal_forces)

    def _beside(self) -> dict[str, Any]:
        interfaces, faces = self.assembly.interfaces, None
        if self.faces is not None:
            certificate = certificate_report(self.faces)
            faces = {"mechanism": str(self.faces.mechanism), "certificate": certificate}
        return super()._beside() | {
            "interlocked": self.result.classification.locked,
            "largest_contact_force": self._largest(self.carried.normal_forces),
            "largest_patch_pressure": self._largest(self.patch_pressures),
            "n_patches": len(interfaces.patches.areas),
            "n_points_without_area": sum(self.bare_contacts.values()),
            "n_crossing_edges": self.bare_contacts[CROSSING_EDGES],
            "n_standing_corners": self.bare_contacts[STANDING_CORNER],
            "by_faces_alone": faces,
            "contact_area": float(interfaces.patches.areas.sum()),
            "tolerance": self.assembly.tolerance,
            **({"edges": STRAIGHT_EDGES} if self.straightened else {}),
            **({} if self.push is None else {"push_limit": push_json(self.scene, self.push)}),
            **self.doubts,
            **({"block_names": list(self.assembly.names)} if self.assembly.names else {}),
        }

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
        return float(values.max(initial=0.0)) if self.carried.shown else None


def run_polyhedra(file: Case, scene: PolyhedralScene) -> PolyhedralRun:
    """Build, check and analyse a scene of triangulated blocks."""
    with stages() as watch:
        tell("reads the blocks and finds where they touch")
        assembly = build_polyhedra(scene, file.folder)
        loads = build_body_loads(scene, assembly)
        stated = stated_load(scene, assembly, loads.load_case(assembly))
        load = at_rest(stated) if scene.push else stated
        if scene.loads:
            loads = replace(loads, live=block_wrenches(assembly, load) - loads.dead)
        watch.lap("build")
    run = PolyhedralRun.to(
        (loads.dead, loads.live),
        watch.seconds(),
        name=file.name,
        scene=scene,
        assembly=assembly,
        load=load,
        push=rigid_push(scene, assembly, stated),
        loads=loads,
        doubts=doubts(scene, assembly, file.folder, assembly),
    )
    if not sum(run.bare_contacts.values()):
        return run
    tell("class by faces alone")
    with stages() as watch:
        faces = class_by_faces(run)
        watch.lap("faces alone")
    spent, before = watch.seconds(), dict(run.cpu_seconds)
    total = before.pop("total") + spent.pop("total")
    seconds = before | spent | {"total": total}
    return replace(run, faces=faces, cpu_seconds=seconds)


def rigid_answer(file: Case) -> RigidAnswer:
    """Build, check and analyse rigid blocks of any kind."""
    if isinstance(file.scene, PolyhedralScene):
        return run_polyhedra(file, file.scene)
    return run_rigid(file)


def class_by_faces(run: PolyhedralRun) -> Classification:
    """Mechanism class where blocks press on each other's faces alone, all held blocks fixed.

    Edges that cross and corners that stand have no area: a chamfer removes them, and no finite
    pressure acts there. A motion that opens or leaves all contacts does so with fewer of them.
    """
    full = run.result.classification
    if full.mechanism is MechanismClass.ACTIVATED:
        return full
    bare = run.assembly.with_faces_alone()
    contacts = contact_jacobian(bare, supports=run.load.held)
    force = generalized_force(bare, run.load, contacts.free_blocks, contacts.length)
    if full.mechanism is MechanismClass.SUPPRESSED and isinstance(full.certificate, Mechanism):
        opposed = full.certificate.virtual_displacement.ravel()
        same = bool((run.load.fixed == bare.fixed).all())
        start = run.result.equilibrium.multiplier if same else None
        weights = column_weights(run.result.norm, contacts.areas) if same else None
        driven = judged(contacts.jacobian, force, weights=weights, start=start)
        return classify_opposed(contacts.jacobian, force, opposed, driven)
    return classify(contacts.jacobian, force)
