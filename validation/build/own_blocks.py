"""Solids as deformable blocks: hexahedra, joints that match or not, body loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fem.element.lagrange_mesh import with_degree
from geometry.assembly import Assembly, AssemblyError
from geometry.block import Block
from geometry.errors import RefusedError
from geometry.files.hexahedral_solids import file_blocks, solid_block
from geometry.loads import LoadCase
from geometry.polyhedra.assembly import (
    PolyhedralAssembly,
    as_polyhedral,
    contact_distance,
    unmatched_joints,
)
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polyhedron import Polyhedron
from validation.build.polyhedra import (
    build_live_load,
    build_polyhedra,
    file_solids,
    placed_blocks,
)
from validation.build.supports import stated_load, supported_blocks
from validation.errors import InputError
from validation.scene.plausibility import check_block_size
from validation.scene.polyhedra import MeshScene, PartSection, PolyhedralScene


def build_own_blocks(scene: PolyhedralScene, name: str) -> LoadCase:
    """Build the load on solids of a family or from files, with hexahedra."""
    if scene.contact.spacing > 0.0:
        raise InputError(
            f"{name}: contact.spacing: got {scene.contact.spacing:g} mm, but these blocks have no "
            "layers to move apart; expected contact.clearance, or places with gaps"
        )
    try:
        assembly = _assembly(scene, name)
        check_block_size(scene, assembly)
        surfaces = as_polyhedral(assembly, scene.detection.options)
        check_assembly(surfaces, supported_blocks(scene, assembly))
    except RefusedError as error:
        # What is wrong with the whole assembly begins with its name.
        raise InputError(f"{name}: {str(error).removeprefix(f'{name}: ')}") from None
    assembly = replace(assembly, layer=contact_distance(surfaces))
    unmatched = unmatched_joints(assembly, surfaces)
    return own_load(scene, replace(assembly, unmatched=unmatched))


def _assembly(scene: PolyhedralScene, name: str) -> Assembly:
    if not isinstance(scene, MeshScene):
        solids = build_polyhedra(scene, Path())
        mesh = scene.mesh
        return Assembly(
            name=name,
            shapes=tuple(solid_block(s, mesh.divisions, mesh.size) for s in solids.shapes),
            shape_of=solids.shape_of,
            rotations=solids.rotations,
            translations=solids.translations,
            layer=np.where(solids.fixed, 0, 1),
            fixed=solids.fixed,
            unmatched_allowed=True,
        )
    placed = placed_blocks(scene, lambda part: _part_blocks(part, scene))
    fixed = placed.fixed
    if fixed.all() or not (fixed.any() or scene.supports):
        raise AssemblyError(
            f"got {int(fixed.sum())} fixed blocks of {len(fixed)}; expected some fixed, some free, "
            "or [[supports]]"
        )
    blocks, turns, shifts = zip(*placed.blocks, strict=True)
    shapes = {id(block): block for block in blocks}
    number = {key: place for place, key in enumerate(shapes)}
    return Assembly(
        name=name,
        shapes=tuple(shapes.values()),
        shape_of=np.array([number[id(block)] for block in blocks], dtype=np.int64),
        rotations=np.array(turns),
        translations=np.array(shifts, dtype=np.float64),
        layer=np.where(fixed, 0, 1),
        fixed=fixed,
        names=placed.names,
        parts=placed.parts,
        unmatched_allowed=True,
    )


def _part_blocks(part: PartSection, scene: MeshScene) -> Sequence[tuple[Block, Polyhedron]]:
    units, mesh, path = scene.block.units, scene.mesh, Path(part.file)
    solids = file_solids(scene, part, Path())
    blocks = file_blocks(path, solids, units=units, divisions=mesh.divisions, size=mesh.size)
    return list(zip(blocks, solids, strict=True))


def bare_joints(surfaces: PolyhedralAssembly) -> list[tuple[int, int]]:
    """Pairs of blocks that touch along edges or at points alone."""
    result = surfaces.interfaces
    pairs = np.sort(np.column_stack([result.block_m, result.block_s]), axis=1)
    key = pairs[:, 0] * surfaces.n_blocks + pairs[:, 1]
    bare = np.unique(pairs[~np.isin(key, key[result.patch >= 0])], axis=0)
    return [(m, s) for m, s in bare.tolist()]


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
