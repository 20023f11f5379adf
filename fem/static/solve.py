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
from dataclasses import replace
from functools import partial

import numpy as np

from fem.contact.search import FacingPoints, SearchedPoints, points_of_search
from fem.state import State
from fem.static.linear_step.condensed import CondensedStep
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.linear_step.grid_block import GridBlock
from fem.static.linear_step.linearisation import LinearStep, SparseStep
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
    completed,
    follow,
    load_path,
)
from fem.static.result import StaticError, doubled
from fem.system.loose import loose_blocks, require_supported
from fem.system.reactions import moving_supports
from fem.system.sector import (
    cyclic_orbits,
    largest_cyclic_orbits,
    with_half_turn,
)
from fem.system.state import facing_points
from fem.system.system import Orbits, System
from geometry.mesh import FloatArray, read_only

__all__ = ["StaticMethod", "StaticOptions", "solve_static"]

#: Parts in which the load is applied when all at once does not converge.
_FALLBACK_LOAD_STEPS = 4
#: Supported nodes of a block beyond which one sparse matrix takes the place of dense flexibilities,
#: which keep them: plane strain holds every node of a slice, and 3 400 took 12 GB.
_MOST_HELD = 1500


def solve_static(
    deformable: System,
    options: StaticOptions | None = None,
    *,
    start: tuple[FloatArray, ...] | None = None,
    store: FlexibilityStore | None = None,
    known: Known = (),
) -> State:
    """Find the static state of an assembly under its loads; single bodies are solved at once.

    Parameters
    ----------
    deformable
        Blocks, loads, supports and contact.
    options
        Method, symmetry and tolerance.
    start
        Displacements of each group in a state of the same model, (n_copies, n_nodes, 3) [mm], for
        instance under another load.
    store
        Of one call for the next: blocks that are the same are condensed once.
    known
        Load factors and displacements of states there that are nearly equilibria, such as those on
        another mesh: where load steps with friction are looked for. They count for no history.

    Returns
    -------
    State
        `State.converged` says whether it is an equilibrium.

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
    store = FlexibilityStore() if store is None else store
    if not deformable.meets:  # linear: all at once
        once = replace(options, motion_steps=None, symmetry=1)
        return _load(deformable, once, start, store)
    change = options.load_tolerance
    without = deformable.contact.friction is None or start is not None
    if without or change is None:
        return _load(deformable, options, start, store)

    near = dict(known)

    def in_parts(parts: int) -> State:
        solve = partial(_load, deformable, replace(options, load_steps=parts))
        result: State | None = None
        if near:
            with contextlib.suppress(StaticError):
                result = solve(None, store, known=tuple(near.items()))
        if result is None or not result.converged:
            result = solve(None, store)
        if result.converged:
            near.update(
                {one.load_factor: one.displacements for one in (*result.evidence.path, result)}
            )
        return result

    return doubled(in_parts, options.load_steps, change)


def _load(
    deformable: System,
    options: StaticOptions,
    start: tuple[FloatArray, ...] | None,
    store: FlexibilityStore,
    *,
    known: Known = (),
) -> State:
    """Apply the load in the requested parts; states under some loads may be ``known`` nearly."""
    clock = time.process_time()
    # Points of a search are those of a sector; states of least energy may be less symmetric.
    contact = deformable.contact
    rough = contact.friction is not None and not contact.finite_sliding
    half_turn = rough or _grids(deformable, options) is not None
    orbits = _orbits(deformable, options.symmetry, half_turn=half_turn)
    problem, search = beginning(deformable.in_sector(orbits), options, store, start)
    ready = time.process_time()
    before = None if start is None else localised(problem.system, start)
    first = start_iterate(problem.system, before)
    again = None if search is None else replace(search)
    path = load_path(problem, options, options.load_steps)
    found = follow(problem, first, path, known=known, search=search)
    more = options.load_steps < _FALLBACK_LOAD_STEPS
    if more and not options.once and not found[-1].converged:
        first = replace(first, residuals=found[-1].evidence.residuals)
        if again is not None:
            problem, first = again.anew(problem, first)
            again.elastic = ElasticSlips.none(again.points)
        path = load_path(problem, options, _FALLBACK_LOAD_STEPS)
        in_parts = follow(problem, first, path, known=known, search=again)
        found = _closer(found, in_parts)
        options = replace(options, load_steps=_FALLBACK_LOAD_STEPS)
    return with_evidence(found, options, (clock, ready))


def with_evidence(found: list[State], options: StaticOptions, clocks: tuple[float, float]) -> State:
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


def beginning(
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
    system, everywhere = problem.system, completed(problem, state)
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
