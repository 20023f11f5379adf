"""`[effects] auto`: say which effects of a scene matter, and simulate only those.

A probe answers: the scene as a static problem on a coarse mesh, all candidates in it, then one
of them left out at a time. An effect goes when that changes p_max, p_eff and the largest
displacement by less than half the tolerance (a probe is not the run), and when what goes
together changes no more than that either. Nothing goes silently: the decision is part of the
result.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

from rich.table import Table

from fem.solution import largest_slip
from fem.static.linear_step.condensed import FlexibilityStore
from geometry.errors import RefusedError
from validation.build.deformable import build_deformable, fem_section
from validation.effects.probe import (
    Answer,
    Change,
    Solved,
    change,
    largest_rotation,
    mesh_words,
    probe_scene,
    refinement,
    solve_probe,
    without_finite_rotation,
)
from validation.errors import InputError
from validation.output.console import listing
from validation.scene.deformable import AutoSection, Damping, EffectName, Method
from validation.scene.family import AssemblyScene
from validation.scene.read import DeformableScene

#: An effect is left out when the probe's change is below the tolerance over this.
MARGIN = 2.0

#: Effects that are on or off, without a value.
_SWITCHES = (EffectName.ELASTIC_FRAME, EffectName.FINITE_ROTATION, EffectName.FINITE_SLIDING)
#: Effects that ``[contact]`` names.
_GAPS = (EffectName.CLEARANCE, EffectName.SPACING)
#: Effects that only a motion has.
_DAMPING = (EffectName.RAYLEIGH, EffectName.BULK_VISCOSITY)
#: Effects of large motions, which the probe leaves out and judges from its motion.
_MOTIONS = (EffectName.FINITE_ROTATION, EffectName.FINITE_SLIDING)


@dataclass(frozen=True)
class Decision:
    """What was decided about one effect."""

    effect: EffectName
    setting: str
    """Its value, as the scene gives it."""
    simulated: bool
    """Whether the run has it."""
    change: Change | None
    """Of the probe's answer when it is left out; None where no number decides."""
    reason: str
    """How it was decided, in words."""
    cpu_seconds: float
    """Of its probe [s]."""


@dataclass(frozen=True)
class EffectsDecision:
    """Which effects a run has, and why."""

    tolerance: float
    """Of p_max, p_eff and the largest displacement, relative [-]."""
    decisions: tuple[Decision, ...]
    """One for each candidate."""
    as_written: tuple[EffectName, ...]
    """Effects that the scene fixes and the run has."""
    together: Change | None
    """Change when all that is left out by the probe goes at once; None where nothing goes."""
    probe: str
    """What was solved."""
    cpu_seconds: float
    """Of all probes [s]."""

    @property
    def left_out(self) -> tuple[EffectName, ...]:
        """Effects that the run does not have."""
        return tuple(d.effect for d in self.decisions if not d.simulated)

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
    return scene.changed({f"effects.{effect}": False if effect in _SWITCHES else None})


def candidates(scene: DeformableScene, name: str, auto: AutoSection) -> tuple[EffectName, ...]:
    """Return the effects to decide.

    Raises
    ------
    InputError
        For effects to decide that have no value in the scene.
    """
    if auto.decide is not None:
        for effect in auto.decide:
            if effect not in _SWITCHES and not has_effect(scene, effect):
                raise InputError(
                    f"{name}: effects.auto.decide names {effect}, which has no value in the scene; "
                    "expected its value beside it, or another list"
                )
        return auto.decide
    explicit = scene.fem.method is Method.EXPLICIT
    found = []
    for effect in EffectName:
        if effect in auto.keep:
            continue
        if effect in _SWITCHES:
            written = effect in scene.effects.model_fields_set
            stands = isinstance(scene, AssemblyScene) and scene.stands
            useless = effect is EffectName.ELASTIC_FRAME and stands
            impossible = effect is EffectName.FINITE_SLIDING and not explicit
            if not (written or useless or impossible):
                found.append(effect)
        elif has_effect(scene, effect):
            found.append(effect)
    return tuple(found)


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


