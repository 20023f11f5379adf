"""Cost of accuracy: methods on finer and finer meshes, and how they differ from the finest answer.

The finest answer is static and has error bars of its own: that of the narrowest error bars where
blocks are refined, else that of one more mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from fem.accuracy.converge import MOST_SECONDS, TARGETS, why_not_refined
from fem.method import Explicit, Static
from geometry.answer import Answer, title_of
from validation.case import Case, Method, refuse_cell
from validation.errors import InputError
from validation.output.answer_files import answer_of_data
from validation.output.console import Printed, listing
from validation.output.files import processor
from validation.output.pictures.gallery import save_figure, subplots, twos_and_fives, wrapped
from validation.output.pictures.scales import BLUE, GREEN, ORANGE, VERMILION
from validation.scene.keys.toml_text import flat
from validation.study.run import answered
from validation.study.study import CaseStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Measures whose errors are measured.
QUANTITIES = ("max_displacement", "p_eff", "p_max_point", "sigma_1_averaged")
#: Curves of the figure by method: name and colour. Rigid blocks are in the table: their error does
#: not shrink with the mesh.
_CURVES = {
    "static": ("static, mesh of the scene", BLUE),
    "converged": ("static, refined to error bars", GREEN),
    "explicit": ("explicit, mesh of the scene", VERMILION),
}


def cpu_seconds(answer: Answer) -> float:
    """CPU time of an answer, without compilation [s]."""
    spent: dict[str, float] = answer.report["cpu_seconds"]
    return spent["total"] - spent.get("compile", 0.0)


@dataclass(frozen=True)
class CostRow:
    """What a method on a mesh answered, and what it cost."""

    name: str
    """Method and mesh."""
    answer: Answer
    errors: dict[str, float]
    """Difference from the finest answer over it, by measure; rigid blocks have no displacement."""

    @property
    def method(self) -> str:
        """``rigid``, ``static``, ``converged`` or ``explicit``."""
        return self.name.partition(",")[0]

    @property
    def cost(self) -> float:
        """CPU time from the case to its measures, without what is compiled once a machine [s]."""
        return cpu_seconds(self.answer)


@dataclass(frozen=True, repr=False)
class CostResult(Printed):
    """All methods and meshes of a scene, and the finest answer; the repr is its table."""

    name: str
    load: str
    """In words."""
    mesh: str
    """Elements of the coarsest mesh."""
    rows: tuple[CostRow, ...]
    """The finest one is the last."""
    processors: str
    failures: dict[str, str]
    """Methods and meshes without an answer, and why."""

    @property
    def finest(self) -> CostRow:
        """What errors are measured against."""
        return self.rows[-1]

    def uncertainty(self, quantity: str) -> float | None:
        """Relative error bar of the finest answer; None where it has none."""
        measure = self.finest.answer[quantity]
        return None if measure.error is None else measure.error / abs(measure.value)

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        finest = self.finest.answer
        return {
            "scene": self.name,
            "base_mesh": self.mesh,
            "processor": self.processors,
            "finest": {
                "name": self.finest.name,
                "values": {q: finest[q].value for q in QUANTITIES},
                "relative_error_bars": {q: self.uncertainty(q) for q in QUANTITIES},
            },
            "cases": [
                {
                    "name": row.name,
                    "method": row.method,
                    "values": {q: row.answer[q].value for q in row.errors},
                    "relative_errors": row.errors,
                    "cpu_seconds": row.cost,
                }
                for row in self.rows
            ],
            "failures": self.failures,
        }

    def print(self, console: Console) -> None:
        """Print CPU time and errors of each method and mesh."""
        heads = [title_of(q).words for q in QUANTITIES]
        table = listing(f"{self.name}: error against CPU time", "case", numbers=("CPU s", *heads))
        for row in self.rows[:-1]:
            cells = (_percent(row.errors.get(q)) for q in QUANTITIES)
            table.add_row(row.name, f"{row.cost:.3g}", *cells)
        bars = (f"± {_percent(self.uncertainty(q))}" for q in QUANTITIES)
        table.add_row(f"finest: {self.finest.name}", f"{self.finest.cost:.3g}", *bars)
        console.print(table)
        console.print(f"mesh ×1: {self.mesh} elements per block; measured on {self.processors}")
        console.print("Differences from the finest answer below its error bar are not significant.")
        for name, why in self.failures.items():
            console.print(f"no answer from {name}: {why}")

    def draw(self, path: str | Path) -> None:
        """Draw error over CPU time for every quantity."""
        figure, panels = subplots(2, 2, size=(12, 9), sharex=True)
        for panel, quantity in zip(panels.ravel(), QUANTITIES, strict=True):
            _draw_panel(panel, self, quantity)
        for panel in panels[1]:
            panel.set_xlabel("CPU time, case to measures [s]")
        for panel in panels[:, 0]:
            panel.set_ylabel("difference from the finest answer [%]")
        panels[0, 0].legend(frameon=False, fontsize=9)
        title = (
            f"{self.name}: {self.load}; cost versus accuracy\n"
            f"at the points: mesh or requested error bar; ×1 has {self.mesh} elements per block"
        )
        figure.suptitle(wrapped(title, 10.0), x=0.02, ha="left")
        save_figure(figure, Path(path), about=self.processors)


def _percent(share: float | None) -> str:
    """A share as a person writes it."""
    if share is None:
        return "–"
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def _draw_panel(axes: Axes, result: CostResult, quantity: str) -> None:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axes.set_xscale("log")
    axes.set_yscale("log")
    rows = [row for row in result.rows[:-1] if row.errors.get(quantity, 0.0) > 0.0]
    errors, unsure = [row.errors[quantity] for row in rows], result.uncertainty(quantity)
    bottom = 0.5 * min([*errors, *filter(None, [unsure])], default=1e-3)
    if unsure is not None:
        axes.axhspan(
            bottom, unsure, color=ORANGE, alpha=0.18, lw=0, label="error bar of the finest answer"
        )
    style_of_words: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8}
    for method, (label, colour) in _CURVES.items():
        mine = [row for row in rows if row.method == method]
        points = [(row.cost, row.errors[quantity]) for row in mine]
        if points:
            style: dict[str, Any] = {"color": colour, "label": label, "lw": 1.2, "markersize": 5}
            axes.plot(*zip(*points, strict=True), "o-", **style)
        for row, point in zip(mine, points, strict=True):
            words = row.name.partition(", ")[2].removeprefix("mesh ")
            place = (4, -11) if method == "explicit" else (4, 4)
            axes.annotate(words, point, place, **style_of_words, color=colour)
    axes.set_ylim(bottom, 2.0 * max(errors, default=1.0))
    axes.margins(x=0.15)  # room for the words at the last point
    axes.set_title(title_of(quantity).words, fontsize=11, loc="left")
    axes.grid(which="major", alpha=0.3)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:g}"))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    # A quick study spans one decade or two, which one label in each would leave bare.
    lowest, highest = axes.get_xlim()
    seconds = twos_and_fives(lambda value: f"{value:g}")
    axes.xaxis.set_minor_formatter(seconds if highest < 1e3 * lowest else NullFormatter())
    axes.yaxis.set_minor_formatter(twos_and_fives(lambda value: f"{100 * value:g}"))


#: Multiples of the coarsest mesh, by method.
LEVELS = {"rigid": (1, 2, 4, 6), "static": (1, 2, 3, 4, 6), "explicit": (1, 2, 4)}
QUICK_LEVELS = {"rigid": (1, 2), "static": (1, 2), "explicit": (1,)}
#: Relative error bars that refined blocks are solved to; the last are those of the finest answer.
ACCURACIES, QUICK_ACCURACIES = (0.1, 0.03, 0.01), (0.1, 0.03)
#: Elements of the coarsest mesh along a wave or an edge, through the wall and in the direction that
#: is left: pressures peak on the flanks of waves, so elements are shortest along these.
_COARSEST = (4, 1, 2)
#: Cases that are cheaper are solved twice: the first loads modules [CPU s].
_CHEAP = 3.0
#: Effects that errors cannot be measured with, and why.
_REFUSED = {
    "friction": "errors are measured against a static solution, which depends on no history",
    "elastic_frame": "expected rigid frame blocks, which rigid and deformable answers share",
}


# ---------------------------------------------------------------------------------------------
# Cases


def coarsest_mesh(case: Case) -> dict[str, Any]:
    """Values of ``[mesh]`` whose multiples are the meshes of `cost`.

    Raises
    ------
    InputError
        A scene whose methods and meshes cannot be compared.
    """
    name, head = case.name, f"{case.name}: block.type {case.kind!r}"
    if case.problem.blocks.detection is not None or not case.meets:
        raise InputError(
            f"{head}: the cost of accuracy is that of contact pressures on finer and finer meshes; "
            "expected a scene whose blocks meet and have [mesh], such as tsb1-pipe, thb0-tunnel "
            "or planar-sine"
        )
    refuse_cell(case, "cost")
    for effect, why in _REFUSED.items():
        if any(on for key, on in case.values.items() if key.startswith(f"effects.{effect}")):
            raise InputError(f"{name}: effects.{effect}: {why}; remove {effect}")
    counts = case.element_counts | case.scene.coarse_mesh(*_COARSEST)
    if not counts:
        raise InputError(
            f"{head}: the cost of accuracy is measured on nested meshes, and this scene gives a "
            "mesh of its own to every block; expected a family with [mesh], such as tsb1-pipe, "
            "thb0-tunnel or planar-sine"
        )
    return counts


def cost_cases(case: Case, *, quick: bool = False) -> dict[str, Case]:
    """Methods on meshes of a scene by name, the finest one last."""
    counts, limits = coarsest_mesh(case), case.method
    levels, accuracies = (QUICK_LEVELS, QUICK_ACCURACIES) if quick else (LEVELS, ACCURACIES)
    static = Static(
        mesh="scene",
        error_estimate=False,
        max_work=limits.max_work or MOST_SECONDS,
        max_memory=limits.max_memory,
    )
    explicit = Explicit(
        damping="static",
        max_work=limits.max_work,
        max_memory=limits.max_memory,
    )

    def on(level: int) -> Case:
        times = {
            key: level * n if isinstance(n, int) else tuple(level * k for k in n)
            for key, n in counts.items()
        }
        return case.changed(dict(flat({"mesh": times})))

    methods: dict[str, Method | str] = {"rigid": "rigid", "static": static, "explicit": explicit}
    cases = {
        f"{name}, mesh ×{level}": on(level).with_method(method)
        for name, method in methods.items()
        for level in levels[name]
    }
    finest = max(levels["static"])
    bars, refined = replace(static, error_estimate=True), on(finest).with_method(static)
    if why_not_refined(refined.problem) is None:
        for share in accuracies:
            targets = dict.fromkeys(TARGETS, share)
            asked = replace(bars, mesh="converged", accuracy=targets)
            cases[f"converged, ± {100 * share:g} %"] = refined.with_method(asked)
    else:
        cases[f"static, mesh ×{finest + 2}"] = on(finest + 2).with_method(bars)
    return cases


# ---------------------------------------------------------------------------------------------
# Running


@dataclass(frozen=True)
class _Measured(CaseStudy):
    """Cases whose CPU time counts."""

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Return the cheaper of two answers, and the processor."""
        first = self._answer(number)
        again = self._answer(number) if _seconds(first) < _CHEAP else first
        return {"answer": min(first, again, key=_seconds), "processor": processor()}, []

    def _answer(self, number: int) -> dict[str, Any]:
        return super().results(number)[0]["answer"]


