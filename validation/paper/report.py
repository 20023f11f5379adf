"""`tubelock reproduce`: one folder that shows the paper beside our results.

``index.html`` holds everything (tables, claims, errata, pictures, 3D views) and needs no
network; the folder keeps the pictures in full size and the numbers as data.
"""

from __future__ import annotations

import base64
import datetime
import html
import os
import platform
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from importlib import resources
from pathlib import Path
from string import Template

import numpy as np
from rich.console import Console

from validation.output.files import prepare_folder, write_json, write_whole
from validation.output.pictures.bodies import (
    EYE,
    coloured_blocks,
    interface_facets,
    outlines,
)
from validation.output.pictures.canvas import Part, View
from validation.output.pictures.gallery import PRESSURE_MAP, scale_from_zero
from validation.output.pictures.tubes import all_faces, stress_scale
from validation.output.pictures.view_3d import (
    View3d,
    make_view,
    viewer_page,
    webp,
)
from validation.output.program import program
from validation.output.provenance import Provenance, stamped
from validation.paper.claims.claim import Truth
from validation.paper.claims.judge import JudgedClaim, claims_json, judge_claims
from validation.paper.errata import ShownErratum, errata_json, show_errata
from validation.paper.evidence import Evidence
from validation.paper.figures import CostRow, FigureFile, cost_rows, draw_figures
from validation.paper.reading import Sensitivity, sensitivity
from validation.paper.tables import (
    HEADS,
    Tables,
    compute_tables,
    count_words,
    number,
    tables_json,
)
from validation.run.deformable import DeformableRun
from validation.run.rigid.assembly import RigidRun

#: Preprint of 1 April 2026, https://arxiv.org/abs/2604.00836.
_PAPER_DOI = "doi:10.48550/arXiv.2604.00836"


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
    tables: Tables
    sensitivity: list[Sensitivity]
    """The tables without one ingredient of the reading after the other."""
    half_block: str
    """By how much the half-block turn is better than the paper's."""
    claims: list[JudgedClaim]
    errata: list[ShownErratum]
    figures: list[FigureFile]
    costs: list[CostRow]
    views: list[View3d]
    cpu_seconds: float
    """CPU time of this process and of the parameter study [s]."""


