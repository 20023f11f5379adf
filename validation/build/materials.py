"""Materials of the blocks of a scene: one for all, or by part and block."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.element.material import Material, one_strength
from geometry.assembly import AnyBlocks
from geometry.mesh import FloatArray
from geometry.parts.chosen import numbers_of
from validation.errors import InputError
from validation.scene.deformable import MaterialSection
from validation.scene.polyhedra import MeshScene
from validation.scene.read import DeformableScene


def build_material(section: MaterialSection) -> Material:
    """Material of a section."""
    return Material(**section.model_dump(exclude={"name", "blocks"}))


def build_materials(scene: DeformableScene, assembly: AnyBlocks) -> Material | tuple[Material, ...]:
    """Material of all blocks, or of each one, (n_blocks,)."""
    sections = _sections(scene, assembly)
    if sections is None:
        return build_material(scene.material)
    built: dict[int, Material] = {}
    for section in sections:
        if id(section) not in built:
            built[id(section)] = build_material(section)
    return tuple(built[id(section)] for section in sections)


def densities(scene: DeformableScene, assembly: AnyBlocks) -> float | FloatArray:
    """Density of all blocks, or of each one, (n_blocks,) [t/mm³]."""
    sections = _sections(scene, assembly)
    if sections is None:
        return scene.material.density
    return np.array([section.density for section in sections])


def material_names(scene: DeformableScene, assembly: AnyBlocks) -> list[str]:
    """Name of the material of each block, empty of the default without a name, (n_blocks,)."""
    chosen, default = dict(_choices(scene, assembly)), scene.material.name or ""
    return [chosen.get(k, default) for k in range(assembly.n_blocks)]


def compressive_strength(scene: DeformableScene) -> float | None:
    """Compressive strength of all blocks [MPa]; None where none is stated."""
    key = "compressive_strength"
    sections = (scene.material, *scene.materials.values())
    return one_strength(key, (vars(section)[key] for section in sections))


def _sections(scene: DeformableScene, assembly: AnyBlocks) -> list[MaterialSection] | None:
    """Section of the material of each block; None: one for all."""
    chosen: dict[int, str] = {}
    for block, name in _choices(scene, assembly):
        other = chosen.setdefault(block, name)
        if other != name:
            raise InputError(
                f"materials: block {assembly.named(block)} is of {other!r} and of {name!r}; "
                "expected one of the two"
            )
    idle = next((name for name in scene.materials if name not in chosen.values()), None)
    if idle is not None:
        raise InputError(
            f"materials.{idle}: no block is of it; expected blocks = [0, 3] there (numbers or "
            f'names), or [[parts]] material = "{idle}"'
        )
    if not chosen:
        return None
    known: dict[str, MaterialSection] = dict(scene.materials)
    for name in set(chosen.values()) - set(known):
        known[name] = type(scene.material).model_validate(name)
    blocks = range(assembly.n_blocks)
    return [known[chosen[k]] if k in chosen else scene.material for k in blocks]


def _choices(scene: DeformableScene, assembly: AnyBlocks) -> Iterator[tuple[int, str]]:
    """Blocks whose material is stated, and its name."""
    if isinstance(scene, MeshScene):
        for block, part in enumerate(assembly.parts):
            name = scene.parts[part].material
            if name is not None:
                yield block, name
    names = assembly.names or ("",) * assembly.n_blocks
    for name, section in scene.materials.items():
        for one in section.blocks:
            for block in numbers_of(f"materials.{name}.blocks", one, names):
                yield block, name
