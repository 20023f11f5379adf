"""Static equilibrium of deformable blocks in contact, by Newton in displacements and pressures.

Each point of contact keeps a *linearisation overclosure* x̂. One iteration solves the linear
problem in which the law is replaced by its tangent there,

    K u + Σ w (p(x̂) + p'(x̂) (x(u) - x̂)) ∂x/∂u = f,

minimises the energy exactly along the way to that solution when the end overshoots, and moves
x̂: after a full step to the overclosure at which the law has the *same pressure* as its tangent
where that presses (Newton on the inverse of the law, which is nearly straight where the law is
an exponential), else to the overclosure just found. Gap gradients follow the current normals
from iteration to iteration. In the first iterations springs hold every block to where it was;
they fade, and what is called equilibrium never contains them.

The residual is that of the law itself: f - K u - Σ w p(x(u)) ∂x/∂u.

Where current normals turn so much that this does not converge, the energy itself is followed down
with the exact tangent (`fem.static.energy_descent`).

Friction, where the model has it, adds rows of the same kind (`fem.static.friction`); its history
advances from load step to load step.

Where facets do not match, or blocks slide far, points are those of the search of explicit runs
(`fem.contact.search`). Equilibrium on the points of one place moves the blocks; the search is
repeated where they are then, until points follow the motion to a small share of a facet.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import numpy as np

from fem.assembly.contact_state import corner_displacements, facing_points
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.local_system import FreeMotions, LocalSystem, free_motions, local_system
from fem.assembly.symmetry import Orbits, cyclic_orbits, largest_cyclic_orbits, no_symmetry
from fem.contact.friction import friction_tractions
from fem.contact.search import FacingPoints, SearchedSurfaces, searched_surfaces
from fem.contact.surfaces import ContactNormals, ContactSurfaces, PointKinematics
from fem.static.energy_descent import minimise_energy
from fem.static.friction import FrictionRows, friction_rows, joined
from fem.static.linear import solve_apart
from fem.static.linear_step.condensed import CondensedStep, FlexibilityStore
from fem.static.linear_step.linearisation import (
    Linearisation,
    LinearStep,
    SparseSolver,
    SparseStep,
    UnheldBlocksError,
    coarsened,
)
from fem.static.result import StaticError, StaticResult, load_factors, loose_blocks, refined
from geometry.mesh import FloatArray, IntArray

#: First holding springs relative to the tangent contact stiffness on a block at the start.
_FIRST_HOLDING = 0.25
#: Holding springs shrink by this factor from iteration to iteration …
_FADING = 0.1
#: … down to this share of the first ones: motions that no contact resists stay determined, and
#: others do not notice.
_LEAST_HOLDING = 1e-6
#: Share of the first holding springs when blocks turn out to be unheld.
_RESCUE_HOLDING = 1e-3
#: Rescues after which the blocks are reported as unheld.
_MAX_RESCUES = 30
#: First iterations with one pressure for each facet: nearly every point is still in contact then.
_COARSE_ITERATIONS = 3
#: A step is cut when the energy slope at its end exceeds this share of the slope at its start.
_OVERSHOOT = 0.1
#: A linear solution farther away than this many block lengths is a motion that nothing resists.
_FARTHEST = 100.0
#: Contact forces count this much in the size against which the residual is measured.
_CONTACT_SHARE = 1e-2
#: Iterations that may bring no better residual, before and after the best is below _NEAR.
_PATIENCE = 40
_PATIENCE_NEAR = 10
_NEAR = 1e-2
#: Iterations without a better residual after which friction limits follow the pressures by half:
#: with much friction (mu 0.6) pressures and their limits drive each other up and down.
_SWINGING = 6
_LIMIT_SHARE = 0.5
#: Parts in which the load is applied when all at once does not converge.
_FALLBACK_LOAD_STEPS = 4
#: Residual of a load step on the way above which its slips are no history to go on with: what load
#: steps are doubled for. Blocks that hardly touch yet under a hundredth of the load may not come to
#: the tolerance, which is of all of it.
_HISTORY = 1e-2
#: Searches for one load step at most, and the motion after the last one that no cut needs to
#: follow: what it changes is its square [skins].
_MAX_SEARCHES = 12
_FOLLOWED = 1e-4


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
    load_path: tuple[float, ...] | None = None
    """Load factors at the ends of the load steps, the last one 1; None: straight up, in
    `load_steps` of `load_factors`."""
    keep_steps: bool = False
    """Whether the result holds the state after each of them."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.tolerance) and self.tolerance > 0.0):
            raise StaticError(f"fem.tolerance: got {self.tolerance}, expected a positive number")
        change = self.load_tolerance
        if change is not None and not (math.isfinite(change) and change > 0.0):
            raise StaticError(f"fem.load_tolerance: got {change}, expected a positive number")
        path = self.load_path
        if path is not None and not (path and path[-1] == 1.0 and min(path) > 0.0):
            raise StaticError(
                f"load_path: got {path}, expected positive load factors that end with 1"
            )
        for name in ("max_iterations", "load_steps"):
            if getattr(self, name) < 1:
                raise StaticError(f"fem.{name}: got {getattr(self, name)}, expected at least 1")


