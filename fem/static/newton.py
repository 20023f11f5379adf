"""Newton's iteration to a static equilibrium under one load.

Each point of contact keeps a *linearisation overclosure* x̂, with friction also slips. One iteration
solves the linear problem in which the law (`fem.contact.friction.Coulomb`) is replaced by its
tangent there,

    K u + Σ w (t(x̂) + t'(x̂) (x(u) - x̂)) ∂x/∂u = f,

minimises the energy exactly along the way to that solution when the end overshoots, and moves
x̂: after a full step to the overclosure at which the law has the *same pressure* as its tangent
where that presses (Newton on the inverse of the law, which is nearly straight where the law is
an exponential), else to the overclosure just found. Gap gradients follow the current normals
from iteration to iteration. In the first iterations springs hold every block to where it was;
they fade, and what is called equilibrium never contains them.

The residual is that of the law itself: f - K u - Σ w p(x(u)) ∂x/∂u.

The iteration leaves out Σ w p ∂²x/∂u²: where blocks turn so much in gaps that this term decides, it
finds no equilibrium.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fem.contact.friction import Coulomb
from fem.contact.surfaces import Gaps
from fem.static.linear_step.condensation import UnheldBlocksError
from fem.static.linear_step.linearisation import (
    Linearisation,
    StaticError,
    coarsened,
)
from fem.static.problem import StaticProblem
from fem.system.system import Sector
from geometry.machine.work import Operation, count
from geometry.mesh import FloatArray

#: First holding springs relative to the tangent contact stiffness on a block at the start.
_FIRST_HOLDING = 0.25
#: Holding springs shrink by this factor from iteration to iteration …
_FADING = 0.1
#: … after steps that go this share of the way to the linear solution at least, and grow again
#: where they do not go its square …
_SHORT_STEP = 0.1
#: … down to this share of the first ones: motions that no contact resists stay determined, and
#: others do not notice.
_LEAST_HOLDING = 1e-6
#: The same of those at the present pressure, where supports move.
_LEAST_IN_MOTION = 1e-4
#: Share of the first holding springs when blocks turn out to be unheld.
_RESCUE_HOLDING = 1e-3
#: The same at a start near the equilibrium, if linear problems are exact.
_EXACT_HOLDING = 1e-4
#: Rescues after which the blocks are reported as unheld.
_MAX_RESCUES = 30
#: First iterations with one pressure for each facet of elements of degree 1: nearly every point is
#: still in contact then.
_COARSE_ITERATIONS = 3
#: A step is cut when the energy slope at its end exceeds this share of the slope at its start.
_OVERSHOOT = 0.1
#: A linear solution farther away than this many block lengths is a motion that nothing resists.
_FARTHEST = 100.0
#: Contact forces count this much in the size against which the residual is measured.
_CONTACT_SHARE = 1e-2
_EPSILON = float(np.finfo(np.float64).eps)
#: Share of the least force that is none: tolerated residuals are hundredths of it.
_NOTHING = 1e-6
#: Pressure of a light touch over that at which contacts begin to press.
LIGHT_TOUCH = 10.0
#: Iterations that may bring no better residual, before and after the best is below _NEAR.
_PATIENCE = 40
_PATIENCE_NEAR = 10
_NEAR = 1e-2
#: Iterations from rest, with friction, of which none brings the residual below this: others need
#: 5 to 16 in all, walls of many courses up to 60.
_LONG, _FAR = 8, 1.0
#: Cosine between steps that follow one motion, and how often holding springs get softer then.
_ALONG, _SOFTENED = 0.99, 4


class PathPoint(NamedTuple):
    """One point of a path."""

    factor: float = 1.0
    """Share of the loads, of a stage of their change [-]."""
    time: float | None = None
    """At which moving supports are where they are prescribed [s]; None: all their way."""
    stage: int = 0
    """Which of several stages."""


class Holding(NamedTuple):
    """What keeps blocks in place while iterations are far from an equilibrium."""

    first: float
    """Stiffness of the first springs [N/mm]."""
    now: float
    """Of the present ones [N/mm]."""
    rescues: int = 0
    """How often they became stiffer because blocks turned out to be unheld."""
    coarse: int = 0
    """Iterations left with one pressure for each facet."""
    pressed: float | None = None
    """Largest pressure at the end of the step before, where supports move [MPa]."""

    def after(self, share: float) -> Holding:
        """Springs of the next iteration: weaker after a long step, else as they were."""
        factor = 1.0 if share > _SHORT_STEP**2 else 1.0 / _FADING
        factor = _FADING if share > _SHORT_STEP else factor
        now = min(max(factor * self.now, _LEAST_HOLDING * self.first), max(self.first, self.now))
        return self._replace(now=now, coarse=self.coarse - 1)

    def stiffer(self) -> Holding:
        """Springs after a rescue."""
        now = max(10.0 * self.now, _RESCUE_HOLDING * self.first)
        return self._replace(now=now, rescues=self.rescues + 1)


class Slid(NamedTuple):
    """What sliding has left at the end of a step."""

    anchor: FloatArray
    """Slips without traction, (n_facets, n_points, 0 or 2) [mm]."""
    dissipation: float = 0.0
    """Work lost [N mm]."""


@dataclass(frozen=True)
class Iterate:
    """What one iteration leaves to the next; a `fem.state.State` is made of the last one."""

    displacement: FloatArray
    force: FloatArray
    """K u of it, condensed where inner nodes are left out, (n_nodes, 3) [N]."""
    gaps: Gaps
    at: FloatArray
    """Overclosures and slips at which the law is linearised, as `Gaps.x` [mm]."""
    slid: Slid
    holding: Holding
    point: PathPoint
    residuals: tuple[float, ...] = ()
    converged: bool = False


def start_iterate(
    system: Sector, start: FloatArray | None = None, *, exact: bool = False
) -> Iterate:
    """Every point linearised at the mean pressure that the loads suggest, or where a state has it.

    ``start`` are its displacements, (n_nodes, 3) [mm]; softer springs hold it if linear problems
    are ``exact`` (`LinearStep.exact`): then they alone would delay the equilibrium near it.
    """
    points, touching = system.points, system.law.touching_pressure
    displacement = np.zeros((system.n_nodes, 3)) if start is None else start
    area = float(points.areas.sum())
    load = float(np.linalg.norm(system.loads[-1], axis=1).sum())
    rest = system.law.normal.overclosure(np.maximum(load / area if area else 0.0, touching))
    first = first_holding(system, rest)
    gaps = points.gaps(displacement)
    at, coarse = gaps.x.copy(), 0
    if start is None:
        at[..., 0].T[:] = rest  # one number, or one for each facet
        flat = all(system.body(slot).element.degree == 1 for slot in range(system.n_slots))
        # Without friction blocks that only friction holds would move far away.
        coarse = _COARSE_ITERATIONS if flat and not system.has_friction else 0
    else:
        first *= _EXACT_HOLDING if exact else _RESCUE_HOLDING
    slid, holding = Slid(np.zeros_like(at[..., 1:])), Holding(first, first, coarse=coarse)
    force = np.zeros_like(displacement)
    return Iterate(displacement, force, gaps, at, slid, holding, PathPoint())


def first_holding(system: Sector, overclosure: FloatArray) -> float:
    """First holding springs of a block where contact is as stiff as at an overclosure [N/mm]."""
    stiffness = float(system.law.normal.stiffness(overclosure).max())
    return _FIRST_HOLDING * stiffness * float(system.points.areas.sum()) / system.n_slots


def held_in_motion(problem: StaticProblem, holding: Holding) -> Holding:
    """Springs at the beginning of a step of a motion, as stiff as its contact.

    Without friction deformed surfaces push blocks that nothing holds aside, in proportion to where
    they are: springs much softer than contact let that grow from step to step.
    """
    system, law, touching = problem.system, problem.system.law, problem.system.law.touching_pressure
    pressed = np.full_like(touching, holding.pressed or 0.0)
    least = max(
        _LEAST_IN_MOTION * first_holding(system, law.normal.overclosure(pressed)),
        _LEAST_HOLDING * first_holding(system, law.normal.overclosure(touching)),
    )
    return holding._replace(first=least / _LEAST_HOLDING, now=max(holding.now, least))


def newton(problem: StaticProblem, state: Iterate) -> Iterate:
    """Iterate to an equilibrium, or until nothing has improved for a while."""
    slips, force = state.gaps.x[..., 1:], problem.step.internal_force(state.displacement)
    state = replace(state, at=np.concatenate([state.at[..., :1], slips], axis=2), force=force)
    least, since, softened, way = math.inf, 0, 0, np.zeros(1)
    held: Iterate | None = None
    rest = state if problem.slides and not state.displacement.any() else None
    for number in range(problem.options.max_iterations):
        if number == _LONG and rest is not None and least > _FAR:
            state = _all_stick(problem, rest)
        before, begin = way, state.displacement
        try:
            state = _iterate(problem, state)
        except StaticError:
            if held is None:
                raise
            return held  # nothing stops the block: as if it had not been let go
        way = state.displacement - begin
        since = 0 if state.residuals[-1] < 0.9 * least else since + 1
        least = min(least, state.residuals[-1])
        if state.converged:
            break
        if since > (_PATIENCE_NEAR if least < _NEAR else _PATIENCE):
            if softened >= _SOFTENED or state.point.time is not None or not _drifts(before, way):
                break
            held, now = state if held is None else held, state.holding
            softer = now._replace(first=_FADING * now.first, now=_FADING * now.now)
            state = replace(state, holding=softer)
            since, softened = 0, softened + 1
    return state if state.converged or held is None else held


def _all_stick(problem: StaticProblem, rest: Iterate) -> Iterate:
    """Nearly an equilibrium where all points that press stick, or the state at rest without one.

    Stick has an energy, which the iteration lowers from step to step; sliding points have none.
    """
    options = replace(problem.options, tolerance=_NEAR)
    stuck = newton(replace(problem, options=options, law=problem.law.sticking), rest)
    if not stuck.converged:
        return rest
    return replace(stuck, residuals=rest.residuals, holding=stuck.holding._replace(rescues=0))


def _drifts(before: FloatArray, way: FloatArray) -> bool:
    """Whether two steps go on along one motion: what resists it are the holding springs alone.

    A block that nothing holds until it meets another is pushed there by deformed surfaces.
    """
    sizes = float(np.linalg.norm(before) * np.linalg.norm(way))
    return bool((before * way).sum() > _ALONG * sizes > 0.0)


def _iterate(problem: StaticProblem, state: Iterate) -> Iterate:
    """One linear problem, and what follows from it."""
    count(Operation.CALL, problem.system.n_slots)
    linear = _linearise(problem, state)
    # One pressure a facet at first.
    simple = coarsened(linear) if state.holding.coarse > 0 else linear
    while True:
        trial, state = _solve(problem, simple, state)
        end = trial, problem.step.internal_force(trial)
        share = _step_share(problem, state, end)
        moved = _moved(problem, linear, state, end, share)
        if state.holding.rescues >= _MAX_RESCUES or not _runs_away(problem, state, moved):
            return moved
        state = replace(state, holding=state.holding.stiffer())


def _runs_away(problem: StaticProblem, state: Iterate, moved: Iterate) -> bool:
    """Whether a step overlaps blocks as no load can: with friction its energy need not tell.

    Blocks that have moved by their length are a mechanism, and no springs help.
    """
    far = np.abs(moved.displacement).max() > problem.system.whole.assembly.characteristic_length
    if far or not problem.system.held.met(state.displacement, state.point.time):
        return False
    return bool((problem.farthest_overclosure < moved.gaps.x[..., 0].T).any())


def _moved(
    problem: StaticProblem,
    linear: Linearisation,
    state: Iterate,
    end: tuple[FloatArray, FloatArray],
    share: float,
) -> Iterate:
    """The state after a share of the way to the ``end``, the linear solution and its K u."""
    displacement, force = (
        after if share == 1.0 else before + share * (after - before)
        for before, after in zip((state.displacement, state.force), end, strict=True)
    )
    gaps = problem.system.points.gaps(displacement)
    at = bounded(problem, state, gaps.x)
    if share == 1.0:
        moved = problem.system.points.gather(linear.gradient, displacement)
        tangent = linear.tractions(linear.constant + moved)
        at = _after_full_step(problem.law, state, tangent, at)
    state = replace(
        state,
        displacement=displacement,
        force=force,
        gaps=gaps,
        at=at,
        holding=state.holding.after(share),
    )
    residual = _residual(problem, state)
    return replace(
        state,
        residuals=(*state.residuals, residual),
        converged=residual <= problem.options.tolerance,
    )


def _after_full_step(
    law: Coulomb, state: Iterate, tangent: FloatArray, x: FloatArray
) -> FloatArray:
    """Overclosures and slips at which the law is linearised after a full step [mm].

    The law has the pressure of the tangent there, where that presses. Stick is so stiff that a
    point whose slip turns back passes through all of it in one step: there it sticks first, and the
    step after shows whether it slides, and where to.

    Parameters
    ----------
    law
        Of the points.
    state
        Before the step.
    tangent
        Tractions of the linear problem, (n_facets, n_points, 1 or 3) [MPa].
    x
        Overclosures and slips after the step, alike [mm].
    """
    at, pressure, anchor = x.copy(), tangent[..., 0], state.slid.anchor
    at[..., 0] = np.where(pressure > 0.0, law.normal.overclosure(pressure), x[..., 0])
    if anchor.shape[2]:
        _, moved = law.tractions(state.at, anchor)
        slid = (moved != anchor).any(axis=2)
        back = ((x[..., 1:] - anchor) * (state.at[..., 1:] - anchor)).sum(axis=2) < 0.0
        at[..., 1:] = np.where((slid & back)[..., None], anchor, x[..., 1:])
    return at


def bounded(problem: StaticProblem, state: Iterate, x: FloatArray) -> FloatArray:
    """Overclosures and slips, as `Gaps.x`, at which the law is linearised anew [mm].

    Where supports move, blocks that run into others overlap far beyond the length of the law, where
    it is too stiff to move them apart: no more than the pressures of the step before have.
    """
    if state.holding.pressed is None:
        return x
    law, bounded = problem.system.law, x.copy()
    most = np.maximum(state.holding.pressed, LIGHT_TOUCH * law.touching_pressure)
    bounded[..., 0] = np.minimum(x[..., 0].T, law.normal.overclosure(most)).T
    return bounded


def _linearise(problem: StaticProblem, state: Iterate) -> Linearisation:
    points, law, gaps = problem.system.points, problem.law, state.gaps
    return Linearisation(
        weights=points.weights,
        gradient=gaps.gradient,
        constant=gaps.x - points.gather(gaps.gradient, state.displacement),
        at=state.at,
        traction=law.tractions(state.at, state.slid.anchor)[0],
        slope=law.slope(state.at, state.slid.anchor),
        load_factor=state.point.factor,
        time=state.point.time,
    )


def _solve(
    problem: StaticProblem, linear: Linearisation, state: Iterate
) -> tuple[FloatArray, Iterate]:
    """Solve the linear problem; hold the blocks more where nothing else does."""
    while True:
        try:
            trial, inverse = problem.step(linear, state.displacement, state.holding.now)
            if problem.free is not None and inverse is not None:
                trial = problem.free.constrained(trial, inverse)
            _check_near(problem.system, trial)
            return trial, state
        except UnheldBlocksError as error:
            if state.holding.rescues >= _MAX_RESCUES:
                raise StaticError(_unheld_text(error)) from None
            state = replace(state, holding=state.holding.stiffer())


def _check_near(system: Sector, displacement: FloatArray) -> None:
    """Raise `UnheldBlocksError` where a displacement is no small motion."""
    farthest = _FARTHEST * system.whole.assembly.characteristic_length
    if np.abs(displacement).max() > farthest:
        raise UnheldBlocksError(
            f"a block would move by {np.abs(displacement).max():.3g} mm, more than "
            f"{_FARTHEST:g} block lengths",
            (),
        )


def require_near(system: Sector, displacement: FloatArray) -> None:
    """Reject displacements of all nodes, (n_nodes, 3) [mm], that are no small motions.

    Newton's iterations see the nodes of contact alone: others may move farther.

    Raises
    ------
    StaticError
        Naming the motion.
    """
    try:
        _check_near(system, displacement)
    except UnheldBlocksError as error:
        raise StaticError(_unheld_text(error)) from None


def _unheld_text(error: UnheldBlocksError) -> str:
    names = ", ".join(str(b) for b in error.blocks)
    where = f"among blocks {names} " if names else ""
    return (
        f"static: {error}: {where}some motion meets no resistance, or the load is far too large "
        "for linear elasticity, so no static state is determined; expected contact, load or "
        "support that holds every block (a smaller initial clearance, a load on every block, or "
        "an explicit run)"
    )


def _step_share(
    problem: StaticProblem, state: Iterate, end: tuple[FloatArray, FloatArray]
) -> float:
    """Share of the way to the ``end``, the linear solution and its K u, of the least energy.

    One, unless the energy rises steeply at the end. Along the way overclosures and slips are
    linear, so without friction the energy is convex, and its slope, the work of the unbalanced
    forces, is found by bisection from contact points alone. A way on which supports move goes to
    its end: energy that they bring in says nothing, and no other state has them where they are
    prescribed.
    """
    system = problem.system
    if not system.held.met(state.displacement, state.point.time):
        return 1.0
    way = end[0] - state.displacement
    start = float(np.vdot(state.force - problem.step.load(state.point.factor), way))
    growth = float(np.vdot(end[1] - state.force, way))
    before, change = state.gaps.x, system.points.gather(state.gaps.gradient, way)
    weighted = system.points.weights[..., None] * change

    def slope(share: float) -> float:
        traction, _ = problem.law.tractions(before + share * change, state.slid.anchor)
        return start + share * growth + float(np.vdot(weighted, traction))

    first = slope(0.0)
    if not first < 0.0 or slope(1.0) <= -_OVERSHOOT * first:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if slope(middle) < 0.0:
            low = middle
        else:
            high = middle
    return high


def _residual(problem: StaticProblem, state: Iterate) -> float:
    """Norm of the unbalanced nodal forces over that of the loads, or 1 % of the contacts'.

    Where supports move over that of their forces, too: often nothing else loads the blocks. Where
    nothing resists them either, over the least force that means anything.
    """
    held = problem.system.held
    unbalanced, pressing = unbalanced_forces(problem, state)
    of_supports = held.part(unbalanced)
    free = unbalanced - of_supports
    if problem.free is not None:
        free = problem.free.without(free)
    sizes = [*map(_norm, problem.system.loads), _CONTACT_SHARE * _norm(pressing)]
    if held.tables:
        least = _least_force(problem, float(np.abs(state.displacement).max()))
        sizes += [_norm(of_supports), least]
    return _norm(free) / (max(sizes) or 1.0)


def _norm(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))


def _least_force(problem: StaticProblem, farthest: float) -> float:
    """Force at which the face of a block begins to press, and no less than round-off tells [N].

    The stiffness times displacements of up to ``farthest`` [mm], even of rigid blocks, rounds off.
    """
    system = problem.system
    length = system.whole.assembly.characteristic_length
    touch = float(system.law.touching_pressure.max(initial=0.0)) * length**2
    rounding = _EPSILON * problem.stiffest * length * farthest * math.sqrt(system.n_nodes)
    return max(touch, rounding / problem.options.tolerance)


def unbalanced_forces(problem: StaticProblem, state: Iterate) -> tuple[FloatArray, FloatArray]:
    """Nodal forces that are not in balance, and pressures of the contact points as forces [N].

    On prescribed components the first are minus the forces of the supports.
    """
    system = problem.system
    traction, _ = problem.law.tractions(state.gaps.x, state.slid.anchor)
    forces = system.points.weights[..., None] * traction
    unbalanced = problem.step.load(state.point.factor) - state.force
    unbalanced += system.points.scatter(state.gaps.gradient, forces)
    return unbalanced, forces[..., 0]


def frictions(problem: StaticProblem, state: Iterate) -> FloatArray | None:
    """Friction on block s at the points of a state, world axes, (n_facets, n_points, 3) [MPa]."""
    if not problem.system.has_friction:
        return None
    traction, _ = problem.system.law.tractions(state.gaps.x, state.slid.anchor)
    return -np.einsum("fpk,fpki->fpi", traction[..., 1:], problem.system.points.sides)


def support_forces(problem: StaticProblem, state: Iterate) -> FloatArray:
    """Forces of the supports on the nodes, (n_nodes, 3) [N].

    Those along the way of supports that move are zero where they are none but round-off.
    """
    held = problem.system.held
    forces = -held.part(unbalanced_forces(problem, state)[0])
    least = _NOTHING * _least_force(problem, float(np.abs(state.displacement).max()))
    least += problem.options.tolerance * float(np.linalg.norm(forces))
    for way in np.moveaxis(held.ways, 1, 0)[:-1]:
        unit = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
        along = (forces[held.nodes] * unit).sum(axis=1, keepdims=True)
        if float(np.abs(along).sum()) <= least:
            forces[held.nodes] -= along * unit
    return forces