def _seconds(answer: dict[str, Any]) -> float:
    return cpu_seconds(answer_of_data(answer))


def run_cost(
    case: Case,
    store: Path,
    *,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> CostResult:
    """Measure what the store lacks, one after another: others would change its CPU time.

    ``progress`` is called with words after each run.

    Raises
    ------
    InputError
        A scene that cannot be measured, or one whose finest case has no answer.
    """
    cases = cost_cases(case, quick=quick)
    names = tuple(cases)
    study = _Measured(case.name, "fem", (("case", names),), cases=tuple(cases.values()))
    failures, answers, processors = {}, {}, set()
    for row in answered(study, store, progress, every=False):
        if row["status"] == "ok":
            answers[row["case"]] = answer_of_data(row["answer"])
            processors.add(row["processor"])
        else:
            failures[row["case"]] = row["message"]
    if names[-1] in failures:
        raise InputError(f"{case.name}: {names[-1]}: {failures[names[-1]]}")
    rows = (
        CostRow(name, answer, _errors(answer, answers[names[-1]]))
        for name, answer in answers.items()
    )
    counts = coarsest_mesh(case)
    sizes = [n for given in counts.values() for n in ([given] if isinstance(given, int) else given)]
    mesh = f"{' × '.join(map(str, sizes))} ({', '.join(counts)})"
    processors_named = " and ".join(sorted(processors))
    return CostResult(case.name, case.load_words, mesh, tuple(rows), processors_named, failures)


def _errors(answer: Answer, finest: Answer) -> dict[str, float]:
    """Relative differences from the finest answer, by measure [-]."""
    return {
        name: abs(answer[name].value / finest[name].value - 1.0)
        for name in QUANTITIES
        if name in answer.measures
    }
