"""Rigid blocks of a case: what `mbd.analyse` takes."""

from __future__ import annotations

from geometry.assembly import AnyBlocks, Assembly
from geometry.loads import LoadCase
from mbd.analysis import RigidStatement, Stated
from validation.build.blocks import build_scene, build_weight
from validation.build.deformable import build_friction
from validation.build.materials import compressive_strength
from validation.build.polyhedra import build_live_load, build_polyhedra
from validation.build.supports import stated_load
from validation.case import Case
from validation.errors import named
from validation.scene.family import AssemblyScene
from validation.scene.polyhedra import PolyhedralScene


def rigid_statement(case: Case, known: Assembly | None = None) -> RigidStatement:
    """Build the blocks of a case, on the contacts of rigid ones, and what acts on them.

    ``known`` are hexahedral blocks that are built already.
    """
    scene = case.scene
    blocks: AnyBlocks
    with named(case.name):
        if isinstance(scene, PolyhedralScene):
            blocks = build_polyhedra(scene, case.folder)
            live = build_live_load(scene, blocks)
            load = LoadCase(blocks, "variable load", (), blocks.fixed, body_wrenches=live)
            load = stated_load(scene, blocks, load)
        elif known is not None and isinstance(scene, AssemblyScene):
            blocks, load = known, stated_load(scene, known, scene.build_load(known))
        else:
            built = build_scene(case)
            blocks, load = built.assembly, built.load
        return Stated(
            rigid_blocks=blocks,
            rigid_load=load,
            rigid_weight=build_weight(scene, blocks),
            coulomb=build_friction(scene, blocks, sliding=False),
            interference=max(0.0, -scene.contact.clearance),
            compressive_strength=compressive_strength(scene),
        )
