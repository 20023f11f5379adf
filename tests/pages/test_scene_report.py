"""The page about a scene: it stands alone, says what the answers say, and in which order."""

from __future__ import annotations

import math
import re
import tomllib
from html import unescape

import pytest

from geometry import Measure
from tests.support.coarse_tubes import keys
from validation import InputError, load_case, report, solve
from validation.pages.report import report_scene
from validation.pages.verdicts import BAD, GOOD, OPEN, strength_verdict

COARSE = keys(2, 2)
SETTINGS = [f"{key}={value}" for key, value in COARSE.items()]
#: Two cubes, one on the other: groups of an OBJ file.
CUBES = "".join(
    f"o cube{k}\n"
    + "".join(f"v {x} {y} {z}\n" for z in (10 * k, 10 * k + 10) for y in (0, 10) for x in (0, 10))
    + "".join(
        "f " + " ".join(str(8 * k + i) for i in quad) + "\n"
        for quad in (
            (1, 3, 4, 2),
            (5, 6, 8, 7),
            (1, 2, 6, 5),
            (3, 7, 8, 4),
            (1, 5, 7, 3),
            (2, 4, 8, 6),
        )
    )
    for k in range(2)
)
OWN = """
[block]
type = "mesh"
units = "mm"
[[parts]]
file = "cubes.obj"
[assembly]
fixed = ["cube0"]
[effects]
gravity = [0, 0, -9810]
[combinations.light]
weight = 0.5
[combinations.heavy]
weight = 2.0
[limits]
least_wall = 12.0
"""


def text_of(page) -> str:
    """Page without its pictures, as a reader sees its words."""
    return unescape(re.sub(r"data:image/webp;base64,[^\"]*|<[^>]*>", " ", page.read_text("utf-8")))


def test_the_page_of_a_tube(tmp_path) -> None:
    page = report("tsb1-pipe", tmp_path / "tube.html", COARSE, quick=True, load_cases=True)
    html = page.read_text("utf-8")
    sources = re.findall(
        r'(?:src|href)="([^"#][^"]*)"', re.sub(r"<script.*?</script>", "", html, flags=re.S)
    )
    assert sources
    assert all(source.startswith("data:image/webp;base64,") for source in sources)
    # Picture, answers, loads, tables, in this order.
    places = [html.index(part) for part in ("<img", 'id="answers"', 'id="loads"', 'id="tables"')]
    assert places == sorted(places)
    words = text_of(page)
    answer = solve(load_case("tsb1-pipe", SETTINGS, method="rigid"))
    assert answer.measures["p_max_facet"].value_words in words
    assert all(
        re.search(rf"<th>{case}</th>", html)
        for case in ("pipe", "tunnel", "pillar", "beam", "shaft")
    )
    # What is missing for a load factor is named with its key.
    assert "needs material.tensile_strength [MPa]" in words
    assert "not checked: set limits.least_wall" in words


def test_every_load_case_has_its_own_answer_where_it_is_asked_for() -> None:
    file = load_case("tsb1-pipe", SETTINGS)
    assert not report_scene(file, deformable=False).loads
    (table,) = report_scene(file, deformable=False, load_cases=True).loads
    assert not table.failed
    for case, answer in table.answers.items():
        own = solve(load_case("tsb1-pipe", [*SETTINGS, f"load.case={case}"], method="rigid"))
        assert answer["p_max"].value == own["p_max"].value


@pytest.mark.quick
@pytest.mark.parametrize(
    ("name", "more", "why"),
    [
        ("arch", (), "that is no tube"),
        ("tsb1-pipe", ("combinations.all.load=1.5",), r"with \[combinations\]"),
    ],
)
def test_load_cases_of_what_has_none_are_rejected(name: str, more: tuple[str], why: str) -> None:
    """They were left out without a word."""
    with pytest.raises(InputError, match=rf"{name}: load_cases: got a scene {why}"):
        report_scene(load_case(name, more), deformable=False, load_cases=True)


