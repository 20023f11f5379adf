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

import numpy as np

from fem.state import State
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.linear_step.linearisation import StaticError
from fem.static.newton import Iterate, PathPoint, require_near, start_iterate
from fem.static.path import ElasticSlips, Known, PointSearch, follow, points_of
from fem.static.problem import (
    StaticMethod,
    StaticOptions,
    StaticProblem,
    problem_of,
    structured_blocks,
)
from fem.system.contact_state import facing_points
from fem.system.loose import loose_blocks, require_supported
from fem.system.reactions import Forces, MovingSupport, PushCurve, moving_supports
from fem.system.sector import cyclic_sector, largest_sector
from fem.system.system import Sector, System
from geometry.machine.system import keep_freed_memory, one_thread_of_blas
from geometry.machine.work import LimitError
from geometry.mesh import FloatArray, read_only

__all__ = ["StaticMethod", "StaticOptions", "static_state"]

#: Parts in which the load is applied when all at once does not converge.
_FALLBACK_LOAD_STEPS = 4
#: Load steps that are not doubled any more.
MOST_PARTS = 16
#: Increments of a stage with which the doubling begins.
_INCREMENTS = 5


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
    friction, and in stages where supports move, load steps are doubled until that changes the
    answer by less than the tolerance of the options.

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
    keep_freed_memory()
    options = StaticOptions() if options is None else options
    store = FlexibilityStore() if store is None else store
    stages = [*before, system]
    way_counts = system.meets and system.contact.friction is not None
    way_counts |= bool(before) and any(stage.supports.tables for stage in stages)
    if before and way_counts:
        options = replace(options, load_steps=max(options.load_steps, _INCREMENTS))
    elif not system.meets:  # linear: all at once
        options = replace(options, motion_steps=None, symmetry=1)
    near = dict(known) if way_counts and start is None and not before else {}
    doubles = options.load_tolerance is not None and way_counts and start is None

    def in_parts(parts: int) -> State:
        once, result = replace(options, load_steps=parts), None
        if near:
            with contextlib.suppress(StaticError):
                result = _followed(stages, once, start, store, known=tuple(near.items()))
        if result is None or not result.evidence.converged:
            result = _followed(stages, once, start, store)
        if doubles and not before and result.evidence.converged:
            path = (*result.evidence.path, result)
            near.update({one.load_factor: one.displacements for one in path})
        return result

    if options.load_tolerance is not None and doubles:
        state = doubled(in_parts, options.load_steps, options.load_tolerance)
    else:
        state = in_parts(options.load_steps)
    if not state.evidence.converged:
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
        enough = (
            known is not None and fine.evidence.converged and path_change(known, fine) <= tolerance
        )
        if enough or 2 * parts > MOST_PARTS:
            break
        known = fine if fine.evidence.converged else known
        parts *= 2
    if known is None:
        return fine
    if not fine.evidence.converged:
        return known
    fine.evidence.coarser = known
    return fine


def _followed(
    stages: Sequence[System],
    options: StaticOptions,
    start: tuple[FloatArray, ...] | None,
    store: FlexibilityStore,
    *,
    known: Known = (),
) -> State:
    """Follow the path of all stages, in load steps where all at once does not converge.

    States under some loads may be ``known`` nearly.
    """
    clock = time.process_time()
    several = [stage.computed for stage in stages] if len(stages) > 1 else []
    if several:
        rest = np.zeros((several[0].n_nodes, 3))
        first = several[0] = replace(several[0], begin=(rest, rest))
    else:
        first = _sector(stages[0], options)
    problem, begin, search = _beginning(first, options, store, start)
    if several:
        begin = replace(begin, point=PathPoint(0.0, 0.0))
    ready = time.process_time()
    path = points_of(several or [first], options)
    found = follow(problem, begin, path, stages=several, known=known, search=search)
    more = options.load_steps < _FALLBACK_LOAD_STEPS
    if more and not options.once and not found[-1].evidence.converged:
        options = replace(options, load_steps=_FALLBACK_LOAD_STEPS)
        problem, begin, search = _beginning(first, options, store, start)
        begin = replace(begin, residuals=found[-1].evidence.residuals)
        path = points_of(several or [first], options)
        found = _closer(found, follow(problem, begin, path, known=known, search=search))
    state = _with_evidence(found, options, (clock, ready))
    if several:
        state.evidence.curves = _curves(found, stages[-1])
    return state


