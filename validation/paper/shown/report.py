"""`tubelock reproduce`: one folder that shows the paper beside our results.

``index.html`` holds everything (tables, claims, errata, pictures, 3D views) and needs no
network; the folder keeps the pictures in full size and the numbers as data.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from geometry.machine.system import write_whole
from validation.output.console import following
from validation.output.files import Provenance, prepare_folder, stamped, write_json
from validation.output.pictures.view_3d import View3d, viewer_page
from validation.pages.page import page_text
from validation.pages.views import pressure_view, stress_view
from validation.paper.claims.judge import claims, judge_claims
from validation.paper.errata import show_errata
from validation.paper.evidence import PaperEvidence
from validation.paper.reading import ReadingVariant, reading_variants
from validation.paper.shown.figures import CpuTimeRow, FigureFile, cost_rows, draw_figures
from validation.paper.tables import compute_tables, count_words, lines_by_block
from validation.paper.verdict import Truth


class Extent(StrEnum):
    """How much is computed."""

    QUICK = "quick"
    """Rigid blocks only: about three minutes of CPU time."""
    NORMAL = "normal"
    """And deformable blocks on a coarse mesh: some minutes."""
    FULL = "full"
    """Everything on fine meshes: about a quarter of an hour of CPU time."""


@dataclass(frozen=True)
class Report:
    """Everything a report shows."""

    extent: Extent
    tables: dict[str, Any]
    sensitivity: list[ReadingVariant]
    """The tables without one ingredient of the reading after the other."""
    half_block: str
    """By how much the half-block turn is better than the paper's."""
    claims: list[dict[str, Any]]
    errata: list[dict[str, Any]]
    figures: list[FigureFile]
    costs: list[CpuTimeRow]
    views: list[View3d]
    cpu_seconds: float
    """CPU time of this process and of the parameter study [s]."""


def write_report(
    folder: Path, console: Console, *, extent: Extent = Extent.NORMAL, workers: int | None = None
) -> Path:
    """Compute everything and write the report folder, whose parameter study is reused.

    Returns the page to open.
    """
    prepare_folder(folder)
    with following("report") as tell:
        evidence = PaperEvidence(
            prepare_folder(folder / "data"),
            tell,
            deformable=extent is not Extent.QUICK,
            full=extent is Extent.FULL,
            workers=workers,
        )
        return report_evidence(evidence, folder, console, extent=extent)


def report_evidence(
    evidence: PaperEvidence, folder: Path, console: Console, *, extent: Extent
) -> Path:
    """Judge, draw and write what the evidence allows; return the page to open."""
    figures, data = prepare_folder(folder / "figures"), prepare_folder(folder / "data")
    start = time.process_time()
    _say(console, "parameter study")
    study = evidence.study
    _say(console, "tables")
    tables = compute_tables(evidence.rigid)
    _say(console, "what the tables depend on")
    sensitive = reading_variants(evidence.rigid)
    _say(console, "claims")
    judged = judge_claims(evidence)
    _say(console, "errata")
    errata = show_errata(evidence)
    _say(console, "figures")
    drawn = draw_figures(evidence, figures)
    _say(console, "3D views")
    views = _views(evidence) if viewer_page() is not None else []
    report = Report(
        extent=extent,
        tables=tables,
        sensitivity=sensitive,
        half_block=half_block_words(evidence),
        claims=judged,
        errata=errata,
        figures=drawn,
        costs=cost_rows(evidence),
        views=views,
        cpu_seconds=time.process_time() - start + study.cpu_seconds,
    )
    _write_data(report, data)
    page = folder / "index.html"
    write_whole(page, lambda path: path.write_text(_page(report), "utf-8"))
    return page


def _say(console: Console, stage: str) -> None:
    console.print(f"{stage} …")


def _write_data(report: Report, folder: Path) -> None:
    for name, content in (
        ("tables", report.tables),
        ("sensitivity", [asdict(item) for item in report.sensitivity]),
        ("claims", report.claims),
        ("errata", report.errata),
        ("cost", [asdict(row) for row in report.costs]),
    ):
        write_json(str(folder / f"{name}.json"), stamped(content, Provenance()))


# ---------------------------------------------------------------------------------------------
# 3D views

#: Layers shown: the middle of the tube, large enough to see.
_SHOWN = (6, 7, 8)
_VIEW_MESH = ("mesh.around=36", "mesh.radial=4", "mesh.axial=10")


def _views(evidence: PaperEvidence) -> list[View3d]:
    middle = f"layers {_SHOWN[0]} to {_SHOWN[-1]}"
    pipe = evidence.rigid("tsb1-pipe", *_VIEW_MESH)
    tunnel = evidence.rigid("thb0-tunnel", "mesh.edge=12", "mesh.radial=4")
    titles = (
        f"TSB1 under internal pressure, {middle}",
        f"Hexagon-based block under external pressure, {middle}",
    )
    views = [
        pressure_view(pipe, titles[0], "rigid-pipe", _SHOWN),
        pressure_view(tunnel, titles[1], "rigid-tunnel", _SHOWN),
    ]
    if evidence.deformable:
        run = evidence.fem("TSB1", "pipe")
        views.append(stress_view(run, titles[0], "stress-pipe", _SHOWN))
    return views


# ---------------------------------------------------------------------------------------------
# The page


def _page(report: Report) -> str:
    """Return the whole page."""
    return page_text(
        "report.html",
        report=report,
        views=report.views,
        blocks=lines_by_block(report.tables),
        met=count_words(report.tables),
        truths=Truth,
        deformable={claim.name for claim in claims() if claim.deformable},
    )


def half_block_words(evidence: PaperEvidence) -> str:
    """Say by how much the half-block turn is better than that of one wave, at the largest f."""
    one, half = evidence.study.p_max, evidence.half_block.p_max
    f = evidence.study.axes[1][-1]
    ratio = np.array([half[key] / one[key] for key in one if key[1] == f])
    return (
        f"At f = {f:g} a turn of half a block instead of one wave lowers p_max in "
        f"{int((ratio < 1).sum())} of {len(ratio)} designs, on average to "
        f"{100 * ratio.mean():.0f} % ({100 * ratio.min():.0f} to {100 * ratio.max():.0f} %); the "
        f"lowest of all designs is {min(half.values()):.3f} instead of {min(one.values()):.3f} MPa."
    )
