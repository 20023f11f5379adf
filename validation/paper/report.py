"""`tubelock reproduce`: one folder that shows the paper beside our results.

``index.html`` holds everything (tables, claims, errata, pictures, 3D views) and needs no
network; the folder keeps the pictures in full size and the numbers as data.
"""

from __future__ import annotations

import base64
import datetime
import os
import platform
import time
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from geometry.files.whole import write_whole
from validation.output.files import prepare_folder, write_json
from validation.output.pictures.bodies import EYE, coloured_blocks, interface_facets, outlines
from validation.output.pictures.canvas import Part, View
from validation.output.pictures.scales import PRESSURE_MAP, scale_from_zero
from validation.output.pictures.tubes import all_faces, stress_scale
from validation.output.pictures.view_3d import View3d, make_view, viewer_page, webp
from validation.output.provenance import Provenance, program, stamped
from validation.paper.claims.claim import Truth
from validation.paper.claims.judge import claims, judge_claims
from validation.paper.errata import show_errata
from validation.paper.evidence import Evidence
from validation.paper.figures import CostRow, FigureFile, cost_rows, draw_figures
from validation.paper.reading import Sensitivity, sensitivity
from validation.paper.tables import compute_tables, count_words, lines_by_block
from validation.run.deformable import DeformableRun
from validation.run.measures import drawing_scale
from validation.run.rigid.answer import RigidRun


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
    sensitivity: list[Sensitivity]
    """The tables without one ingredient of the reading after the other."""
    half_block: str
    """By how much the half-block turn is better than the paper's."""
    claims: list[dict[str, Any]]
    errata: list[dict[str, Any]]
    figures: list[FigureFile]
    costs: list[CostRow]
    views: list[View3d]
    cpu_seconds: float
    """CPU time of this process and of the parameter study [s]."""


def write_report(
    folder: Path, console: Console, *, extent: Extent = Extent.NORMAL, workers: int | None = None
) -> Path:
    """Compute everything and write the report folder, whose parameter study is reused.

    Returns the page to open.

    Raises
    ------
    InputError
        When the folder cannot be written.
    """
    prepare_folder(folder)
    evidence = Evidence(
        prepare_folder(folder / "data"),
        console,
        deformable=extent is not Extent.QUICK,
        full=extent is Extent.FULL,
        workers=workers,
    )
    return report_evidence(evidence, folder, extent=extent)


def report_evidence(evidence: Evidence, folder: Path, *, extent: Extent) -> Path:
    """Judge, draw and write what the evidence allows; return the page to open."""
    console = evidence.console
    figures, data = prepare_folder(folder / "figures"), prepare_folder(folder / "data")
    start = time.process_time()
    _say(console, "parameter study")
    study = evidence.study
    _say(console, "tables")
    tables = compute_tables(console, evidence.rigid)
    _say(console, "what the tables depend on")
    sensitive = sensitivity(evidence.rigid)
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
    write_whole(page, lambda path: path.write_text(page_text(report), "utf-8"))
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

_VIEW_MESH = ("mesh.around=36", "mesh.radial=4", "mesh.axial=10")


def _views(evidence: Evidence) -> list[View3d]:
    result = [
        _pressure_view(
            evidence.rigid("tsb1-pipe", *_VIEW_MESH), "TSB1 under internal pressure", "rigid-pipe"
        ),
        _pressure_view(
            evidence.rigid("thb0-tunnel", "mesh.edge=12", "mesh.radial=4"),
            "Hexagon-based block under external pressure",
            "rigid-tunnel",
        ),
    ]
    if evidence.deformable:
        result.append(_stress_view(evidence.fem("TSB1", "pipe")))
    return result


#: Layers shown: the middle of the tube, large enough to see.
_SHOWN = (6, 7, 8)


def _pressure_view(run: RigidRun, title: str, name: str) -> View3d:
    """Contact facets of the middle layers, coloured by pressure."""
    interfaces, layer = run.assembly.interfaces, run.assembly.layer
    index = run.result.contact_index
    touches = np.isin(layer[interfaces.block_m[index]], _SHOWN) | np.isin(
        layer[interfaces.block_s[index]], _SHOWN
    )
    pressures = run.result.contact_pressures[touches]
    facets = interface_facets(run.assembly, index[touches], pressures)
    scale = scale_from_zero("MPa", PRESSURE_MAP, [pressures])
    shown = np.flatnonzero(np.isin(layer, _SHOWN)).tolist()
    parts: list[Part] = [
        facets.surface(np.arange(len(pressures)), scale),
        outlines(run.assembly, shown),
    ]
    return make_view(
        name,
        f"{title}, layers {_SHOWN[0]} to {_SHOWN[-1]}",
        "Rigid blocks: the faces that can meet another block, coloured by contact pressure.",
        View(parts, EYE),
        scale=scale,
    )


def _stress_view(run: DeformableRun) -> View3d:
    """All faces of the middle layers' blocks, coloured by σ₁, moved by exaggerated displacement."""
    solution, deformable = run.solution, run.solution.deformable
    scale, factor = replace(stress_scale(solution), label="MPa"), drawing_scale(solution)
    surface = coloured_blocks(
        deformable.assembly,
        np.flatnonzero(np.isin(deformable.assembly.layer, _SHOWN)).tolist(),
        lambda block: solution.principal(block)[:, 0],
        scale,
        nodes=lambda block: deformable.positions(block) + factor * solution.displacement(block),
        faces=all_faces(solution),
    )
    return make_view(
        "stress-pipe",
        f"TSB1 under internal pressure, layers {_SHOWN[0]} to {_SHOWN[-1]}, displacements × "
        f"{factor:g}",
        "Deformable blocks: maximum principal stress σ₁; red is tension.",
        View([surface], EYE),
        scale=scale,
    )


# ---------------------------------------------------------------------------------------------
# The page


def page_text(report: Report) -> str:
    """Return the whole page."""
    from jinja2 import Environment, PackageLoader

    pages = Environment(loader=PackageLoader("validation", "paper"), autoescape=True)
    pages.filters["base64"] = lambda content: base64.b64encode(content).decode()
    pages.filters["percent"] = lambda share: "" if share is None else f"{100 * share:+.1f} %"
    pages.filters["webp"] = _webp_of
    return pages.get_template("report.html").render(
        report=report,
        blocks=lines_by_block(report.tables),
        met=count_words(report.tables),
        truths=Truth,
        deformable={claim.name for claim in claims() if claim.deformable},
        program=program(),
        today=datetime.datetime.now(tz=datetime.UTC).date().isoformat(),
        machine=f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        viewer=(viewer_page() or "").encode(),
    )


def half_block_words(evidence: Evidence) -> str:
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


def _webp_of(path: Path) -> bytes:
    """Picture of a figure, to stand in the page: it is sent alone."""
    import matplotlib.image

    pixels = matplotlib.image.imread(path)
    return webp((255 * pixels[..., :3]).astype(np.uint8))
