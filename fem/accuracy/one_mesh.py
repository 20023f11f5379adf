"""Static states on one mesh, and the other meshes that give them error bars.

Coarser meshes, about half and two thirds as fine, are compared by `fem.accuracy.errors`; where
one of them is missing, a mesh twice as fine as well, as far as its work allows. Elements of degree
two and more are judged by the same elements of one degree less as well, curved hexahedra of degree
two by degree three, since degree one straightens their edges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

from fem.accuracy.errors import one_mesh_bars, with_stick
from fem.accuracy.ladder import coarser, split
from fem.accuracy.transfer import MeshFacets, means_on
from fem.answer.measures import bracketed, facet_step, load_step_change, measures_of
from fem.problem import Problem
from fem.state import State
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.path import Known
from fem.static.solve import StaticOptions, static_state
from geometry.block import Block
from geometry.errors import RefusedError
from geometry.machine.work import Budget, LimitError, allowance, unlimited
from geometry.mesh import FloatArray

#: Elements along an edge of the coarser meshes over those of the run.
SHARES = (0.5, 2.0 / 3.0)
#: Error of elements of one degree less over that of one degree more, at least: shares, this factor
#: and `SAFETY` are judged by stored finer answers in tests/fem/test_error_estimate.py.
_DEGREE = 2.0
#: Unknowns of a mesh twice as fine over those of the run.
_FINER = 8.0


def state_of(
    problem: Problem,
    options: StaticOptions,
    factor: float = 1.0,
    *,
    store: FlexibilityStore | None = None,
    start: tuple[FloatArray, ...] | None = None,
    known: Known = (),
) -> State:
    """State of a problem on its mesh, under a factor times its loads and weight.

    Whatever is solved beside an answer is this case of another problem: another mesh, softer stick,
    other load steps, another factor. The others are those of `static_state`.
    """
    *before, system = (stage.system for stage in problem.stages)
    system = system if factor == 1.0 else system.under(factor)
    return static_state(system, options, before=before, start=start, store=store, known=known)


def static_errors(
    problem: Problem,
    state: State,
    solve: Callable[[Problem], State],
    spent: Budget | None = None,
) -> OneMeshErrors:
    """Estimate the error of each measure of a state; none without another mesh.

    Parameters
    ----------
    problem, state
        On the mesh whose errors are asked for.
    solve
        Solves the problem on another mesh.
    spent
        Operations of the solution: of elements of degree one with fewer than two coarser meshes,
        such as hexahedra of one's own, the state on a finer one is solved where so much more work
        is left. None: it is not.

    Raises
    ------
    LimitError
        A limit is reached before one coarser mesh. One after it leaves wider bars of that alone.
    """
    degrees = []
    if problem.degree > 1:
        more = problem.degree == 2 and any(map(_is_straightened, problem.blocks.shapes))
        other = solve(replace(problem, degree=problem.degree + (1 if more else -1)))
        degrees = [(values_of(other), 1.0 / _DEGREE if more else _DEGREE)]
    coarser_ones, stick = list[tuple[Problem, State]](), dict[str, float]()
    for stated in _coarser_problems(problem):
        try:
            other = solve(stated)
        except LimitError:
            if not coarser_ones:
                raise
            break
        except RefusedError:
            continue
        if not coarser_ones:
            stick = stick_change(stated, other, solve)
        coarser_ones.append((stated, other))
    if not coarser_ones:
        stick = stick_change(problem, state, solve)
    finer: State | None = None
    few = len(coarser_ones) < len(SHARES) and not degrees
    if few and spent is not None and spent.grown(_FINER) <= allowance().work:
        with suppress(RefusedError):
            finer = solve(_twice_as_fine(problem))
    elements, meshes = state.whole.n_elements, []
    with unlimited():  # of what is solved
        others = [(other, values_of(other)) for _, other in coarser_ones]
        if finer is not None:
            others.append((finer, values_of(finer, means_on(problem.blocks, finer))))
        for other, found in others:
            refinement = (elements / other.whole.n_elements) ** (1.0 / 3.0)
            if refinement != 1.0:
                meshes.append((found, refinement))
        values, sides = values_of(state), bracketed(state) if meshes and not degrees else {}
        bars = one_mesh_bars(values, meshes, degrees, sides, load_step_change(state))
        if bars.get("p_eff"):
            bars["p_eff"] += facet_step(state, bars["p_eff"] / values["p_eff"])
    searched = not problem.searches and any(one.searches for one, _ in coarser_ones)
    return OneMeshErrors(with_stick(bars, stick), searched)


class OneMeshErrors(NamedTuple):
    """Error bars of a mesh, and what they compare."""

    errors: dict[str, float]
    """Of each measure, in its unit."""
    searched: bool
    """Whether contact is searched on coarser meshes alone, whose facets do not match."""


def stick_change(
    problem: Problem, state: State, solve: Callable[[Problem], State]
) -> dict[str, float]:
    """Change of each measure of a state by a tenth of the default stick stiffness, in its unit.

    Empty without friction, and where the stiffness is stated. Softer stick is found as fast as the
    state itself, stiffer stick is not.
    """
    coulomb = problem.coulomb
    if coulomb is None or coulomb.stick_stiffness is not None:
        return {}
    softer = replace(coulomb, stick_stiffness=0.1 * problem.system.stick())
    before, after = values_of(state), values_of(solve(replace(problem, friction=softer)))
    return {name: abs(value - before[name]) for name, value in after.items()}


def values_of(state: State, facets: MeshFacets | None = None) -> dict[str, float]:
    """Values of all measures of a state, each in its unit; means over other facets, if given."""
    return {name: measure.value for name, measure in measures_of(state, facets=facets).items()}


def _is_straightened(block: Block) -> bool:
    """Whether elements of degree one lose the shape of a block: curved hexahedra of one's own."""
    return block.curve is not None and block.charts is None


def _twice_as_fine(problem: Problem) -> Problem:
    """The problem on a mesh of half as long elements, of a family or by splitting hexahedra."""
    family = all(shape.charts is not None for shape in problem.blocks.shapes)
    finer = coarser(problem, 2.0) if family else None
    return split(problem, 2, 1) if finer is None else finer


def _coarser_problems(problem: Problem) -> Iterator[Problem]:
    """The problem on coarser meshes, the coarsest first: the others take most of the time."""
    known = set[int]()
    for share in SHARES:
        stated = coarser(problem, share)
        elements = 0 if stated is None else sum(s.mesh.n_elements for s in stated.blocks.shapes)
        if stated is not None and elements not in known:
            known.add(elements)
            yield stated
