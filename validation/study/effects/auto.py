"""`[effects] auto`: simulate only the effects of a scene that matter.

The rule is that of `tubelock effects`: an effect of the scene is switched off, and matters if
p_max, p_eff or the largest displacement change by more than the tolerance. The scene is solved as a
static problem on a coarse mesh. Effects that are left out change no more than the tolerance
together: the probe without all of them says so. Probes take a third of the answer's limit of work
at most; beyond it effects stay as written. The decision is part of the result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass, replace
from typing import Any

from fem.accuracy.converge import usual_work
from fem.method import Explicit, Static
from fem.state import State
from geometry.errors import RefusedError
from geometry.machine.work import budget
from validation.case import Case
from validation.errors import InputError
from validation.scene.deformable import EffectName
from validation.study.effects.probe import (
    Change,
    KeyChange,
    change,
    effects_of,
    key_changes,
    largest_slip_share,
    mesh_words,
    probe_of,
    quantities_of,
    solve_probe,
    without_effect,
)

#: Part of the limit of work of an answer that its probes may take.
SHARE = 1.0 / 3.0
#: Effects that only a motion has.
_DAMPING = (EffectName.RAYLEIGH, EffectName.BULK_VISCOSITY)
#: The effect that is judged by slip.
_SLIDING = EffectName.FINITE_SLIDING


@dataclass(frozen=True)
class Decision:
    """What was decided about one effect."""

    effect: EffectName
    changes: tuple[KeyChange, ...]
    """Keys that switch it off."""
    simulated: bool
    """Whether the run has it."""
    change: Change | None
    """Of the probe's answer when it is switched off; None where no number decides."""
    reason: str
    """How it was decided, in words."""

    @property
    def words(self) -> str:
        """The effect with its largest change, or the reason; keys where it is left out."""
        why = self.reason if self.change is None else f"off: {self.change.words}"
        keys = "" if self.simulated else "".join(f"; {c.words}" for c in self.changes)
        return f"{self.effect.replace('_', ' ')} ({why}{keys})"

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "effect": self.effect,
            "changes": [change.as_json() for change in self.changes],
            "simulated": self.simulated,
            "change": None if self.change is None else asdict(self.change),
            "reason": self.reason,
        }


@dataclass(frozen=True)
class EffectsDecision:
    """Which effects a run has, and why."""

    tolerance: float
    """Of p_max, p_eff and the largest displacement, relative [-]."""
    decisions: tuple[Decision, ...]
    """One for each candidate."""
    as_written: tuple[EffectName, ...]
    """Effects of the scene that are not decided; the run has them."""
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
        return {
            **{key: getattr(self, key) for key in ("tolerance", "as_written", "left_out")},
            "decisions": [decision.as_json() for decision in self.decisions],
            **{key: getattr(self, key) for key in ("probe", "cpu_seconds", "work")},
        }


def candidates(case: Case, keep: Collection[str]) -> tuple[EffectName, ...]:
    """Effects of a case that a static probe can decide."""
    explicit = isinstance(case.method, Explicit)
    fixed = {EffectName.FINITE_ROTATION} if explicit else {EffectName.FINITE_ROTATION, _SLIDING}
    return tuple(e for e in effects_of(case) if e not in keep and e not in fixed)


def require_wider(case: Case) -> None:
    """Reject error bars that effects which are left out may exceed, as none holds their change."""
    auto, accuracy = case.auto, getattr(case.method, "accuracy", None)
    if auto is None or not accuracy:
        return
    least = min(accuracy, key=lambda measure: accuracy[measure])
    share = f"{100 * accuracy[least]:g}%"
    if auto > accuracy[least]:
        raise InputError(
            f"{case.name}: fem.accuracy: got {least}={share} where effects may be left out that "
            f"change {100 * auto:g} %; expected --auto of at most {share}"
        )


def decide_effects(
    case: Case, keep: Collection[str] = (), *, told: Callable[[str], None] | None = None
) -> tuple[Case, EffectsDecision]:
    """Decide which effects of a case with ``effects.auto`` matter, and tell what is probed next.

    Effects to keep are not decided. Returns the case with what matters and nothing to decide, and
    the decision.
    """
    tolerance = case.auto
    assert tolerance is not None
    plain = case.changed({"effects.auto": None})
    require_wider(case)
    names = candidates(plain, keep)
    start = time.process_time()
    probe = _Probe(plain, names, told or (lambda _: None))
    result = _left_out(probe, [probe.decision(effect) for effect in names], tolerance)
    decided = plain
    for decision in result:
        if not decision.simulated:
            decided = without_effect(decided, decision.effect)
    return decided, EffectsDecision(
        tolerance=tolerance,
        decisions=result,
        as_written=tuple(e for e in effects_of(plain) if e not in names),
        probe=f"static, {mesh_words(probe.case)}",
        cpu_seconds=time.process_time() - start,
        work=probe.work,
    )


