"""The paper's figures from our own results: data first, pictures from the data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from rich.console import Console

from geometry import Answer
from validation.output.console import listing
from validation.output.files import write_csv
from validation.output.pictures.bodies import EYE, far_side, rigid_facets, steep
from validation.output.pictures.canvas import Direction, View
from validation.output.pictures.gallery import Panel, gallery, save_figure, subplots
from validation.output.pictures.scales import OF_LINES, PRESSURE_MAP, Scale, scale_from_zero
from validation.paper.deformable_study import JUDGED, Compared, rank_correlations
from validation.paper.evidence import IntArray, PaperEvidence, StudyTable
from validation.paper.reference import reference

#: Okabe–Ito, dark enough on white, and a mark each: readable without colour.
_LINES = (
    ("#0072B2", "o"),
    ("#D55E00", "s"),
    ("#009E73", "^"),
    ("#CC79A7", "D"),
    ("#555555", "v"),
)


#: Frequency, thickness [mm] and blocks in a layer of a curve.
_Panel = tuple[float, float, int]


def parameter_curves(table: StudyTable, shift: float) -> dict[_Panel, list[float]]:
    """p_max [MPa] over the amplitudes: figures mbd_anal_sinus (shift 0), mbd_anal_cosinus (0.5)."""
    _, frequencies, numbers, thicknesses, amplitudes = table.axes
    return {
        (f, t, int(n)): [table.p_max[shift, f, int(n), t, a] for a in amplitudes]
        for f, t, n in product(frequencies, thicknesses, numbers)
    }


def write_curves(table: StudyTable, shift: float, path: Path) -> None:
    """Write the points of the curves of one shift as CSV."""
    rows = (
        (shift, f, n, t, a, p)
        for (f, t, n), curve in parameter_curves(table, shift).items()
        for a, p in zip(table.axes[4], curve, strict=True)
    )
    write_csv(path, ("s", "f", "n", "t_mm", "a_mm", "p_max_MPa"), rows)


def draw_parameter_study(
    table: StudyTable, shift: float, path: Path, *, dashed: StudyTable | None = None
) -> None:
    """Draw p_max over a: a row for each frequency, a column for each thickness, a line for each n.

    The curves are those of one shift; those of deformable blocks have the rigid ones beside them,
    ``dashed``.
    """
    _, frequencies, numbers, thicknesses, amplitudes = table.axes
    shape = len(frequencies), len(thicknesses)
    figure, axes = subplots(*shape, size=(12, 9.5), sharex=True, sharey=True, squeeze=False)
    panels = dict(zip(product(frequencies, thicknesses), axes.flat, strict=True))
    curves = parameter_curves(table, shift)
    other = {} if dashed is None else parameter_curves(dashed, shift)
    for (f, t, n), curve in curves.items():
        colour, mark = _LINES[numbers.index(n) % len(_LINES)]
        if other:
            panels[f, t].plot(amplitudes, other[f, t, n], color=colour, linestyle="--", linewidth=1)
        panels[f, t].plot(
            amplitudes,
            curve,
            color=colour,
            marker=mark,
            markersize=5,
            linewidth=1.4,
            label=f"n = {n}",
        )
    best = min(curves, key=lambda key: min(curves[key]))
    at = int(np.argmin(curves[best]))
    panels[best[:2]].annotate(
        f"lowest: {curves[best][at]:.3f} MPa",
        (amplitudes[at], curves[best][at]),
        (0.03, 0.05),
        textcoords="axes fraction",
        fontsize=9,
        arrowprops={"arrowstyle": "->", "color": "black"},
    )
    drawn = [p for curve in (*curves.values(), *other.values()) for p in curve]
    low, high = 0.8 * min(drawn), 1.25 * max(drawn)
    ticks = [p for p in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0) if low <= p <= high]
    for (f, t), panel in panels.items():
        panel.set_yscale("log")
        panel.set_yticks(ticks, [f"{p:g}" for p in ticks])
        panel.set_ylim(low, high)
        panel.minorticks_off()
        panel.set_xticks(amplitudes)
        panel.grid(color="#DDDDDD", linewidth=0.6)
        panel.set_title(f"f = {f:g}, t = {t:g} mm", fontsize=10, loc="left")
        if t == thicknesses[0]:
            panel.set_ylabel("p_max [MPa]")
        if f == frequencies[-1]:
            panel.set_xlabel("amplitude a [mm]")
    name = "Sine Block, s = 0" if shift == 0 else f"Cosine Block, s = {shift:g}"
    title = f"{name}: max–mean contact pressure under internal pressure "
    title += (
        f"(rigid blocks, {table.mesh} elements per block)"
        if dashed is None
        else ("(deformable blocks; dashed: rigid)")
    )
    figure.suptitle(title, fontsize=13, x=0.05, ha="left")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=len(labels),
        frameon=False,
        fontsize=10,
    )
    save_figure(figure, path)


# ---------------------------------------------------------------------------------------------
# Pressure distributions


def rings(run: Answer) -> dict[str, IntArray]:
    """Rows of the result on the top frame, between the middle layers and on the bottom frame."""
    layers = run.details.blocks.n_layers
    middle = layers // 2
    lower = {
        f"layer {layers} and the top frame": layers,
        f"layers {middle} and {middle + 1}": middle,
        "the bottom frame and layer 1": 0,
    }
    layer = np.sort(run.contacts["layer"], axis=1)
    return {
        title: np.flatnonzero((layer == (below, below + 1)).all(axis=1))
        for title, below in lower.items()
    }


def draw_pressure_comparison(left: Answer, right: Answer, path: Path, *, title: str) -> None:
    """Draw two pressure distributions in the same colours: whole tubes outside, rings inside."""
    highest = [run.details.contact_pressures for run in (left, right)]
    label, nothing = "contact pressure [MPa]", "open joint"
    scale = scale_from_zero(label, PRESSURE_MAP, highest, nothing=nothing)

    def tube(run: Answer) -> list[Panel]:
        return [Panel(f"{run.case.name}, cut open", _view(run, _far_half(run), scale, EYE))]

    def inside(run: Answer) -> list[Panel]:
        return [
            Panel(f"{run.case.name}: {title}", _view(run, rows, scale, steep(EYE, 1.0)))
            for title, rows in rings(run).items()
        ]

    columns = [tube(left), inside(left), inside(right), tube(right)]
    save_figure(gallery(columns, title, height=9.0, scale=scale), path)


def _far_half(run: Answer) -> IntArray:
    points = run.details.blocks.interfaces.centroids[run.details.contact_index]
    return np.flatnonzero(far_side(run.details.blocks, points))


def _view(run: Answer, rows: IntArray, scale: Scale, direction: Direction) -> View:
    return View([rigid_facets(run).surface(rows, scale)], direction)


# ---------------------------------------------------------------------------------------------
# Cost


@dataclass(frozen=True)
class CpuTimeRow:
    """A row of table cpu-times."""

    method: str
    configurations: int
    cpu_hours: float
    remark: str

    @property
    def cells(self) -> tuple[str, ...]:
        """The row in words: method, tubes, CPU hours, CPU seconds of a tube, remark."""
        seconds = 3600 * self.cpu_hours / self.configurations
        numbers = (str(self.configurations), f"{self.cpu_hours:.3g}", f"{seconds:,.3g}")
        return (self.method, *numbers, self.remark)


def cost_rows(evidence: PaperEvidence) -> list[CpuTimeRow]:
    """Return the printed rows, and ours as far as computed."""
    printed = reference()["cost"]
    study = evidence.study
    rows = [
        CpuTimeRow(
            "rigid blocks, printed",
            printed["mbd_configurations"],
            printed["mbd_cpu_hours"],
            "AMD Ryzen 7 PRO 4750U",
        ),
        CpuTimeRow(
            "rigid blocks, tubelock",
            len(study.rows),
            study.cpu_seconds / 3600,
            f"{study.mesh} elements per block, class, equilibrium and measures",
        ),
        CpuTimeRow(
            "finite elements, printed",
            printed["fem_configurations"],
            printed["fem_cpu_hours"],
            "Abaqus/Explicit, Intel Xeon Platinum 8160",
        ),
    ]
    return rows + [
        CpuTimeRow("finite elements, tubelock", 1, seconds / 3600, name)
        for name, seconds in evidence.cpu_seconds.items()
        if name.startswith("fem ")
    ]


def print_costs(rows: list[CpuTimeRow], console: Console) -> None:
    """Print the cost table."""
    heads = ("method", "tubes", "CPU hours", "CPU seconds per tube", "remark")
    table = listing("Computational cost", *heads)
    for row in rows:
        table.add_row(*row.cells)
    console.print(table)


def draw_cost(evidence: PaperEvidence, path: Path) -> None:
    """Draw CPU seconds per tube over its size: ours computed, the paper's as lines."""
    printed = reference()["cost"]
    rows = list(evidence.study.rows.values())
    figure, panel = subplots(1, 1, size=(8.5, 5.5))
    # Those that built their blocks themselves: others took the ones of an earlier run.
    whole = [run for run in evidence.rigid_runs.values() if run.case.stated is None]
    fine = [run for run in whole if run.details.n_contacts > 20_000]
    series = (
        (
            [(row["n_contacts"], row["cpu_seconds"]) for row in rows],
            {"marker": "o", "markersize": 3, "color": "#0072B2"},
            "rigid blocks, tubelock: the 480 designs",
        ),
        (
            [(run.details.n_contacts, run.report["cpu_seconds"]["total"]) for run in fine],
            {"marker": "s", "markersize": 4, "color": "#009E73"},
            "rigid blocks, tubelock: more than 20 000 contacts",
        ),
        (
            [
                (run.details.whole.surfaces.n_facets, run.report["cpu_seconds"]["total"])
                for run in evidence.fem_runs.values()
            ],
            {"marker": "^", "markersize": 6, "color": "#D55E00"},
            "deformable blocks, tubelock: static state, one sector or (beam) whole",
        ),
    )
    for points, style, label in series:
        if points:
            panel.loglog(*zip(*points, strict=True), linestyle="", label=label, **style)
    for hours, name, colour in (
        (printed["mbd_cpu_hours"] / printed["mbd_configurations"], "rigid blocks", "#0072B2"),
        (printed["fem_cpu_hours"] / printed["fem_configurations"], "finite elements", "#D55E00"),
    ):
        seconds = 3600 * hours
        panel.axhline(seconds, color=colour, linestyle="--", linewidth=1)
        panel.text(
            0.01,
            seconds * 1.15,
            f"printed, {name}: {seconds:,.0f} s a tube",
            color=colour,
            transform=panel.get_yaxis_transform(),
            fontsize=9,
        )
    panel.set_ylim(1e-2, 1e7)
    panel.set_xlabel("contact facets of the tube")
    panel.set_ylabel("CPU seconds per tube")
    panel.grid(color="#DDDDDD", linewidth=0.6)
    panel.legend(loc="upper left", bbox_to_anchor=(0.0, 0.72), fontsize=9, frameon=False)
    panel.set_title("Cost of one tube, one core", fontsize=12, loc="left")
    save_figure(figure, path)