def decide_effects(
    scene: DeformableScene,
    name: str,
    *,
    told: Callable[[str], None] | None = None,
) -> tuple[DeformableScene, EffectsDecision]:
    """Decide which effects of a scene with ``effects.auto`` matter, and tell what is probed next.

    Returns the scene with what matters and nothing to decide, and the decision.

    Raises
    ------
    InputError
        A probe that has no solution, or an effect that matters and that the method does not have.
    """
    auto = scene.effects.auto or AutoSection()
    plain = scene.changed({"effects.auto": None})
    fem = fem_section(plain, name)
    names = candidates(plain, name, auto)
    start = time.process_time()
    probe = _Probe(plain, name, auto.tolerance, names, told or (lambda _: None))
    decisions = probe.decide()
    left_out = {d.effect for d in decisions if not d.simulated}
    decided = plain
    for effect in names:
        if effect in left_out:
            decided = without_effect(decided, effect) if has_effect(decided, effect) else decided
        elif effect in _SWITCHES:
            decided = with_effect(decided, effect)
    if fem.method is Method.STATIC:
        _refuse_motion(name, decisions, auto.tolerance)
    fixed = tuple(e for e in EffectName if e not in names and has_effect(plain, e))
    found = EffectsDecision(
        tolerance=auto.tolerance,
        decisions=decisions,
        as_written=fixed,
        together=probe.together,
        probe=f"static, {mesh_words(probe.scene)}",
        cpu_seconds=time.process_time() - start,
    )
    return decided, found


def _refuse_motion(name: str, decisions: Iterable[Decision], tolerance: float) -> None:
    """Refuse a static run where sliding matters, which only explicit runs have."""
    for decision in decisions:
        if decision.simulated and decision.effect is EffectName.FINITE_SLIDING:
            assert decision.change is not None
            raise InputError(
                f"{name}: effects.auto: {decision.effect} changes the answer by "
                f"{100 * decision.change.largest:.2g} % (tolerance {100 * tolerance:.3g} %) and a "
                'static run does not have it; set fem.method = "explicit", or '
                f"effects.{decision.effect} = false to leave it out all the same"
            )


