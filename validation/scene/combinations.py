"""Load combinations: a scene whose named loads have factors.

``[combinations.NAME]`` gives factors by the names of loads: ``weight`` is `effects.gravity`,
``load`` the section ``[load]`` with those of ``[[loads]]`` that have no name, other names are
those of ``[[loads]]``. What is not named does not act.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from validation.errors import InputError
from validation.scene.deformable import DeformableSections
from validation.scene.sections import Section
from validation.scene.supports import LOAD, NOT_LOADS, SAME_SUPPORTS, WEIGHT

AnyScene = TypeVar("AnyScene", bound=DeformableSections)

#: Keys of loads that factors apply to.
_SCALED = ("pressure", "traction", "force", "per_length", "acceleration")
#: Keys of ``[rigid]`` that ask for the factor by which the variable load may grow.
_LIMITS = ("collapse", "sliding")


def load_names(scene: DeformableSections) -> tuple[str, ...]:
    """Names that factors of a scene can have."""
    named = tuple(dict.fromkeys(one.name for one in scene.loads if one.name))
    return ((WEIGHT,) if scene.effects.gravity is not None else ()) + (LOAD, *named)


def combined(scene: AnyScene, name: str) -> AnyScene:
    """Scene with the loads of one of its combinations."""
    if name not in scene.combinations:
        known = ", ".join(scene.combinations) or "none"
        raise InputError(f"combinations: got {name!r}, expected one of {known}")
    factors = scene.combinations[name]
    known_names = load_names(scene)
    supports = {one.name for one in scene.supports} | set(NOT_LOADS)
    for load in factors:
        if load not in known_names:
            if load in supports:
                raise InputError(f"combinations.{name}.{load}: {SAME_SUPPORTS}")
            raise InputError(
                f"combinations.{name}.{load}: no load has this name; expected one of "
                f"{', '.join(known_names)} (give [[loads]] a name)"
            )
    nameless = [k for k, one in enumerate(scene.loads) if not one.name]
    if nameless and LOAD not in factors:
        raise InputError(
            f"combinations.{name}: loads[{nameless[0]}] ({scene.loads[nameless[0]].words}) has no "
            "name, and its factor is not given; expected [[loads]] with a name, or the "
            f"factor {LOAD}, which is that of [load] and of all loads without a name"
        )
    values: dict[str, Any] = {"combinations": {}}
    acting = [one for one in scene.loads if (one.name or LOAD) in factors]
    values["loads"] = tuple(_scaled(one, factors[one.name or LOAD]) for one in acting)
    if scene.effects.gravity is not None:
        factor = factors.get(WEIGHT)
        weight = None if factor is None else _times(factor, scene.effects.gravity)
        values["effects.gravity"] = weight
    given: Any = scene.load  # type: ignore[attr-defined]
    factor = factors.get(LOAD, 0.0)
    if isinstance(given, Mapping):
        parts = given.items() if factor else ()
        values["load"] = {key: _scaled(part, factor) for key, part in parts}
    else:
        values["load"] = _scaled(given, factor)
    if (
        scene.push is None
        and _act(scene.loads, given)
        and not _act(values["loads"], values["load"])
    ):
        values |= {f"rigid.{key}": False for key in _LIMITS if getattr(scene.rigid, key)}
    return scene.changed(values)


def _act(loads: Iterable[Section], load: Any) -> bool:
    """Whether one of ``[[loads]]`` or ``[load]``, which grow up to a limit, has a size."""
    parts = [*loads, *(load.values() if isinstance(load, Mapping) else [load])]
    sizes = (part.__dict__.get(key) for part in parts for key in _SCALED)
    return any(any(size) if isinstance(size, tuple) else size for size in sizes)


def _scaled(section: Section, factor: float) -> Section:
    """Load with all its sizes times a factor."""
    given = {key: section.__dict__.get(key) for key in _SCALED}
    changes = {key: _times(factor, value) for key, value in given.items() if value is not None}
    return section.changed(changes)


def _times(factor: float, value: Any) -> Any:
    """A number or a vector times a factor."""
    if isinstance(value, tuple):
        return tuple(factor * part for part in value)
    return factor * value
