"""Solids as deformable blocks: hexahedra, joints that match or not, body loads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from fem.element.lagrange_mesh import with_degree
from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.files.hexahedral_solids import with_hexahedra
from geometry.loads import LoadCase
from validation.build.polyhedra import build_live_load, build_solids
from validation.build.supports import stated_load, supported_blocks
from validation.errors import InputError
from validation.scene.plausibility import check_block_size
from validation.scene.polyhedra import PolyhedralScene


def build_own_blocks(scene: PolyhedralScene, name: str) -> LoadCase:
    """Build the load on solids of a family or from files, with hexahedra."""
    if scene.contact.spacing > 0.0:
        raise InputError(
            f"{name}: contact.spacing: got {scene.contact.spacing:g} mm, but these blocks have no "
            "layers to move apart; expected contact.clearance, or places with gaps"
        )
    mesh = scene.mesh
    try:
        solids = replace(build_solids(scene, Path()), name=name)
        check_block_size(scene, solids)
        assembly = with_hexahedra(
            solids, mesh.divisions, mesh.size, lambda blocks: supported_blocks(scene, blocks)
        )
    except RefusedError as error:
        # What is wrong with the whole assembly begins with its name.
        line = str(error).removeprefix("own blocks: ").removeprefix(f"{name}: ")
        raise InputError(f"{name}: {line}") from None
    return own_load(scene, assembly)


def own_load(scene: PolyhedralScene, assembly: Assembly) -> LoadCase:
    """Variable loads on whole blocks; deformable blocks carry their weight node by node."""
    bodies = assembly
    if scene.fem.degree > 1:
        # Blocks of curved elements weigh what is within their curved faces.
        shapes = tuple(with_degree(shape, scene.fem.degree) for shape in assembly.shapes)
        bodies = replace(assembly, shapes=shapes)
    live = build_live_load(scene, bodies)
    wrenches = live if live.any() else None
    load = LoadCase(assembly, "variable load", (), assembly.fixed, body_wrenches=wrenches)
    return stated_load(scene, assembly, load)
