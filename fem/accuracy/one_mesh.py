"""Static states on one mesh, and the error bars that other meshes give them.

A run on a mesh with 1/r of the elements along every edge has r times the error, if this falls like
the size of an element. Coarser meshes, about two thirds and half as fine, are asked
(`fem.accuracy.errors`); where there is none, a mesh twice as fine.

Peaks are known from two sides (`fem.measures.bracketed`). Contact forces are in balance on facets,
so means over them lie below a peak of pressure and values at their corners, continued outwards by a
steep law, above it: an error bar is at least the distance. Stresses inside elements and at their
corners lie on the same side: what an element hides comes on top of what the mesh leaves out.

Elements of degree two and more are judged by the same elements of one degree less, whose error is
taken as twice as large: means over facets are those over the same facets then. Curved hexahedra
of degree two are judged by degree three, since degree one straightens their edges. All else has the
larger estimate of degrees and of meshes. Stresses at a point gain least: what the degree and what
the mesh leave out add up. Values that a few elements decide have bars of `SHARED` of the widest
relative one of their kind at least: two degrees may agree by chance.

With friction the way to the load counts: what half as many load steps change is added
(`fem.measures.load_step_change`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from fem.accuracy.errors import error_bar
from fem.accuracy.ladder import AT_EDGES, LOCAL, SHARED, coarser, split
from fem.measures import bracketed, load_step_change, measures_of
from fem.problem import Problem
from fem.solution import Solution
from fem.static.history import solve_history
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.load_steps import Known
from fem.static.result import StaticError, StaticResult
from fem.static.solve import StaticOptions, solve_static
from fem.system.build import DeformableAssembly
from geometry.answer import Measure
from geometry.block import Block
from geometry.errors import RefusedError
from geometry.system import one_thread_of_blas

#: Elements along an edge of the coarser meshes over those of the run.
SHARES = (2.0 / 3.0, 0.5)
#: Error of elements of one degree less over that of one degree more, at least.
_DEGREE = 2.0
#: Parts of the way of supports that move.
MOTION_STEPS = 20
#: Elements at most of a finer mesh that is solved for error bars alone: some CPU s.
_MOST_ELEMENTS = 20_000
#: What coarser meshes judge beside them in elements of degree two or more.
_OF_MESHES = ("sigma_1_averaged", "p_max_point", "max_displacement")


@one_thread_of_blas()
def static_solution(
    deformable: DeformableAssembly,
    options: StaticOptions | None = None,
    *,
    finite_rotation: bool = False,
    store: FlexibilityStore | None = None,
    start: StaticResult | None = None,
    before: Sequence[DeformableAssembly] = (),
    known: Known = (),
) -> Solution:
    """Solve for the static state of blocks that are built: see `fem.solve_static`.

    Runs that share a ``store`` condense the same blocks once; ``start`` is a state of the same
    model near the solution. ``before`` are the stages from rest on that come before; states under
    some loads may be ``known`` nearly.

    Raises
    ------
    StaticError, SymmetryError
        As `fem.solve_static`.
    """
    options = StaticOptions() if options is None else options
    if options.motion_steps is None and deformable.moves and not before:
        options = replace(options, motion_steps=MOTION_STEPS)
    if before:
        result = solve_history([*before, deformable], options, store)
    elif finite_rotation:
        # Its internal forces are those of explicit runs, which load a compiler.
        from fem.static.rotation import solve_static_with_rotation

        result = solve_static_with_rotation(deformable, options, start=start, store=store)
    else:
        result = solve_static(deformable, options, store=store, start=start, known=known)
    if not result.converged:
        raise StaticError(result.status)
    return Solution(
        deformable=result.deformable,
        group_displacements=result.displacements,
        contact_state=result.contact_state,
        finite_rotation=finite_rotation,
        solver=result,
    )


def estimated_errors(
    solution: Solution,
    on_others: Iterable[Solution],
    of_degree: tuple[Solution, float] | None = None,
) -> dict[str, float]:
    """Estimate the error of each measure, in its unit; empty without another mesh.

    Parameters
    ----------
    solution
        On the mesh whose errors are asked for.
    on_others
        The same problem on coarser meshes, or on a finer one.
    of_degree
        The same with elements of another degree, and its error over that of the solution; None for
        degree one.
    """
    measures = measures_of(solution)
    of_meshes = _of_meshes(solution, measures, on_others)
    steps = load_step_change(solution) if solution.static is not None else {}
    if of_degree is not None:
        other, reduction = measures_of(of_degree[0]), of_degree[1]
        degrees = {
            n: error_bar([other[n].value, m.value], [reduction])
            for n, m in measures.items()
            if n in other
        }
        bars = {n: _both(n, bar, of_meshes.get(n, 0.0)) for n, bar in degrees.items()}
        local = (LOCAL | set(AT_EDGES)) & bars.keys()
        sizes = {n: abs(measures[n].value) for n in local}
        least = SHARED * max(
            (bars[n] / sizes[n] for n in LOCAL & sizes.keys() if sizes[n]), default=0.0
        )
        bars |= {n: max(bars[n], least * size) for n, size in sizes.items()}
    else:
        sides = bracketed(solution) if of_meshes else {}
        bars = {
            name: (sum if name in AT_EDGES else max)((bar, sides.get(name, 0.0)))
            for name, bar in of_meshes.items()
        }
    return {name: steps.get(name, 0.0) + bar for name, bar in bars.items()}


def _of_meshes(
    solution: Solution, measures: Mapping[str, Measure], on_others: Iterable[Solution]
) -> dict[str, float]:
    """Estimates from other meshes."""
    values: dict[str, list[float]] = {name: [] for name in measures}
    refinements = []
    for other in on_others:
        ratio = solution.deformable.model.n_elements / other.deformable.model.n_elements
        refinement = ratio ** (1.0 / 3.0)
        if refinement == 1.0:
            continue
        refinements.append(refinement)
        for name, measure in measures_of(other).items():
            values.setdefault(name, []).append(measure.value)
    # Facets may match on one mesh and not on another, which has other measures.
    everywhere = [n for n in measures if refinements and len(values[n]) == len(refinements)]
    return {n: error_bar([*values[n], measures[n].value], refinements) for n in everywhere}


def _both(name: str, degrees: float, meshes: float) -> float:
    """Estimate of elements of degree two or more from those of degrees and of meshes."""
    if name in AT_EDGES:
        return degrees + meshes
    return max(degrees, meshes) if name in _OF_MESHES else degrees


def static_errors(
    problem: Problem, solution: Solution, solve: Callable[[Problem], Solution]
) -> dict[str, float]:
    """Estimate the errors of a state of a problem by solving it on coarser meshes.

    Of elements of degree one without a coarser mesh, such as hexahedra of one's own, the static
    state is solved on a finer one, where this takes no more than seconds.
    """
    of_degree = None
    if problem.degree > 1:
        more = problem.degree == 2 and any(map(_is_straightened, problem.blocks.shapes))
        degree, reduction = problem.degree + (1 if more else -1), 1 / _DEGREE if more else _DEGREE
        of_degree = solve(replace(problem, degree=degree)), reduction
    others = list(_coarser_solutions(problem, solve))
    few = 8 * solution.deformable.model.n_elements <= _MOST_ELEMENTS
    if not others and of_degree is None and few and solution.static is not None:
        with suppress(RefusedError):
            others = [solve(split(problem, 2, 1))]
    return estimated_errors(solution, others, of_degree)


def _is_straightened(block: Block) -> bool:
    """Whether elements of degree one lose the shape of a block: curved hexahedra of one's own."""
    return block.curve is not None and block.charts is None


def _coarser_solutions(
    problem: Problem, solve: Callable[[Problem], Solution]
) -> Iterator[Solution]:
    solved = set[int]()
    for share in SHARES:
        stated = coarser(problem, share)
        elements = 0 if stated is None else sum(s.mesh.n_elements for s in stated.blocks.shapes)
        if stated is not None and elements not in solved:
            solved.add(elements)
            with suppress(RefusedError):
                yield solve(stated)