def test_the_page_of_own_blocks(tmp_path) -> None:
    (tmp_path / "cubes.obj").write_text(CUBES)
    (tmp_path / "own.toml").write_text(OWN)
    page = report(tmp_path / "own.toml", tmp_path / "own.html", quick=True)
    words = text_of(page)
    # Weight of 1000 mm³ of the default density on 100 mm², once, and in both combinations.
    density = load_case(str(tmp_path / "own.toml")).scene.material.density
    pressure = density * 9810.0 * 10.0
    for factor in (1.0, 0.5, 2.0):
        assert str(Measure(factor * pressure, "MPa")) in words
    assert "TOO THIN, limits.least_wall is 12 mm" in words
    assert "That is the load without factors. Combinations have their own verdicts below." in words
    # The scene on the page is the scene, without folders of this machine.
    assert str(tmp_path) not in words
    (pre,) = re.findall(r"<pre>(.*?)</pre>", page.read_text("utf-8"), flags=re.S)
    stated = tomllib.loads(unescape(pre))
    assert stated["parts"] == [{"file": "cubes.obj"}]
    assert stated["combinations"] == {"light": {"weight": 0.5}, "heavy": {"weight": 2.0}}


def test_numbers_without_error_bars_say_what_ended_the_refinement() -> None:
    result = report_scene(load_case("tsb1-pipe", {"assembly.layers": 1, "fem.max_work": 0.06}))
    words = {verdict.question: verdict.words for verdict in result.verdicts}["How sure is it?"]
    assert words.startswith("no error bars: the refinement was ended by the limit of work")


def test_an_answer_that_is_missing_says_why(tmp_path) -> None:
    # One cube that nothing holds: rigid blocks have an answer, deformable ones none.
    (tmp_path / "cubes.obj").write_text(CUBES)
    loose = OWN.replace("gravity = [0, 0, -9810]", "gravity = [0, 0, 9810]")
    (tmp_path / "own.toml").write_text(loose)
    result = report_scene(load_case(str(tmp_path / "own.toml")))
    verdicts = {verdict.question: verdict for verdict in result.verdicts}
    assert verdicts["Does it carry the load?"].words == "no"
    assert verdicts["Deformable blocks?"].lines == (result.failed["fem"],)
    assert verdicts["Where and how much?"].words == "no forces: the load is not carried"


@pytest.mark.quick
@pytest.mark.parametrize(
    ("factor", "remark", "tone"),
    [
        (2.0, "", GOOD),
        (0.5, "", BAD),
        (math.inf, "none: no tension", OPEN),
        (0.5, "not found: above 0.5 times the load", OPEN),
    ],
)
def test_only_a_factor_below_one_is_bad_news(factor: float, remark: str, tone: str) -> None:
    measure = Measure(factor, "times the load", remark=remark)
    strong = load_case("tsb1-pipe", [*SETTINGS, "material.tensile_strength=3"])
    found = strength_verdict(strong.problem.materials, {"cracking_factor": measure}, computed=True)
    assert found.tone == tone
    assert (remark or measure.value_words) in found.words
    # What is not stated is asked for by its key, what is stated is not.
    assert [line.split()[-1] for line in found.lines] == ["material.compressive_strength=30"]


@pytest.mark.quick
@pytest.mark.parametrize(("least", "first"), [(math.nan, True), (1.0, True), (200.0, False)])
def test_a_missing_factor_never_makes_a_larger_one_the_answer(least: float, first: bool) -> None:
    missing = Measure(least, "times the load", remark="not found: the limit of work")
    factors = {"cracking_factor": Measure(98.95, "times the load"), "crushing_factor": missing}
    materials = load_case("tsb1-pipe", SETTINGS).problem.materials
    found = strength_verdict(materials, factors, computed=True)
    assert found.tone == OPEN
    assert ("crushing" in found.words) is first
    assert ("98.95" in found.words) is not first


def test_a_scene_without_any_answer_is_rejected(tmp_path) -> None:
    with pytest.raises(InputError, match="one deformable body without contacts"):
        report("cantilever", tmp_path / "page.html", quick=True)
    assert not (tmp_path / "page.html").exists()
