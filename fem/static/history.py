"""Static states one after the other: loads and supports change, and slips of friction stay.

A stage is a problem with the loads and supports at its end. From the state before it, forces and
prescribed displacements change in equal increments; each begins where the one before ended, with
its slips. A support that ends is released at the start of its stage. Increments that do not
converge are halved.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem.state import State
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.newton import start_iterate
from fem.static.path import StaticOptions, follow
from fem.static.result import StaticError, doubled, load_factors
from fem.static.solve import beginning, problem_of, with_evidence
from fem.system.reactions import Forces, MovingSupport, PushCurve, moving_supports
from fem.system.system import System
from geometry.mesh import FloatArray

#: Increments of a stage with which the doubling begins.
_INCREMENTS = 5
#: Supports that are to move by less, over the largest displacement, stay where they are.
_ROUNDING = 1e-12


def solve_history(
    stages: Sequence[System],
    options: StaticOptions,
    store: FlexibilityStore | None = None,
) -> State:
    """Find the state at the end of the last stage.

    Parameters
    ----------
    stages
        The same blocks with the loads and supports at the end of each stage.
    options
        With a load tolerance the increments are doubled until that changes the answer by less.
    store
        Of one call for the next, as `fem.static.solve.solve_static`.

    Raises
    ------
    StaticError
        An increment without an equilibrium; and as
        `fem.static.solve.solve_static`.
    """
    store = FlexibilityStore() if store is None else store

    def in_parts(parts: int) -> State:
        return _through(stages, replace(options, load_steps=parts), store)

    least = max(options.load_steps, _INCREMENTS)
    if options.load_tolerance is None:
        return in_parts(least)
    return doubled(in_parts, least, options.load_tolerance)


def _through(stages: Sequence[System], options: StaticOptions, store: FlexibilityStore) -> State:
    """Follow all stages, each in as many increments as there are load steps."""
    clock = time.process_time()
    moved = forces = np.zeros((stages[0].n_nodes, 3))
    system = replace(stages[0], begin=(moved, forces))
    problem, search = beginning(system, options, store)
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
    state = with_evidence(found, options, (clock, ready))
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
