"""From scenes to what the solvers take: assemblies and load cases."""

from __future__ import annotations

from geometry.assembly import Assembly, AssemblyError
from geometry.brick_stack import brick_stack
from geometry.hexagon_block import HexagonBlockDivisions, HexagonBlockParameters
from geometry.load_case import LoadCase, LoadCaseError, load_case
from geometry.mesh import MeshError
from geometry.sine_block import BlockParameterError, SineBlockDivisions, SineBlockParameters
from geometry.tube import hexagon_tube, sine_tube
from validation.errors import InputError
from validation.scene import AssemblyScene, BrickScene, Scene, TubeScene
from validation.scene_families import HexagonTubeScene


def block_parameters(scene: TubeScene) -> SineBlockParameters:
    """Return the block of a tube scene."""
    return SineBlockParameters(**scene.block.model_dump(exclude={"type"}))


def require_assembly(scene: Scene, name: str, command: str) -> AssemblyScene:
    """Return the scene if its blocks meet each other.

    Raises
    ------
    InputError
        For a scene of a single box.
    """
    if isinstance(scene, AssemblyScene):
        return scene
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
        if isinstance(scene, BrickScene):
            return brick_stack(
                scene.block.size,
                scene.mesh.divisions,
                columns=scene.assembly.columns,
                layers=scene.assembly.layers,
            )
        if isinstance(scene, HexagonTubeScene):
            return hexagon_tube(
                HexagonBlockParameters(**scene.block.model_dump(exclude={"type"})),
                HexagonBlockDivisions(**scene.mesh.model_dump()),
                scene.assembly.layers,
            )
        divisions = SineBlockDivisions(**scene.mesh.model_dump())
        return sine_tube(block_parameters(scene), divisions, scene.assembly.layers)
    except (BlockParameterError, AssemblyError, MeshError) as error:
        raise InputError(str(error)) from None


def build_load(scene: AssemblyScene, assembly: Assembly) -> LoadCase:
    """Build the load case of a scene.

    Raises
    ------
    InputError
        When the assembly cannot take it.
    """
    load = scene.load
    try:
        return load_case(
            assembly, load.case, load.pressure, as_printed=load.as_printed, layer=load.layer
        )
    except LoadCaseError as error:
        raise InputError(str(error)) from None