def _curves(found: list[State], stage: System) -> tuple[PushCurve, ...]:
    """Forces of supports that move in the last of several stages, from where it begins."""
    mine = _of_last_stage(found)
    before, (last,) = found[: -len(mine)], mine[-1:]
    assert last.system.begin is not None
    places = tuple(last.system.expand(last.system.begin[0]))
    still = tuple(np.zeros_like(place) for place in places)
    pushed: dict[float, Forces] = {0.0: (before[-1].support_forces if before else ()) or still}
    pushed |= {one.load_factor: one.support_forces for one in mine}
    return tuple(_curve(moving, places, pushed) for moving in moving_supports(stage))


def _of_last_stage(found: list[State]) -> list[State]:
    """States that go on from the beginning of the last one."""
    return [one for one in found if one.system.begin is found[-1].system.begin]


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
    *path, last = _of_last_stage(found)
    (clock, ready), end = clocks, time.process_time()
    require_near(last.system, last.displacement)
    evidence = replace(
        last.evidence,
        load_steps=options.load_steps,
        cpu_seconds={"setup": ready - clock, "newton": end - ready, "total": end - clock},
        path=tuple(path),
    )
    state = replace(last, evidence=evidence)
    if state.whole.contact.friction is None:
        at_points = state.displacements, state.pressures, state.points
        loose = loose_blocks(state.whole, *at_points, state.system.orbits.representative)
        evidence.loose_blocks = read_only(loose)
    evidence.status = _status(state, options)
    return state


def _beginning(
    system: Sector,
    options: StaticOptions,
    store: FlexibilityStore,
    start: tuple[FloatArray, ...] | None,
) -> tuple[StaticProblem, Iterate, PointSearch | None]:
    """The problem of a system, where it begins, and what follows the motion if it is searched."""
    if not system.whole.meets:
        require_supported(system)
    near = None if start is None else _localised(system, start)
    if not system.whole.contact.finite_sliding:
        problem = problem_of(system, options, store, near)
        return problem, start_iterate(problem.system, near, exact=problem.step.exact), None
    points = facing_points(system, start)
    rest = np.zeros((system.n_nodes, 3)) if near is None else near
    search = PointSearch(points, ElasticSlips.none(points), rest)
    problem = problem_of(search.system(system), options, store)
    return problem, start_iterate(problem.system, near), search


def _localised(system: Sector, start: tuple[FloatArray, ...]) -> FloatArray:
    """Displacements of each body on the representatives, in block frames; (n_nodes, 3) [mm]."""
    expected = [(g.n_copies, g.n_nodes, 3) for g in system.whole.bodies]
    if [u.shape for u in start] != expected:
        raise StaticError(
            f"start: got displacements of shapes {[u.shape for u in start]}; "
            f"expected {expected}: start from a state of the same model"
        )
    return system.localised(start)


def _closer(once: list[State], in_parts: list[State]) -> list[State]:
    """What is closer to equilibrium under the whole load: its last state, or that of load steps."""
    first, last = once[-1], in_parts[-1]
    before, after = first.evidence.residuals, last.evidence.residuals
    whole = (last.load_factor, last.time) == (first.load_factor, first.time)
    if last.evidence.converged or (whole and after[-1] <= before[-1]):
        return in_parts
    tried = replace(first.evidence, residuals=(*after, before[-1]))
    return [*once[:-1], replace(first, evidence=tried)]


def _sector(system: System, options: StaticOptions) -> Sector:
    """What is computed of a system."""
    if options.symmetry is not None:
        return cyclic_sector(system, options.symmetry)
    # Points of a search are those of a sector; states of least energy may be less symmetric.
    rough = system.contact.friction is not None and not system.contact.finite_sliding
    half_turn = rough or structured_blocks(system, options) is not None
    return largest_sector(system, half_turn=half_turn)


# ---------------------------------------------------------------------------------------------
# Result


def _ways(state: State) -> str:
    """How far supports have moved."""
    at = {state.time or 0.0: 0.0}
    curves = [moving.curve(at) for moving in moving_supports(state.whole)]
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
    if evidence.converged and not state.whole.meets:
        return f"equilibrium of single bodies, residual {residual:.1e}"
    if evidence.converged:
        undetermined = ": their place is not determined" if len(loose) else ""
        return (
            f"equilibrium after {count} iterations, residual {residual:.1e}{unheld}{undetermined}"
        )
    return (
        f"no equilibrium found in {count} iterations: residual {residual:.1e}, expected "
        f'{options.tolerance:.1e}{unheld}; use an explicit run (fem.method = "explicit"), or '
        "more load steps (fem.load_steps)"
    )
