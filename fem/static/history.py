"""Static states one after the other: loads and supports change, and slips of friction stay.

A stage is a problem with the loads and supports at its end. From the state before it, forces and
prescribed displacements change in equal increments; each begins where the one before ended, with
its slips. What is held no longer lets go at the beginning. Increments that find no equilibrium are
halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.reactions import Forces, MovingSupport, PushCurve, moving_supports
from fem.problem.loads import TabularAmplitude
from fem.problem.model import NodalLoad, Support
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.load_steps import StaticOptions
from fem.static.result import StaticError, StaticResult, load_factors, refined
from fem.static.solve import solve_static
from geometry.mesh import FloatArray

#: Increments of a stage with which the doubling begins.
_INCREMENTS = 5
#: Share of a stage below which an increment is not halved.
_SHORTEST = 1e-3

#: Displacements of each group, world axes, (n_copies, n_nodes, 3) [mm].
_Displacements = tuple[FloatArray, ...]


def solve_history(
    stages: Sequence[DeformableAssembly],
    options: StaticOptions,
    store: FlexibilityStore | None = None,
) -> StaticResult:
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
        An increment without an equilibrium; and as `fem.static.solve.solve_static`.
    """
    store = FlexibilityStore() if store is None else store
    least = max(options.load_steps, _INCREMENTS)
    once = replace(options, load_steps=1, load_tolerance=None, load_path=(1.0,), symmetry=1)
    once = replace(once, motion_steps=None)

    def in_parts(parts: int) -> StaticResult:
        result: StaticResult | None = None
        for number in range(len(stages)):
            result = _stage(stages, number, result, parts, once, store)
        assert result is not None
        return replace(result, load_steps=parts)

    if options.load_tolerance is None:
        return in_parts(least)
    result, coarser = refined(in_parts, least, options.load_tolerance)
    return replace(result, coarser_loading=coarser)


def _stage(
    stages: Sequence[DeformableAssembly],
    number: int,
    start: StaticResult | None,
    parts: int,
    options: StaticOptions,
    store: FlexibilityStore,
) -> StaticResult:
    """Go from the state before a stage to its end."""
    stage, before = stages[number], stages[number - 1] if number else None
    begin = None if start is None else start.displacements
    ahead = list(load_factors(parts, friction=start is None))[::-1]
    pushed: dict[float, Forces] = {0.0: () if start is None else start.support_forces}
    lost = 0.0 if start is None else start.frictional_dissipation
    result, done = start, 0.0
    while ahead:
        share = ahead.pop()
        found = _increment(stage, before, begin, share, result, options, store)
        if found is None:
            middle = 0.5 * (done + share)
            if middle - done < _SHORTEST:
                raise StaticError(
                    f"static: no equilibrium was found at {share:.3g} of stage {number + 1} of "
                    f"{len(stages)}; the one before is at {done:.3g}"
                )
            ahead += [share, middle]
            continue
        lost += found.frictional_dissipation
        pushed[share] = found.support_forces
        result, done = found, share
    assert result is not None
    return replace(
        result,
        deformable=stage,
        frictional_dissipation=lost,
        curves=tuple(_curve(moving, begin, pushed) for moving in moving_supports(stage.model)),
    )


def _curve(
    moving: MovingSupport, begin: _Displacements | None, pushed: dict[float, Forces]
) -> PushCurve:
    """Force over the way of a support in a stage, from the state before it on."""
    part, k = moving.largest
    first = float(_along(part, begin)[k])
    shares = np.array(list(pushed))
    ways = first + shares * (float(_aim(part)[k]) - first)
    forces = [moving.force(forces) if forces else 0.0 for forces in pushed.values()]
    return PushCurve(part.name, shares, ways * np.sign(part.displacement[k]), np.array(forces))


def _increment(
    stage: DeformableAssembly,
    before: DeformableAssembly | None,
    begin: _Displacements | None,
    share: float,
    start: StaticResult | None,
    options: StaticOptions,
    store: FlexibilityStore,
) -> StaticResult | None:
    """State at a share of the way from the state before a stage to its end; None: none found."""
    model = stage.model
    loads = _scaled(model.loads, share)
    gravity = model.effects.gravity
    weight = None if gravity is None else share * np.asarray(gravity)
    if before is not None:
        loads += _scaled(before.model.loads, 1.0 - share)
        first = before.model.effects.gravity
        if first is not None:
            weight = (0.0 if weight is None else weight) + (1.0 - share) * np.asarray(first)
    supports = tuple(
        replace(support, displacement=_at(support, begin, share), amplitude=_ONCE)
        for support in model.supports
    )
    there = replace(
        stage,
        model=replace(
            model,
            loads=loads,
            supports=supports,
            effects=replace(model.effects, gravity=weight),
        ),
    )
    try:
        result = solve_static(there, options, start=start, goes_on=True, store=store)
    except StaticError:
        if start is None and share == 1.0:
            raise
        return None
    return result if result.converged else None


#: A way that is gone at the end of an increment.
_ONCE = TabularAmplitude((0.0, 1.0), (0.0, 1.0))


def _scaled(loads: tuple[NodalLoad, ...], share: float) -> tuple[NodalLoad, ...]:
    return tuple(replace(load, forces=share * load.forces) for load in loads if share)


def _at(support: Support, begin: _Displacements | None, share: float) -> FloatArray:
    """Prescribed displacements at a share of the way from those at the beginning, (n,) [mm]."""
    first = _along(support, begin)
    return first + share * (_aim(support) - first)


def _aim(support: Support) -> FloatArray:
    last = 1.0 if support.amplitude is None else support.amplitude(np.inf)
    return last * support.displacement


def _along(support: Support, moved: _Displacements | None) -> FloatArray:
    """Displacements along the directions of a support, (n,) [mm]."""
    if moved is None:
        return np.zeros(len(support.nodes))
    at = moved[support.group][support.copies, support.nodes]
    return np.asarray(np.einsum("ni,ni->n", at, support.directions))