class _Probe:
    """The runs that decide."""

    def __init__(
        self,
        scene: DeformableScene,
        name: str,
        tolerance: float,
        names: tuple[EffectName, ...],
        told: Callable[[str], None],
    ) -> None:
        self._whole, self._name = scene, name
        self._bound = tolerance / MARGIN
        self._names, self._told = names, told
        self.scene = probe_scene(scene, name)
        self.together: Change | None = None
        self._store = FlexibilityStore()

    def decide(self) -> tuple[Decision, ...]:
        """Decide about all candidates."""
        by_law = [self._damping(e) for e in self._names if e in _DAMPING]
        full, refused = self._with_all()
        others = {*_DAMPING, *_MOTIONS, *(d.effect for d in refused)}
        solved = [e for e in self._names if e not in others]
        motions = [e for e in self._names if e in _MOTIONS]
        if not solved and not motions:
            return self._in_order([*by_law, *refused])
        self._told("all effects")
        everything = solve_probe(full, self._name, self._store)
        decisions = [self._solved(e, full, everything.answer) for e in solved]
        estimated = [self._motion(e, everything) for e in motions]
        decisions = self._jointly(full, everything.answer, decisions, estimated)
        return self._in_order([*by_law, *refused, *decisions, *estimated])

    def _in_order(self, decisions: list[Decision]) -> tuple[Decision, ...]:
        return tuple(sorted(decisions, key=lambda d: self._names.index(d.effect)))

    def _with_all(self) -> tuple[DeformableScene, list[Decision]]:
        """Probe with every candidate in it, and decisions about those that it cannot have."""
        full, refused = self.scene, []
        elastic = EffectName.ELASTIC_FRAME
        if elastic in self._names and not has_effect(full, elastic):
            try:
                build_deformable(with_effect(full, elastic), self._name)
                full = with_effect(full, elastic)
            except RefusedError as error:
                reason = f"not possible here: {error}"
                refused.append(self._decision(elastic, None, reason, simulated=False))
        return full, refused

    def _decision(
        self,
        effect: EffectName,
        moved: Change | None,
        reason: str,
        cpu: float = 0.0,
        *,
        simulated: bool = True,
    ) -> Decision:
        """Decide by a change; where there is none, as is said."""
        if moved is not None:
            simulated = moved.largest > self._bound
        setting = setting_words(self._whole, effect)
        return Decision(effect, setting, simulated, moved, reason, cpu)

    def _solved(self, effect: EffectName, full: DeformableScene, reference: Answer) -> Decision:
        """Decide about an effect by the probe without it."""
        self._told(f"without {effect}")
        start = time.process_time()
        try:
            without = solve_probe(without_effect(full, effect), self._name, self._store)
        except RefusedError:
            reason = "without it the probe has no static state"
            return self._decision(effect, None, reason, time.process_time() - start)
        moved = change(reference, without.answer)
        return self._decision(effect, moved, "probe with and without it", without.cpu_seconds)

    def _damping(self, effect: EffectName) -> Decision:
        """Decide about a viscous force: it is zero at rest, so no static state has it."""
        fem, at_rest = self._whole.fem, Change(0.0, 0.0, 0.0)
        if fem.method is Method.STATIC:
            return self._decision(effect, at_rest, "zero at rest: a static run")
        if fem.damping is Damping.STATIC:
            return self._decision(effect, at_rest, "zero at rest, where this run ends")
        reason = "this run is not driven to rest, so damping shapes its end"
        return self._decision(effect, None, reason)

    def _motion(self, effect: EffectName, run: Solved) -> Decision:
        """Decide about an effect of large motions from the motion of the probe."""
        start = time.process_time()
        if effect is EffectName.FINITE_ROTATION:
            self._told(f"without {effect}")
            angle = largest_rotation(run)
            moved = without_finite_rotation(run, self._name, self._store)
            words = f"probe with and without it; blocks turn by {angle:.2g} rad at most"
        else:
            result = run.result
            pressures = result.pressures.max(axis=1)
            slip, size = largest_slip(run.deformable, result.displacements, pressures)
            size /= refinement(self._whole, self.scene)
            share = slip / size
            moved = Change(share, share, share)
            words = f"surfaces slip by {slip:.2g} mm at most, {100 * share:.2g} % of a facet"
        return self._decision(effect, moved, words, time.process_time() - start)

    def _jointly(
        self,
        full: DeformableScene,
        reference: Answer,
        decisions: list[Decision],
        estimated: list[Decision],
    ) -> list[Decision]:
        """Put effects back, the largest first, until what goes together is small enough."""
        unseen = [c for _, c in _gone(estimated)]
        further = sum(c.largest for c in unseen)
        while gone := _gone(decisions):
            moved = gone[0][1]
            if len(gone) > 1:
                self._told("without all that seems not to matter")
                scene = full
                for decision, _ in gone:
                    scene = without_effect(scene, decision.effect)
                moved = change(reference, solve_probe(scene, self._name, self._store).answer)
            if moved.largest + further <= self._bound:
                self.together = moved
                return decisions
            worst, _ = max(gone, key=lambda one: one[1].largest)
            reason = f"{worst.reason}; small alone, too much together with the others"
            kept = replace(worst, simulated=True, reason=reason)
            decisions = [kept if d is worst else d for d in decisions]
        if unseen:
            self.together = Change(*map(sum, zip(*(c.values for c in unseen), strict=True)))
        return decisions


def _gone(decisions: list[Decision]) -> list[tuple[Decision, Change]]:
    """What is left out by a change, and that change."""
    return [(d, d.change) for d in decisions if not d.simulated and d.change is not None]


# ---------------------------------------------------------------------------------------------
# Text


def decision_table(name: str, found: EffectsDecision) -> Table:
    """Return one row for each candidate, and what was decided."""
    title = (
        f"{name}: effects that matter beyond {100 * found.tolerance:.3g} % (left out below half "
        f"of it; probe: {found.probe}, {found.cpu_seconds:.2g} CPU s in all)"
    )
    heads = ("effect", "value", "p_max", "p_eff", "u", "decision", "by", "CPU s")
    table = listing(title, *heads)
    for d in found.decisions:
        table.add_row(
            d.effect.replace("_", " "),
            d.setting,
            *_columns(d.change),
            "simulated" if d.simulated else "left out",
            d.reason,
            f"{d.cpu_seconds:.2f}",
        )
    for effect in found.as_written:
        name_of = effect.replace("_", " ")
        table.add_row(name_of, "", *_columns(None), "simulated", "as the scene says", "")
    if found.together is not None:
        table.add_row("all that is left out", "", *_columns(found.together), "", "together", "")
    return table


def _columns(found: Change | None) -> tuple[str, ...]:
    """Return a change as text."""
    if found is None:
        return ("–",) * 3
    return tuple("0" if value == 0.0 else f"{100 * value:+.2g} %" for value in found.values)
