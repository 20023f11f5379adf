"""Static equilibrium of deformable blocks in contact, by Newton in displacements and pressures.

Under one load `fem.static.newton` iterates. The history of friction, where the model has it,
advances from load step to load step.

Where facets do not match, or blocks slide far, points are those of the search of explicit runs
(`fem.contact.search`). Equilibrium on the points of one place moves the blocks; the search is
repeated where they are then, until points follow the motion to a small share of a facet.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fem.contact.search import FacingPoints, SearchedPoints, points_of_search
from fem.state import State
from fem.static.linear_step.condensed import CondensedStep
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.linear_step.grid_block import GridBlock
from fem.static.linear_step.linearisation import LinearStep, SparseStep, StaticError
from fem.static.linear_step.reduced import ReducedStep, is_smaller
from fem.static.newton import (
    Iterate,
    StaticProblem,
    localised,
    require_near,
    start_iterate,
)
from fem.static.path import (
    ElasticSlips,
    Known,
    PointSearch,
    StaticMethod,
    StaticOptions,
    follow,
    load_factors,
    points_of,
)
from fem.system.contact_state import facing_points
from fem.system.loose import loose_blocks, require_supported
from fem.system.reactions import Forces, MovingSupport, PushCurve, moving_supports
from fem.system.sector import (
    cyclic_orbits,
    largest_cyclic_orbits,
    with_half_turn,
)
from fem.system.system import Orbits, System
from geometry.machine.system import one_thread_of_blas
from geometry.machine.work import LimitError
from geometry.mesh import FloatArray, read_only

__all__ = ["StaticMethod", "StaticOptions", "static_state"]

#: Parts in which the load is applied when all at once does not converge.
_FALLBACK_LOAD_STEPS = 4
#: Load steps that are not doubled any more.
MOST_PARTS = 16
#: Increments of a stage with which the doubling begins.
_INCREMENTS = 5
#: Supported nodes of a block beyond which one sparse matrix takes the place of dense flexibilities,
#: which keep them: plane strain holds every node of a slice, and 3 400 took 12 GB.
_MOST_HELD = 1500


@one_thread_of_blas()
def static_state(
    system: System,
    options: StaticOptions | None = None,
    *,
    before: Sequence[System] = (),
    start: tuple[FloatArray, ...] | None = None,
    store: FlexibilityStore | None = None,
    known: Known = (),
) -> State:
    """Find the static state of an assembly under its loads; single bodies are solved at once.

    Without friction the state does not depend on the path of the loads, which act at once. With
    friction, and in stages, load steps are doubled until that changes the answer by less than the
    tolerance of the options.

    Parameters
    ----------
    system
        Blocks, loads, supports and contact.
    options
        Method, symmetry, load steps and tolerances.
    before
        Stages from rest on that come before: the same blocks with other loads and supports.
    start
        Displacements of each body in a state of the same model, (n_copies, n_nodes, 3) [mm], for
        instance under another load.
    store
        Of one call for the next: blocks that are the same are condensed once.
    known
        Load factors and displacements of states there that are nearly equilibria, such as those on
        another mesh: where load steps with friction are looked for. They count for no history.

    Raises
    ------
    StaticError
        No equilibrium was found, or no contact holds a block: its place is not determined.
    SymmetryError
        A symmetry asked for that the model does not have.
    SparseSolverError
        A library that is not installed.
    """
    options = StaticOptions() if options is None else options
    store = FlexibilityStore() if store is None else store
    if before:
        options = replace(options, load_steps=max(options.load_steps, _INCREMENTS))
    elif not system.meets:  # linear: all at once
        options = replace(options, motion_steps=None, symmetry=1)
    rubs = system.meets and system.contact.friction is not None and start is None
    doubles = options.load_tolerance is not None and (rubs or bool(before))
    near = dict(known) if doubles else {}

    def in_parts(parts: int) -> State:
        once = replace(options, load_steps=parts)
        if before:
            return _through_stages([*before, system], once, store)
        result: State | None = None
        if near:
            with contextlib.suppress(StaticError):
                result = _load(system, once, start, store, known=tuple(near.items()))
        if result is None or not result.converged:
            result = _load(system, once, start, store)
        if doubles and result.converged:
            path = (*result.evidence.path, result)
            near.update({one.load_factor: one.displacements for one in path})
        return result

    if options.load_tolerance is not None and doubles:
        state = doubled(in_parts, options.load_steps, options.load_tolerance)
    else:
        state = in_parts(options.load_steps)
    if not state.converged:
        raise StaticError(state.evidence.status)
    return state


def path_change(coarse: State, fine: State) -> float:
    """Relative change of an answer: displacement, pressure at a point, pressures in the mean [-].

    Both are states of the same facets; of a search only what does not name facets is compared.
    """

    def numbers(state: State) -> tuple[float, float, float]:
        pressures, areas = state.contact_state.pressures, state.contact_state.areas
        mean = float(np.sqrt(areas @ pressures**2 / max(float(areas.sum()), 1e-300)))
        return state.largest_displacement, float(state.pressures.max(initial=0.0)), mean

    pairs = zip(numbers(coarse), numbers(fine), strict=True)
    return max(abs(a - b) / abs(b) if b else float(a != b) for a, b in pairs)


def doubled(solve: Callable[[int], State], parts: int, tolerance: float) -> State:
    """Double the parts of the load until that changes the answer by less than a tolerance.

    Returns
    -------
    State
        The last one that was reached; the one before it, in fewer parts, is in its evidence.

    Raises
    ------
    LimitError
        A limit is reached before any state.
    """
    known: State | None = None
    while True:
        try:
            fine = solve(parts)
        except LimitError:
            if known is None:
                raise
            return known
        # More than asked for where so few had no equilibrium.
        parts = max(parts, fine.evidence.load_steps)
        enough = known is not None and fine.converged and path_change(known, fine) <= tolerance
        if enough or 2 * parts > MOST_PARTS:
            break
        known = fine if fine.converged else known
        parts *= 2
    if known is None:
        return fine
    if not fine.converged:
        return known
    fine.evidence.coarser = known
    return fine


def _load(
    system: System,
    options: StaticOptions,
    start: tuple[FloatArray, ...] | None,
    store: FlexibilityStore,
    *,
    known: Known = (),
) -> State:
    """Apply the load in the requested parts; states under some loads may be ``known`` nearly."""
    clock = time.process_time()
    # Points of a search are those of a sector; states of least energy may be less symmetric.
    contact = system.contact
    rough = contact.friction is not None and not contact.finite_sliding
    half_turn = rough or _grids(system, options) is not None
    orbits = _orbits(system, options.symmetry, half_turn=half_turn)
    problem, search = _beginning(system.in_sector(orbits), options, store, start)
    ready = time.process_time()
    before = None if start is None else localised(problem.system, start)
    first = start_iterate(problem.system, before)
    again = None if search is None else replace(search)
    path = points_of(problem.system, options)
    found = follow(problem, first, path, known=known, search=search)
    more = options.load_steps < _FALLBACK_LOAD_STEPS
    if more and not options.once and not found[-1].converged:
        options = replace(options, load_steps=_FALLBACK_LOAD_STEPS)
        first = replace(first, residuals=found[-1].evidence.residuals)
        if again is not None:
            problem, first = again.anew(problem, first)
            again.elastic = ElasticSlips.none(again.points)
        path = points_of(problem.system, options)
        found = _closer(found, follow(problem, first, path, known=known, search=again))
    return _with_evidence(found, options, (clock, ready))


def _through_stages(
    stages: Sequence[System], options: StaticOptions, store: FlexibilityStore
) -> State:
    """Follow all stages, each in as many increments as there are load steps.

    From the state before a stage forces and prescribed displacements change in equal increments.
    Slips of friction stay; a support that ends is released at the start of its stage. Increments
    that do not converge are halved.
    """
    clock = time.process_time()
    moved = forces = np.zeros((stages[0].n_nodes, 3))
    system = replace(stages[0], begin=(moved, forces))
    problem, search = _beginning(system, options, store)
    begin, ready = start_iterate(problem.system), time.process_time()
    found = list[State]()
    for number, stage in enumerate(stages, start=1):
        if found:
            state = found[-1]
            moved, forces = state.displacement, _force(state)
            system = replace(stage, begin=(moved, system.external_force))
            problem = problem_of(system.on(state.system.points), options, store)
            begin = replace(
                start_iterate(problem.system, problem.step.kept(moved)),
                dissipation=state.frictional_dissipation,
                residuals=state.evidence.residuals,
            )
            if state.anchor is not None:
                begin = replace(begin, anchor=state.anchor)
        acts = stage.moves or system.loads.any()
        parts = load_factors(options.load_steps if acts else 1, friction=number == 1)
        begin = replace(begin, load_factor=0.0, time=0.0)
        found = follow(problem, begin, [(s, s) for s in parts], search=search)
        state = found[-1]
        failed, reached = state.evidence.stopped, state.load_factor
        if failed is None and not state.converged:
            failed, reached = reached, 0.0
        if failed is not None:
            raise StaticError(
                f"static: no equilibrium was found at {failed:.3g} of stage {number} of "
                f"{len(stages)}; the one before is at {reached:.3g}"
            )
    pushed = {0.0: forces} | {one.load_factor: _force(one) for one in found}
    whole = {share: tuple(system.expand(force)) for share, force in pushed.items()}
    first = tuple(system.expand(moved))
    curves = tuple(_curve(one, first, whole) for one in moving_supports(stages[-1]))
    state = _with_evidence(found, options, (clock, ready))
    state.evidence.curves = curves
    return state


def _force(state: State) -> FloatArray:
    """Of the supports on all nodes, (n_nodes, 3) [N]."""
    return np.zeros_like(state.displacement) if state.support_force is None else state.support_force


def _curve(moving: MovingSupport, begin: Forces, pushed: dict[float, Forces]) -> PushCurve:
    """Force of a support over its way in the last stage, from where it is at the beginning."""
    last = moving.way * moving.amplitude(np.inf)
    shares = np.array(list(pushed))
    ways = (moving.place(begin) + shares * (last - moving.place(begin))) * np.sign(last)
    return PushCurve(
        moving.name, shares, ways, np.array([moving.force(f) for f in pushed.values()])
    )


def _with_evidence(
    found: list[State], options: StaticOptions, clocks: tuple[float, float]
) -> State:
    """The last state of a path with the evidence of it.

    ``clocks`` are the CPU times at which the run and its path began [s].
    """
    *path, last = found
    (clock, ready), end = clocks, time.process_time()
    require_near(last.system, last.displacement)
    evidence = replace(
        last.evidence,
        load_steps=options.load_steps,
        cpu_seconds={"setup": ready - clock, "newton": end - ready, "total": end - clock},
        path=tuple(path),
    )
    state = replace(last, evidence=evidence)
    if state.deformable.contact.friction is None:
        at_points = state.displacements, state.pressures, state.points
        loose = loose_blocks(state.deformable, *at_points, state.representative)
        evidence.loose_blocks = read_only(loose)
    evidence.status = _status(state, options)
    return state


def _beginning(
    system: System,
    options: StaticOptions,
    store: FlexibilityStore,
    start: tuple[FloatArray, ...] | None = None,
) -> tuple[StaticProblem, PointSearch | None]:
    """The problem of a system, and points that follow the motion where contact is searched."""
    if not system.meets:
        require_supported(system)
    near = None if start is None else localised(system, start)
    if not system.contact.finite_sliding:
        return problem_of(system, options, store, near), None
    points = facing_points(system, start)
    anew = partial(_searched_anew, options=options, points=points, store=store)
    problem = problem_of(system.on(_found(points, system)), options, store)
    begin = np.zeros((system.n_nodes, 3)) if near is None else near
    return problem, PointSearch(points, anew, ElasticSlips.none(points), begin)


def _found(points: FacingPoints, system: System) -> SearchedPoints:
    """Points of a search at its present positions."""
    return points_of_search(points, system.surfaces.clearance, system.contact.normals)


def _closer(once: list[State], in_parts: list[State]) -> list[State]:
    """What is closer to equilibrium under the whole load: its last state, or that of load steps."""
    first, last = once[-1], in_parts[-1]
    before, after = first.evidence.residuals, last.evidence.residuals
    whole = (last.load_factor, last.time) == (first.load_factor, first.time)
    if last.converged or (whole and after[-1] <= before[-1]):
        return in_parts
    tried = replace(first.evidence, residuals=(*after, before[-1]))
    return [*once[:-1], replace(first, evidence=tried)]


def problem_of(
    system: System,
    options: StaticOptions,
    store: FlexibilityStore,
    near: FloatArray | None = None,
) -> StaticProblem:
    """The system with its linear step; displacements ``near`` its solution, (n_nodes, 3) [mm]."""
    friction = system.has_friction
    step: LinearStep
    # On searched points limits of friction follow the pressures, in displacements alone.
    in_displacements = isinstance(system.points, SearchedPoints) and friction
    whole = options.method is StaticMethod.SPARSE or not system.meets
    whole |= _most_held(system) > _MOST_HELD
    grids = _grids(system, options)
    if grids is not None:
        from fem.static.linear_step.grid import GridStep

        step = GridStep(system, grids, near)
    elif whole or (in_displacements and not is_smaller(system)):
        step = SparseStep(system, options.sparse_solver)
    elif in_displacements:
        step = ReducedStep(system, store, options.sparse_solver)
    else:
        step = CondensedStep(system, store, friction=friction)
    return StaticProblem(system, step, options.tolerance, options.max_iterations)


def _grids(deformable: System, options: StaticOptions) -> tuple[GridBlock, ...] | None:
    """Structured blocks, where these are solved in the forces of their contact points."""
    curved = any(group.element.degree > 1 for group in deformable.bodies)
    if options.method is StaticMethod.SPARSE or not curved:
        return None
    from fem.static.linear_step.grid import grid_blocks

    return grid_blocks(deformable)


def _most_held(system: System) -> int:
    """Supported nodes of the block that has most of them."""
    slots = np.searchsorted(system.node_start, system.held.nodes, side="right")
    return int(np.bincount(slots).max(initial=0))


def _orbits(deformable: System, symmetry: int | None, *, half_turn: bool) -> Orbits:
    if symmetry is None:
        largest = largest_cyclic_orbits(deformable)
        return with_half_turn(deformable, largest) if half_turn else largest
    return deformable.orbits if symmetry == 1 else cyclic_orbits(deformable, symmetry)


def _searched_anew(
    problem: StaticProblem,
    state: Iterate,
    *,
    options: StaticOptions,
    points: FacingPoints,
    store: FlexibilityStore,
) -> tuple[StaticProblem, Iterate]:
    """The problem on the points of the place that a state has, and the state linearised there."""
    system = problem.system
    everywhere = problem.step.complete(state.displacement, state.load_factor)
    points.displace(tuple(system.expand(everywhere)))
    points.search()
    there = problem_of(system.on(_found(points, system)), options, store)
    return there, linearised_at(there, state, everywhere)


def linearised_at(problem: StaticProblem, state: Iterate, displacement: FloatArray) -> Iterate:
    """A state of a problem linearised at displacements of all nodes, (n_nodes, 3) [mm]."""
    kept = problem.step.kept(displacement)
    gaps = problem.system.points.gaps(kept)
    return replace(state, displacement=kept, gaps=gaps, at=gaps.x)


# ---------------------------------------------------------------------------------------------
# Result


def _ways(state: State) -> str:
    """How far supports have moved."""
    at = {state.time or 0.0: 0.0}
    curves = [moving.curve(at) for moving in moving_supports(state.system)]
    return ", ".join(f"{curve.name} by {curve.displacements[-1]:.4g} mm" for curve in curves)


def _status(state: State, options: StaticOptions) -> str:
    evidence = state.evidence
    loose = evidence.loose_blocks
    count, residual = len(evidence.residuals), evidence.residual
    names = ", ".join(str(b) for b in loose[:8]) + (", …" if len(loose) > 8 else "")
    unheld = f"; no contact holds blocks {names} in every direction" if len(loose) else ""
    if evidence.stopped is not None:
        return (
            f"equilibrium while supports moved until {state.time:.4g} s of their tables "
            f"({_ways(state)}); none was found at {evidence.stopped:.4g} s{unheld}"
        )
    if state.converged and not state.deformable.meets:
        return f"equilibrium of single bodies, residual {residual:.1e}"
    if state.converged:
        undetermined = ": their place is not determined" if len(loose) else ""
        return (
            f"equilibrium after {count} iterations, residual {residual:.1e}{unheld}{undetermined}"
        )
    return (
        f"no equilibrium found in {count} iterations: residual {residual:.1e}, expected "
        f'{options.tolerance:.1e}{unheld}; use an explicit run (fem.method = "explicit"), or '
        "more load steps (fem.load_steps)"
    )
