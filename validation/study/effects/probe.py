"""Cheap versions of a scene that tell what an effect changes: static, on a coarse mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fem.answer.measures import slip
from fem.answer.pressures import contact_measures
from fem.method import Explicit
from fem.state import State
from geometry.errors import RefusedError
from validation.case import Case, solve
from validation.errors import InputError
from validation.scene.deformable import EffectName
from validation.scene.keys.toml_text import flat, toml_value

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
        return case.changed({f"contact.{effect}": 0.0})
    if effect is EffectName.FRICTION:
        stated = case.keys.get("contact", {}).get("pairs", ())
        pairs = [pair | {"friction": None} for pair in stated if "law" in pair]
        return case.changed({"effects.friction": None, "contact.pairs": pairs})
    return case.changed({f"effects.{effect}": False if effect in _SWITCHES else None})


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


#: Most elements of a block in the probe: four a wave (or an edge), two through the wall, four in
#: the remaining direction.
_PER_WAVE, _THROUGH, _OTHER = 4, 2, 4
_STRENGTHS = ("tensile_strength", "compressive_strength")


@dataclass(frozen=True)
class Quantities:
    """The quantities by which effects are judged."""

    p_max: float
    """Mean of the block maxima of the contact pressure [MPa]."""
    p_eff: float
    """Effective mean contact pressure [MPa]."""
    displacement: float
    """Largest displacement [mm]."""

    @property
    def values(self) -> tuple[float, float, float]:
        """All three."""
        return self.p_max, self.p_eff, self.displacement


class Change(Quantities):
    """Relative change of each quantity [-]."""

    @property
    def largest(self) -> float:
        """Largest of the three, in size."""
        return max(map(abs, self.values))

    def matters(self, tolerance: float) -> bool:
        """Whether any of the three is larger than the tolerance [-]."""
        return self.largest > tolerance

    @property
    def words(self) -> str:
        """The largest of the three, with its name."""
        named = zip(("p_max", "p_eff", "u"), self.values, strict=True)
        name, value = max(named, key=lambda one: abs(one[1]))
        return f"{name} {100 * value:+.3g} %" if value else "no change"


def quantities_of(solution: State) -> Quantities:
    """Quantities of a run."""
    contact = contact_measures(solution)
    return Quantities(contact.p_max, contact.p_eff, solution.largest_displacement)


def change(before: Quantities, after: Quantities) -> Change:
    """Relative change from one answer to another; one, a hundred per cent, where it was zero."""

    def relative(a: float, b: float) -> float:
        if a == b:
            return 0.0
        return b / a - 1.0 if a else 1.0

    return Change(*map(relative, before.values, after.values))


def solve_probe(case: Case) -> State | None:
    """Static state of a probe; None where a limit of work ends it."""
    try:
        state: State = solve(case).details
    except InputError as error:
        if error.of_input:
            raise
        return None
    return state


def probe_of(case: Case) -> Case:
    """Return the case as a static problem on a mesh that is as coarse as its blocks allow.

    Layers, loads and contact stay: what an effect does to a tall tube shows only in a tall tube.
    """
    still: dict[str, Any] = {"rayleigh": None, "bulk_viscosity": None, "finite_rotation": False}
    if isinstance(case.method, Explicit):
        still["finite_sliding"] = False
    # Without a history of steps, other meshes or load factors, of which it tells nothing.
    once = {"mesh": "scene", "error_estimate": False, "load_steps": 1, "frames": 0}
    none = {"accuracy": None, "max_meshes": None, "max_work": None, "max_seconds": None}
    fem, strengths = {"method": "static", **once, **none}, dict.fromkeys(_STRENGTHS)
    static = case.changed(dict(flat({"fem": fem, "effects": still, "material": strengths})))
    for factor in (1, 2, 4):
        coarse = _coarse_mesh(case, factor)
        if not coarse:
            break
        probe = static.changed(dict(flat({"mesh": coarse})))
        try:
            _ = probe.problem.system
        except RefusedError:
            continue
        return probe
    return static


def _coarse_mesh(case: Case, factor: int) -> dict[str, Any]:
    """Values of ``[mesh]`` that are lower in the probe; none where the mesh is given."""
    result = case.scene.coarse_mesh(factor * _PER_WAVE, factor * _THROUGH, factor * _OTHER)
    own = case.element_counts
    return {key: value for key, value in result.items() if value != own[key]}


def refinement(case: Case, probe: Case) -> float:
    """How many times as many elements the case has along an edge of a block, at most."""
    fine, coarse = case.element_counts, probe.element_counts
    if not fine:
        return 1.0
    return max(float(np.max(np.divide(fine[key], coarse[key]))) for key in fine)


def mesh_words(case: Case) -> str:
    """Elements of a block."""
    counts = case.element_counts
    if not counts:
        return "its own mesh"
    flat = np.concatenate([np.atleast_1d(v) for v in counts.values()]).tolist()
    return " × ".join(str(v) for v in flat) + f" elements per block ({', '.join(counts)})"


def largest_slip_share(solved: State, case: Case, probe: Case) -> tuple[float, float] | None:
    """Largest slip of a probe [mm], and its share of a facet of the case [-].

    None where facets are searched: their meshes do not match.
    """
    found = slip(solved)
    if found is None:
        return None
    return found["largest"], found["largest"] / found["facet_size"] * refinement(case, probe)
