"""`[effects] auto`: simulate only the effects of a scene that matter.

The rule is that of `tubelock effects`: an effect is added to the scene without any, and matters if
p_max, p_eff or the largest displacement change by more than the tolerance. The scene is solved as a
static problem on a coarse mesh. Effects that are left out change no more than the tolerance
together, as the sum of their changes. Probes take a third of the answer's limit of work at most;
beyond it effects stay as written. The decision is part of the result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass, replace
from typing import Any

from fem.accuracy.converge import usual_work
from fem.method import Static
from fem.state import State
from fem.static.linear_step.flexibility import FlexibilityStore
from geometry.errors import RefusedError
from geometry.machine.work import LimitError, budget
from validation.build.problem import fem_section, scene_problem
from validation.errors import InputError
from validation.run.probe import (
    Change,
    change,
    largest_slip_share,
    mesh_words,
    numbers_of,
    probe_scene,
    solve_probe,
)
from validation.scene.deformable import EffectName, Method
from validation.scene.family import AssemblyScene
from validation.scene.read import DeformableScene

#: Part of the limit of work of an answer that its probes may take.
SHARE = 1.0 / 3.0
#: Effects that are on or off, without a value.
_SWITCHES = (EffectName.ELASTIC_FRAME, EffectName.FINITE_ROTATION, EffectName.FINITE_SLIDING)
#: Effects that ``[contact]`` names.
_GAPS = (EffectName.CLEARANCE, EffectName.SPACING)
#: Effects that only a motion has.
_DAMPING = (EffectName.RAYLEIGH, EffectName.BULK_VISCOSITY)


@dataclass(frozen=True)
class Decision:
    """What was decided about one effect."""

    effect: EffectName
    setting: str
    """Its value, as the scene gives it."""
    simulated: bool
    """Whether the run has it."""
    change: Change | None
    """Of the probe's answer when it is added; None where no number decides."""
    reason: str
    """How it was decided, in words."""

    @property
    def words(self) -> str:
        """The effect with its value and its largest change, or the reason."""
        setting = "" if self.setting == "on" else f" {self.setting}"
        why = self.reason if self.change is None else self.change.words
        return f"{self.effect.replace('_', ' ')}{setting} ({why})"


@dataclass(frozen=True)
class EffectsDecision:
    """Which effects a run has, and why."""

    tolerance: float
    """Of p_max, p_eff and the largest displacement, relative [-]."""
    decisions: tuple[Decision, ...]
    """One for each candidate."""
    as_written: tuple[EffectName, ...]
    """Effects that the scene fixes and the run has."""
    probe: str
    """What was solved."""
    cpu_seconds: float
    """Of all probes [s]."""
    work: float
    """Of all probes [reference s]."""

    @property
    def left_out(self) -> tuple[EffectName, ...]:
        """Effects that the run does not have."""
        return tuple(d.effect for d in self.decisions if not d.simulated)

    @property
    def words(self) -> str:
        """Which effects are simulated and which are left out, and why, in a line."""
        parts = []
        for verb, simulated in (("simulated", True), ("left out", False)):
            named = [d.words for d in self.decisions if d.simulated is simulated]
            if simulated:
                named += [f"{e.replace('_', ' ')} (as written)" for e in self.as_written]
            parts.append(f"{verb}: {', '.join(named) or 'none'}")
        return (
            f"effects   beyond {100 * self.tolerance:.3g} % of p_max, p_eff or u; "
            f"{'; '.join(parts)} (probe: {self.probe}, {self.cpu_seconds:.2g} CPU s)"
        )

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self) | {"left_out": list(self.left_out)}


# ---------------------------------------------------------------------------------------------
# Candidates


def has_effect(scene: DeformableScene, effect: EffectName) -> bool:
    """Whether a scene has an effect."""
    if effect in _GAPS:
        return bool(getattr(scene.contact, effect) > 0.0)
    return bool(getattr(scene.effects, effect))


def with_effect(scene: DeformableScene, effect: EffectName) -> DeformableScene:
    """Scene with one of the effects that need no value."""
    return scene.changed({f"effects.{effect}": True})


def without_effect(scene: DeformableScene, effect: EffectName) -> DeformableScene:
    """Scene without an effect."""
    if effect in _GAPS:
        return scene.changed({f"contact.{effect}": 0.0})
    if effect is EffectName.FRICTION:
        pairs = scene.contact.frictionless_pairs
        return scene.changed({"effects.friction": None, "contact.pairs": pairs})
    return scene.changed({f"effects.{effect}": False if effect in _SWITCHES else None})


