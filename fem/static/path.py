"""The path to a static state: parts of the load, motions of supports, changes of both in a stage.

Each of its points is an equilibrium that begins at the one before. The history of friction, where
the model has it, advances from point to point. Points of a search follow the motion until they
stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from fem.contact.search import FacingPoints, SearchedPoints
from fem.state import Evidence, State
from fem.static.linear_step.linearisation import SparseSolver, StaticError
from fem.static.newton import (
    Iterate,
    StaticProblem,
    bounded,
    frictions,
    held_in_motion,
    newton,
    support_forces,
)
from fem.system.forces import TabularAmplitude
from fem.system.system import System, unresisted_motions
from geometry.errors import is_number
from geometry.mesh import FloatArray, IntArray

#: Change of the measures by twice as many load steps below which they are enough [-].
LOAD_TOLERANCE = 0.01
#: Residual of a body without contact that is round-off: its equilibrium is one linear solution.
_ROUND_OFF = 1e-6
#: Residual of an intermediate load step above which its slips are no usable history: load steps are
#: doubled then. Blocks that hardly touch yet under a hundredth of the load may not come to
#: the tolerance, which is of all of it.
_HISTORY = 1e-2
#: Share of the time of all motions below which a step is cut no more.
_SHORTEST = 1e-4
#: Searches for one load step at most, and the motion after the last one that no cut needs to
#: follow [skins]: pressures at edges where surfaces end change in proportion to it, by a sixth.
_MAX_SEARCHES = 12
_FOLLOWED = 1e-6
#: The same in load steps before the last one, of which only slips remain [motion of the step].
_ON_THE_WAY = 0.02
#: Searches in a row that may bring no motion shorter than this share of one before: points at edges
#: where surfaces end then come and go, and further searches lead around.
_AROUND = 2
_SHORTER = 0.9
#: Searches along the motion of loose blocks, for each joint that they find.
_MAX_TRIES = 2


#: Holding springs where a state is known, relative to the first ones.
_SOON_HELD = 1e-3
#: Load factors, and displacements of each group there, (n_copies, n_nodes, 3) [mm].
Known = Sequence[tuple[float, tuple[FloatArray, ...]]]
#: Share of the loads and time of a point of a path; None: no support moves.
Target = tuple[float, float | None]


class StaticMethod(StrEnum):
    """How the linear problems are solved."""

    CONDENSED = "condensed"
    """In contact forces, with one dense flexibility per shape
    (`fem.static.linear_step.condensed`)."""
    SPARSE = "sparse"
    """One sparse matrix of everything, factored by a library: slower, the oracle."""


@dataclass(frozen=True)
class StaticOptions:
    """How a static problem is solved."""

    method: StaticMethod = StaticMethod.CONDENSED
    """How the linear problems are solved."""
    sparse_solver: SparseSolver | None = None
    """Library of the sparse method; None: the best that is installed."""
    symmetry: int | None = None
    """Order of the cyclic sector model; None: the largest exact one; 1: none."""
    tolerance: float = 1e-8
    """Norm of the residual over norm of the loads at which the iteration stops [-]."""
    max_iterations: int = 120
    """Linear problems solved at most for one load step."""
    load_steps: int = 1
    """Parts in which the load is applied: equal ones, with friction as `load_factors` says."""
    load_tolerance: float | None = None
    """With friction the parts are doubled until that changes displacements and pressures by less
    [-]; None: they stay as they are, and so they do from a given start."""
    motion_steps: int | None = 20
    """Parts of the way of supports that move, after the load; the times of their tables come on
    top. None: all their way at once, with the load."""
    once: bool = False
    """Whether what does not converge is given up, not tried in smaller load steps."""

    def __post_init__(self) -> None:
        if not (is_number(self.tolerance) and self.tolerance > 0.0):
            raise StaticError(f"fem.tolerance: got {self.tolerance!r}, expected a positive number")
        change = self.load_tolerance
        if change is not None and not (math.isfinite(change) and change > 0.0):
            raise StaticError(f"fem.load_tolerance: got {change}, expected a positive number")
        for name in ("max_iterations", "load_steps", "motion_steps"):
            if getattr(self, name) is not None and getattr(self, name) < 1:
                raise StaticError(f"fem.{name}: got {getattr(self, name)}, expected at least 1")


def follow(
    problem: StaticProblem,
    state: Iterate,
    path: Sequence[Target],
    *,
    known: Known = (),
    search: PointSearch | None = None,
) -> list[State]:
    """Find the states at the points of a path, one after the other; those of a motion are cut.

    A step starts where fewer parts of the load led to, or else where the one before leads to, if
    loads grow or supports go on as before: contact laws are stiff over lengths that are far shorter
    than a step. Steps of a motion that fail are halved; where the shortest has no equilibrium
    either, what was reached before is an answer.

    Parameters
    ----------
    problem, state
        The problem, and where the path begins.
    path
        Share of the loads and time of each point.
    known
        States under some loads that are nearly equilibria.
    search
        Points that follow the motion; None: facets stay matched.

    Returns
    -------
    list[State]
        One for each point that was reached, at least one; the last one may be no equilibrium, or
        tell when it `stopped` (`fem.state.Evidence`).
    """
    found, ahead = list[State](), list(path[::-1])
    shortest = _SHORTEST * (path[-1][1] or 0.0)
    rate: FloatArray | None = None
    done: Target | None = None if state.displacement.any() else (0.0, None)
    while ahead:
        aim = factor, moment = ahead.pop()
        begin, length = state.displacement, _length(done, aim)
        leads = length > 0.0 and bool(moment) == bool(done and done[1])
        way = length * rate if leads and rate is not None else None
        guess = _guess(problem, state, aim, way, known)
        middle = 0.5 * (state.load_factor + factor), 0.5 * ((state.time or 0.0) + (moment or 0.0))
        shorter = bool(moment) and middle[1] - (state.time or 0.0) >= shortest
        try:
            there, reached, goes_on = _equilibrium(problem, guess, begin, search)
        except StaticError:
            if not (shorter or any(s.time is not None and s.converged for s in found)):
                raise
            there, reached, goes_on = problem, guess, False
        if moment and not reached.converged:
            tried = reached.residuals[len(state.residuals) :]
            residuals = (*state.residuals[:-1], *tried, *state.residuals[-1:])
            state = replace(state, residuals=residuals)
            if shorter:
                ahead += [aim, middle]
                continue
            if any(s.time and s.converged for s in found):
                stopped = replace(found[-1].evidence, residuals=residuals, stopped=moment)
                return [*found[:-1], replace(found[-1], evidence=stopped)]
            return [*found, state_at(there, reached)]
        rate = (reached.displacement - begin) / length if length > 0.0 else None
        problem, state, done = there, reached, aim
        found.append(state_at(problem, state))
        if not goes_on:
            break
    return found


def _guess(
    problem: StaticProblem, state: Iterate, aim: Target, way: FloatArray | None, known: Known
) -> Iterate:
    """Where the iteration to the next point begins: a known state, or a ``way`` [mm] further on."""
    factor, moment = aim
    guess = replace(state, load_factor=factor, time=moment, converged=False)
    if moment or way is not None:
        pressures = problem.system.law.normal.pressure(state.gaps.overclosure)
        more = 1.0 if moment else factor / state.load_factor
        guess = replace(guess, pressed=more * float(pressures.max(initial=0.0)))
    if moment and not problem.system.has_friction:
        guess = held_in_motion(problem, guess)
    above = [(load, u) for load, u in known if load >= factor and not moment]
    if above:
        near = min(above, key=lambda one: one[0])[1]
        holding = min(guess.holding, _SOON_HELD * guess.first_holding)
        guess = replace(guess, holding=holding, pressed=None)
        way = problem.step.kept(problem.system.localised(near)) - state.displacement
    return guess if way is None else _led_on(problem, guess, way)


def state_at(problem: StaticProblem, last: Iterate) -> State:
    """State of all nodes from the last iterate of a point of a path."""
    system = problem.system
    displacement = problem.step.complete(last.displacement, last.load_factor)
    whole = unresisted_motions(system)
    if whole is not None:
        displacement = whole.without(displacement)
    return State(
        system=system,
        displacement=displacement,
        friction=frictions(problem, last),
        anchor=last.anchor,
        support_force=support_forces(problem, last) if len(system.held.nodes) else None,
        load_factor=last.load_factor,
        time=last.time,
        frictional_dissipation=last.dissipation,
        evidence=Evidence(residuals=last.residuals, converged=last.converged),
    )


def _equilibrium(
    problem: StaticProblem,
    state: Iterate,
    begin: FloatArray,
    search: PointSearch | None,
) -> tuple[StaticProblem, Iterate, bool]:
    """Take a state, or a guess of it, to its own point of the path from that before, at ``begin``.

    Also returns whether the next one may follow.
    """
    if search is not None:
        return search.equilibrium(problem, state, begin)
    reached = newton(problem, state)
    if not reached.gaps.x.size:  # linear: what more steps change is the round-off of slender blocks
        within = reached.residuals[-1] <= _ROUND_OFF
        return problem, replace(reached, converged=reached.converged or within), True
    if problem.system.has_friction and reached.residuals[-1] > _HISTORY:
        # What follows would start from a history that no equilibrium has.
        return problem, reached, False
    return problem, _advance_friction(problem, reached, begin), True


def _length(done: Target | None, aim: Target) -> float:
    """How much a step adds to the load, or to the time [s]; 0: the step before leads nowhere."""
    if aim[1]:
        return aim[1] - ((done[1] if done else None) or 0.0)
    return max(aim[0] - done[0], 0.0) if done else 0.0


def _led_on(problem: StaticProblem, state: Iterate, way: FloatArray) -> Iterate:
    """Move a state by displacements (n_nodes, 3) [mm], if supports are there where they should be.

    Contact is linearised where it then is.
    """
    displacement = state.displacement + way
    if not problem.system.held.met(displacement, state.time):
        return state
    gaps = problem.system.points.gaps(displacement)
    at = bounded(problem, state, gaps.x)
    return replace(state, displacement=displacement, gaps=gaps, at=at)


def load_factors(parts: int, *, friction: bool) -> tuple[float, ...]:
    """Load factors at the ends of the load steps, the last one 1.

    Without friction the way to the load does not matter, and the parts are equal. With friction
    most of the history lies under small loads, where contact by an exponential law is soft and
    blocks make most of their motion: factors are squares, so that four steps do what sixteen equal
    ones did.
    """
    power = 2 if friction else 1
    return tuple((k / parts) ** power for k in range(1, parts + 1))


def points_of(system: System, options: StaticOptions) -> list[Target]:
    """Load factor and time at the end of each step: the load first, then motions of supports.

    Without supports that move there is no time.
    """
    moving, steps = system.held.moving, options.motion_steps
    requested = load_factors(options.load_steps, friction=system.has_friction)
    if not moving or steps is None:
        return [(factor, None) for factor in requested]
    tables = [np.array(share.times) for share, _ in moving if isinstance(share, TabularAmplitude)]
    end = max((float(times[-1]) for times in tables), default=1.0)
    times = np.unique(np.concatenate([end * np.arange(1, steps + 1) / steps, *tables]))
    before = [(factor, 0.0) for factor in requested] if system.external_force.any() else []
    return [*before, *((1.0, time) for time in times[times > 0.0].tolist())]


@dataclass
class PointSearch:
    """Points that follow the motion along a path."""

    points: FacingPoints
    anew: Callable[[StaticProblem, Iterate], tuple[StaticProblem, Iterate]]
    """Problem and state on the points of the place that a state has."""
    elastic: ElasticSlips
    """Elastic slips where the next step begins."""
    begin: FloatArray | None
    """Displacements from which slips of the first step count, on points that are searched there,
    (n_nodes, 3) [mm]; None: a step came before."""

    def equilibrium(
        self, problem: StaticProblem, state: Iterate, begin: FloatArray
    ) -> tuple[StaticProblem, Iterate, bool]:
        """Find an equilibrium whose points are those of its own place, as `_equilibrium`."""
        points, begin = self.points, begin if self.begin is None else self.begin
        aim, joints, tries = (state.load_factor, state.time), 0, _MAX_TRIES
        least, around = math.inf, 0
        for search in range(_MAX_SEARCHES):
            if search or self.begin is None:
                problem, state = self.anew(problem, state)
            if _n_joints(problem) > joints:
                joints, tries = _n_joints(problem), _MAX_TRIES
            state = replace(
                state,
                load_factor=aim[0],
                time=aim[1],
                anchor=self.elastic.anchor(problem, points, begin),
                converged=False,
            )
            before = state.displacement
            state = newton(problem, state)
            moved = float(np.abs(state.displacement - before).max())
            if not state.converged and aim[1] is None and moved > points.skin and tries:
                # Where blocks move to, others may stop them.
                reached = points.farthest / max(moved, points.farthest)
                on_the_way = before + reached * (state.displacement - before)
                state, tries = replace(state, displacement=on_the_way), tries - 1
                continue
            least, around = (moved, 0) if moved < _SHORTER * least else (least, around + 1)
            enough = _FOLLOWED * points.skin
            if problem.system.has_friction and aim[0] < 1.0 and search:
                way = float(np.abs(state.displacement - begin).max())
                enough = max(enough, _ON_THE_WAY * way)
            settled = 2.0 * moved <= enough
            if not state.converged or settled or (around >= _AROUND and 2.0 * moved <= points.skin):
                break
        self.begin = None
        if not state.converged or 2.0 * moved > points.skin:
            return problem, replace(state, converged=False), False
        state = _advance_friction(problem, state, begin)
        self.elastic = ElasticSlips.of(problem, points, state)
        return problem, state, True


@dataclass(frozen=True)
class ElasticSlips:
    """Elastic slips at the end of a load step, on the points that then were."""

    slave: IntArray
    shapes: FloatArray
    slip: FloatArray
    """World axes, in the order of the search, (n, 3) [mm]."""

    @classmethod
    def none(cls, points: FacingPoints) -> ElasticSlips:
        """Before any load."""
        result = points.now
        return cls(result.slave.copy(), result.shapes.copy(), np.zeros((points.count, 3)))

    @classmethod
    def of(cls, problem: StaticProblem, points: FacingPoints, state: Iterate) -> ElasticSlips:
        """After the anchors have moved."""
        result, surfaces = cls.none(points), _searched(problem)
        if problem.system.has_friction:
            slip = (state.gaps.x[..., 1:] - state.anchor)[:, 0]
            result.slip[surfaces.order] = np.einsum("nk,nki->ni", slip, surfaces.sides[:, 0])
        return result

    def anchor(self, problem: StaticProblem, points: FacingPoints, begin: FloatArray) -> FloatArray:
        """Anchors on the present points: their slip at the start of the step less the elastic."""
        surfaces = _searched(problem)
        if not problem.system.has_friction:
            return np.zeros((*surfaces.weights.shape, 0))
        slip = problem.system.points.gaps(begin).x[..., 1:]
        carried = points.carried(self.slave, self.shapes, self.slip)[surfaces.order]
        return slip - np.einsum("npki,ni->npk", surfaces.sides, carried)


def _n_joints(problem: StaticProblem) -> int:
    """Pairs of blocks that face each other at some point."""
    return len(problem.system.points.pair_start) - 1


def _searched(problem: StaticProblem) -> SearchedPoints:
    surfaces = problem.system.points
    assert isinstance(surfaces, SearchedPoints)
    return surfaces


def _advance_friction(problem: StaticProblem, state: Iterate, begin: FloatArray) -> Iterate:
    """Move the anchors at the end of a load step, and count the work lost on their way.

    An anchor moves only while a point slides, at the limit of its traction: that goes along with
    the pressure from the beginning to the end, in the mean. A point that lifts off loses half of
    what it had.
    """
    if not problem.system.has_friction:
        return state
    law, anchor = problem.system.law, state.anchor
    first, _ = law.tractions(problem.system.points.gaps(begin).x, anchor)
    last, moved = law.tractions(state.gaps.x, anchor)
    before, pressure, touching = first[..., 0], last[..., 0], last[..., 0] > 0.0
    mean = 0.5 + 0.5 * np.divide(before, pressure, out=np.zeros_like(pressure), where=touching)
    resisting = np.where(touching[..., None], mean[..., None] * last, 0.5 * first)[..., 1:]
    lost = problem.system.points.weights * ((moved - anchor) * resisting).sum(axis=2)
    times = problem.system.orbits.times(problem.system.points)
    total = state.dissipation + float((times * lost).sum())
    return replace(state, anchor=moved, dissipation=total)
