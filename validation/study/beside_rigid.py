"""What a rigid answer has beside it: its stages, facets of half the length, other layers.

Each stage of a construction is a row of a file: an interrupted one goes on from there.

Forces between rigid blocks are not unique: the answer is the one of least norm on the facets of
``[mesh]``, and its means follow the facets. How far they do is seen on facets of half the length.

Between two frames a few layers can be locked whose blocks, in a longer tube, are not: tubes of
hexagon-based blocks under internal pressure are. `layers_to_unlock` finds how many layers it takes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from geometry.answer import Answer
from geometry.machine.work import summed
from geometry.parts.rows import Row, number
from mbd import MechanismClass
from mbd.answer import analyse
from mbd.building.stages import Construction
from mbd.options import Rigid
from validation.case import Case, solve
from validation.errors import InputError, named
from validation.scene.family import round_types
from validation.study.rowfile import StudyRows
from validation.study.run import answered, computed, runner_for
from validation.study.scene_study import SceneStudy
from validation.study.study import Study, case_content, data_digest

# ---------------------------------------------------------------------------------------------
# Stages


@dataclass(frozen=True)
class StageStudy(Study):
    """Stages by their numbers, judged one after the other."""

    base: Case = field(kw_only=True)
    construction: Construction = field(kw_only=True)
    sought: dict[int, float] = field(default_factory=dict, kw_only=True)
    """What each stage spent on whether its joints are pressed beforehand, by its design [s]."""

    @cached_property
    def digest(self) -> str:
        """Digest of what its scene states."""
        return data_digest([type(self).__name__, case_content(self.base)])

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
        study = StageStudy(case.name, "rigid", numbers, base=case, construction=build)
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


# ---------------------------------------------------------------------------------------------
# Shorter facets

#: Elements along every edge over those of the scene.
FACTOR = 2.0
#: Measures that are compared [MPa].
_COMPARED = ("p_eff", "p_eff_pooled", "p_max")
#: Largest change of a measure, relative to it, that shorter facets may make in a converged answer.
_CONVERGED = 0.05


@dataclass(frozen=True)
class Refinement:
    """Measures of a scene and of the same scene with shorter facets."""

    n_contacts: int
    """Of the finer mesh."""
    class_changes: bool
    """Whether the mechanism class does."""
    values: dict[str, float]
    """Measures of the finer mesh [MPa]; none where either holds nothing."""
    changes: dict[str, float]
    """Finer less the scene's own [MPa]."""

    @property
    def not_converged(self) -> list[str]:
        """Measures that shorter facets change by more than a twentieth."""
        return [k for k, v in self.values.items() if abs(self.changes[k]) > _CONVERGED * abs(v)]

    @property
    def rows(self) -> list[Row]:
        """Measures on the finer mesh, and how they change."""
        words = f"{self.n_contacts} contacts: "
        if self.class_changes:
            words += "another mechanism class, the facets of [mesh] are too long"
        elif not self.values:
            words += "the same class, and no pressures to compare"
        elif self.not_converged:
            words += f"not converged with the facets ({', '.join(self.not_converged)})"
        rows = [Row("half the facet size", words)]
        for name, value in self.values.items():
            own = value - self.changes[name]
            share = f" ({100.0 * self.changes[name] / own:+.2g} %)" if own else ""
            rows.append(Row(f"{name}, half the size", f"{number(value)} MPa{share}", value, "MPa"))
        return rows

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self) | {"not_converged": self.not_converged}


def check_asked(case: Case, asked: Mapping[str, bool]) -> None:
    """Reject what makes no tube, and facets that are given node by node or by triangles."""
    for option in ("--layers-to-unlock", "--disassemble"):
        if asked[option] and not case.is_tube:
            raise InputError(
                f"{case.name}: {option}: block.type {case.kind!r} makes no tube; "
                f"expected {round_types()}"
            )
    if asked["--refine"] and case.coarser(FACTOR) is None:
        raise InputError(
            f"{case.name}: --refine: its blocks have no mesh that could be refined; expected a "
            "scene that states how many elements a block has"
        )


def refined(case: Case, answer: Answer) -> Refinement:
    """Solve a rigid case on facets of half the length and compare."""
    finer = case.coarser(FACTOR)
    assert finer is not None
    result = solve(finer)
    one, other = _compared(answer), _compared(result)
    values = other if one else {}
    return Refinement(
        n_contacts=result.details.n_contacts,
        class_changes=result.details.mechanism is not answer.details.mechanism,
        values=values,
        changes={name: value - one[name] for name, value in values.items()},
    )


def _compared(answer: Answer) -> dict[str, float]:
    """Pressures of an answer by name [MPa]; none where nothing holds."""
    peak, paper = answer.measures.get("p_max_facet"), answer.details.measures
    if paper is None or peak is None:
        return {}
    return {"p_max_facet": peak.value} | {k: getattr(paper, k) for k in _COMPARED}


# ---------------------------------------------------------------------------------------------
# Other numbers of layers

#: Most layers that are tried: four times the paper's tubes.
_MOST_LAYERS = 48


@dataclass(frozen=True)
class Unlocking:
    """Classes of a tube by its number of layers."""

    classes: dict[int, str]
    """Of the numbers of layers that were tried, ascending."""
    layers: int | None
    """The least number of layers with which the tube is not locked; None: none was found."""

    @property
    def rows(self) -> list[Row]:
        """The number of layers, and those that were tried."""
        tried = ", ".join(f"{layers}: {result}" for layers, result in self.classes.items())
        head = "locked with every number tried" if self.layers is None else f"{self.layers} layers"
        words = f"{head} (on this mesh, frames held; {tried})"
        return [Row("layers to unlock", words, self.layers)]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {"layers": self.layers, "classes": {str(k): v for k, v in self.classes.items()}}


def layers_to_unlock(case: Case, store: Path) -> Unlocking:
    """Find the least number of layers with which a tube of rigid blocks is not locked.

    Doubled until it is not, then halved in between: a mechanism of some layers is taken to be one
    of more layers too. The store, a file of rows, keeps those that were tried.
    """
    numbers = tuple(range(1, _MOST_LAYERS + 1))
    study = SceneStudy(case.name, "rigid", (("assembly.layers", numbers),), case.keys)
    rows, result = StudyRows(store, study), dict[int, str]()

    def locked(layers: int) -> bool:
        (row,) = computed(rows, runner_for(study), [layers - 1])
        if row["status"] == "failed":
            raise InputError(f"{case.name}: assembly.layers = {layers}: {row['message']}")
        result[layers] = row["mechanism"]
        return result[layers] == MechanismClass.LOCKED

    low, high = 0, 1
    while locked(high):
        low, high = high, 2 * high
        if high > _MOST_LAYERS:
            return Unlocking(dict(sorted(result.items())), None)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if locked(middle) else (low, middle)
    return Unlocking(dict(sorted(result.items())), high)
