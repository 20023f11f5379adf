"""`tubelock report`: one page about one scene that can be sent: pictures inside, tables last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from geometry.answer import Answer
from geometry.errors import RefusedError
from geometry.machine.system import write_whole
from geometry.parts.rows import RowTable
from validation.case import Case, solve
from validation.errors import InputError
from validation.output.answer_files import is_meshed, pictures
from validation.output.files import Provenance
from validation.output.pictures.view_3d import View3d, viewer_page, webp
from validation.pages.page import page_text
from validation.pages.verdicts import PageVerdict, verdicts
from validation.pages.views import layer_words, middle_layers, pressure_view, stress_view
from validation.scene.keys.toml_text import toml_text
from validation.study.combinations import (
    combination_answers,
    combination_cases,
    combination_rows,
)
from validation.study.rowfile import store_or_none

Tell = Callable[[Any], None]

#: What pictures show, by the names of their files, in the order of the page.
_CAPTIONS = {
    "assembly": "Blocks, fixed blocks and load.",
    "contacts": "Blocks and contact interfaces.",
    "contact_pressures": "Contact pressures.",
    "mechanism": "Mechanism: how the blocks move.",
    "stages": "Stages of the construction: what is new, what is propped.",
    "stresses": "Principal stresses.",
    "displacement": "Deformed shape.",
}


@dataclass(frozen=True)
class Figure:
    """A picture of the page."""

    caption: str
    content: bytes
    """WebP."""


@dataclass(frozen=True)
class LoadTable:
    """Answers to several loads side by side."""

    kind: str
    """``rigid`` or ``fem``."""
    answers: Mapping[str, Answer]
    failed: Mapping[str, str]
    """Why a load has no answer."""

    @property
    def rows(self) -> list[list[str]]:
        """Title, value under each load, governing load."""
        return list(combination_rows(self.answers)) if self.answers else []


@dataclass(frozen=True)
class SceneReport:
    """Everything that the page shows."""

    file: Case
    rigid: Answer | None
    deformable: Answer | None
    failed: Mapping[str, str] = field(default_factory=dict)
    """Why there is no rigid or no deformable answer, by its kind."""
    loads: tuple[LoadTable, ...] = ()
    loads_title: str = ""

    @cached_property
    def verdicts(self) -> list[PageVerdict]:
        """Answers to what a reader asks first."""
        return verdicts(self.rigid, self.deformable, self.failed)

    @property
    def title(self) -> str:
        """Scene and load."""
        return f"{self.file.name}: {self.file.load_words}"

    @cached_property
    def tables(self) -> list[RowTable]:
        """All that `tubelock mbd` and `tubelock fem` print."""
        return [a.table for a in (self.rigid, self.deformable) if a is not None]

    def as_dict(self) -> dict[str, Any]:
        """Answers as plain data."""
        return {
            "scene": self.file.name,
            "verdicts": {verdict.question: verdict.words for verdict in self.verdicts},
            "rigid": None if self.rigid is None else self.rigid.as_dict(),
            "deformable": None if self.deformable is None else self.deformable.as_dict(),
            "failed": dict(self.failed),
            "loads": {
                table.kind: {name: answer.as_dict() for name, answer in table.answers.items()}
                for table in self.loads
            },
        }


def report_scene(
    file: Case,
    *,
    deformable: bool = True,
    load_cases: bool = False,
    tell: Tell = lambda _: None,
) -> SceneReport:
    """Compute the answers that a report shows.

    Parameters
    ----------
    file
        The scene.
    deformable
        Whether deformable blocks are solved too.
    load_cases
        Whether a tube without combinations is solved under the five load cases.
    tell
        Called with what it is at: words, or what the solvers tell.

    Raises
    ------
    InputError
        A scene that neither rigid nor deformable blocks answer, or one without load cases.
    """
    if load_cases and (file.combinations or not file.is_tube):
        why = "with [combinations]" if file.combinations else "that is no tube"
        raise InputError(
            f"{file.name}: load_cases: got a scene {why}; expected a tube without them, or no "
            "load_cases"
        )
    failed: dict[str, str] = {}
    tell("rigid blocks")
    rigid = _tried(failed, "rigid", lambda: solve(file.with_method("rigid"), tell))
    run = None
    if deformable:
        tell("deformable blocks")
        run = _tried(failed, "fem", lambda: solve(file, tell))
    if rigid is None and run is None:
        raise InputError(next(iter(failed.values())))
    title = ""
    if file.combinations:
        title = "Load combinations"
    elif load_cases:
        title = "The five load cases, same pressure"
    known = [answer for answer in (rigid, run) if answer is not None and title]
    loads = tuple(_side_by_side(answer, tell) for answer in known)
    return SceneReport(file, rigid, run, failed, loads, title)


def _tried(failed: dict[str, str], kind: str, solve: Callable[[], Any]) -> Any:
    """An answer, or None and the line that says why there is none."""
    try:
        return solve()
    except RefusedError as error:
        failed[kind] = str(error)
        return None


def _side_by_side(known: Answer, tell: Tell) -> LoadTable:
    """Numbers under each combination or load case; the answer to the case itself is known."""
    from geometry.loads import CASES

    case, failed = known.case, dict[str, str]()
    if case.combinations:
        cases = combination_cases(case)
    else:
        under = {name: case.changed({"load.case": name}) for name in CASES}
        cases = {name: replace(one, name=f"{case.name}, {name}") for name, one in under.items()}
    kind, blocks = ("rigid", "rigid") if known.method == "rigid" else ("fem", "deformable")
    answers = {n: known.numbers_alone() for n, one in cases.items() if one.source == case.source}
    others = {name: one for name, one in cases.items() if name not in answers}
    with store_or_none(None) as rows:
        answers |= combination_answers(
            case, others, rows, lambda words: tell(f"{blocks} blocks under {words}"), failed
        )
    return LoadTable(kind, {name: answers[name] for name in cases if name in answers}, failed)


# ---------------------------------------------------------------------------------------------
# Pictures


def _pictures(report: SceneReport) -> Iterator[tuple[str, str, Any]]:
    """Kind of blocks, name and figure of each picture."""
    rigid = report.rigid
    if rigid is not None and is_meshed(rigid):
        yield "all", "assembly", _assembly(rigid)
    for kind, answer in (("deformable", report.deformable), ("rigid", rigid)):
        for name, draw in ({} if answer is None else pictures(answer)).items():
            yield kind, Path(name).stem, draw()


def _assembly(run: Answer) -> Any:
    from validation.output.pictures.assemblies import draw_assembly

    title, weight = f"{run.case.name}: {run.case.load_words}", run.problem.gravity
    return draw_assembly(run.details.blocks, run.details.load, title=title, weight=weight)


def figures(report: SceneReport) -> list[Figure]:
    """Pictures of the page, the contact pressures first."""
    from validation.output.pictures.gallery import pixels_of

    result = {}
    for kind, name, drawn in _pictures(report):
        blocks = "" if kind == "all" else f" {kind.capitalize()} blocks."
        result[kind, name] = Figure(f"{_CAPTIONS[name]}{blocks}", webp(pixels_of(drawn)))
    first = ("contact_pressures", "contacts", "assembly")
    order = sorted(result, key=lambda key: [*first, *_CAPTIONS].index(key[1]))
    return [result[key] for key in order]


def _views(report: SceneReport) -> list[View3d]:
    """3-D views; none without the library."""
    views: list[View3d] = []
    if viewer_page() is None:
        return views
    rigid, run = report.rigid, report.deformable
    if rigid is not None:
        layers = middle_layers(rigid.details.blocks)
        words = "contact pressures" if rigid.details.holds else "blocks"
        title = f"{rigid.title}; {words}{layer_words(layers)}"
        views.append(pressure_view(rigid, title, "rigid", layers))
    if run is not None:
        layers = middle_layers(run.details.whole.assembly)
        title = f"{run.title}; σ₁{layer_words(layers)}"
        views.append(stress_view(run, title, "deformable", layers))
    return views


# ---------------------------------------------------------------------------------------------
# The page


def write_page(report: SceneReport, path: Path) -> None:
    """Write the page, whole or not at all."""
    text = report_page(report)
    write_whole(path, lambda partial: partial.write_text(text, "utf-8"))


def report_page(report: SceneReport) -> str:
    """Return the page as text: it needs no network and no other file."""
    stated = Provenance(report.file).as_json()["scene"]
    stated.pop("name")
    for part in stated.get("parts", ()):  # the page is sent: folders of this machine are not
        part["file"] = Path(part["file"]).name
    pictures = figures(report)
    return page_text(
        "scene.html",
        report=report,
        lead=pictures[0] if pictures else None,
        figures=pictures[1:],
        views=_views(report),
        scene=toml_text(stated),
    )