def solve_static(
    deformable: DeformableAssembly,
    options: StaticOptions | None = None,
    *,
    start: StaticResult | None = None,
    store: FlexibilityStore | None = None,
) -> StaticResult:
    """Find the static state of an assembly under its loads; single bodies are solved at once.

    Parameters
    ----------
    deformable
        Blocks, loads, supports and contact.
    options
        Method, symmetry and tolerance.
    start
        A state of the same model to start from, for instance under another load.
    store
        Of one call for the next: blocks that are the same are condensed once.

    Returns
    -------
    StaticResult
        `StaticResult.converged` says whether it is an equilibrium.

    Raises
    ------
    StaticError
        Blocks that no contact holds in the solution: their place is not determined.
    SymmetryError
        A symmetry asked for that the model does not have.
    SparseSolverError
        A library that is not installed.
    """
    options = StaticOptions() if options is None else options
    if not deformable.meets:
        return solve_apart(deformable, load_steps=options.load_steps, keep_steps=options.keep_steps)
    store = FlexibilityStore() if store is None else store
    change = options.load_tolerance
    without = deformable.contact.friction is None or start is not None
    if without or change is None or options.load_path is not None:
        return _load(deformable, options, start, store)

    def in_parts(parts: int) -> StaticResult:
        return _load(deformable, replace(options, load_steps=parts), None, store)

    found, coarser = refined(in_parts, options.load_steps, change)
    return replace(found, coarser_loading=coarser)


def _load(
    deformable: DeformableAssembly,
    options: StaticOptions,
    start: StaticResult | None,
    store: FlexibilityStore,
) -> StaticResult:
    """Apply the load in the parts that are asked for."""
    clock = time.process_time()
    orbits = _orbits(deformable, options.symmetry)
    points = None
    if deformable.contact.finite_sliding:
        points = facing_points(deformable, None if start is None else start.displacements, orbits)
    problem = _problem(deformable, orbits, options, store, points)
    ready = time.process_time()
    first = _start_state(problem.system, start)
    way = _load_up if points is None else partial(_follow_up, points=points, store=store)
    problem, state = way(problem, first, options.load_steps)
    more = options.load_steps < _FALLBACK_LOAD_STEPS and options.load_path is None
    if more and not state.converged:
        again = replace(first, residuals=state.residuals)
        if points is not None:
            problem, again = _searched_anew(problem, again, points, store)
        problem, state = way(problem, again, _FALLBACK_LOAD_STEPS)
    solved = time.process_time()
    system = problem.system
    displacement = problem.step.complete(state.displacement)
    whole = free_motions(system, np.ones(system.n_nodes, dtype=np.bool_))
    if whole is not None:
        displacement = whole.without(displacement)
    seconds = {"setup": ready - clock, "newton": solved - ready}
    seconds["recovery"] = time.process_time() - solved
    seconds["total"] = time.process_time() - clock
    return _result(problem, state, displacement, seconds, searched=points is not None)


