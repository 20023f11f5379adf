"""The report in a real browser: no error, no network, nothing to scroll sideways, 3D drawn."""

from __future__ import annotations

import asyncio
import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from tests.support.chromium import BROWSER, Page
from tests.verification.evidence import coarse_evidence, picture_is_drawn
from validation.paper.reference import reference
from validation.paper.shown.report import Extent, report_evidence

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    """A report of rigid blocks on coarse meshes."""
    folder = tmp_path_factory.mktemp("report")
    return report_evidence(
        coarse_evidence(folder), folder, Console(quiet=True), extent=Extent.QUICK
    )


def test_the_page_stands_alone_and_its_figures_are_drawn(report) -> None:
    text = report.read_text("utf-8")
    # What a browser would fetch: nothing but data in the page, which is sent alone.
    page = re.sub(r'<script type="text/plain".*?</script>', "", text, flags=re.S)
    sources = re.findall(r'(?:src|href)="([^"#][^"]*)"', page)
    assert sources
    assert all(s.startswith("data:image/webp;base64,") for s in sources)
    # A picture and what came out stand before the first table.
    assert (
        0 < page.index('class="lead"') < page.index("statements judged here") < page.index("<table")
    )
    assert page.index("<img") < page.index("<table")
    assert f"tubelock {version('tubelock')}+" in page
    for heading in ("Claims", "Tables", "Figures", "Cost", "Errata", "Repeat"):
        assert f"<h2>{heading}</h2>" in page
    assert page.count("<span>reproduce</span> <span>claims</span>") >= 40
    assert {p.name for p in (report.parent / "data").iterdir()} == {
        "tables.json",
        "claims.json",
        "errata.json",
        "cost.json",
        "sensitivity.json",
    }
    folder = report.parent / "figures"
    assert {p.stem for p in folder.glob("*.png")} == {
        "parameter-study-sine",
        "parameter-study-cosine",
        "pressures-pipe",
        "pressures-pillar",
        "pressures-tunnel",
        "cost",
    }
    assert all(picture_is_drawn(path) for path in folder.glob("*.png"))
    # A header and 3 f × 4 t × 5 n × 4 a.
    assert len((folder / "parameter-study-sine.csv").read_text().splitlines()) == 241


@pytest.mark.quick
def test_reference_numbers_live_in_one_file() -> None:
    assert reference()["table"]["TSB1"]["pipe"]["p_max"] == 0.467
    assert set(reference()["table"]) == {"TSB1", "TSB2", "THB0"}


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width", [390, pytest.param(1200, marks=pytest.mark.thorough)])
def test_the_page_in_a_browser(report, tmp_path, width) -> None:
    pytest.importorskip("tornado")
    pytest.importorskip("trame_vtk")

    async def visit() -> None:
        async with Page(tmp_path / "browser", width, 844) as page:
            await page.open(report)
            assert await page.evaluate("document.documentElement.scrollWidth") <= width
            assert await page.evaluate("document.querySelectorAll('section table').length") >= 8
            await page.evaluate("document.getElementById('views').scrollIntoView()")
            await page.evaluate("document.querySelector('.view button').click()")
            await page.wait(
                "document.querySelector('.view iframe')?.contentDocument?.querySelector('canvas')"
            )
            box = await page.evaluate(
                "(r => [r.left, r.top, r.right, r.bottom])"
                "(document.querySelector('.view iframe').getBoundingClientRect())"
            )
            left, top, right, bottom = (int(v) for v in box)
            stage = np.s_[max(top, 0) + 2 : bottom - 2, left + 2 : right - 2]
            picture = await page.pixels(lambda shown: a_tube_is_drawn(shown[stage]))
            await page.evaluate(
                "document.querySelector('.view iframe').contentDocument.dispatchEvent("
                "new KeyboardEvent('keydown', {key: 'ArrowRight'}))"
            )
            # An arrow key turns it.
            await page.pixels(lambda shown: (np.abs(shown - picture) > 0.1).mean() > 0.005)
            assert page.errors == []
            outside = [
                url
                for url in page.requests
                if not url.startswith(("file:", "data:", "blob:", "about:"))
            ]
            assert outside == []

    asyncio.run(visit())


def a_tube_is_drawn(stage: np.ndarray) -> bool:
    """The canvas is white but for coloured facets and dark edges, and not all of it."""
    drawn, coloured = (stage < 0.95).any(axis=2), np.ptp(stage, axis=2) > 0.2
    return bool(0.02 < drawn.mean() < 0.9 and coloured.mean() > 0.005)
