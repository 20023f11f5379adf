"""From scenes of triangulated blocks to checked assemblies and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from fem.element.lagrange import with_degree
from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.files.block_files import diagnosed_blocks, read_blocks
from geometry.files.hexahedral_solids import with_hexahedra
from geometry.files.named_surfaces import Y_UP
from geometry.files.readers import left_out
from geometry.loads import LoadCase
from geometry.mesh import BoolArray, FloatArray
from geometry.parts.block_selection import numbers_of
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polyhedron import Polyhedron
from validation.build.materials import body_forces
from validation.build.supports import stated_load, supported_blocks
from validation.errors import InputError, keyed, named
from validation.scene.families.mesh import MeshScene, PartSection, PlaceSection
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import check_block_size

Shape = TypeVar("Shape")


#: Places are turned by at most this, ten turns [°].
LARGEST_ANGLE = 3600.0


def build_polyhedra(scene: PolyhedralScene) -> PolyhedralAssembly:
    """Build and check the blocks of a scene."""
    assembly = build_solids(scene)
    check_block_size(scene, assembly)
    check_assembly(assembly, supported_blocks(scene, assembly))
    return assembly


def build_solids(scene: PolyhedralScene) -> PolyhedralAssembly:
    """Build the blocks of a scene, whose contacts are not checked."""
    detection = scene.detection.options
    if isinstance(scene, MeshScene):
        return _from_files(scene, detection)
    with keyed(scene.keys):
        return scene.stated.build(detection)


def motion(place: PlaceSection) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) [mm] of a place."""
    axis = np.array(place.axis)
    size = float(np.abs(axis).max())
    if size == 0.0:
        raise AssemblyError("parts.places.axis: got [0, 0, 0], expected a direction")
    if not abs(place.angle) <= LARGEST_ANGLE:
        raise AssemblyError(
            f"parts.places.angle: got {place.angle:g}, expected degrees between "
            f"-{LARGEST_ANGLE:g} and {LARGEST_ANGLE:g}"
        )
    axis = axis / size  # first: the square of a component may be no float
    turn = Rotation.from_rotvec(np.radians(place.angle) * axis / np.linalg.norm(axis)).as_matrix()
    return np.asarray(turn, dtype=np.float64), np.array(place.at)


def _from_files(scene: MeshScene, detection: DetectionOptions) -> PolyhedralAssembly:
    placed = placed_solids(scene, [file_solids(scene, part) for part in scene.parts])
    assembly = polyhedral_assembly(
        "own blocks",
        placed.blocks,
        placed.fixed,
        detection,
        placed.names,
        supported=bool(scene.supports),
    )
    return replace(assembly, parts=placed.parts)


@dataclass(frozen=True)
class PlacedSolids:
    """Blocks of a scene as its parts place them."""

    blocks: list[tuple[Polyhedron, FloatArray, FloatArray]]
    """Shape, rotation (3, 3) and translation (3,) [mm]."""
    fixed: BoolArray
    """(n_blocks,)"""
    names: tuple[str, ...]
    """Of each block; none where no file names one."""
    parts: tuple[int, ...]
    """Number of the part of each block."""


def placed_solids(scene: MeshScene, solids: Sequence[Sequence[Polyhedron]]) -> PlacedSolids:
    """Place the solids of each part."""
    blocks: list[tuple[Polyhedron, FloatArray, FloatArray]] = []
    held: list[bool] = []
    parts: list[int] = []
    upright = Y_UP if scene.block.up == "y" else np.eye(3)
    for number, (part, of_part) in enumerate(zip(scene.parts, solids, strict=True)):
        for place in part.places:
            turn, shift = motion(place)
            blocks += [(solid, turn @ upright, shift) for solid in of_part]
            held += [part.fixed or place.fixed or solid.held for solid in of_part]
            parts += [number] * len(of_part)
    names, fixed = tuple(solid.given_name for solid, _, _ in blocks), np.array(held, dtype=np.bool_)
    for one in scene.assembly.fixed:
        fixed[numbers_of("assembly.fixed", one, names)] = True
    return PlacedSolids(blocks, fixed, names if any(names) else (), tuple(parts))