def _problem(
    deformable: DeformableAssembly,
    orbits: Orbits,
    options: StaticOptions,
    store: FlexibilityStore,
    points: FacingPoints | None,
) -> _Problem:
    """Unknowns, linear step and friction on matched facets or on the points of a search."""
    searched = None
    if points is not None:
        searched = searched_surfaces(points, deformable.surfaces.clearance)
    system = local_system(deformable, orbits, searched)
    friction = deformable.contact.friction
    rows = None if friction is None else friction_rows(system, friction)
    step: LinearStep
    if options.method is StaticMethod.SPARSE:
        step, kept = SparseStep(system, options.sparse_solver), np.ones(system.n_nodes, np.bool_)
    else:
        step = CondensedStep(system, store)
        kept = np.isin(np.arange(system.n_nodes), system.corner_nodes)
    free = free_motions(system, kept)
    return _Problem(system, step, options, rows, deformable.contact.normals, free)


def _orbits(deformable: DeformableAssembly, symmetry: int | None) -> Orbits:
    if symmetry is None:
        return largest_cyclic_orbits(deformable)
    return no_symmetry(deformable) if symmetry == 1 else cyclic_orbits(deformable, symmetry)


# ---------------------------------------------------------------------------------------------
# Iteration


@dataclass(frozen=True)
class _Problem:
    """What stays the same in all iterations."""

    system: LocalSystem
    step: LinearStep
    options: StaticOptions
    friction: FrictionRows | None
    normals: ContactNormals
    free: FreeMotions | None

    def kinematics(self, displacement: FloatArray) -> PointKinematics:
        """Overclosures and gradients at a displacement."""
        return self.system.kinematics(displacement, self.normals)


@dataclass(frozen=True)
class _State:
    """What one iteration leaves to the next."""

    displacement: FloatArray
    kinematics: PointKinematics
    at: FloatArray
    first_holding: float
    holding: float
    load_factor: float = 1.0
    rescues: int = 0
    coarse_iterations: int = 0
    anchor: FloatArray | None = None
    limiting: FloatArray | None = None
    """Pressures whose friction limits the last linear problem had."""
    swinging: bool = False
    dissipation: float = 0.0
    residuals: tuple[float, ...] = ()
    converged: bool = False
    saddles: int = 0
    path: tuple[tuple[float, FloatArray], ...] = ()
    """Load factor and displacement after each load step, where they are kept."""


def _start_state(system: LocalSystem, start: StaticResult | None) -> _State:
    """Every point linearised at the mean pressure that the loads suggest, or at a given state."""
    contact, surfaces = system.deformable.contact, system.surfaces
    displacement = np.zeros((system.n_nodes, 3))
    area = float(surfaces.areas.sum())
    load = float(np.linalg.norm(system.external_force, axis=1).sum())
    law = contact.law
    least = max(float(law.pressure(0.0)), 1e-9 * law.touching_stiffness)
    pressure = max(load / area if area else 0.0, least)
    at = np.full(surfaces.weights.shape, float(law.overclosure(pressure)))
    stiffness = float(law.stiffness(law.overclosure(pressure)))
    holding = _FIRST_HOLDING * stiffness * area / system.n_slots
    if start is not None:
        displacement = _localised(system, start)
        at = system.kinematics(displacement, contact.normals).overclosure
        holding *= _RESCUE_HOLDING
    return _State(
        displacement=displacement,
        kinematics=system.kinematics(displacement, contact.normals),
        at=at,
        first_holding=holding,
        holding=holding,
        coarse_iterations=_COARSE_ITERATIONS if start is None else 0,
    )


def _localised(system: LocalSystem, start: StaticResult) -> FloatArray:
    """Displacements of a result on the representatives, in block frames."""
    deformable = system.deformable
    expected = [(g.n_copies, g.n_nodes, 3) for g in deformable.model.groups]
    if [u.shape for u in start.displacements] != expected:
        raise StaticError(
            f"start: got displacements of shapes {[u.shape for u in start.displacements]}; "
            f"expected {expected}: start from a state of the same model"
        )
    return system.localised(start.displacements)


def _load_up(problem: _Problem, state: _State, parts: int) -> tuple[_Problem, _State]:
    """Apply the load in parts."""
    for factor in _load_path(problem, parts):
        begin = state.displacement
        state = replace(state, load_factor=factor, converged=False, swinging=False)
        reached = _converge(problem, state)
        if problem.friction is not None and reached.residuals[-1] > _HISTORY:
            # What follows would start from a history that no equilibrium has.
            return problem, reached
        if not reached.converged and _has_potential(problem):
            reached = _descend(problem, replace(state, residuals=reached.residuals))
        state = _advance_friction(problem, reached, begin)
        if problem.options.keep_steps:
            state = replace(state, path=(*state.path, _kept_step(problem, state)))
    return problem, state