def candidates(scene: DeformableScene, keep: Collection[str]) -> tuple[EffectName, ...]:
    """Effects to decide: those with a value, and switches that the scene does not set."""
    explicit = scene.fem.method is Method.EXPLICIT
    result = []
    for effect in EffectName:
        if effect in keep:
            continue
        if effect in _SWITCHES:
            written = effect in scene.effects.model_fields_set
            stands = isinstance(scene, AssemblyScene) and scene.stands
            useless = effect is EffectName.ELASTIC_FRAME and stands
            # Probes are static, with small rotations.
            impossible = effect is EffectName.FINITE_ROTATION
            impossible |= effect is EffectName.FINITE_SLIDING and not explicit
            if not (written or useless or impossible):
                result.append(effect)
        elif has_effect(scene, effect):
            result.append(effect)
    return tuple(result)


def setting_words(scene: DeformableScene, effect: EffectName) -> str:
    """Value of an effect in a scene."""
    if effect in _SWITCHES:
        return "on"
    if effect in _GAPS:
        return f"{getattr(scene.contact, effect):g} mm"
    value = getattr(scene.effects, effect)
    if effect is EffectName.GRAVITY:
        return ", ".join(f"{g:g}" for g in value) + " mm/s²"
    given = value.model_dump(exclude_none=True)
    return ", ".join(f"{key.replace('_', ' ')} {number:g}" for key, number in given.items())


# ---------------------------------------------------------------------------------------------
# Deciding


def require_wider(scene: DeformableScene, name: str) -> None:
    """Reject error bars that effects which are left out may exceed, as none holds their change."""
    auto, accuracy = scene.effects.auto, scene.fem.accuracy
    if auto is None or not accuracy:
        return
    least = min(accuracy, key=lambda measure: accuracy[measure])
    share = f"{100 * accuracy[least]:g}%"
    if auto > accuracy[least]:
        raise InputError(
            f"{name}: fem.accuracy: got {least}={share} where effects may be left out that change "
            f"{100 * auto:g} %; expected --auto of at most {share}"
        )


def decide_effects(
    scene: DeformableScene,
    name: str,
    keep: Collection[str] = (),
    *,
    told: Callable[[str], None] | None = None,
) -> tuple[DeformableScene, EffectsDecision]:
    """Decide which effects of a scene with ``effects.auto`` matter, and tell what is probed next.

    Effects to keep are not decided. Returns the scene with what matters and nothing to decide, and
    the decision.
    """
    tolerance = scene.effects.auto
    assert tolerance is not None
    plain = scene.changed({"effects.auto": None})
    fem_section(plain, name)
    require_wider(scene, name)
    names = candidates(plain, keep)
    start = time.process_time()
    probe = _Probe(plain, name, names, told or (lambda _: None))
    result = _together([probe.decision(effect) for effect in names], tolerance)
    decided = plain
    for decision in result:
        change = with_effect if decision.simulated else without_effect
        if decision.simulated is not has_effect(plain, decision.effect):
            decided = change(decided, decision.effect)
    return decided, EffectsDecision(
        tolerance=tolerance,
        decisions=result,
        as_written=tuple(e for e in EffectName if e not in names and has_effect(plain, e)),
        probe=f"static, {mesh_words(probe.scene)}",
        cpu_seconds=time.process_time() - start,
        work=probe.work,
    )


def _together(probed: list[Decision], tolerance: float) -> tuple[Decision, ...]:
    """Leave out effects, the smallest first, as long as all of them change no more than allowed."""
    total, decided = 0.0, {}
    measured = [d for d in probed if d.change is not None]
    for d in sorted(measured, key=lambda d: d.change.largest if d.change else 0.0):
        assert d.change is not None
        total += d.change.largest
        reason = d.reason
        if total > tolerance and not d.change.matters(tolerance):
            reason += "; small alone, too much together with the others"
        decided[d.effect] = replace(d, simulated=total > tolerance, reason=reason)
    return tuple(decided.get(d.effect, d) for d in probed)


#: Why an effect is not decided.
_TOO_DEAR = "as written: to probe it takes more than a third of the limit of work"


