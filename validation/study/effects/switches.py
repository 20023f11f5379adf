"""The effects of a scene, switched off one at a time; what that changes in its keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from validation.case import Case
from validation.scene.deformable import EffectName
from validation.scene.keys.toml_text import toml_value

#: Effects that are on or off, without a value.
_SWITCHES = (EffectName.ELASTIC_FRAME, EffectName.FINITE_ROTATION, EffectName.FINITE_SLIDING)
#: Effects that ``[contact]`` names.
_GAPS = (EffectName.CLEARANCE, EffectName.SPACING)


def has_effect(case: Case, effect: EffectName) -> bool:
    """Whether a case has an effect."""
    values = case.values
    if effect is EffectName.FRICTION and any(p["friction"] for p in values["contact.pairs"]):
        return True
    section = "contact" if effect in _GAPS else "effects"
    return any(on for key, on in values.items() if f"{key}.".startswith(f"{section}.{effect}."))


def effects_of(case: Case) -> tuple[EffectName, ...]:
    """Effects of a case."""
    return tuple(effect for effect in EffectName if has_effect(case, effect))


def without_effect(case: Case, effect: EffectName) -> Case:
    """Case without an effect."""
    if effect in _GAPS:
        return case.varied({f"contact.{effect}": 0.0})
    if effect is EffectName.FRICTION:
        stated = case.keys.get("contact", {}).get("pairs", ())
        pairs = [pair | {"friction": None} for pair in stated if "law" in pair]
        return case.varied({"effects.friction": None, "contact.pairs": pairs})
    return case.varied({f"effects.{effect}": False if effect in _SWITCHES else None})


@dataclass(frozen=True)
class KeyChange:
    """A key of a scene with its value before and after; None: it has none."""

    key: str
    before: Any
    after: Any

    @property
    def words(self) -> str:
        """Key, from, to."""
        return f"{self.key} {_text(self.before)} → {_text(self.after)}"

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return {"key": self.key, "from": self.before, "to": self.after}


def _text(value: Any) -> str:
    """Value as TOML, numbers to six digits."""
    if value is None:
        return "none"
    return f"{value:.6g}" if isinstance(value, float) else toml_value(value)


def key_changes(before: Case, after: Case) -> tuple[KeyChange, ...]:
    """What differs between the scenes of two cases."""
    old, new = before.values, after.values
    return tuple(
        KeyChange(key, old.get(key), new.get(key))
        for key in dict.fromkeys([*old, *new])
        if old.get(key) != new.get(key)
    )
