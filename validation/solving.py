"""Every answer: `solve(case)`, by rigid blocks, statics or explicit dynamics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from fem.method import Static
from geometry.answer import Answer
from geometry.compilation.clocks import timed_stages
from geometry.parts.dimensions import Limits
from mbd.options import Rigid
from validation.case import Case
from validation.errors import InputError, named

if TYPE_CHECKING:
    from fem.explicit.solve import Frame
    from geometry.machine.work import Budget
    from geometry.parts.dimensions import Built


def solve(
    case: Case,
    progress: Callable[[Any], None] | None = None,
    *,
    otherwise: Mapping[str, float] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> Answer:
    """Answer a case by its method.

    Parameters
    ----------
    case
        Of `load_case`, or ``Case(problem, Rigid())``.
    progress
        Called with what the run is at: words, or an object whose ``str`` is.
    otherwise
        Relative error bars [-] that a static state is refined to where its method has no accuracy;
        None: `fem.accuracy.converge.TARGETS`.
    on_frame, checkpoint, resume
        As `fem.solve_static` and `fem.solve_explicit`.

    Returns
    -------
    Answer
        With its case; ``print(answer)`` is its table.

    Raises
    ------
    InputError
        One line: what was got, what is expected, what to do.
    KeyboardInterrupt
        An explicit run that was interrupted and has no checkpoint.
    """
    show, method = progress or (lambda _: None), case.method
    show("builds the blocks and finds where they touch")
    with timed_stages() as watch:
        problem = case.problem if isinstance(method, Rigid) else case.check()
        watch.lap("build")
    built = watch.seconds()
    with named(case.name, keys=case.source is not None):
        if isinstance(method, Rigid):
            from mbd.answer import analyse

            answer = analyse(problem, method, progress=show)
        elif isinstance(method, Static):
            from fem.accuracy.statics import solve_static

            answer = solve_static(
                problem, method, otherwise=otherwise, progress=show, on_frame=on_frame
            )
        else:
            from fem.dynamics import solve_explicit

            answer = solve_explicit(
                problem,
                method,
                progress=show,
                on_frame=on_frame,
                checkpoint=checkpoint,
                resume=resume,
            )
            run = answer.details.run
            if checkpoint is None and run.status == "interrupted":
                raise KeyboardInterrupt(
                    f"{run.n_steps} time steps were done; no checkpoint was written: -o names a "
                    "folder for one"
                )
    answer = case.told(answer, built)
    built_blocks = cast("Built", answer.parts["dimensions"])
    limits = Limits(case.limits.least_wall, case.limits.steepest_joint)
    return replace(answer.beside({"dimensions": replace(built_blocks, limits=limits)}), case=case)


def repeatable(answer: Answer) -> Answer:
    """Return an answer that every machine gives.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C ended its run.
    InputError
        A limit of CPU time did.
    """
    run = None if answer.method == "rigid" else answer.details.run
    by = cast("Budget", answer.parts["work"]).stopped_by
    if by == "interrupt" or (run is not None and run.status == "interrupted"):
        raise KeyboardInterrupt
    if run is not None and by == "work":
        raise InputError(
            "fem.max_work: the limit of work ended an explicit run before its end; expected more, "
            "or none"
        )
    if by == "clock":
        section = "rigid" if answer.method == "rigid" else "fem"
        raise InputError(
            f"{section}.max_seconds: the limit of CPU time ended a run, and its answer depends on "
            f"the machine; expected {section}.max_work, which is the same on every machine"
        )
    return answer
