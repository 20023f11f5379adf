"""Friction and laws of some joints: ``[[contact.pairs]]``, blocks by number, name or material."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fem.contact.law import ContactLaw
from geometry.assembly import AnyBlocks
from geometry.mesh import BoolArray
from geometry.parts.chosen import numbers_of
from geometry.parts.pairs import OfPairs, PairError
from validation.build.materials import material_names
from validation.scene.read import DeformableScene

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
        raise PairError(
            f"{_KEY}: got {end!r}; expected the number of a block, or a name of {known}"
        )
    meant[numbers_of(_KEY, end, assembly.names or ("",) * assembly.n_blocks)] = True
    return meant


def _words(end: int | str) -> str:
    return f"block {end}" if isinstance(end, int) else repr(end)
