"""Keys of a scene on which no answer of a method depends: by what methods are, not by watching."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from fem.contact.law import LAWS
from fem.method import Explicit, Static
from geometry.loads import CASES
from mbd.options import Rigid
from validation.scene.sections import ContactPairSection, law_keys

if TYPE_CHECKING:
    from validation.scene.read import DeformableScene

#: Constants of contact laws.
_LAWS = tuple(
    f"contact.{name}"
    for name in ContactPairSection.model_fields
    if name not in ("between", "friction")
)
#: Of elastic blocks, their joints and their motion in time.
_ELASTIC = (
    *("material.young_modulus", "material.poisson_ratio", "material.averaging_radius"),
    *(
        "material.tensile_strength",
        *_LAWS,
        *(law.replace("contact", "contact.pairs") for law in _LAWS),
    ),
    *("effects.elastic_frame", "effects.friction.stick_stiffness"),
)
#: With which static answers have load factors, and rigid ones that at first crushing.
_STRENGTHS = ("material.tensile_strength", "material.compressive_strength")
#: Fields of methods that decks have.
_WRITTEN = {"end_time", "ramp_time", "damping", "time_step", "safety_factor", "frames"}
_IN_TIME = ("effects.rayleigh", "effects.bulk_viscosity")
#: Of a scene's answer, which decks leave to the program that reads them.
_NOT_WRITTEN = (
    *("rigid", "stages", "sections", "material.averaging_radius", *_STRENGTHS),
    *(
        f"fem.{one.name}"
        for one in (*fields(Static), *fields(Explicit))
        if one.name not in _WRITTEN
    ),
)
#: Of rigid blocks alone: compared are answers of the solver in both norms.
_RIGID_ALONE = tuple(
    f"rigid.{one.name}" for one in fields(Rigid) if one.name not in ("solver", "norm")
)
#: Sections and keys that a method does not have, by its name.
_ABSENT: Mapping[str, tuple[str, ...]] = {
    "rigid": ("fem", "effects.auto", "pictures.mises", *_ELASTIC, *_IN_TIME),
    "static": ("rigid", "stages", *_IN_TIME),
    "explicit": ("rigid", "stages", *_STRENGTHS),
    "compare": ("stages", *_RIGID_ALONE, *_IN_TIME),
    "explicit compare": ("stages", *_RIGID_ALONE),
    "static deck": (*_NOT_WRITTEN, *_IN_TIME, "fem.damping"),
    "explicit deck": (*_NOT_WRITTEN, "effects.finite_sliding"),
    "blocks": (
        *("fem", "rigid", "stages", "material", "contact", "effects", "load", "loads", "supports"),
        *("initial", "combinations", "sections"),
    ),
}
#: Keys that are printed: others a scene may state for other methods, and the data name them. Files
#: that are exported have no data, and all their keys are printed.
_PRINTED: tuple[str, ...] = ("block.", "effects.", "load.", "pictures.")


def _solids(scene: Any) -> bool:
    return hasattr(scene, "detection")


def _of_other_law(constant: str) -> Callable[[Any, str], bool]:
    """Whether the contact law of a scene has no such constant."""
    return lambda scene, _: scene.meets and constant not in law_keys(scene.contact.law)


#: Keys that matter in some scenes alone: where they do not.
_IDLE_WHERE: Mapping[str, Callable[[Any, str], bool]] = {
    "load.as_printed": lambda scene, _: not CASES[scene.load.case].force_as_printed,
    "material.density": lambda scene, method: (
        method == "rigid"
        and scene.effects.gravity is None
        and getattr(scene.load, "acceleration", None) is None
    ),
    "mesh": lambda scene, method: method in ("rigid", "blocks") and _solids(scene),
    "fem.safety_factor": lambda scene, _: scene.fem.time_step is not None,
    "fem.residual": lambda scene, _: scene.damping != "static" and not scene.meets,
    "effects.elastic_frame": lambda scene, _: scene.stands,
    "fem.motion_steps": lambda scene, _: not scene.moves,
    "rigid.friction_law": lambda scene, _: scene.effects.friction is None,
    "block.thickness": lambda scene, _: scene.block.type == "ball",
    **{f"contact.{key}": _of_other_law(key) for name in LAWS for key in law_keys(name)},
}


@dataclass(frozen=True)
class KeyUse:
    """Keys of a scene on which its answer by a method depends, and those on which it does not."""

    scene: DeformableScene
    method: str
    """Of `_ABSENT`: that of an answer, "blocks", and "compare" or a deck with or without explicit
    runs."""
    drawn: bool = True
    """Whether pictures are requested."""

    def is_idle(self, key: str) -> bool:
        """Whether no answer depends on a key."""
        plain = re.sub(r"^materials\.[^.]+", "material", key)
        plain = re.sub(r"\.\d+(?=\.|$)", "", plain)
        if any(plain == k or plain.startswith(f"{k}.") for k in _ABSENT[self.method]):
            return True
        return any(
            where(self.scene, self.method)
            for name, where in _IDLE_WHERE.items()
            if plain == name or plain.startswith(f"{name}.")
        )

    @cached_property
    def idle(self) -> list[str]:
        """Keys that the scene sets and on which its answer does not depend."""
        keys = dict.fromkeys(_set_keys(self.scene, ""))
        pictures = () if self.drawn else ("pictures.",)
        return [key for key in keys if key.startswith(pictures) or self.is_idle(key)]

    @property
    def ignored(self) -> str:
        """Effects and loads among them, in words; of decks all keys, of blocks all sections."""
        if self.method == "blocks":
            return ", ".join(dict.fromkeys(f"[{key.partition('.')[0]}]" for key in self.idle))
        if self.method.endswith("deck"):
            return ", ".join(self.idle)
        printed = _PRINTED if self.method == "rigid" else (*_PRINTED, "contact.", "material.")
        if self.method.endswith("compare"):
            printed = (*printed, "rigid.")
        return ", ".join(k for k in self.idle if k.startswith(printed) and "stick" not in k)

    @property
    def defaults(self) -> dict[str, str]:
        """Sections that the scene leaves out and its answer depends on, in words."""
        scene, rigid = self.scene, self.method in ("rigid", "blocks")
        names = ["mesh"] if rigid else ["mesh", "material", "contact", "fem"]
        if self.method == "rigid" and not self.is_idle("material.density"):
            names.append("material")
        if not scene.meets:
            names = [name for name in names if name != "contact"]
        sections = {name: getattr(scene, name, None) for name in names}
        words = {name: getattr(section, "words", "") for name, section in sections.items()}
        return {
            name: text
            for name, text in words.items()
            if text and name not in scene.model_fields_set
        }

    @property
    def words(self) -> dict[str, str]:
        """Defaults, what is unusual, and keys that the method ignores, in words by their heads."""
        words = {
            "defaults": ", ".join(f"{name} {value}" for name, value in self.defaults.items()),
            "note": self.scene.caution or "",
            "ignored": self.ignored and f"{self.ignored} (not used by this method)",
        }
        return {head: text for head, text in words.items() if text}


def _set_keys(section: BaseModel, place: str) -> Iterator[str]:
    """Keys that are set and state something."""
    for name, field in type(section).model_fields.items():
        if name not in section.model_fields_set:
            continue
        value = getattr(section, name)
        inner = list(_sections(value))
        for key, part in inner:
            keys = list(_set_keys(part, f"{place}{name}{key}."))
            # An effect that a scene switches on with all its defaults: `bulk_viscosity = {}`.
            on = not keys and field.default is None and any(part.model_dump().values())
            yield from [f"{place}{name}{key}"] if on else keys
        nothing = value is None or value is False or (isinstance(value, tuple | dict) and not value)
        if not inner and not nothing:
            yield f"{place}{name}"


def _sections(value: Any) -> Iterator[tuple[str, BaseModel]]:
    """Sections that a value is made of, and how their keys go on."""
    if isinstance(value, BaseModel):
        yield "", value
    elif isinstance(value, Mapping):
        yield from ((f".{key}", part) for key, part in value.items() if isinstance(part, BaseModel))
    elif isinstance(value, tuple | list):
        yield from (("", part) for part in value if isinstance(part, BaseModel))