def _left_out(probe: _Probe, probed: list[Decision], tolerance: float) -> tuple[Decision, ...]:
    """Leave out small effects: the largest of them stay until the others are small together."""
    measured = [d for d in probed if d.change is not None and not d.change.matters(tolerance)]
    small = sorted(measured, key=lambda d: d.change.largest if d.change else 0.0)
    together = list(small)
    while together and not probe.within(together, tolerance):
        together.pop()
    result = []
    for d in probed:
        more = d in small and d not in together
        reason = f"{d.reason}; small alone, too much together with the others" if more else d.reason
        result.append(replace(d, simulated=d not in together, reason=reason))
    return tuple(result)


#: Why an effect is not decided.
_TOO_DEAR = "as written: to probe it takes more than a third of the limit of work"


def _most_work(case: Case) -> float:
    """Reference seconds that the probes of a case may take.

    Explicit runs take thousands of steps: there is no limit beside them.
    """
    if not isinstance(case.method, Static):
        return math.inf
    return SHARE * (case.method.max_work or usual_work(case.problem))


class _Probe:
    """A scene solved as it is written, and once more without each of its effects."""

    def __init__(
        self, case: Case, names: tuple[EffectName, ...], told: Callable[[str], None]
    ) -> None:
        self._full, self._told = case, told
        self.case = probe_of(case)
        solved = any(e not in _DAMPING for e in names)
        self.work, self._limit = 0.0, _most_work(case) if solved else 0.0
        try:
            self._base = self._run(self.case, "all effects") if solved else None
        except RefusedError as error:
            raise InputError(
                f"{case.name}: effects.auto: the probe has no static state ({self._why(error)}); "
                "expected one that can be probed: remove effects.auto, and every effect acts as "
                "written"
            ) from None

    def _why(self, error: RefusedError) -> str:
        """Why a probe has no state, without its name and remedies."""
        return str(error).removeprefix(f"{self.case.name}: ").partition("; expected")[0]

    def _run(self, case: Case, what: str) -> State | None:
        """Solve a probe within the work that is left; None where it takes more."""
        self._told(what)
        with budget(self._limit - self.work) as spent:
            try:
                return solve_probe(case)
            finally:
                self.work += spent.seconds

    def _changed(self, effects: Collection[EffectName]) -> Change | None:
        """What the probe's answer changes without some effects; None where it takes too much."""
        case = self.case
        for effect in effects:
            case = without_effect(case, effect)
        names = ", ".join(effect.replace("_", " ") for effect in effects)
        without = None if self._base is None else self._run(case, f"without {names}")
        if self._base is None or without is None:
            return None
        return change(quantities_of(self._base), quantities_of(without))

    def within(self, left_out: list[Decision], tolerance: float) -> bool:
        """Whether the probe without some effects is within the tolerance of the one with them."""
        solved = [d.effect for d in left_out if d.effect not in (*_DAMPING, _SLIDING)]
        total = sum(d.change.largest for d in left_out if d.change and d.effect not in solved)
        try:
            moved = self._changed(solved) if len(solved) > 1 else None
        except RefusedError:
            return False
        if len(solved) > 1 and moved is None:
            return False
        alone = (d.change for d in left_out if d.effect in solved)
        together = moved or next(alone, None)
        return total + (together.largest if together else 0.0) <= tolerance

    def decision(self, effect: EffectName) -> Decision:
        """What an effect changes; whether it is left out is decided for all of them together."""
        off = key_changes(self._full, without_effect(self._full, effect))
        if effect in _DAMPING:
            return self._damping(effect, off)
        if self._base is None:
            return Decision(effect, off, True, None, _TOO_DEAR)
        if effect is _SLIDING:
            return self._sliding(off, self._base)
        try:
            moved = self._changed((effect,))
        except RefusedError as error:
            return Decision(
                effect, off, True, None, f"no static state without it: {self._why(error)}"
            )
        return Decision(effect, off, True, moved, _TOO_DEAR if moved is None else "probe")

    def _sliding(self, off: tuple[KeyChange, ...], base: State) -> Decision:
        """Decide about finite sliding by the slip of the probe, which is static and small."""
        slips = largest_slip_share(base, self._full, self.case)
        if slips is None:
            return Decision(_SLIDING, off, True, None, "meshes that do not match need it")
        slip, share = slips
        words = f"surfaces slip by {slip:.2g} mm at most, {100 * share:.2g} % of a facet"
        return Decision(_SLIDING, off, True, Change(share, share, share), words)

    def _damping(self, effect: EffectName, off: tuple[KeyChange, ...]) -> Decision:
        """Decide about a viscous force: it is zero at rest, so no static state has it."""
        method, at_rest = self._full.method, Change(0.0, 0.0, 0.0)
        if isinstance(method, Static):
            return Decision(effect, off, False, at_rest, "zero at rest: a static run")
        assert isinstance(method, Explicit)
        if method.damped(moves=self._full.problem.motion is not None) == "static":
            return Decision(effect, off, False, at_rest, "zero at rest, where this run ends")
        reason = "this run is not driven to rest, so damping shapes its end"
        return Decision(effect, off, True, None, reason)