def _load_path(problem: _Problem, parts: int) -> tuple[float, ...]:
    """Load factors at the ends of the load steps."""
    asked = problem.options.load_path
    return load_factors(parts, friction=problem.friction is not None) if asked is None else asked


def _follow_up(
    problem: _Problem, state: _State, parts: int, *, points: FacingPoints, store: FlexibilityStore
) -> tuple[_Problem, _State]:
    """Apply the load in parts; points follow the motion until they stay."""
    elastic = _Elastic.none(points)
    for part, factor in enumerate(_load_path(problem, parts)):
        begin = state.displacement
        for search in range(_MAX_SEARCHES):
            if search or part:
                problem, state = _searched_anew(problem, state, points, store)
            state = replace(
                state,
                load_factor=factor,
                anchor=elastic.anchor(problem, points, begin),
                converged=False,
            )
            before = state.displacement
            state = _converge(problem, state)
            moved = float(np.abs(state.displacement - before).max())
            if not state.converged or 2.0 * moved <= _FOLLOWED * points.skin:
                break
        if not state.converged or 2.0 * moved > points.skin:
            return problem, replace(state, converged=False)
        state = _advance_friction(problem, state, begin)
        elastic = _Elastic.of(problem, points, state)
        if problem.options.keep_steps:
            state = replace(state, path=(*state.path, _kept_step(problem, state)))
    return problem, state


def _searched_anew(
    problem: _Problem, state: _State, points: FacingPoints, store: FlexibilityStore
) -> tuple[_Problem, _State]:
    """The problem on the points of the place that a state has, and the state linearised there."""
    system = problem.system
    points.displace(tuple(system.expand(problem.step.complete(state.displacement))))
    points.search()
    there = _problem(system.deformable, system.orbits, problem.options, store, points)
    kinematics = there.kinematics(state.displacement)
    at = kinematics.overclosure
    return there, replace(state, kinematics=kinematics, at=at, limiting=None)


@dataclass(frozen=True)
class _Elastic:
    """Elastic slips at the end of a load step, on the points that then were."""

    slave: IntArray
    shapes: FloatArray
    slip: FloatArray
    """World axes, in the order of the search, (n, 3) [mm]."""

    @classmethod
    def none(cls, points: FacingPoints) -> _Elastic:
        """Before any load."""
        found = points.now
        return cls(found.slave.copy(), found.shapes.copy(), np.zeros((points.count, 3)))

    @classmethod
    def of(cls, problem: _Problem, points: FacingPoints, state: _State) -> _Elastic:
        """After the anchors have moved."""
        found, rows = cls.none(points), problem.friction
        if rows is not None:
            slip = (rows.slip(state.displacement) - _anchor(state))[:, 0]
            order = _searched(problem).order
            found.slip[order] = np.einsum("nk,nki->ni", slip, rows.tangents[:, 0])
        return found

    def anchor(
        self, problem: _Problem, points: FacingPoints, begin: FloatArray
    ) -> FloatArray | None:
        """Anchors on the present points: their slip at the start of the step less the elastic."""
        rows = problem.friction
        if rows is None:
            return None
        carried = points.carried(self.slave, self.shapes, self.slip)[_searched(problem).order]
        elastic = np.einsum("nki,ni->nk", rows.tangents[:, 0], carried)
        return rows.slip(begin) - elastic[:, None]


def _searched(problem: _Problem) -> SearchedSurfaces:
    surfaces = problem.system.surfaces
    assert isinstance(surfaces, SearchedSurfaces)
    return surfaces


def _kept_step(problem: _Problem, state: _State) -> tuple[float, FloatArray]:
    """Load factor and displacements of a load step.

    Inner nodes follow contact nodes and load linearly, and the step knows the whole load.
    """
    share = state.load_factor
    return share, share * problem.step.complete(state.displacement / share)


