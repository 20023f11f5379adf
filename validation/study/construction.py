"""Stages of a construction, each a row of a file: an interrupted one goes on from there."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from geometry.answer import Answer
from geometry.compilation.clocks import summed
from mbd.answer import analyse
from mbd.building.stages import Construction
from mbd.options import Rigid
from validation.case import Case
from validation.errors import named
from validation.solving import solve
from validation.study.rowfile import StudyRows
from validation.study.run import answered
from validation.study.study import Study, case_content, data_digest


@dataclass(frozen=True)
class StageStudy(Study):
    """Stages by their numbers, judged one after the other."""

    case: Case = field(kw_only=True)
    construction: Construction = field(kw_only=True)
    sought: dict[int, float] = field(default_factory=dict, kw_only=True)
    """What each stage spent on whether its joints are pressed beforehand, by its design [s]."""

    @cached_property
    def digest(self) -> str:
        """Digest of what its scene states."""
        return data_digest([type(self).__name__, case_content(self.case)])

    def content(self, number: int) -> Any:
        """Return which stage it is."""
        return number

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Judge a stage within what those before left."""
        before = sum(spent for k, spent in self.sought.items() if k < number)
        stage = self.construction.stage(number + 1, before)
        self.sought[number] = stage.sought
        return {"judged": stage.as_json()}, []


def solve_in_stages(case: Case, store: Path, show: Callable[[Any], None]) -> Answer:
    """Answer a case of rigid blocks with its stages, which the store, a file of rows, keeps.

    Stages under a limit of CPU time depend on the machine, and are not kept.
    """
    method = case.method
    if not isinstance(method, Rigid) or method.stages is None or method.max_seconds is not None:
        return solve(case, show)
    show("builds the blocks and finds where they touch")
    start = time.process_time()
    with named(case.name):
        problem, built = case.check(), time.process_time() - start
        build = Construction(problem, method.stages, method, show, analyse)
        numbers = (("stage", tuple(range(1, len(build.order) + 1))),)
        study = StageStudy(case.name, "rigid", numbers, case=case, construction=build)
        for row in StudyRows(store, study).rows():
            study.sought[row["number"]] = row.get("judged", {}).get("sought", 0.0)
        rows = answered(study, store, lambda words: show(f"stage {words.partition(', ')[2]}"))
        stages = build.results(build.restored(row["judged"]) for row in rows)
        spent = time.process_time() - start
    answer = solve(replace(case, method=replace(method, stages=None), stated=problem), show)
    before = {"build": built, "parts": spent - built, "total": spent}
    seconds = summed(answer.report["cpu_seconds"], before)
    answer = replace(answer, case=case, parts={"stages": stages, **answer.parts})
    return answer.with_report({"cpu_seconds": seconds})
