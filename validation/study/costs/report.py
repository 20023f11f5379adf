"""Cost and accuracy of a scene as a table, data and a figure."""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from geometry.answer import Answer, title_of
from validation.output.console import listing, plain_console
from validation.output.pictures.gallery import save_figure, subplots, twos_and_fives
from validation.output.pictures.scales import BLUE, GREEN, ORANGE, VERMILION

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
class CostResult:
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
        figure.suptitle(
            f"{self.name}: {self.load}; cost versus accuracy\n"
            f"at the points: mesh or requested error bar; ×1 has {self.mesh} elements per block",
            x=0.02,
            ha="left",
        )
        save_figure(figure, Path(path), about=self.processors)

    def __repr__(self) -> str:
        """Return what `print` prints."""
        self.print(plain_console(text := StringIO()))
        return text.getvalue().rstrip()


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