def _most_work(scene: DeformableScene, name: str) -> float:
    """Reference seconds that the probes of a scene may take, its effects as written.

    Explicit runs take thousands of steps: there is no limit beside them.
    """
    method = scene.method
    if not isinstance(method, Static):
        return math.inf
    return SHARE * (method.max_work or usual_work(scene_problem(scene, name)))


class _Probe:
    """A scene without the effects to decide, solved once, and once more with each of them."""

    def __init__(
        self,
        scene: DeformableScene,
        name: str,
        names: tuple[EffectName, ...],
        told: Callable[[str], None],
    ) -> None:
        self._full, self._name, self._told = scene, name, told
        self._store = FlexibilityStore()
        self.scene = probe_scene(scene, name)
        self._needed: tuple[EffectName, ...] = ()
        solved = [e for e in names if e not in _DAMPING]
        self.work, self._limit = 0.0, _most_work(scene, name) if solved else 0.0
        self._base = self._solved(solved) if solved else None

    def _run(self, scene: DeformableScene) -> State:
        """Solve a probe within the work that is left."""
        with budget(self._limit - self.work) as spent:
            try:
                return solve_probe(scene, self._name, self._store)
            finally:
                self.work += spent.seconds

    def _solved(self, names: list[EffectName]) -> State | None:
        """Solve without effects; those that have a value stay where there is no solution.

        None where this takes too much work.
        """
        self._told("none of the effects")
        written = [e for e in names if has_effect(self.scene, e)]
        bare = self.scene
        for effect in written:
            bare = without_effect(bare, effect)
        try:
            result = self._run(bare)
        except LimitError:
            return None
        except RefusedError:
            if not written:
                raise
            result = self._run(self.scene)
            self._needed = tuple(written)
            return result
        self.scene = bare
        return result

    def decision(self, effect: EffectName) -> Decision:
        """What an effect changes; whether it then matters is decided for all of them together."""
        setting = setting_words(self._full, effect)
        if effect in self._needed:
            reason = "without these effects the probe has no static state"
            return Decision(effect, setting, True, None, reason)
        if effect in _DAMPING:
            return self._damping(effect, setting)
        if self._base is None:
            return self._as_written(effect, setting)
        return self._probed(effect, setting, self._base)

    def _probed(self, effect: EffectName, setting: str, base: State) -> Decision:
        """What adding an effect to a probe without it changes."""
        if effect is EffectName.FINITE_SLIDING:
            slips = largest_slip_share(base, self._full, self.scene)
            if slips is None:
                return Decision(effect, setting, True, None, "meshes that do not match need it")
            slip, share = slips
            words = f"surfaces slip by {slip:.2g} mm at most, {100 * share:.2g} % of a facet"
            return Decision(effect, setting, True, Change(share, share, share), words)
        self._told(str(effect))
        try:
            result = self._run(self._with(effect))
        except LimitError:
            return self._as_written(effect, setting)
        except RefusedError as error:
            possible = effect is not EffectName.ELASTIC_FRAME
            reason = f"{'no probe' if possible else 'not possible here'}: {error}"
            return Decision(effect, setting, possible, None, reason)
        return Decision(
            effect, setting, True, change(numbers_of(base), numbers_of(result)), "probe"
        )

    def _as_written(self, effect: EffectName, setting: str) -> Decision:
        """No decision: the effect stays as the scene has it."""
        return Decision(effect, setting, has_effect(self._full, effect), None, _TOO_DEAR)

    def _with(self, effect: EffectName) -> DeformableScene:
        """The probe with an effect of the scene."""
        if effect in _SWITCHES:
            return with_effect(self.scene, effect)
        section = "contact" if effect in _GAPS else "effects"
        value = getattr(getattr(self._full, section), effect)
        result = self.scene.changed({f"{section}.{effect}": value})
        if effect is EffectName.FRICTION:
            result = result.changed({"contact.pairs": self._full.contact.pairs})
        return result

    def _damping(self, effect: EffectName, setting: str) -> Decision:
        """Decide about a viscous force: it is zero at rest, so no static state has it."""
        fem, at_rest = self._full.fem, Change(0.0, 0.0, 0.0)
        if fem.method is Method.STATIC:
            return Decision(effect, setting, False, at_rest, "zero at rest: a static run")
        if self._full.damping == "static":
            return Decision(effect, setting, False, at_rest, "zero at rest, where this run ends")
        reason = "this run is not driven to rest, so damping shapes its end"
        return Decision(effect, setting, True, None, reason)