def _advance_friction(problem: _Problem, state: _State, begin: FloatArray) -> _State:
    """Move the anchors at the end of a load step, and count the work lost on their way.

    An anchor moves only while a point slides, at the limit of its traction: that goes along with
    the pressure from the beginning to the end, in the mean. A point that lifts off loses half of
    what it had.
    """
    rows = problem.friction
    if rows is None:
        return state
    law = problem.system.deformable.contact.law
    pressure = law.pressure(state.kinematics.overclosure)
    before = law.pressure(problem.kinematics(begin).overclosure)
    anchor = _anchor(state)
    slip = rows.slip(state.displacement)
    first, _ = friction_tractions(rows.friction, rows.slip(begin), anchor, before)
    traction, moved = friction_tractions(rows.friction, slip, anchor, pressure)
    touching = pressure > 0.0
    mean = 0.5 + 0.5 * np.divide(before, pressure, out=np.zeros_like(pressure), where=touching)
    resisting = np.where(touching[:, :, None], mean[:, :, None] * traction, 0.5 * first)
    lost = problem.system.surfaces.weights * ((moved - anchor) * resisting).sum(axis=2)
    orbits = problem.system.orbits
    times: IntArray | int = orbits.order
    if not isinstance(problem.system.surfaces, SearchedSurfaces):
        times = np.bincount(orbits.point_of[:, 0] // lost.shape[1], minlength=len(lost))
    lost = times * lost.sum(axis=1)
    return replace(state, anchor=moved, dissipation=state.dissipation + float(lost.sum()))


def _anchor(state: _State) -> FloatArray:
    """Anchors of the friction; zero before the first load step."""
    if state.anchor is not None:
        return state.anchor
    return np.zeros((*state.at.shape, 2))


def _converge(problem: _Problem, state: _State) -> _State:
    """Iterate to an equilibrium, or until nothing improves any more."""
    least, since = math.inf, 0
    for _ in range(problem.options.max_iterations):
        state = _iterate(problem, state)
        since = 0 if state.residuals[-1] < 0.9 * least else since + 1
        if problem.friction is not None and since == _SWINGING and not state.swinging:
            state, since = replace(state, swinging=True), 0
        least = min(least, state.residuals[-1])
        if state.converged or since > (_PATIENCE_NEAR if least < _NEAR else _PATIENCE):
            break
    return state


def _has_potential(problem: _Problem) -> bool:
    """Whether the energy can be followed: what the plain iteration leaves out then decides."""
    return problem.friction is None and problem.normals is ContactNormals.CURRENT


def _descend(problem: _Problem, state: _State) -> _State:
    """Follow the energy from the equilibrium with reference normals."""
    start = _converge(replace(problem, normals=ContactNormals.REFERENCE), state)
    descent = minimise_energy(
        problem.system,
        problem.step,
        start.displacement,
        residual=partial(_relative, problem),
        load_factor=state.load_factor,
        holding=start.holding,
        tolerance=problem.options.tolerance,
        max_iterations=problem.options.max_iterations,
    )
    kinematics = problem.kinematics(descent.displacement)
    return replace(
        start,
        displacement=descent.displacement,
        kinematics=kinematics,
        at=kinematics.overclosure,
        residuals=(*start.residuals, *descent.residuals),
        converged=descent.converged,
        saddles=state.saddles + descent.saddles,
    )


def _iterate(problem: _Problem, state: _State) -> _State:
    """One linear problem, and what follows from it."""
    system, law = problem.system, problem.system.deformable.contact.law
    linear = _linearise(system, state)
    state = _with_limits(problem, state)
    trial, state = _solve(problem, _linear_problem(problem, linear, state), state)
    share = _step_share(problem, linear, state, trial)
    displacement = state.displacement + share * (trial - state.displacement)
    pressure = linear.linear_pressure(system, displacement)
    kinematics = problem.kinematics(displacement)
    same_pressure = (pressure > 0.0) & (share == 1.0)
    state = replace(
        state,
        displacement=displacement,
        kinematics=kinematics,
        at=np.where(same_pressure, law.overclosure(pressure), kinematics.overclosure),
        holding=max(_FADING * state.holding, _LEAST_HOLDING * state.first_holding),
        coarse_iterations=state.coarse_iterations - 1,
    )
    residual = _residual(problem, state)
    return replace(
        state,
        residuals=(*state.residuals, residual),
        converged=residual <= problem.options.tolerance,
    )


def _linear_problem(problem: _Problem, normal: Linearisation, state: _State) -> Linearisation:
    """One pressure a facet at first; friction, where there is any, after that."""
    if state.coarse_iterations > 0:
        return coarsened(normal)
    if problem.friction is None:
        return normal
    assert state.limiting is not None
    rows = problem.friction.linearise(state.displacement, _anchor(state), state.limiting)
    return joined(normal, rows)


def _with_limits(problem: _Problem, state: _State) -> _State:
    """The state with the pressures that limit friction in the next linear problem."""
    if problem.friction is None:
        return state
    pressure = problem.system.deformable.contact.law.pressure(state.kinematics.overclosure)
    if state.swinging and state.limiting is not None:
        pressure = state.limiting + _LIMIT_SHARE * (pressure - state.limiting)
    return replace(state, limiting=pressure)


def _linearise(system: LocalSystem, state: _State) -> Linearisation:
    law, found = system.deformable.contact.law, state.kinematics
    return Linearisation(
        weights=system.surfaces.weights,
        gradient=found.gradient,
        constant=found.overclosure - system.gather(found.gradient, state.displacement),
        at=state.at,
        pressure=law.pressure(state.at),
        stiffness=law.stiffness(state.at),
        load_factor=state.load_factor,
    )


def _solve(problem: _Problem, linear: Linearisation, state: _State) -> tuple[FloatArray, _State]:
    """Solve the linear problem; hold the blocks more where nothing else does."""
    farthest = _FARTHEST * problem.system.deformable.assembly.characteristic_length
    while True:
        try:
            trial = problem.step(linear, state.displacement, state.holding)
            if problem.free is not None:
                inverse = problem.step.inverse(linear, state.holding)
                trial = problem.free.constrained(trial, inverse)
            if np.abs(trial).max() <= farthest:
                return trial, state
            raise UnheldBlocksError(
                f"a block would move by {np.abs(trial).max():.3g} mm, more than "
                f"{_FARTHEST:g} block lengths",
                (),
            )
        except UnheldBlocksError as error:
            if state.rescues >= _MAX_RESCUES:
                raise StaticError(_unheld_text(error)) from None
            stronger = max(10.0 * state.holding, _RESCUE_HOLDING * state.first_holding)
            state = replace(state, holding=stronger, rescues=state.rescues + 1)


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
    problem: _Problem, linear: Linearisation, state: _State, trial: FloatArray
) -> float:
    """Share of the way to the linear solution at which the energy is least.

    One, unless the energy rises steeply at the end. Along the way overclosures and slips are
    linear, so the energy is convex (friction limits frozen) and the slope is found by bisection
    from contact points alone. A way on which supports move goes to its end: energy that they
    bring in says nothing, and no other state has them where they are prescribed.
    """
    system, step = problem.system, problem.step
    if not system.has_prescribed(state.displacement):
        return 1.0
    law, weights = system.deformable.contact.law, system.surfaces.weights
    way = trial - state.displacement
    force = step.internal_force(state.displacement) - linear.load_factor * step.external_force
    start = float(np.vdot(force, way))
    growth = float(np.vdot(step.internal_force(way), way))
    before = linear.constant + system.gather(linear.gradient, state.displacement)
    change = system.gather(linear.gradient, way)

    sliding = _sliding_slope(problem, state, way)

    def slope(share: float) -> float:
        pressure = law.pressure(before + share * change)
        normal = float(np.vdot(weights * pressure, change))
        return start + share * growth + normal + sliding(share)

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