# ---------------------------------------------------------------------------------------------
# All of them


@dataclass(frozen=True)
class FigureFile:
    """A written figure."""

    name: str
    """Stem of the file."""
    caption: str
    path: Path
    command: str
    """Shell command that makes it."""


def draw_figures(evidence: PaperEvidence, folder: Path) -> list[FigureFile]:
    """Draw every figure that the evidence allows into a folder; what it lacks is computed."""
    files = []
    for figures in (_parameter_figures, _pressure_figures, _deformable_figures, _cost_figure):
        fem = figures is _deformable_figures
        if fem and not evidence.deformable:
            continue
        command = f"tubelock reproduce figures{' --fem' if fem else ''}"
        for name, caption, draw in figures(evidence):
            path = folder / f"{name}.png"
            draw(path)
            files.append(FigureFile(name, caption, path, command))
    return files


#: Stem of the file, caption, and what draws it.
_Drawn = tuple[str, str, Callable[[Path], object]]


def _parameter_figures(evidence: PaperEvidence) -> Iterator[_Drawn]:
    for shift, name, words in ((0.0, "sine", "Sine Block"), (0.5, "cosine", "Cosine Block")):

        def draw(path: Path, shift: float = shift) -> None:
            draw_parameter_study(evidence.study, shift, path)
            write_curves(evidence.study, shift, path.with_suffix(".csv"))

        caption = (
            f"{words}: max–mean contact pressure over the amplitude for every f, n and t, "
            "internal pressure 0.01 MPa."
        )
        yield f"parameter-study-{name}", caption, draw


