"""The path to a static state: parts of the load, motions of supports, changes of both in a stage.

Each of its points is an equilibrium that begins at the one before. The history of friction, where
the model has it, advances from point to point. Points of a search follow the motion until they
stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fem.contact.search import FacingPoints, SearchedPoints, points_of_search
from fem.state import Evidence, State
from fem.static.linear_step.linearisation import StaticError
from fem.static.newton import (
    Iterate,
    PathPoint,
    Slid,
    bounded,
    frictions,
    held_in_motion,
    newton,
    start_iterate,
    support_forces,
)
from fem.static.problem import StaticOptions, StaticProblem
from fem.system.loose import unresisted_motions
from fem.system.rows import TabularAmplitude
from fem.system.system import Sector
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
#: Load factors, and displacements of each body there, (n_copies, n_nodes, 3) [mm].
Known = Sequence[tuple[float, tuple[FloatArray, ...]]]


@dataclass(frozen=True)
class _Place:
    """Where a path has come to."""

    problem: StaticProblem
    iterate: Iterate
    since: PathPoint | None = None
    """The same point of the path; None: the next step goes on from no other."""
    rate: FloatArray | None = None
    """Displacements by load or time of the step before, (n_nodes, 3)."""
    usable: bool = True
    """Whether another point may follow."""

    def state(self) -> State:
        """State of all nodes."""
        problem, system, last = self.problem, self.problem.system, self.iterate
        displacement = problem.step.complete(last.displacement, last.point.factor)
        whole = unresisted_motions(system)
        if whole is not None:
            displacement = whole.without(displacement)
        return State(
            system=system,
            displacement=displacement,
            friction=frictions(problem, last),
            support_force=support_forces(problem, last) if len(system.held.nodes) else None,
            load_factor=last.point.factor,
            time=last.point.time,
            evidence=Evidence(last.residuals, last.converged, last.slid.dissipation),
        )


def follow(
    problem: StaticProblem,
    state: Iterate,
    path: Sequence[PathPoint],
    *,
    stages: Sequence[Sector] = (),
    known: Known = (),
    search: PointSearch | None = None,
) -> list[State]:
    """Find the states at the points of a path, one after the other; those of a motion are cut.

    Steps of a motion that fail are halved; where the shortest has no equilibrium either, what was
    reached before is an answer.

    Parameters
    ----------
    problem, state
        The problem, and where the path begins.
    path
        Its points.
    stages
        What acts in each of several stages.
    known
        States under some loads that are nearly equilibria.
    search
        Points that follow the motion; None: facets stay matched.

    Returns
    -------
    list[State]
        One for each point that was reached, at least one; the last one may be no equilibrium, or
        tell when it `stopped` (`fem.state.Evidence`).

    Raises
    ------
    StaticError
        A point of several stages has no equilibrium.
    """
    found, ahead = list[State](), list(path[::-1])
    place = _Place(problem, state, None if state.displacement.any() else PathPoint(0.0))
    while ahead and place.usable:
        aim = ahead.pop()
        if aim.stage > place.iterate.point.stage:
            place = _entered(place, found[-1], stages[aim.stage], aim.stage)
        begin = place.iterate.point
        middle = _middle(begin, aim, _SHORTEST * (path[-1].time or 0.0))
        there = _step(place, aim, known, search, may_fail=bool(middle or begin.time))
        if there.iterate.converged or not aim.time:
            place = there
            found.append(place.state())
            continue
        residuals = _with_tried(place.iterate.residuals, there.iterate.residuals)
        place = replace(place, iterate=replace(place.iterate, residuals=residuals))
        if middle is not None:
            ahead += [aim, middle]
        elif stages:
            raise StaticError(
                f"static: no equilibrium was found at {aim.factor:.3g} of stage {aim.stage + 1} of "
                f"{len(stages)}; the one before is at {begin.factor:.3g}"
            )
        elif begin.time:
            stopped = replace(found[-1].evidence, residuals=residuals, stopped=aim.time)
            return [*found[:-1], replace(found[-1], evidence=stopped)]
        else:
            return [*found, there.state()]
    return found


def _entered(place: _Place, last: State, stage: Sector, number: int) -> _Place:
    """Where a stage begins: slips of friction stay, and supports that ended release."""
    before, system = place.iterate, place.problem.system
    changed = replace(stage, begin=(last.displacement, system.loads[-1]))
    problem = place.problem.on(changed.on(system.points))
    start = start_iterate(problem.system, problem.step.kept(last.displacement))
    point = PathPoint(0.0, 0.0, number)
    start = replace(start, slid=before.slid, point=point, residuals=before.residuals)
    return _Place(problem, start)


def _middle(begin: PathPoint, aim: PathPoint, shortest: float) -> PathPoint | None:
    """Where a step of a motion is cut; None: no further, or it is none."""
    time = 0.5 * ((begin.time or 0.0) + (aim.time or 0.0))
    if not aim.time or time - (begin.time or 0.0) < shortest:
        return None
    return PathPoint(0.5 * (begin.factor + aim.factor), time, aim.stage)


def _with_tried(before: tuple[float, ...], after: tuple[float, ...]) -> tuple[float, ...]:
    """Residuals after iterations that led nowhere: the last is that of the state before."""
    return (*before[:-1], *after[len(before) :], *before[-1:])


def _step(
    place: _Place, aim: PathPoint, known: Known, search: PointSearch | None, *, may_fail: bool
) -> _Place:
    """Take one step; one that fails leads to no equilibrium.

    It starts where fewer parts of the load led to, or else where the one before leads to, if loads
    grow or supports go on as before: contact laws are stiff over lengths that are far shorter than
    a step.
    """
    problem, before, since = place.problem, place.iterate, place.since
    length = aim.time - ((since and since.time) or 0.0) if aim.time else 0.0
    if since is not None and not aim.time:
        length = max(aim.factor - since.factor, 0.0)
    way = None
    if place.rate is not None and length > 0.0 and bool(aim.time) == bool(since and since.time):
        way = length * place.rate
    guess = _guess(problem, before, aim, way, known)
    try:
        if search is None:
            reached, usable = _equilibrium(problem, guess, before.displacement)
        else:
            problem, reached, usable = search.equilibrium(problem, guess, before.displacement)
    except StaticError:
        if not may_fail:
            raise
        return replace(place, iterate=guess)
    rate = (reached.displacement - before.displacement) / length if length > 0.0 else None
    return _Place(problem, reached, aim, rate, usable)


def _guess(
    problem: StaticProblem, state: Iterate, aim: PathPoint, way: FloatArray | None, known: Known
) -> Iterate:
    """Where the iteration to the next point begins: a known state, or a ``way`` [mm] further on."""
    holding = state.holding
    if aim.time or way is not None:
        pressures = problem.system.law.normal.pressure(state.gaps.overclosure)
        more = 1.0 if aim.time else aim.factor / state.point.factor
        holding = holding._replace(pressed=more * float(pressures.max(initial=0.0)))
    if aim.time and not problem.system.has_friction:
        holding = held_in_motion(problem, holding)
    above = [(load, u) for load, u in known if load >= aim.factor and not aim.time]
    if above:
        near = min(above, key=lambda one: one[0])[1]
        now = min(holding.now, _SOON_HELD * holding.first)
        holding = holding._replace(now=now, pressed=None)
        way = problem.step.kept(problem.system.localised(near)) - state.displacement
    guess = replace(state, holding=holding, point=aim, converged=False)
    return guess if way is None else _led_on(problem, guess, way)


def _led_on(problem: StaticProblem, state: Iterate, way: FloatArray) -> Iterate:
    """Move a state by displacements (n_nodes, 3) [mm], if supports are there where they should be.

    Contact is linearised where it then is.
    """
    displacement = state.displacement + way
    if not problem.system.held.met(displacement, state.point.time):
        return state
    gaps = problem.system.points.gaps(displacement)
    at = bounded(problem, state, gaps.x)
    return replace(state, displacement=displacement, gaps=gaps, at=at)


def _equilibrium(problem: StaticProblem, guess: Iterate, begin: FloatArray) -> tuple[Iterate, bool]:
    """Take a guess to the equilibrium of its point from that before, at ``begin``.

    Also returns whether the next one may follow.
    """
    reached = newton(problem, guess)
    if not reached.gaps.x.size:  # linear: what more steps change is the round-off of slender blocks
        within = reached.residuals[-1] <= _ROUND_OFF
        return replace(reached, converged=reached.converged or within), True
    if problem.system.has_friction and reached.residuals[-1] > _HISTORY:
        # What follows would start from a history that no equilibrium has.
        return reached, False
    return _advance_friction(problem, reached, begin), True


def load_factors(parts: int, *, friction: bool) -> tuple[float, ...]:
    """Load factors at the ends of the load steps, the last one 1.

    Without friction the way to the load does not matter, and the parts are equal. With friction
    most of the history lies under small loads, where contact by an exponential law is soft and
    blocks make most of their motion: factors are squares, so that four steps do what sixteen equal
    ones did.
    """
    power = 2 if friction else 1
    return tuple((k / parts) ** power for k in range(1, parts + 1))


def points_of(stages: Sequence[Sector], options: StaticOptions) -> list[PathPoint]:
    """Points of a path: the load first, then motions of supports; of several stages both at once.

    Without supports that move a single stage has no time. In a stage forces and prescribed
    displacements change in equal increments from the state before it, as many as load steps.
    """
    *before, system = stages
    parts, steps = options.load_steps, options.motion_steps
    if before:
        act = [bool(stage.loads[-1].any()) for stage in stages]
        return [
            PathPoint(share, share, number)
            for number, stage in enumerate(stages)
            for share in load_factors(
                parts
                if stage.whole.supports.tables or any(act[max(number - 1, 0) : number + 1])
                else 1,
                friction=number == 0,
            )
        ]
    moving = system.held.tables
    requested = load_factors(parts, friction=system.has_friction)
    if not moving or steps is None:
        return [PathPoint(factor) for factor in requested]
    tables = [np.array(share.times) for share in moving if isinstance(share, TabularAmplitude)]
    end = max((float(times[-1]) for times in tables), default=1.0)
    times = np.unique(np.concatenate([end * np.arange(1, steps + 1) / steps, *tables]))
    loads = [PathPoint(factor, 0.0) for factor in requested] if system.loads[-1].any() else []
    return [*loads, *(PathPoint(1.0, time) for time in times[times > 0.0].tolist())]


@dataclass
class PointSearch:
    """Points that follow the motion along a path."""

    points: FacingPoints
    elastic: ElasticSlips
    """Elastic slips where the next step begins."""
    begin: FloatArray | None
    """Displacements from which slips of the first step count, on points that are searched there,
    (n_nodes, 3) [mm]; None: a step came before."""

    def system(self, system: Sector) -> Sector:
        """A system on the present points."""
        clearance, normals = system.whole.surfaces.clearance, system.whole.contact.normals
        return system.on(points_of_search(self.points, clearance, normals))

    def anew(self, problem: StaticProblem, state: Iterate) -> tuple[StaticProblem, Iterate]:
        """Problem and state on the points of the place that a state has."""
        everywhere = problem.step.complete(state.displacement, state.point.factor)
        self.points.displace(tuple(problem.system.expand(everywhere)))
        self.points.search()
        problem = problem.on(self.system(problem.system))
        kept = problem.step.kept(everywhere)
        gaps = problem.system.points.gaps(kept)
        return problem, replace(state, displacement=kept, gaps=gaps, at=gaps.x)

    def equilibrium(
        self, problem: StaticProblem, state: Iterate, begin: FloatArray
    ) -> tuple[StaticProblem, Iterate, bool]:
        """Find an equilibrium whose points are those of its own place, as `_equilibrium`."""
        points, begin = self.points, begin if self.begin is None else self.begin
        joints, tries, least, around = 0, _MAX_TRIES, math.inf, 0
        for search in range(_MAX_SEARCHES):
            if search or self.begin is None:
                problem, state = self.anew(problem, state)
            if _n_joints(problem) > joints:
                joints, tries = _n_joints(problem), _MAX_TRIES
            anchor = self.elastic.anchor(problem, points, begin)
            state = replace(state, slid=state.slid._replace(anchor=anchor), converged=False)
            before = state.displacement
            state = newton(problem, state)
            moved = float(np.abs(state.displacement - before).max())
            if not state.converged and state.point.time is None and moved > points.skin and tries:
                # Where blocks move to, others may stop them.
                reached = points.farthest / max(moved, points.farthest)
                on_the_way = before + reached * (state.displacement - before)
                state, tries = replace(state, displacement=on_the_way), tries - 1
                continue
            least, around = (moved, 0) if moved < _SHORTER * least else (least, around + 1)
            enough = _FOLLOWED * points.skin
            if problem.system.has_friction and state.point.factor < 1.0 and search:
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
            slip = (state.gaps.x[..., 1:] - state.slid.anchor)[:, 0]
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
    law, anchor = problem.system.law, state.slid.anchor
    first, _ = law.tractions(problem.system.points.gaps(begin).x, anchor)
    last, moved = law.tractions(state.gaps.x, anchor)
    before, pressure, touching = first[..., 0], last[..., 0], last[..., 0] > 0.0
    mean = 0.5 + 0.5 * np.divide(before, pressure, out=np.zeros_like(pressure), where=touching)
    resisting = np.where(touching[..., None], mean[..., None] * last, 0.5 * first)[..., 1:]
    lost = problem.system.points.weights * ((moved - anchor) * resisting).sum(axis=2)
    times = problem.system.orbits.times(problem.system.points)
    total = state.slid.dissipation + float((times * lost).sum())
    return replace(state, slid=Slid(moved, total))
