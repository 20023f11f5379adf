"""Materials of the blocks of a scene: one for all, or by part and block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fem.contact.law import ContactLaw
from fem.element.material import Material, each_material
from geometry.mesh import BoolArray, FloatArray
from geometry.parts.block_selection import numbers_of
from geometry.parts.pairs import OfPairs, PairError
from geometry.parts.placed import AnyBlocks
from validation.errors import InputError
from validation.scene.deformable import MaterialSection
from validation.scene.read import DeformableScene
from validation.scene.sections import Vector


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


def material_names(scene: DeformableScene, assembly: AnyBlocks) -> list[str]:
    """Name of the material of each block, empty of the default without a name, (n_blocks,)."""
    chosen, default = dict(_choices(scene, assembly)), scene.material.name or ""
    return [chosen.get(k, default) for k in range(assembly.n_blocks)]


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
    if scene.files:
        for block, part in enumerate(assembly.parts):
            name = scene.files[part].material
            if name is not None:
                yield block, name
    names = assembly.names or ("",) * assembly.n_blocks
    for name, section in scene.materials.items():
        for one in section.blocks:
            for block in numbers_of(f"materials.{name}.blocks", one, names):
                yield block, name


_Value = TypeVar("_Value")
_KEY = "contact.pairs.between"


def friction_of_pairs(
    scene: DeformableScene, assembly: AnyBlocks, *, anywhere: bool = False
) -> OfPairs:
    """Blocks of the joints whose friction a scene names, and their coefficients.

    ``anywhere``: any two blocks may come to touch; else those that touch are meant. Blocks that are
    named go before materials.
    """
    given = [(p.between, p.friction) for p in scene.contact.pairs if p.friction is not None]
    return _joints(scene, assembly, given, anywhere=anywhere)


def laws_of_pairs(
    scene: DeformableScene, assembly: AnyBlocks, *, anywhere: bool = False
) -> tuple[tuple[int, int, ContactLaw], ...]:
    """Blocks of the joints whose contact law a scene names, and the laws; errors alike."""
    given = [(p.between, p.built) for p in scene.contact.pairs if p.has_law]
    return _joints(scene, assembly, given, anywhere=anywhere)


def _joints(
    scene: DeformableScene,
    assembly: AnyBlocks,
    given: Sequence[tuple[tuple[int | str, int | str], _Value]],
    *,
    anywhere: bool,
) -> tuple[tuple[int, int, _Value], ...]:
    """Blocks of each joint that is named, and its value."""
    if not given:
        return ()
    if anywhere:
        joints = np.column_stack(np.triu_indices(assembly.n_blocks, 1))
    else:
        found = assembly.interfaces
        ends = np.sort(np.column_stack([found.block_m, found.block_s]), axis=1)
        joints = np.unique(ends, axis=0)
    materials = np.array(material_names(scene, assembly))
    result: dict[tuple[int, int], tuple[_Value, int]] = {}
    for between, value in given:
        one, other = (_blocks(end, materials, assembly) for end in between)
        m, s = joints.T
        here = (one[m] & other[s]) | (one[s] & other[m])
        if not here.any():
            raise PairError(
                f"{_KEY}: {_words(between[0])} and {_words(between[1])} do not touch; "
                "expected two that do"
            )
        exact = sum(isinstance(end, int) or end not in materials for end in between)
        for a, b in joints[here].tolist():
            known = result.get((a, b))
            if known is not None and known[1] == exact:
                raise PairError(
                    f"{_KEY}: the joint of blocks {a} and {b} is named twice; expected once"
                )
            if known is None or known[1] < exact:
                result[a, b] = value, exact
    return tuple((*ends, value) for ends, (value, _) in sorted(result.items()))


def _blocks(end: int | str, materials: NDArray[np.str_], assembly: AnyBlocks) -> BoolArray:
    """Whether each block is meant, (n_blocks,)."""
    if isinstance(end, str) and end in materials:
        return np.asarray(materials == end)
    meant = np.zeros(assembly.n_blocks, dtype=np.bool_)
    if isinstance(end, str) and end not in assembly.names:
        known = ", ".join(
            repr(name) for name in dict.fromkeys([*materials.tolist(), *assembly.names]) if name
        )
        names = f", or a name of {known}" if known else "; none has a name"
        raise PairError(f"{_KEY}: got {end!r}; expected the number of a block{names}")
    meant[numbers_of(_KEY, end, assembly.names or ("",) * assembly.n_blocks)] = True
    return meant


def _words(end: int | str) -> str:
    return f"block {end}" if isinstance(end, int) else repr(end)


def body_forces(
    scene: DeformableScene, assembly: AnyBlocks, acceleration: Vector | None
) -> FloatArray:
    """Mass times an acceleration [mm/s²] of every block, (n_blocks, 6) [N, N mm]; None: zero.

    Fixed blocks are ground, which weighs nothing.
    """
    wrenches = np.zeros((assembly.n_blocks, 6))
    if acceleration is not None:
        each = each_material(build_materials(scene, assembly), assembly.n_blocks)
        density = np.array([material.density for material in each])
        wrenches[:, :3] = np.outer(density * assembly.volumes, acceleration)
        wrenches[assembly.fixed] = 0.0
    return wrenches