_COMPARISONS = (
    ("pipe", "TSB1", "TSB2", "internal pressure"),
    ("pillar", "TSB1", "TSB2", "axial pressure"),
    ("tunnel", "THB0", "TSB2", "external pressure"),
)


def _pressure_figures(evidence: PaperEvidence) -> Iterator[_Drawn]:
    for case, left, right, load in _COMPARISONS:
        runs = evidence.case(left, case), evidence.case(right, case)
        title = f"{left} against {right}, {load} 0.01 MPa: contact pressures of rigid blocks"
        caption = (
            f"Contact pressures of {left} (left) and {right} (right) under {load}: how the "
            "load reaches the frames (top, bottom) and passes between the middle layers."
        )
        yield f"pressures-{case}", caption, partial(draw_pressure_comparison, *runs, title=title)


def _cost_figure(evidence: PaperEvidence) -> Iterator[_Drawn]:
    caption = (
        "CPU seconds of one tube over its number of contact facets; dashed, what the paper prints "
        "for its own machines."
    )
    yield "cost", caption, partial(draw_cost, evidence)


def _deformable_figures(evidence: PaperEvidence) -> Iterator[_Drawn]:
    from validation.paper.shown.figures_fem import (
        draw_displacements,
        draw_layer_comparison,
        draw_principal,
    )

    caption = (
        "Contact pressures of rigid and of deformable blocks on the sinusoidal faces of layer 7, "
        "each in units of its own largest."
    )
    yield "layer-7", caption, partial(draw_layer_comparison, evidence)
    for component, name, words in ((0, "sigma-1", "Maximum"), (2, "sigma-3", "Minimum")):
        caption = f"{words} principal stress on the unrolled outer surface, five load cases."
        yield name, caption, partial(draw_principal, evidence, component)
    caption = "Displacements of the five load cases, exaggerated."
    yield "displacements", caption, partial(draw_displacements, evidence)