def write_report(
    folder: Path, console: Console, *, extent: Extent = Extent.NORMAL, workers: int | None = None
) -> Path:
    """Compute everything and write the report folder.

    Parameters
    ----------
    folder
        Created if needed; the parameter study in it is reused.
    console
        Progress.
    extent
        How much is computed.
    workers
        Processes of the parameter study; None: one per core.

    Returns
    -------
    Path
        The page to open.

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
    """Judge, draw and write what the evidence allows.

    Parameters
    ----------
    evidence
        Computed where it has not been yet.
    folder
        Of the report.
    extent
        What the page says about how much was computed.

    Returns
    -------
    Path
        The page to open.
    """
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
    claims = judge_claims(evidence)
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
        claims=claims,
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
        ("tables", tables_json(report.tables)),
        ("sensitivity", [asdict(item) for item in report.sensitivity]),
        ("claims", claims_json(report.claims)),
        ("errata", errata_json(report.errata)),
        ("cost", [asdict(row) for row in report.costs]),
    ):
        write_json(str(folder / f"{name}.json"), stamped(content, Provenance()))


# ---------------------------------------------------------------------------------------------
# 3D views

_VIEW_MESH = ("mesh.around=36", "mesh.radial=4", "mesh.axial=10")


def _views(evidence: Evidence) -> list[View3d]:
    found = [
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
        found.append(_stress_view(evidence.fem("TSB1", "pipe")))
    return found


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
    assembly, scale = run.deformable.assembly, replace(stress_scale(run, 0), label="MPa")
    shown = np.flatnonzero(np.isin(assembly.layer, _SHOWN)).tolist()
    surface = coloured_blocks(
        assembly,
        shown,
        lambda block: run.principal(block)[:, 0],
        scale,
        nodes=lambda block: run.positions(block) + run.drawing_scale * run.displacement(block),
        faces=all_faces(run),
    )
    return make_view(
        "stress-pipe",
        f"TSB1 under internal pressure, layers {_SHOWN[0]} to {_SHOWN[-1]}, displacements × "
        f"{run.drawing_scale:g}",
        "Deformable blocks: maximum principal stress σ₁; red is tension.",
        View([surface], EYE),
        scale=scale,
    )


# ---------------------------------------------------------------------------------------------
# The page


def page_text(report: Report) -> str:
    """Return the whole page."""
    template = Template(
        (resources.files("validation") / "pages" / "report.html").read_text("utf-8")
    )
    sections: list[tuple[str, str, str]] = [
        ("claims", "Claims", _claims_html(report.claims)),
        ("tables", "Tables", _tables_html(report.tables)),
        ("reading", "Reading", _reading_html(report)),
        ("views", "Turn it", _views_html(report.views)),
        ("figures", "Figures", "".join(_figure_html(f) for f in report.figures)),
        ("cost", "Cost", _cost_html(report.costs)),
        ("errata", "Errata", _errata_html(report.errata)),
        ("repeat", "Repeat", _repeat_html(report)),
    ]
    return template.substitute(
        title="The Sine Block: the paper beside our results",
        subtitle=_subtitle(report),
        navigation="".join(f'<a href="#{key}">{name}</a>' for key, name, _ in sections),
        body=_lead_html(report)
        + "".join(
            f'<section id="{key}"><h2>{name}</h2>{text}</section>' for key, name, text in sections
        ),
        data=_data_html(report.views),
    )


def _escape(value: object) -> str:
    return html.escape(str(value))


def _command_html(command: str) -> str:
    """Command to copy; its lines break between words, never at a hyphen."""
    words = " ".join(f"<span>{_escape(word)}</span>" for word in command.split())
    return f"<code>{words}</code>"


def _subtitle(report: Report) -> str:
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    return _escape(
        "Influence of the geometry on the mechanical performance of tubular interlockings: A "
        "study of the Sine Block (Macek, Weiß, Akpanya, Brepols, Holthusen, Niemeyer; 2026, "
        f"{_PAPER_DOI}), recomputed with tubelock {program()} on {today} ({machine}; extent: "
        f"{report.extent}; {report.cpu_seconds:.0f} CPU seconds)."
    )


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]], caption: str = "") -> str:
    """Table of HTML cells; on a narrow screen each row becomes a card."""
    names = list(heads)
    head = "".join(f"<th>{name}</th>" for name in names)
    lines = []
    for row in rows:
        cells = "".join(
            f'<td data-label="{_escape(name)}">{cell}</td>'
            for name, cell in zip(names, row, strict=True)
        )
        lines.append(f"<tr>{cells}</tr>")
    title = f"<caption>{caption}</caption>" if caption else ""
    return (
        f'<table class="cards">{title}<thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table>"
    )


#: Classes of the verdicts in the page's style sheet.
_KINDS = {
    Truth.TRUE: "true",
    Truth.FALSE: "false",
    Truth.UNDECIDABLE: "open",
    Truth.NOT_COMPUTED: "open",
}


def _lead_html(report: Report) -> str:
    """What the reader sees first: a picture and what came out."""
    if report.views:
        picture, words = report.views[0].poster, report.views[0].title
    elif report.figures:
        picture, words = _webp_of(report.figures[0].path), report.figures[0].caption
    else:
        return _summary_html(report)
    return (
        f'<div class="lead"><figure><img src="{_data_uri(picture)}" alt="{_escape(words)}">'
        f"<figcaption>{_escape(words)}</figcaption></figure>"
        f"<div>{_summary_html(report)}</div></div>"
    )


def _summary_html(report: Report) -> str:
    counts = {truth: sum(c.verdict.truth is truth for c in report.claims) for truth in Truth}
    boxes = "".join(
        f'<div><b class="{_KINDS[truth]}">{counts[truth]}</b>{truth}</div>' for truth in Truth
    )
    return (
        f"<p>Of the paper's {len(report.claims)} statements judged here:</p>"
        f'<div class="counts">{boxes}</div>'
        f"<p>Of the paper's tables are met: {count_words(report.tables)}.</p>"
    )


def _claims_html(claims: list[JudgedClaim]) -> str:
    rows = [
        (
            _escape(item.claim.statement),
            f'<span class="verdict {_KINDS[item.verdict.truth]}">{item.verdict.truth}</span>',
            _escape(item.verdict.number),
            _command_html(
                f"tubelock reproduce claims {item.claim.name}"
                f"{' --fem' if item.claim.deformable else ''}"
            ),
        )
        for item in claims
    ]
    return _table(("the paper says", "verdict", "number", "repeat"), rows)


def _tables_html(tables: Tables) -> str:
    text = (
        "<p>Read as the tables are: what that is, and what each part of it moves, stands under "
        "<em>Reading</em>. As physics says: the whole traction in shaft, p_eff as the mean of "
        "block means.</p>"
    )
    heads = ("load case", "quantity", "paper", "ours", "difference", "to the digit", "physics")
    for block in dict.fromkeys(found.block for found in tables.classes):
        lines: list[tuple[str, ...]] = []
        for found in tables.classes:
            if found.block != block:
                continue
            same = _yes(found.paper == found.ours)
            lines.append((found.case, "mechanism", found.paper, found.ours, "", same, ""))
            for row in tables.rows:
                if (row.block, row.case) == (block, found.case):
                    lines.append(
                        (
                            row.case,
                            HEADS[row.quantity],
                            number(row.quantity, row.paper),
                            number(row.quantity, row.ours, 2),
                            _percent(row.relative_difference),
                            _yes(row.to_the_digit),
                            number(row.quantity, row.physical, 2),
                        )
                    )
        text += _table(heads, lines, block)
    command = _command_html("tubelock reproduce tables")
    return f"{text}<p>{count_words(tables)}. {command}</p>"


def _yes(holds: bool) -> str:
    return f'<span class="verdict {"true" if holds else "false"}">{"yes" if holds else "no"}</span>'


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:+.1f} %"


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


def _reading_html(report: Report) -> str:
    """One table: what is left out, how many numbers are still met, the error of each number."""
    found = report.sensitivity
    whole, *without = found
    heads = ["number", "whole reading", *(f"without {item.ingredient}" for item in without)]
    counts = [f"{item.to_the_digit} of {item.of}" for item in found]
    lines = [["to the last digit", *counts]]
    moved = [item.moved(whole) for item in without]
    for place, error in whole.differences.items():
        lines.append([_escape(place), _percent(error), *(_percent(m.get(place)) for m in moved)])
    return (
        "<p>Error of every number of the tables, (ours − printed) / printed, and what it becomes "
        "without one ingredient of the reading; empty where it stays.</p>"
        f"{_table(heads, lines)}<p>{_command_html('tubelock reproduce errata')}</p>"
        "<p>The parameter study turns every second layer by one wave at every f, as what the paper "
        f"says of it shows. {_escape(report.half_block)} "
        f"{_command_html('tubelock sweep half-block-160')}</p>"
    )


def _views_html(views: list[View3d]) -> str:
    if not views:
        return (
            "<p>3D views need the library trame-vtk: <code>pip install 'tubelock[report]'</code>, "
            "then write the report again.</p>"
        )
    return f'<div class="views">{"".join(_view_html(view) for view in views)}</div>'


def _view_html(view: View3d) -> str:
    bar = ""
    if view.colour_bar is not None:
        gradient, low, high = view.colour_bar
        bar = (
            f'<div class="bar"><span>{_escape(low)}</span><i style="background: {gradient}"></i>'
            f"<span>{_escape(high)}</span></div>"
        )
    return (
        f'<div class="view" data-view="{view.name}"><h3>{_escape(view.title)}</h3>'
        f'<div class="stage"><img src="{_data_uri(view.poster)}" alt="{_escape(view.title)}">'
        f'<button type="button">Turn in 3D</button></div>{bar}'
        f'<p class="soft">{_escape(view.note)} Drag or arrow keys to turn; pinch, scroll, + and − '
        "to zoom.</p></div>"
    )


def _data_uri(image: bytes) -> str:
    return f"data:image/webp;base64,{base64.b64encode(image).decode()}"


def _figure_html(figure: FigureFile) -> str:
    picture, caption = _data_uri(_webp_of(figure.path)), _escape(figure.caption)
    return (
        f'<figure><img src="{picture}" alt="{caption}" loading="lazy">'
        f"<figcaption>{caption} {_command_html(figure.command)}</figcaption></figure>"
    )


def _webp_of(path: Path) -> bytes:
    """Picture of a figure, to stand in the page: it is sent alone."""
    import matplotlib.image

    pixels = matplotlib.image.imread(path)
    return webp((255 * pixels[..., :3]).astype(np.uint8))


def _cost_html(rows: list[CostRow]) -> str:
    lines = [
        (
            _escape(row.method),
            str(row.configurations),
            f"{row.cpu_hours:.3g}",
            f"{3600 * row.cpu_hours / row.configurations:,.3g}",
            _escape(row.remark),
        )
        for row in rows
    ]
    return _table(("method", "tubes", "CPU hours", "CPU seconds per tube", "remark"), lines)


def _errata_html(errata: list[ShownErratum]) -> str:
    rows = [
        (
            _escape(item.erratum.printed),
            _escape(item.erratum.meant),
            _escape(item.shown.words),
            _command_html(item.erratum.command),
        )
        for item in errata
    ]
    return "<p>What the paper prints and cannot mean.</p>" + _table(
        ("printed", "meant", "shown", "repeat"), rows
    )


def _repeat_html(report: Report) -> str:
    flag = {Extent.QUICK: " --quick", Extent.NORMAL: "", Extent.FULL: " --full"}[report.extent]
    fem = "" if report.extent is Extent.QUICK else " --fem"
    rows = [
        ("this page", f"tubelock reproduce{flag} -o DIR"),
        ("the tables", "tubelock reproduce tables"),
        ("the parameter study", "tubelock sweep paper-480 --csv paper-480.csv"),
        ("the figures", f"tubelock reproduce figures{fem} -o DIR"),
        ("the claims", f"tubelock reproduce claims{fem}"),
        ("the errata", "tubelock reproduce errata"),
        ("one load case", "tubelock mbd tsb1-pipe"),
        ("one load case with deformable blocks", "tubelock fem tsb1-pipe"),
    ]
    table = _table(("what", "command"), [(_escape(a), _command_html(b)) for a, b in rows])
    return (
        table + "<p>The numbers of this page lie as JSON, CSV and SQLite in <code>data</code>.</p>"
    )


def _data_html(views: list[View3d]) -> str:
    """Data of the 3D views, kept once in the page and read when a view is opened."""
    page = viewer_page()
    if not views or page is None:
        return ""

    def block(name: str, content: bytes) -> str:
        text = base64.b64encode(content).decode()
        return f'<script type="text/plain" id="{name}">{text}</script>\n'

    return block("viewer", page.encode()) + "".join(
        block(f"scene-{view.name}", view.scene) for view in views
    )