def file_solids(scene: MeshScene, part: PartSection) -> list[Polyhedron]:
    """Solids of one of the files of a scene."""
    block = scene.block
    return read_blocks(
        Path(part.file),
        units=block.units,
        element_size=block.element_size,
        repair=block.repair,
        leave_out=part.leave_out,
    )


def parts_left_out(scene: MeshScene) -> list[str]:
    """Solids and objects of the files of a scene that are no blocks."""
    out = [f"{Path(part.file).name}: {one}" for part in scene.parts for one in part.leave_out]
    for file in dict.fromkeys(part.file for part in scene.parts):
        out += [f"{Path(file).name}: {one}" for one in left_out(Path(file))]
    return out


@dataclass(frozen=True)
class FileBlocks:
    """Blocks of files, whether or not they can be analysed."""

    placed: PlacedSolids
    faults: list[list[str]]
    """What keeps each block from being analysed."""
    left_out: list[str]
    """Objects of the files that are no blocks."""
    units: str = "mm"
    """Of the files."""
    detection: DetectionOptions = field(default_factory=DetectionOptions)


def file_blocks(scene: MeshScene) -> FileBlocks:
    """Read and place the blocks of a scene of files, those with faults too."""
    section, solids = scene.block, []
    faults: dict[int, list[str]] = {}
    for part in scene.parts:
        result = diagnosed_blocks(
            Path(part.file),
            units=section.units,
            element_size=section.element_size,
            repair=section.repair,
        )
        names = [block.given_name for block, _ in result]
        no_block = {k for one in part.leave_out for k in numbers_of("parts.leave_out", one, names)}
        kept = [one for k, one in enumerate(result) if k not in no_block]
        solids.append([block for block, _ in kept])
        faults |= {id(block): of_block for block, of_block in kept}
    placed = placed_solids(scene, solids)
    of_blocks = [faults[id(block)] for block, _, _ in placed.blocks]
    options = scene.detection.options
    return FileBlocks(placed, of_blocks, parts_left_out(scene), section.units, options)


def build_own_blocks(scene: PolyhedralScene, name: str) -> LoadCase:
    """Build the load on solids of a family or from files, with hexahedra."""
    if scene.contact.spacing > 0.0:
        raise InputError(
            f"{name}: contact.spacing: got {scene.contact.spacing:g} mm, but these blocks have no "
            "layers to move apart; expected contact.clearance, or places with gaps"
        )
    mesh = scene.mesh
    try:
        solids = replace(build_solids(scene), name=name)
        check_block_size(scene, solids)
        assembly = with_hexahedra(
            solids, mesh.divisions, mesh.size, lambda blocks: supported_blocks(scene, blocks)
        )
    except RefusedError as error:
        # What is wrong with the whole assembly begins with its name.
        line = str(error).removeprefix("own blocks: ").removeprefix(f"{name}: ")
        with named(name):
            raise RefusedError(line) from None
    return own_load(scene, assembly)


def own_load(scene: PolyhedralScene, assembly: Assembly) -> LoadCase:
    """Variable loads on whole blocks; deformable blocks carry their weight node by node."""
    bodies = assembly
    if scene.fem.degree > 1:
        # Blocks of curved elements weigh what is within their curved faces.
        shapes = tuple(with_degree(shape, scene.fem.degree) for shape in assembly.shapes)
        bodies = replace(assembly, shapes=shapes)
    live = body_forces(scene, bodies, scene.load.acceleration)
    wrenches = live if live.any() else None
    load = LoadCase(assembly, "variable load", (), assembly.fixed, body_wrenches=wrenches)
    return stated_load(scene, assembly, load)