def _sliding_slope(problem: _Problem, state: _State, way: FloatArray) -> Callable[[float], float]:
    """Work of the friction per share of a way, as a function of the share."""
    rows = problem.friction
    if rows is None:
        return lambda _: 0.0
    pressure = problem.system.deformable.contact.law.pressure(state.kinematics.overclosure)
    before, change, anchor = rows.slip(state.displacement), rows.slip(way), _anchor(state)
    weighted = problem.system.surfaces.weights[:, :, None] * change

    def slope(share: float) -> float:
        traction, _ = friction_tractions(rows.friction, before + share * change, anchor, pressure)
        return float(np.vdot(weighted, traction))

    return slope


def _residual(problem: _Problem, state: _State) -> float:
    """Norm of the unbalanced nodal forces over that of the loads, or 1 % of the contacts'."""
    system, step = problem.system, problem.step
    pressure = system.deformable.contact.law.pressure(state.kinematics.overclosure)
    forces = system.surfaces.weights * pressure
    unbalanced = state.load_factor * step.external_force
    unbalanced = unbalanced - step.internal_force(state.displacement)
    unbalanced += system.scatter(state.kinematics.gradient, forces)
    if problem.friction is not None:
        unbalanced += problem.friction.forces(state.displacement, _anchor(state), pressure)
    return _relative(problem, system.free_part(unbalanced), forces)


