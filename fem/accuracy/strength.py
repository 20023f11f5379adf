"""Load factors at first cracking and crushing: loads are scaled until a stress is a strength.

Contact is not linear in the load, so each factor is found by solving again, on the mesh of the
answer. Cracking is judged by the averaged tension. Crushing is judged by the contact pressure at a
point, which a mesh must resolve, and by the minimum principal stress at a point where the mesh
resolves it: by the larger one. A contact law is stiffer under a larger load: what nodes may hide of
a pressure is that at the factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from fem.accuracy.one_mesh import state_of
from fem.answer.measures import hidden_between_nodes, measures_of
from fem.element.material import one_strength
from fem.problem import Problem
from fem.state import State
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.solve import StaticOptions
from geometry.answer import Measure
from geometry.errors import RefusedError
from geometry.machine.work import LimitError

#: Measures that are compared with each strength, the largest counts.
JUDGED = {
    "tensile_strength": ("cracking_factor", ("sigma_1_averaged",)),
    "compressive_strength": ("crushing_factor", ("p_max_point", "sigma_3_min")),
}
#: Error bars under a factor times the loads, with the state there.
Bars = Callable[[float, State], Mapping[str, float]]
#: Why a factor is none.
_TOO_COARSE = "not resolved: under {:.2g} times the load the law is too stiff for this mesh"
#: Logarithm of strength over stress from which the last secant is followed without solving again
#: (it leaves out the curvature, about its square), and most loads that are tried.
_NEAR, _MOST = 0.03, 12
#: The same without any secant.
_SAME = 1e-6
#: Tension below this share of the largest stress is rounding.
_ROUNDING = 1e-9
#: Loads are scaled by this factor at most in one step.
_STRIDE = 10.0
#: Loads that differ by less than this factor have states from which each other's is found.
_NEARBY = 2.0


def strength_factors(
    problem: Problem,
    state: State,
    measures: Mapping[str, Measure],
    options: StaticOptions | None = None,
    bars: Bars | None = None,
) -> dict[str, Measure]:
    """Factors of all loads and the weight at first cracking and crushing, by name.

    Parameters
    ----------
    problem, state
        On one mesh, and its static state under the load as stated.
    measures
        Its measures with their error bars.
    options
        Of the solver.
    bars
        Error bars of measures under a factor times the loads, whose state is given: that of the
        factor is that of the stress there. None: factors have none.

    Returns
    -------
    dict[str, Measure]
        Empty where the material has no strength. A factor that is not found has a remark, and as
        its value the smallest factor that is not ruled out: NaN where no load is known to stay
        below the strength, infinity where no factor exists.

    Raises
    ------
    MaterialError
        Blocks of different strengths.
    """
    materials = [body.material for body in state.whole.bodies]
    strengths = {
        name: one_strength(name, (getattr(material, name) for material in materials))
        for name in JUDGED
    }
    if not any(strengths.values()):
        return {}
    store = FlexibilityStore()
    options = replace(options or StaticOptions(), once=True)

    last, solved = 1.0, {1.0: state}
    known: dict[float, Mapping[str, Measure]] = {1.0: measures}
    path_counts = state.whole.contact.friction is not None

    def at(factor: float) -> Mapping[str, Measure]:
        nonlocal last
        near = abs(math.log(factor / last)) < math.log(_NEARBY)
        start = solved[last].displacements if near and not path_counts else None
        result = state_of(problem, options, factor, store=store, start=start)
        last, solved[factor] = factor, result
        known[factor] = measures_of(result, hidden_between_nodes(result))
        return known[factor]

    def bar_at(factor: float, name: str) -> float | None:
        if bars is None:
            return None
        near = min(solved, key=lambda one: abs(math.log(factor / one)))
        if near == 1.0:
            return measures[name].error
        try:
            return bars(near, solved[near]).get(name)
        except RefusedError:  # no state there on another mesh, or a limit
            return None

    result = {}
    for name, strength in strengths.items():
        title, judged = JUDGED[name]
        if strength is not None:
            result[title] = _judged(state, known, judged, strength, (at, bar_at))
    return result


def _judged(
    state: State,
    known: Mapping[float, Mapping[str, Measure]],
    names: tuple[str, ...],
    strength: float,
    asked: tuple[Callable[[float], Mapping[str, Measure]], Callable[[float, str], float | None]],
) -> Measure:
    """Find the factor at which a measure reaches a strength [MPa].

    ``known`` are the measures of the factors that are solved; ``asked`` under a factor: measures,
    and the error bar of one.
    """
    at, bar_at = asked
    measures = known[1.0]
    if state.whole.supports.tables:
        return _not_found("supports move, and loads alone are scaled")
    there = [name for name in names if name in measures]
    usable = [name for name in there if measures[name].is_number]
    first, stress = measures[there[0]], _largest(measures, usable or there)
    stresses = [abs(m.value) for m in measures.values() if m.is_number and m.unit == "MPa"]
    tension = names[0] == "sigma_1_averaged"
    bound = stress.value + (stress.error or 0.0)
    small = tension and bound <= _ROUNDING * max(stresses, default=0.0)
    if first.resolved and (stress.value == 0.0 or small):
        return _none("none: no tension" if tension else "none: no stress")
    if not first.is_number:  # what others are on this mesh is no bound of it
        return _not_found(f"{there[0]} is not resolved on this mesh")
    try:
        begun = {
            f: _largest(of, usable)
            for f, of in known.items()
            if all(of[n].is_number for n in usable)
        }
        alike = {f: m for f, m in begun.items() if m.value > 0.0 or not tension}
        factor, reached = _scaled_until(
            strength, {1.0: stress} | alike, lambda f: _largest(at(f), usable)
        )
    except _BoundError as error:
        return _not_found(str(error), error.least)
    place = dict(reached.place or {})
    if stress.place is not None and place.get("blocks") != stress.place.get("blocks"):
        place["moved"] = True
    if state.whole.surfaces.clearance < 0.0:
        place["interference"] = True
    if not (reached.resolved and (stress.error is None or reached.is_number)):
        remark = _TOO_COARSE.format(factor)
        return Measure(factor, "times the load", place=place, remark=remark)
    bar = bar_at(factor, place["stress"]) if stress.error is not None else None
    if bar is not None:
        hidden = reached.error or 0.0
        bar = factor * abs(max(bar, hidden) / reached.value)
    return Measure(factor, "times the load", bar, place=place)


def _largest(measures: Mapping[str, Measure], names: Sequence[str]) -> Measure:
    """The measure of the largest size, with its name beside its place."""
    name = max(names, key=lambda one: abs(measures[one].value))
    found = measures[name]
    return replace(found, place={**(found.place or {}), "stress": name})


class _BoundError(RefusedError):
    """A strength that the search did not reach: on which side of which load it lies, and why."""

    def __init__(self, words: str, least: float) -> None:
        super().__init__(words)
        self.least = least
        """Smallest factor that is not ruled out; NaN where each load is one."""


def _scaled_until(
    strength: float, known: Mapping[float, Measure], at: Callable[[float], Measure]
) -> tuple[float, Measure]:
    """Factor at which the size of a stress is a strength, by secants in logarithms.

    ``known`` are stresses by load: the search begins at the largest load up to which all are below
    the strength, or at the smallest. A load without a state halves the steps. Where the stress
    falls while the load grows, or a limit is reached, the search ends: what lies beyond would not
    be first cracking.
    """
    solved = {load: abs(stress.value) for load, stress in sorted(known.items())}
    below = _below(strength, solved)
    factor, slope = (below[-1] if below else min(solved)), 1.0
    if len(below) > 1 and solved[factor] > solved[below[-2]] > 0.0:
        slope = _slope(solved, below[-2], factor)
    result = known[factor]
    stride, why = math.log(_STRIDE), f"{_MOST} loads were tried"
    for count in range(_MOST):
        short = math.log(strength / abs(result.value))
        step = min(max(short / slope, -stride), stride)
        tried = factor * math.exp(step)
        if abs(short) <= (_NEAR if count else _SAME):
            return tried, result
        try:
            after = at(tried)
        except LimitError as error:
            why = str(error)
            break
        except RefusedError as error:
            stride, why = 0.5 * abs(step), f"no static state at {tried:.4g} times the load: {error}"
            continue
        solved[tried] = abs(after.value)
        if (solved[tried] - solved[factor]) * step <= 0.0:
            why = "it does not grow with the load there"
            break
        slope = _slope(solved, factor, tried)
        factor, result = tried, after
    below = _below(strength, solved)
    least = below[-1] if below else math.nan
    raise _BoundError(f"{_bounds(strength, solved)} ({why})", least)


def _slope(solved: Mapping[float, float], one: float, other: float) -> float:
    """Logarithmic slope of the stress between two loads, within what a search can use."""
    slope = math.log(solved[other] / solved[one]) / math.log(other / one)
    return min(max(slope, 0.2), 5.0)


def _below(strength: float, solved: Mapping[float, float]) -> list[float]:
    """Loads from the smallest on up to which no stress is the strength, in their order."""
    above = min((load for load, stress in solved.items() if stress >= strength), default=math.inf)
    return sorted(load for load in solved if load < above)


def _bounds(strength: float, solved: Mapping[float, float]) -> str:
    """Say between which loads a stress may be a strength, from the stresses by load [MPa]."""
    below = _below(strength, solved)
    above = min((load for load, stress in solved.items() if stress >= strength), default=None)
    if not below:
        return f"below {above:.4g} times the load: at that the stress is more than {strength:g} MPa"
    if above is not None:
        return f"between {below[-1]:.4g} and {above:.4g} times the load"
    most = max(solved.values())
    return (
        f"above {below[-1]:.4g} times the load, if at all: up to that the stress is at most "
        f"{most:.3g} of {strength:g} MPa"
    )


def _none(why: str) -> Measure:
    """No load reaches the strength."""
    return Measure(math.inf, "times the load", remark=why)


def _not_found(why: str, least: float = math.nan) -> Measure:
    """Say why a factor is not found; ``least`` is the smallest that is not ruled out."""
    return Measure(least, "times the load", remark=f"not found: {why}")
