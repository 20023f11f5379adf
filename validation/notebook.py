"""What a notebook calls: scenes, files of answers, pictures, comparisons and studies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from validation.case import Case, Method, load_case
from validation.errors import InputError
from validation.scene.read import Settings

if TYPE_CHECKING:
    import numpy.typing as npt

    from fem.problem import Problem
    from geometry.answer import Answer
    from geometry.parts.measures import SectionForces
    from validation.study.comparison.report import Comparison
    from validation.study.cost import CostResult
    from validation.study.optimisation.report import SearchResult
    from validation.study.optimisation.sensitivity import Sensitivity
    from validation.study.study import Study


def write(answer: Answer, folder: str | Path) -> tuple[Path, ...]:
    """Write an answer into a folder: numbers (JSON), arrays (numpy), meshes for ParaView.

    Raises
    ------
    InputError
        A folder that cannot be written.
    """
    from validation.output.answer_files import write_answer

    return write_answer(_answer(answer), Path(folder))


def read_answer(folder: str | Path) -> Answer:
    """Read an answer that `write` wrote; its `details`, the solver's own result, is not kept.

    Raises
    ------
    InputError
        A folder without an answer, or a damaged one.
    """
    from validation.output.answer_files import read_answer as read

    return read(Path(folder))


def read_rows(path: str | Path) -> list[dict[str, Any]]:
    """Read rows of a study from the CSV that `tubelock sweep --csv` writes, by their columns.

    Raises
    ------
    InputError
        A file that cannot be read.
    """
    from validation.study.rowfile import read_csv

    return list(read_csv(Path(path)))


def plot(answer: Answer, field: str, *, layer: int | None = None, unrolled: bool = False) -> Any:
    """Draw a field of an answer: see `validation.output.plot.plot`.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it; ``.savefig(path)`` writes it.
    """
    from validation.output.plot import plot as draw

    return draw(_answer(answer), field, layer=layer, unrolled=unrolled)


def report(
    case: str | Path | Case,
    page: str | Path,
    settings: Settings = (),
    *,
    quick: bool = False,
    load_cases: bool = False,
) -> Path:
    """Write one page about a scene that can be sent: what `tubelock report` writes.

    Parameters
    ----------
    case, settings
        As `sweep`.
    page
        HTML file to write.
    quick
        Rigid blocks only.
    load_cases
        Also a tube without combinations under the five load cases.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        A scene that neither rigid nor deformable blocks answer, or a file that cannot be written.
    """
    from validation.output.files import prepare_file
    from validation.pages.report import report_scene, write_page

    path = prepare_file(Path(page))
    result = report_scene(_case(case, settings), deformable=not quick, load_cases=load_cases)
    write_page(result, path)
    return path


def section(
    answer: Answer,
    point: npt.ArrayLike,
    normal: npt.ArrayLike,
    *,
    blocks: Sequence[int] | None = None,
) -> SectionForces:
    """Compute normal force, shear forces and moments through planes: see `Answer.sections`.

    Raises
    ------
    SectionError
        A plane that cuts nothing, or forces that the answer does not have.
    """
    return _answer(answer).sections(point, normal, blocks=blocks)


def compare(*answers: Answer) -> Comparison:
    """Compare answers to one problem: measures side by side, pressures facet by facet.

    ``print(compare(rigid, static))`` is what `tubelock compare` prints; ``draw(path)`` its picture.
    ``.why()`` solves the steps between, one assumption at a time: what ``--why`` prints beside.

    Raises
    ------
    InputError
        Fewer than two answers, or answers on other facets.
    """
    from validation.study.comparison.report import compare_answers

    return compare_answers(tuple(map(_answer, answers)))


def cost(
    case: str | Path | Case,
    settings: Settings = (),
    *,
    quick: bool = False,
    store: str | Path | None = None,
) -> CostResult:
    """Measure error against CPU time of every method and mesh on a scene.

    ``print`` shows the table, ``draw(path)`` the curves.

    Parameters
    ----------
    case, settings
        As `sweep`.
    quick
        Coarse meshes only.
    store
        File that keeps what was measured (JSON lines); None: nothing is kept.

    Raises
    ------
    InputError
        A scene that no method can solve.
    """
    from validation.study.cost import run_cost
    from validation.study.rowfile import store_or_none

    with store_or_none(store) as path:
        return run_cost(_case(case, settings), path, quick=quick)


def _answer(answer: object) -> Answer:
    """Reject what is no answer."""
    from geometry.answer import Answer

    if not isinstance(answer, Answer):
        raise InputError(
            f"answer: got a {type(answer).__name__}; expected what solve_static, solve_explicit, "
            "analyse or read_answer returns"
        )
    return answer


def _case(case: str | Path | Case, settings: Settings) -> Case:
    """Case of a name or a file, or one that is read, with some settings changed."""
    if isinstance(case, str | Path):
        return load_case(case, settings)
    if not isinstance(case, Case):
        raise InputError(
            f"case: got a {type(case).__name__}; expected a name, a file, or a case of load_case"
        )
    return case.changed(settings) if settings else case


@dataclass(frozen=True, repr=False)
class SweepResult:
    """Rows of a parameter study."""

    rows: tuple[dict[str, Any], ...]
    """One for each design: its parameters, its measures, ``status`` and ``message``;
    ``pandas.DataFrame(study.rows)`` is a table."""
    summary: dict[str, Any]
    """How many designs were computed and failed, and their CPU time [s]."""
    study: Study
    """What was requested."""
    table: str
    """Designs and measures as `tubelock sweep` prints them, and the verdict on them."""
    judged: tuple[dict[str, Any], ...] = ()
    """With ``judge`` rows of deformable blocks: best and worst design by rigid ones."""

    def plot(self, parameter: str, measure: str) -> Any:
        """Draw a measure against a parameter, one curve for each combination of the others.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; ``.savefig(path)`` writes it.

        Raises
        ------
        InputError
            A parameter that does not vary, or a measure that the rows do not have.
        """
        from validation.study.picture import study_figure

        return study_figure(self.study, self.rows, parameter, measure)

    def __repr__(self) -> str:
        """Return the table of the designs."""
        return self.table


def sweep(
    case: str | Path | Case | Callable[..., Problem],
    parameters: Mapping[str, Sequence[Any]] | None = None,
    settings: Settings = (),
    *,
    quantity: Literal["rigid", "fem"] = "rigid",
    method: Method | None = None,
    accuracy: float | None = None,
    store: str | Path | None = None,
    workers: int | None = 1,
    judge: bool = False,
    progress: Callable[[str, int, int], object] | None = None,
) -> SweepResult:
    """Compute a scene with every combination of some values; what a store holds is not repeated.

    Parameters
    ----------
    case
        Name of a built-in scene, a TOML file, a case of `load_case`, or a function that makes a
        `fem.Problem` of the parameters, such as ``lambda amplitude: Problem(...)``. Without
        parameters name or file of a study: what `tubelock sweep` takes.
    parameters
        Values by key, such as ``{"block.amplitude": [0, 10, 20]}``; the last varies fastest.
    settings
        Values of other keys.
    quantity
        Which answer: ``rigid`` or ``fem``.
    method
        Of the problems of a function, such as ``Rigid()`` or ``Static()``.
    accuracy
        Relative error bars of deformable designs [-]; None: 0.1, within a limit of work.
    store
        File of the results (JSON lines), which a later call goes on with; None: nothing is kept.
    workers
        Processes; 1: this one; None: one for each core.
    judge
        Solve the best and the worst design of rigid blocks with deformable ones too.
    progress
        Called after each row with words, the number of rows so far and that of all designs.

    Raises
    ------
    InputError
        Parameters that a scene does not have, or a store that is no file of results.
    """
    from functools import partial

    from validation.study.rowfile import StudyRows, store_or_none
    from validation.study.run import runner_for
    from validation.study.scene_study import load_study
    from validation.study.sweep import run_sweep

    study: Study
    asked, given = quantity != "rigid" or accuracy is not None, parameters is not None
    _require_taken(case, method, settings=bool(settings), asked=asked, parameters=given)
    if callable(case):
        study = _study_of_function(case, parameters or {}, method, store, workers)
    elif parameters is None:
        study = load_study(str(case), settings)
    else:
        study = _study_of_scene(case, parameters, settings, quantity, accuracy)
    with store_or_none(store) as path:
        results, runner = StudyRows(path, study), partial(runner_for, workers=workers)
        done, total = results.counts()[0], study.n_designs

        def tell(_: object) -> None:
            nonlocal done
            done += 1
            if progress is not None:
                progress(f"{done} of {total} designs", done, total)

        swept = run_sweep(results, runner, tell, judged=judge)
        judged = () if swept.judgement is None else swept.judgement.rows
        rows = tuple(results.rows())
        return SweepResult(rows, swept.summary, study, repr(swept), judged)


def _require_taken(
    case: object, method: object, *, settings: bool, asked: bool, parameters: bool
) -> None:
    """Reject what a sweep of a function, of a study or of a scene does not have.

    ``asked``: whether a quantity or an accuracy is.
    """
    if callable(case):
        if settings or asked:
            raise InputError(
                "sweep: settings, quantity and accuracy are those of a scene; expected what a "
                "function makes to have them, and its method"
            )
    elif method is not None:
        raise InputError(
            "sweep: method is that of the problems of a function; expected quantity, or settings "
            "such as fem.method"
        )
    elif asked and not parameters:
        raise InputError(
            "sweep: quantity and accuracy are those of parameters given here; expected a study "
            "that states them"
        )


def _study_of_scene(
    case: str | Path | Case,
    parameters: Mapping[str, Sequence[Any]],
    settings: Settings,
    quantity: str,
    accuracy: float | None,
) -> Study:
    """Study of a scene, as its file would state it."""
    from validation.study.scene_study import check_study

    data: dict[str, Any] = {
        "scene": str(case) if isinstance(case, str | Path) else _case(case, ()).keys,
        "quantity": quantity,
        "parameters": {key: _listed(values) for key, values in parameters.items()},
    }
    if accuracy is not None:
        data["accuracy"] = accuracy
    return check_study(data, "sweep", None, settings)


def _listed(values: Any) -> Any:
    """Values as a file of a study has them: tuples, ranges and arrays as lists."""
    if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
        return values
    return values.tolist() if hasattr(values, "tolist") else list(values)


def _study_of_function(
    make: Callable[..., Problem],
    parameters: Mapping[str, Sequence[Any]],
    method: Method | None,
    store: str | Path | None,
    workers: int | None,
) -> Study:
    """Study of the problems of a function."""
    from mbd.options import Rigid
    from validation.study.study import FunctionStudy

    if method is None or store is not None or workers != 1:
        raise InputError(
            "sweep: a function makes problems, which have no method and no keys to store rows by; "
            "expected method=Rigid() or Static(), no store, and one worker"
        )
    stated = tuple((key, tuple(_listed(values))) for key, values in parameters.items())
    name = getattr(make, "__name__", "function")
    kind: Literal["rigid", "fem"] = "rigid" if isinstance(method, Rigid) else "fem"
    return FunctionStudy(name, kind, stated, make=make, method=method)


def sensitivity(
    case: str | Path | Case,
    settings: Settings = (),
    *,
    method: Literal["rigid", "fem"] = "rigid",
    parameters: Sequence[str] | None = None,
    step: float = 0.01,
    store: str | Path | None = None,
    workers: int = 1,
) -> Sensitivity:
    """Differentiate the measures of a scene with respect to its parameters.

    ``print`` shows the derivatives; ``draw(path)`` the elasticities.

    Parameters
    ----------
    case, settings
        As `sweep`.
    method
        ``rigid`` or ``fem``.
    parameters
        Keys such as ``block.amplitude``; None: all numbers of block, assembly and material.
    step
        Relative step of real parameters [-].
    store
        File of the answers (JSON lines), which a later call goes on with; None: nothing is kept.
    workers
        Processes; 1: this one.

    Raises
    ------
    InputError
        A key that is no number of the scene, or a scene without an answer.
    """
    from validation.study.optimisation.sensitivity import sensitivity_of
    from validation.study.rowfile import store_or_none

    named = None if parameters is None else list(parameters)
    with store_or_none(store) as path:
        return sensitivity_of(_case(case, settings), path, method, named, step, workers=workers)


def optimise(
    stated: Mapping[str, Any] | str | Path,
    store: str | Path | None = None,
    *,
    workers: int = 1,
) -> SearchResult:
    """Find the best design under limits.

    ``print`` shows the best designs; ``rows`` are all that were computed, ``best`` the best ones,
    ``judged`` those with the answer that decides; ``draw(path)`` the course of the search.

    Parameters
    ----------
    stated
        TOML file of `tubelock optimise`, or its content as a mapping.
    store
        File of the rows (JSON lines), which a later call goes on with; None: nothing is kept.
    workers
        Processes.

    Raises
    ------
    InputError
        A search that is not stated well, or no design that meets its limits.
    """
    from functools import partial

    from validation.study.optimisation import report, statement
    from validation.study.rowfile import store_or_none
    from validation.study.run import runner_for

    if isinstance(stated, Mapping):
        checked = statement.check_optimisation(stated)
    else:
        checked = statement.load_optimisation(str(stated))
    with store_or_none(store) as path:
        return report.optimise(checked, path, partial(runner_for, workers=workers))