def draw_deformable_study(compared: Compared) -> Iterator[tuple[str, Callable[[Path], object]]]:
    """Names of the figures and what draws them."""
    for shift, name in ((0.0, "sine"), (0.5, "cosine")):
        if shift in compared.axes[0]:
            tables = compared.table("p_max_fem"), compared.table("p_max")
            draw = partial(draw_parameter_study, tables[0], shift, dashed=tables[1])
            yield f"deformable-study-{name}.png", draw
    yield "deformable-study-ranks.png", partial(draw_ranks, compared)


def draw_ranks(compared: Compared, path: Path) -> None:
    """Draw deformable against rigid p_max, and the averaged tension against both."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure, axes = subplots(1, 3, size=(13, 4.4))
    panels = (
        ("p_max", "p_max_fem"),
        ("p_max", "sigma_1_averaged_fem"),
        ("p_max_fem", "sigma_1_averaged_fem"),
    )
    ranks = {row["measure"]: row for row in rank_correlations(compared)}
    frequencies = [key[1] for key in compared.rows]
    for panel, (x, y) in zip(axes, panels, strict=True):
        titles = JUDGED[x][0], JUDGED[y][0]
        for colour, mark, f in zip(OF_LINES, "os^Dv", compared.axes[1], strict=False):
            places = [k for k, frequency in enumerate(frequencies) if frequency == f]
            bars = [
                list(compared.rows.values())[k][f"{y.removesuffix('_fem')}_error_fem"]
                for k in places
            ]
            panel.errorbar(
                compared.values(x)[places],
                compared.values(y)[places],
                yerr=bars,
                fmt=mark,
                markersize=3.5,
                elinewidth=0.8,
                color=colour,
                label=f"f = {f:g}",
            )
        if y == "p_max_fem":
            ends = compared.values(x).min(), compared.values(x).max()
            panel.plot(ends, ends, color="#999999", linewidth=0.8, label="equal")
        panel.set_xscale("log")
        panel.set_yscale("log")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            axis.set_minor_formatter(NullFormatter())
        panel.set_xlabel(f"{titles[0]} [MPa]")
        panel.set_ylabel(f"{titles[1]} [MPa]")
        panel.set_title(f"rank correlation {ranks[titles[0]][titles[1]]:.2f}", loc="left")
        panel.grid(alpha=0.3)
    axes[0].legend(frameon=False)
    figure.suptitle(f"{len(compared.rows)} designs under internal pressure", x=0.02, ha="left")
    save_figure(figure, path)
