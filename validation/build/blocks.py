"""From scenes to what the solvers take: assemblies and load cases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.families.box_column import ColumnBox, box_column, unmatched_joints
from geometry.families.brick_stack import brick_stack
from geometry.families.hexagon_block import HexagonBlockDivisions, HexagonBlockParameters
from geometry.families.planar_wall import WallBlock, osteomorphic_wall, planar_sine_wall
from geometry.families.sine_block import (
    BlockParameterError,
    SineBlockDivisions,
    SineBlockParameters,
)
from geometry.families.tube import hexagon_tube, sine_tube
from geometry.joints import UnmatchedJoint
from geometry.load_case import LoadCase, LoadCaseError, face_pressure, load_case
from geometry.mesh import FloatArray
from geometry.units import check_size
from validation.errors import InputError
from validation.scene.families import (
    BoxesScene,
    HexagonTubeScene,
    OsteomorphicScene,
    PlanarSineScene,
)
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import AssemblyScene, BrickScene, DeformableScene, Scene, TubeScene


@dataclass(frozen=True)
class HexahedralBlocks:
    """Blocks of a scene, every one with hexahedra, and their load."""

    assembly: Assembly
    load: LoadCase
    unmatched: tuple[UnmatchedJoint, ...]
    """Joints where facets do not match corner on corner."""


def require_matching(name: str, unmatched: tuple[UnmatchedJoint, ...], remedy: str) -> None:
    """Refuse joints that do not match.

    Raises
    ------
    InputError
        Naming the first one, and what to do.
    """
    if unmatched:
        more = len(unmatched) - 1
        others = f" (and {more} more joint{'s' if more > 1 else ''})" if more else ""
        raise InputError(f"{name}: {unmatched[0]}{others}; {remedy}")


def block_parameters(scene: TubeScene) -> SineBlockParameters:
    """Return the block of a tube scene.

    Raises
    ------
    InputError
        For parameters that describe no block.
    """
    try:
        return SineBlockParameters(**scene.block.model_dump(exclude={"type"}))
    except BlockParameterError as error:
        raise InputError(str(error)) from None


def require_assembly(scene: Scene, name: str, command: str) -> AssemblyScene:
    """Return the scene if its blocks meet each other.

    Raises
    ------
    InputError
        For a scene of a single box, or of triangulated blocks.
    """
    if isinstance(scene, AssemblyScene):
        return scene
    if isinstance(scene, PolyhedralScene):
        raise InputError(
            f"{name}: the blocks of type {scene.block.type!r} are triangulated surfaces without a "
            f"volume mesh: rigid only, use `tubelock mbd`; `tubelock {command}` needs hexahedra"
        )
    raise InputError(
        f"{name}: block.type {scene.block.type!r} is one deformable body without contacts; "
        f"`tubelock {command}` needs an assembly, such as tsb1-pipe"
    )


def build_assembly(scene: AssemblyScene) -> Assembly:
    """Build the blocks of a scene.

    Raises
    ------
    InputError
        When the parameters describe no assembly.
    """
    try:
        assembly = _blocks(scene)
        check_size(assembly)
        return assembly
    except RefusedError as error:
        raise InputError(str(error)) from None


def _blocks(scene: AssemblyScene) -> Assembly:
    if isinstance(scene, BrickScene):
        return brick_stack(
            scene.block.size,
            scene.mesh.divisions,
            columns=scene.assembly.columns,
            layers=scene.assembly.layers,
        )
    if isinstance(scene, BoxesScene):
        return box_column([ColumnBox(box.size, box.divisions) for box in scene.block.boxes])
    if isinstance(scene, HexagonTubeScene):
        return hexagon_tube(
            HexagonBlockParameters(**scene.block.model_dump(exclude={"type"})),
            HexagonBlockDivisions(**scene.mesh.model_dump()),
            scene.assembly.layers,
        )
    if isinstance(scene, PlanarSineScene | OsteomorphicScene):
        return _wall(scene)
    divisions = SineBlockDivisions(**scene.mesh.model_dump())
    return sine_tube(block_parameters(scene), divisions, scene.assembly.layers, scene.assembly.turn)


def _wall(scene: PlanarSineScene | OsteomorphicScene) -> Assembly:
    outline = WallBlock(
        scene.block.width, scene.block.thickness, scene.block.height, scene.block.amplitude
    )
    if isinstance(scene, OsteomorphicScene):
        return osteomorphic_wall(
            outline,
            scene.mesh.divisions,
            columns=scene.assembly.columns,
            layers=scene.assembly.layers,
        )
    return planar_sine_wall(
        outline,
        scene.block.frequency,
        scene.block.shift,
        scene.mesh.divisions,
        columns=scene.assembly.columns,
        layers=scene.assembly.layers,
    )


def build_load(scene: AssemblyScene, assembly: Assembly) -> LoadCase:
    """Build the load case of a scene.

    Raises
    ------
    InputError
        When the assembly cannot take it.
    """
    try:
        if isinstance(scene, BoxesScene):
            top = np.array([assembly.n_blocks - 1])
            return face_pressure(assembly, top, "z+", scene.load.pressure)
        load = scene.load
        return load_case(
            assembly, load.case, load.pressure, as_printed=load.as_printed, layer=load.layer
        )
    except LoadCaseError as error:
        raise InputError(str(error)) from None


def build_weight(scene: DeformableScene, assembly: Assembly) -> FloatArray | None:
    """Weight of rigid blocks under ``effects.gravity``, about their mass centroids.

    Deformable blocks carry theirs node by node (`fem.assembly.deformable`).

    Returns
    -------
    FloatArray | None
        (n_blocks, 6) [N, N mm]; None where the scene names no gravity.

    Raises
    ------
    InputError
        Gravity without a density.
    """
    if scene.effects.gravity is None:
        return None
    if scene.material is None:
        raise InputError(
            "effects.gravity: blocks weigh by material.density, and [material] is missing; add it, "
            "or remove effects.gravity"
        )
    wrenches = np.zeros((assembly.n_blocks, 6))
    wrenches[:, :3] = np.outer(scene.material.density * assembly.volumes, scene.effects.gravity)
    return wrenches


def build_blocks(scene: AssemblyScene) -> HexahedralBlocks:
    """Build blocks and load of a scene.

    Raises
    ------
    InputError
        When the parameters describe no assembly, or it cannot take the load.
    """
    assembly = build_assembly(scene)
    # Blocks of all other families match by construction, or are refused by their shape.
    unmatched = unmatched_joints(assembly) if isinstance(scene, BoxesScene) else ()
    return HexahedralBlocks(assembly, build_load(scene, assembly), unmatched)
