"""Answers of deformable blocks without what takes long: refinement and error estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fem import Problem, Static
from fem.answer.answer import answer_of
from fem.static.solve import StaticOptions, static_state
from geometry import Answer
from validation import Case, load_case, solve

#: On the mesh of a problem, without error bars, which take another solution.
PLAIN = Static(mesh="scene", error_estimate=False)


def on_its_mesh(
    stated: Case | str | Path | Mapping[str, Any],
    settings: Mapping[str, Any] | Sequence[str] = (),
    *,
    method: str | None = None,
    error_estimate: bool = False,
    **follow: Any,
) -> Answer:
    """Answer of a case on the mesh that its scene states, without what else takes time."""
    case = stated.changed(settings) if isinstance(stated, Case) else load_case(stated, settings)
    if method is not None:
        case = case.with_method(method)
    if case.scene.fem.method == "static":
        case = case.changed({"fem.error_estimate": error_estimate, "fem.mesh": "scene"})
    return solve(case, **follow)


def by_options(problem: Problem, options: StaticOptions | None = None) -> Answer:
    """Static answer on the mesh of a problem, by options of the solver that no scene has."""
    return answer_of(static_state(problem.system, options), problem=problem)


def both_kinds(case: Case, *, explicit: bool = False) -> tuple[Answer, ...]:
    """Answers by rigid blocks in both norms, then static and ``explicit`` ones on its mesh."""
    norms = ({"rigid.norm": norm} for norm in ("force", "pressure"))
    rigid = tuple(solve(case.changed(norm).with_method("rigid")) for norm in norms)
    static = on_its_mesh(case, method="static")
    if not explicit:
        return *rigid, static
    to_rest = {"fem.method": "explicit", "fem.damping": "static"}
    return *rigid, static, on_its_mesh(case.changed(to_rest))
