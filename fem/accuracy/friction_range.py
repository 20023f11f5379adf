"""How wide the set of answers with friction is.

Forces and displacements under the same load depend on the load path. One bound is the state of
monotonic loading; the other is sought by overload to 150 % and unload, which reverses the slip of
all joints that slide. Both are solved by the static solver on a
coarse mesh; their ratio counts.

Reference: Barber, Klarbring, Ciavarella, Shakedown in frictional contact problems for the
continuum, C. R. Mecanique 336 (2008), on the dependence on the initial state.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial

from fem.accuracy.ladder import coarser, ladder_for, mesh_of, on_rung
from fem.accuracy.one_mesh import static_state, values_of
from fem.accuracy.parts import FrictionSet
from fem.measures import load_step_change
from fem.problem import Problem
from fem.state import State
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.solve import StaticOptions
from geometry.errors import RefusedError
from geometry.machine.work import LIMITS, LimitError, allowance, budget

#: Load factors of the path past the load and back.
PAST_AND_BACK = (0.09, 0.38, 0.84, 1.5, 1.25, 1.0)
#: Of finer and finer meshes those on which the width is sought, where the first is too coarse.
_RUNGS = 2
#: Share of the work that is left which this may take.
_SHARE = 0.5
#: Elements along an edge of the meshes on which the width is sought, over those of the answer.
_SHARES = (0.5, 2.0 / 3.0)


def friction_set(
    problem: Problem,
    state: State,
    options: StaticOptions,
    *,
    refined: bool,
    known: Mapping[str, Mapping[str, float]] | None = None,
) -> FrictionSet:
    """State which member of the set a state is, and how wide the set is.

    Parameters
    ----------
    problem
        As stated.
    state
        Its static state, or the end of an explicit run.
    options
        Of the static solver.
    refined
        Whether the state is of the last of finer and finer meshes: the width is sought on the
        first of these, else on coarser ones than that of the problem.
    known
        Values of measures under the whole load on meshes that are solved, by `mesh_of`.
    """
    with budget(_SHARE * allowance().work):
        width, words = _width(problem, options, known or {}, refined=refined)
    return FrictionSet(_member(state), load_step_change(state), width, words)


def _width(
    problem: Problem,
    options: StaticOptions,
    known: Mapping[str, Mapping[str, float]],
    *,
    refined: bool,
) -> tuple[dict[str, float], str]:
    """Relative change of each measure from one end to the other, and where or why not."""
    remark = ""
    for stated, words in _rungs(problem) if refined else _coarser(problem):
        direct, mesh = None, mesh_of(stated)
        solve = partial(
            static_state,
            stated.deformable,
            finite_rotation=stated.finite_rotation,
            store=FlexibilityStore(),
        )
        try:
            direct = known[mesh] if mesh in known else values_of(solve(options))
            back = values_of(solve(replace(options, load_path=PAST_AND_BACK)))
        except LimitError as error:
            return {}, f"not sought: {LIMITS[error.by]}"
        except RefusedError as error:
            what = "no static state" if direct is None else "150 % of the load are not carried"
            remark = f"{what}: {error}"
            if direct is None or refined:
                continue
            break
        width = {n: value / direct[n] - 1.0 for n, value in back.items() if direct[n]}
        return width, f"on {stated.deformable.n_elements} elements{words}"
    return {}, remark


def _rungs(problem: Problem) -> Iterator[tuple[Problem, str]]:
    for rung in ladder_for({}, problem)[:_RUNGS]:
        yield on_rung(problem, rung), f" of degree {rung.degree}"


def _coarser(problem: Problem) -> Iterable[tuple[Problem, str]]:
    """Coarser meshes first; some are too coarse for blocks."""
    meshes = (*(coarser(problem, share) for share in _SHARES), problem)
    return ((stated, "") for stated in meshes if stated is not None)


def _member(state: State) -> str:
    """How the load was applied."""
    if state.run is None:
        steps = state.evidence.load_steps
        return f"monotonic loading in {steps} step{'s' if steps > 1 else ''}"
    return f"smooth ramp of {1e3 * state.run.stated.ramp_time:.3g} ms, damped"
