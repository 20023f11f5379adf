"""Static states one after the other: loads and supports change, and slips of friction stay.

A stage is a problem with the loads and supports at its end. From the state before it, forces and
prescribed displacements change in equal increments; each begins where the one before ended, with
its slips. What is held no longer lets go at the beginning. Increments that find no equilibrium are
halved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.load_steps import StaticOptions
from fem.static.result import StaticError, StaticResult, load_factors, refined
from fem.static.solve import solve_static
from fem.system.build import DeformableAssembly
from fem.system.forces import TabularAmplitude
from fem.system.model import Model, NodalLoad, Support
from fem.system.reactions import Forces, MovingSupport, PushCurve, moving_supports
from geometry.mesh import FloatArray

#: Increments of a stage with which the doubling begins.
_INCREMENTS = 5
#: Share of a stage below which an increment is not halved.
_SHORTEST = 1e-3
#: A way that is gone at the end of an increment.
_ONCE = TabularAmplitude((0.0, 1.0), (0.0, 1.0))


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
        An increment without an equilibrium, or a load path of its own; and as
        `fem.static.solve.solve_static`.
    """
    if options.load_path is not None:
        raise StaticError(
            f"static: got load_path {options.load_path} for a problem after another, whose loads "
            "change in equal increments; expected load_steps, or a problem for each part of the way"
        )
    least = max(options.load_steps, _INCREMENTS)
    once = replace(
        options, load_steps=1, load_tolerance=None, load_path=(1.0,), symmetry=1, motion_steps=None
    )
    store = FlexibilityStore() if store is None else store
    solve = partial(solve_static, options=once, goes_on=True, store=store)

    def in_parts(parts: int) -> StaticResult:
        result, before = None, None
        for number, problem in enumerate(stages, start=1):
            stage = _Stage(problem, before, result, f"{number} of {len(stages)}")
            result, before = stage.end(parts, solve), problem.model
        assert result is not None
        return replace(result, load_steps=parts)

    if options.load_tolerance is None:
        return in_parts(least)
    result, coarser = refined(in_parts, least, options.load_tolerance)
    return replace(result, coarser_loading=coarser)


@dataclass(frozen=True)
class _Stage:
    """From the state before to the loads and supports of a problem."""

    problem: DeformableAssembly
    before: Model | None
    """Whose loads act at the beginning; None: nothing does."""
    start: StaticResult | None
    """State at the beginning; None: rest."""
    title: str

    @property
    def acts(self) -> bool:
        """Whether there are loads, or supports that move: else one increment is enough."""
        model = self.problem.model
        moves = any(support.displacement.any() for support in model.supports)
        return moves or bool(model.loads) or model.effects.gravity is not None

    def end(self, parts: int, solve: Callable[..., StaticResult]) -> StaticResult:
        """State at the end, after some increments or more."""
        result, done = self.start, 0.0
        pushed: dict[float, Forces] = {0.0: () if result is None else result.support_forces}
        lost = 0.0 if result is None else result.frictional_dissipation
        first = result is None
        ahead = list(load_factors(parts if self.acts or not first else 1, friction=first))[::-1]
        while ahead:
            share = ahead.pop()
            try:
                found = solve(self.at(share), start=result)
            except StaticError:
                if first and share == 1.0:
                    raise
                found = None
            if found is None or not found.converged:
                if share - done < _SHORTEST:
                    raise StaticError(
                        f"static: no equilibrium was found at {share:.3g} of stage {self.title}; "
                        f"the one before is at {done:.3g}"
                    )
                ahead += [share, 0.5 * (done + share)]
                continue
            lost += found.frictional_dissipation
            pushed[share] = found.support_forces
            result, done = found, share
        assert result is not None
        curves = tuple(self._curve(one, pushed) for one in moving_supports(self.problem.model))
        return replace(result, deformable=self.problem, frictional_dissipation=lost, curves=curves)

    def at(self, share: float) -> DeformableAssembly:
        """Problem at a share of the way."""
        model, before = self.problem.model, self.before
        loads, weight = _scaled(model, share)
        if before is not None:
            more, added = _scaled(before, 1.0 - share)
            loads += more
            weight += added
        supports = []
        for support in model.supports:
            first = self._first(support)
            there = first + share * (_last(support) - first)
            supports.append(replace(support, displacement=there, amplitude=_ONCE))
        effects = replace(model.effects, gravity=weight if weight.any() else None)
        changed = replace(model, loads=loads, supports=tuple(supports), effects=effects)
        return replace(self.problem, model=changed)

    def _first(self, support: Support) -> FloatArray:
        """Displacements along the directions of a support at the beginning, (n,) [mm]."""
        if self.start is None:
            return np.zeros(len(support.nodes))
        at = self.start.displacements[support.group][support.copies, support.nodes]
        return np.asarray(np.einsum("ni,ni->n", at, support.directions))

    def _curve(self, moving: MovingSupport, pushed: dict[float, Forces]) -> PushCurve:
        """Force of a support over its way in the stage."""
        part, k = moving.largest
        first, last = float(self._first(part)[k]), float(_last(part)[k])
        shares = np.array(list(pushed))
        ways = (first + shares * (last - first)) * np.sign(last)
        forces = [moving.force(forces) if forces else 0.0 for forces in pushed.values()]
        return PushCurve(part.name, shares, ways, np.array(forces))


def _scaled(model: Model, share: float) -> tuple[tuple[NodalLoad, ...], FloatArray]:
    """Loads and gravity times a share."""
    loads = tuple(replace(load, forces=share * load.forces) for load in model.loads if share)
    gravity = model.effects.gravity
    return loads, share * np.asarray((0.0, 0.0, 0.0) if gravity is None else gravity)


def _last(support: Support) -> FloatArray:
    """Displacements along the directions of a support at the end, (n,) [mm]."""
    share = 1.0 if support.amplitude is None else support.amplitude(np.inf)
    return share * support.displacement
