"""Every answer: `solve(case)`, by rigid blocks, statics or explicit dynamics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from mbd.options import Rigid
from validation.case import Case

if TYPE_CHECKING:
    from geometry.answer import Answer


def solve(case: Case, progress: Callable[[str], None] | None = None) -> Answer:
    """Answer a case by its method.

    Parameters
    ----------
    case
        Of `load_case`, or ``Case(name=..., stated=problem, method=Rigid())``.
    progress
        Called with a line on what the run is at.

    Returns
    -------
    Answer
        With its case; ``print(answer)`` is its table.

    Raises
    ------
    InputError
        One line: what was got, what is expected, what to do.
    """
    from validation.run.stages import telling

    with telling(progress or (lambda _: None)):
        answer = _rigid(case) if isinstance(case.method, Rigid) else _deformable(case)
    return replace(answer, case=case)


def _rigid(case: Case) -> Answer:
    from validation.run.rigid.polyhedra import rigid_answer

    return rigid_answer(case).answer


def _deformable(case: Case) -> Answer:
    from validation.run.solve import run_as_asked, with_factors

    return with_factors(run_as_asked(case.name, case.scene)).answer
