"""Static answers of a stated accuracy: meshes from coarse to fine until error bars are narrow."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fem.accuracy.errors import (
    TOO_FAR,
    Accuracy,
    Meshes,
    OnMesh,
    Values,
    growing,
    is_reached,
    relative,
    sequence_bars,
    unmet,
    unresolved,
    with_stick,
)
from fem.accuracy.ladder import OF_FACETS, Ladder, Rung, fineness, ladder_for, on_rung
from fem.accuracy.one_mesh import state_of, stick_change
from fem.accuracy.transfer import MeshFacets, means_on, transferred
from fem.answer.measures import large_motion, load_step_change, measures_of
from fem.element.hexahedron import ElementType
from fem.problem import Problem
from fem.state import State
from fem.static.linear_step.linearisation import StaticError
from fem.static.path import LOAD_TOLERANCE
from fem.static.solve import StaticOptions
from geometry.answer import ALIASES, TITLES, Measure
from geometry.assembly import Assembly
from geometry.errors import RefusedError, is_number
from geometry.machine.work import (
    SECONDS,
    Budget,
    LimitError,
    Operation,
    allowance,
    budget,
    clock,
    memory_limit,
    stop,
)
from geometry.mesh import FloatArray
from geometry.parts.rows import Part
from geometry.refinement import charts_of

#: Relative error bars that an answer has by default [-].
TARGETS: Mapping[str, float] = {
    "max_displacement": 0.05,
    "p_eff": 0.05,
    "p_max_point": 0.05,
    "sigma_1_averaged": 0.05,
}
#: The same with friction, where a mesh costs tens of times as much, and pressures at a point seldom
#: settle.
WITH_FRICTION: Mapping[str, float] = {
    "max_displacement": 0.1,
    "p_eff": 0.1,
    "sigma_1_averaged": 0.1,
}
#: Options of the static solver where none are given.
OPTIONS = StaticOptions(load_tolerance=LOAD_TOLERANCE)
#: Reference seconds of a run where no accuracy is requested: of contact that is conforming and
#: without friction or gaps, and of all else.
CONFORMING_SECONDS, MOST_SECONDS = 15.0, 40.0
#: The same for each free block at least: four meshes of 48 layers.
_BLOCK_SECONDS = 0.12
#: The general solver works in the three displacements of the nodes of both sides, six unknowns a
#: point, about twelve times; with friction in parts of the load, ten times that.
_GENERAL, _WITH_FRICTION = 12 * 6**3, 10
#: Meshes without which there is no error bar, and part of the work forecast for the last of them
#: with which it is begun: it takes 0.1 to 0.5 of it, for its iterations begin near its state.
_FOR_BARS, _FROM_START = 2, 0.3
#: Without a request no mesh is solved after the fourth one where some bar would stay this many
#: times as wide as sought.
_OUT_OF_REACH, _FOURTH = 3.0, 4


class AccuracyError(RefusedError):
    """An accuracy that cannot be reached, or a problem that cannot be refined."""


@dataclass(frozen=True)
class MeshProgress:
    """What is known between two meshes."""

    rung: int
    """Number of the next mesh, from 1."""
    n_rungs: int
    """Meshes at most."""
    unknowns: int
    """Displacement components of the blocks that are computed on the next mesh."""
    measures: Mapping[str, Measure]
    """Of the mesh before, with error bars from the second mesh on."""
    seconds: float
    """Expected CPU time of the next mesh [s]; 0 where nothing is known."""

    def __str__(self) -> str:
        """The next mesh, its expected time, and the best values so far."""
        expected = f", about {self.seconds:.2g} CPU s" if self.seconds > 0.0 else ""
        count = f"mesh {self.rung} of at most {self.n_rungs}"
        words = f"{count}, {self.unknowns} unknowns a block{expected}"
        if "p_max_point" in self.measures:
            words += f"; pressure at a point {self.measures['p_max_point'].value_words}"
        return words


@dataclass(frozen=True)
class Solved:
    """A problem on one mesh."""

    problem: Problem
    """On that mesh."""
    state: State
    """Displacements, stresses and contact there."""
    facets: MeshFacets | None
    """Of the mesh that was stated; None where contact is searched."""
    numbers: OnMesh
    spent: Budget
    """Operations of this mesh alone."""
    load_steps: int | None = None
    """Those that a finer mesh takes as well, with the change by half as many; None: it doubles
    its own."""

    @property
    def measures(self) -> Mapping[str, Measure]:
        """Without errors."""
        return self.numbers.measures


@dataclass(frozen=True)
class Converged:
    """A static state on the last of some meshes, with its error bars."""

    solved: Solved
    """On that mesh."""
    errors: dict[str, float]
    """Estimated error of each measure, in its unit."""
    remarks: dict[str, str]
    """Why some values are none to use."""
    accuracy: Accuracy
    """What was requested and reached, and what ended the refinement."""
    meshes: Meshes
    """Those that were solved."""
    stick: Values
    """Change of each measure by a tenth of the stick stiffness, in its unit."""

    @property
    def measures(self) -> Mapping[str, Measure]:
        """Numbers with errors and places."""
        return self.accuracy.measures

    @property
    def parts(self) -> dict[str, Part]:
        """What an answer has beside the measures."""
        facets = {} if self.solved.facets is None else {"facets": self.solved.facets}
        return {**facets, "accuracy": self.accuracy, "meshes": self.meshes}


def converge(
    problem: Problem,
    requested: Mapping[str, float] | None = None,
    *,
    otherwise: Mapping[str, float] | None = None,
    options: StaticOptions = OPTIONS,
    max_seconds: float | None = None,
    max_meshes: int | None = None,
    progress: Callable[[MeshProgress], None] | None = None,
    ladder: Ladder | None = None,
) -> Converged:
    """Solve on finer and finer meshes until the error bars are as narrow as requested.

    Or until a limit of `geometry.machine.work.budget` is reached, or Ctrl-C: the last mesh that was
    finished is the answer then.

    Parameters
    ----------
    problem
        The statement; its mesh gives the facets of `p_eff`, `p_max` and `p_max_facet`.
    requested
        Relative error [-] by the name of the measure, reached however long it takes; those that
        the problem does not have, such as pressures of single bodies, are left out.
    otherwise
        Those sought where none is requested; None: `TARGETS`, or `WITH_FRICTION`.
    options
        Of the static solver.
    max_seconds
        CPU time at most [s], but for the first mesh; None: no limit.
    max_meshes
        Meshes at most; None: all of the ladder.
    progress
        Called before each mesh.
    ladder
        Meshes; None: those that serve the requested measures best.

    Raises
    ------
    AccuracyError
        A problem that cannot be refined.
    LimitError
        A limit that was reached on the first mesh.
    StaticError, SymmetryError
        As `fem.solve_static`.
    """
    check_refinable(problem)
    targets = requested or otherwise or (TARGETS if problem.coulomb is None else WITH_FRICTION)
    every = ladder or ladder_for(requested or otherwise or TARGETS, problem)
    ladder = every[:max_meshes]
    # Of earlier meshes only their numbers stay in memory.
    last: Solved | None = None
    stick: Values = {}
    meshes, told = list[OnMesh](), dict[str, Measure]()
    ended = "the finest mesh" if ladder == every else "the limit of meshes"
    errors, remarks = dict[str, float](), dict[str, str]()
    stopped: str | None = None
    ends = clock(max_seconds)
    for number, rung in enumerate(ladder, 1):
        stated = on_rung(problem, rung)
        if last is not None:
            beyond = _beyond(
                stated, last, number, ends, _widest(told, {} if requested else targets)
            )
            if beyond is not None:
                stopped, ended = beyond
                break
        if progress is not None:
            seconds = 0.0 if last is None else _expected_seconds(stated, last)
            unknowns = round(_unknowns(stated))
            progress(MeshProgress(number, len(ladder), unknowns, told, seconds))
        try:
            with budget(ends=math.inf if last is None else ends):
                if last is not None and number == _FOR_BARS:
                    stick = _stick_change(last, options)
                last = _solve(problem, stated, rung, options, before=last)
        except (LimitError, KeyboardInterrupt) as limit:
            if last is None:
                raise _first_mesh(limit, stated) from None
            stopped = limit.by if isinstance(limit, LimitError) else "interrupt"
            ended = f"{stop(stopped)}: mesh {number} was not finished"
            break
        except StaticError:
            if last is None:
                raise
            ended = "the next mesh, which did not converge"
            break
        meshes.append(last.numbers)
        if number >= _FOR_BARS:
            errors = with_stick(sequence_bars(meshes, searched=problem.searches), stick)
        remarks = unresolved(meshes) | growing(meshes) | _too_far(last)
        told = {
            name: replace(m, error=errors.get(name), remark=remarks.get(name, ""))
            for name, m in last.measures.items()
        }
        if is_reached(told, targets, number):
            ended = "the requested accuracy"
            break
    assert last is not None
    sought = {name: share for name, share in targets.items() if name in told}
    accuracy = Accuracy(sought, told, ended, stopped)
    return Converged(last, errors, remarks, accuracy, Meshes(meshes), stick)


def climbed(
    problem: Problem,
    rungs: Iterable[Rung],
    options: StaticOptions = OPTIONS,
    factor: float = 1.0,
) -> Iterator[Solved]:
    """Solve on meshes from coarse to fine, each from the state on the one before.

    Under a factor times all loads [-].

    Raises
    ------
    AccuracyError, StaticError, SymmetryError
        As `converge`.
    """
    check_refinable(problem)
    result = None
    for rung in rungs:
        stated = on_rung(problem, rung)
        result = _solve(problem, stated, rung, options, before=result, factor=factor)
        yield result


def bars_under(
    problem: Problem, rungs: Sequence[Rung], options: StaticOptions, factor: float, there: State
) -> dict[str, float]:
    """Error bars of measures of a state under a factor times the loads and the weight.

    Parameters
    ----------
    problem
        As stated.
    rungs
        The first meshes of a ladder, the last one that of the state; one alone gives no bars.
    options
        Of the static solver.
    factor
        Of all loads [-].
    there
        The state.
    """
    *coarser, last = rungs
    if not coarser:
        return {}
    solved = list(climbed(problem, coarser, options, factor))
    finest = _on_mesh(on_rung(problem, last), last, there, means_on(problem.blocks, there))
    numbers = [*(one.numbers for one in solved), finest]
    bars = sequence_bars(numbers, searched=problem.searches)
    return with_stick(bars, _stick_change(solved[0], options, factor))


def _stick_change(one: Solved, options: StaticOptions, factor: float = 1.0) -> Values:
    """Changes by softer stick on one mesh, under a factor times the loads in as many steps."""
    once = replace(options, load_steps=one.state.evidence.load_steps, load_tolerance=None)
    return stick_change(one.problem, one.state, lambda softer: state_of(softer, once, factor))


def check_refinable(problem: Problem, asked: str = "mesh") -> None:
    """Reject a problem whose mesh cannot be refined, as an option ``asked``."""
    why = why_not_refined(problem)
    if why is not None:
        remedy = "" if asked == "mesh" else f" without {asked}"
        raise AccuracyError(
            f'{asked}: got {why}, whose mesh is not refined; expected mesh = "scene"{remedy}'
        )


def why_not_refined(problem: Problem) -> str | None:
    """What stands against refining the mesh of a problem; None where nothing does."""
    own = own_elements(problem)
    if own is not None:
        return f"{own[0]} = {own[1]}"
    if problem.searches:
        second = on_rung(problem, ladder_for(TARGETS, problem)[_FOR_BARS - 1])
        friction = problem.coulomb is not None
        if general_work(second.blocks, second.degree, friction=friction) > MOST_SECONDS:
            return "general contact of so many facets that finer ones are beyond the usual work"
    if problem.blocks.image_of is not None:
        return "a periodic cell"
    if any(held.moves for held in problem.load_case.held):
        return "supports that move step by step"
    if problem.load_case.without_couple:
        return "a load as printed, which acts at the mean of the nodes of a mesh"
    return None


def own_elements(problem: Problem) -> tuple[str, str | int] | None:
    """Kind or degree of elements that finer meshes would not have, by its field; None: neither."""
    if problem.element is not ElementType.INCOMPATIBLE:
        return "element", problem.element.value
    usual = usual_degree(problem.blocks, friction=problem.coulomb is not None)
    return None if problem.degree in {1, usual} else ("degree", problem.degree)


def usual_work(problem: Problem) -> float:
    """Work at most where neither a limit nor an accuracy is stated [reference s]."""
    opened = problem.clearance > 0.0 or problem.spacing > 0.0
    conforming = problem.coulomb is None and not (opened or problem.searches)
    usual = CONFORMING_SECONDS if conforming else MOST_SECONDS
    return max(usual, _BLOCK_SECONDS * len(problem.blocks.free_blocks))


def usual_degree(blocks: Assembly, *, friction: bool) -> int:
    """Degree of the elements where nothing states it: of tetrahedra split into hexahedra 2.

    Degree 1 of all else, and where general contact of so many facets is beyond the usual work.
    """
    if all(shape.tetrahedra is None for shape in blocks.shapes):
        return 1
    return 2 if general_work(blocks, 2, friction=friction) <= MOST_SECONDS else 1


def checked_targets(accuracy: Mapping[str, float]) -> dict[str, float]:
    """Requested error bars by the names of measures."""
    result = {}
    if not isinstance(accuracy, Mapping):
        raise AccuracyError(f'accuracy: got {accuracy!r}; expected names, as {{"p_max": 0.05}}')
    for given, share in accuracy.items():
        name = ALIASES.get(given, given)
        if name not in TITLES or not (is_number(share) and 0.0 < share < 1.0):
            raise AccuracyError(
                f"accuracy: got {given} = {share}; expected a share between 0 and 1 of one of "
                f"{', '.join(TITLES)}"
            )
        result[name] = share
    return result


def _solve(
    base: Problem,
    stated: Problem,
    rung: Rung,
    options: StaticOptions,
    *,
    before: Solved | None = None,
    factor: float = 1.0,
) -> Solved:
    """Solve on one mesh under a factor times the loads, from the state on a coarser one."""
    begun = time.process_time()
    with budget() as spent:
        state = _state(stated, options, before, factor)
        facets = means_on(base.blocks, state)
        numbers, load_steps = _on_mesh(stated, rung, state, facets), None
        if before is not None and numbers.steps:
            load_steps = state.evidence.load_steps
        elif before is not None and before.load_steps is not None:
            numbers, load_steps = replace(numbers, steps=before.numbers.steps), before.load_steps
    beside = {
        "elements_per_block": stated.blocks.shapes[0].mesh.n_elements,
        "unknowns": state.displacement.size,
        "cpu_seconds": time.process_time() - begun,
        "work": spent.seconds,
    }
    return Solved(stated, state, facets, replace(numbers, beside=beside), spent, load_steps)


def _on_mesh(stated: Problem, rung: Rung, state: State, facets: MeshFacets | None) -> OnMesh:
    measures, steps = dict(measures_of(state, facets=facets)), load_step_change(state)
    return OnMesh(measures, rung, fineness(stated), fineness(stated, "along"), steps)


def _state(stated: Problem, options: StaticOptions, before: Solved | None, factor: float) -> State:
    """State on a mesh, from that on a coarser one where it may start there."""
    start, known = None, list[tuple[float, tuple[FloatArray, ...]]]()
    if before is not None and stated.system.meets and _may_start(stated, before.problem):
        coarse = before.state
        move = partial(transferred, source=coarse.whole, target=stated.system)
        if stated.coulomb is None:
            start = move(coarse.displacements)
        else:
            path = (*coarse.evidence.path, coarse)
            known = [(one.load_factor, move(one.displacements)) for one in path]
            if before.load_steps is not None:
                options = replace(options, load_steps=before.load_steps, load_tolerance=None)
            else:
                halved = max(options.load_steps, coarse.evidence.load_steps // 2)
                options = replace(options, load_steps=halved)
    return state_of(stated, options, factor, start=start, known=known)


def _may_start(stated: Problem, before: Problem) -> bool:
    """Whether states on another mesh are near those on this one.

    Searched points take long to come to rest however near the start is.
    """
    if stated.searches:
        return False
    shapes = zip(stated.blocks.shapes, before.blocks.shapes, strict=True)
    return all(charts_of(a).directions == charts_of(b).directions for a, b in shapes)


def general_work(blocks: Assembly, degree: int, *, friction: bool) -> float:
    """Work of general contact between blocks before it is solved [reference s].

    Of dense matrices, by half of the outer points of the free blocks of each layer.
    """
    free = blocks.free_blocks
    outer = [len(blocks.shape(block).contact_quads) for block in free.tolist()]
    points = 0.5 * degree**2 * np.bincount(blocks.layer[free], weights=outer)
    times = _GENERAL * (_WITH_FRICTION if friction else 1)
    return SECONDS[Operation.DENSE] * times * float((points**3).sum())


def _beyond(
    stated: Problem, last: Solved, number: int, ends: float, widest: float
) -> tuple[str | None, str] | None:
    """Which limit keeps a mesh from being solved, in a word and in words; None where none does.

    The work of the mesh before grows with the unknowns; CPU time ends at ``ends`` [s]. Error bars
    need two meshes: the second is begun as long as any CPU time is left. The ``widest`` bar over
    that sought falls as the fineness grows.
    """
    if large_motion(last.state) is not None:
        return None, "the large motion, which no mesh of small motions describes"
    bound = _OUT_OF_REACH * fineness(stated) / last.numbers.fineness
    if number > _FOURTH and widest > bound:
        return None, "an error bar that the next mesh leaves much too wide as well"
    ratio = _growth(stated, last)
    part = _FROM_START if number <= _FOR_BARS else 1.0
    if part * last.spent.grown(ratio) > allowance().work:
        return "work", stop("work")
    if last.spent.bytes_grown(ratio) > memory_limit():
        return "memory", stop("memory")
    left = ends - time.process_time() if ends < math.inf else ends
    need = _expected_seconds(stated, last)
    if need <= left or (number <= _FOR_BARS and left > 0.0):
        return None
    remain = f"{left:.2g} s remain" if left > 0.0 else "none is left"
    words = f"{stop('clock')}: the next mesh needs about {need:.2g} s, and {remain}"
    return "clock", words


def _too_far(last: Solved) -> dict[str, str]:
    """Say why means over facets are none: blocks moved far, one is above the largest pressure."""
    both = [last.measures[n].value for n in ("p_max_facet", "p_max_point") if n in last.measures]
    above = len(both) > 1 and both[0] > both[1]
    return dict.fromkeys(OF_FACETS, TOO_FAR) if above and large_motion(last.state) else {}


def _widest(told: Mapping[str, Measure], targets: Mapping[str, float]) -> float:
    """Largest error bar over that sought; 0 where there is none."""
    shares = (relative(told[name]) / targets[name] for name in unmet(told, targets))
    return max((share for share in shares if share < math.inf), default=0.0)


def _first_mesh(limit: BaseException, stated: Problem) -> BaseException:
    """What is raised where a limit stops the first mesh: an interrupt goes on as it is.

    A limit of memory has its own words.
    """
    if not isinstance(limit, LimitError) or limit.by == "memory":
        return limit
    return LimitError(
        limit.by,
        f"no state within {stop(limit.by)}: the first mesh, of {_unknowns(stated):.0f} unknowns a "
        f"block, was not finished; expected a coarser mesh, fewer blocks, or a higher `max_work`",
    )


def _growth(stated: Problem, last: Solved) -> float:
    """Unknowns of the next mesh over those of the last one."""
    return _unknowns(stated) / _unknowns(last.problem)


def _expected_seconds(stated: Problem, last: Solved) -> float:
    """CPU time of the next mesh, which grows as the work [s]."""
    seconds: float = last.numbers.beside["cpu_seconds"]
    return last.spent.grown(_growth(stated, last)) / last.spent.seconds * seconds


def _unknowns(stated: Problem) -> float:
    shape = max(stated.blocks.shapes, key=lambda s: s.mesh.n_elements)
    return 3.0 * shape.mesh.n_elements * stated.degree**3