def _relative(problem: _Problem, unbalanced: FloatArray, contact_forces: FloatArray) -> float:
    size = max(
        float(np.linalg.norm(problem.system.external_force)),
        _CONTACT_SHARE * float(np.linalg.norm(contact_forces)),
    )
    if problem.free is not None:
        unbalanced = problem.free.without(unbalanced)
    left = float(np.linalg.norm(unbalanced))
    return left / size if size > 0.0 else left


# ---------------------------------------------------------------------------------------------
# Result


def _result(
    problem: _Problem,
    state: _State,
    displacement: FloatArray,
    seconds: dict[str, float],
    *,
    searched: bool,
) -> StaticResult:
    system, options = problem.system, problem.options
    deformable, orbits = system.deformable, system.orbits
    law = deformable.contact.law
    displacements = tuple(system.expand(displacement))
    points = facing_points(deformable, displacements) if searched else None
    surfaces: ContactSurfaces | SearchedSurfaces = deformable.surfaces
    if points is None:
        found = system.kinematics(displacement, deformable.contact.normals)
        overclosure = found.overclosure.ravel()[orbits.point_of]
    else:
        surfaces = searched_surfaces(points, deformable.surfaces.clearance)
        corners = corner_displacements(deformable, displacements, surfaces)
        overclosure = surfaces.kinematics(corners, deformable.contact.normals).overclosure
    share = _copies(system)
    pressures = law.pressure(overclosure)
    loose = np.zeros(0, dtype=np.int64)
    if deformable.contact.friction is None:
        loose = loose_blocks(deformable, displacements, pressures, surfaces)
    strain = 0.5 * displacement * system.internal_force(displacement)
    work = displacement * system.external_force
    stored = surfaces.weights * law.stored_energy(overclosure)
    return StaticResult(
        deformable=deformable,
        displacements=displacements,
        overclosures=overclosure,
        pressures=pressures,
        residual=state.residuals[-1],
        converged=state.converged,
        status=_status(state, options, loose),
        steps=tuple((factor, tuple(system.expand(u))) for factor, u in state.path),
        loose_blocks=loose,
        residuals=state.residuals,
        strain_energy=float(share @ strain.sum(axis=1)),
        contact_energy=float(stored.sum()),
        external_work=float(share @ work.sum(axis=1)),
        frictional_dissipation=state.dissipation,
        symmetry=orbits.order,
        n_unknowns=displacement.size,
        load_steps=options.load_steps,
        cpu_seconds=seconds,
        points=points,
        searched=surfaces if isinstance(surfaces, SearchedSurfaces) else None,
    )


def _copies(system: LocalSystem) -> FloatArray:
    """Blocks that each node's representative stands for, (n_nodes,)."""
    slots = system.slot_of[system.deformable.deformable_blocks]
    count = np.bincount(slots, minlength=system.n_slots)
    return np.repeat(count, np.diff(system.node_start)).astype(np.float64)


def _status(state: _State, options: StaticOptions, loose: IntArray) -> str:
    count, residual = len(state.residuals), state.residuals[-1]
    names = ", ".join(str(b) for b in loose[:8]) + (", …" if len(loose) > 8 else "")
    unheld = f"; no contact holds blocks {names} in every direction" if len(loose) else ""
    if state.saddles:
        unheld = (
            f"; left {state.saddles} stationary state{'s' if state.saddles > 1 else ''} from which "
            f"the energy falls: other equilibria exist{unheld}"
        )
    if state.converged:
        undetermined = ": their place is not determined" if len(loose) else ""
        return (
            f"equilibrium after {count} iterations, residual {residual:.1e}{unheld}{undetermined}"
        )
    return (
        f"no equilibrium after {count} iterations: residual {residual:.1e}, expected "
        f"{options.tolerance:.1e}{unheld}; use more load steps, reference normals, a smaller "
        "initial clearance or an explicit run"
    )
