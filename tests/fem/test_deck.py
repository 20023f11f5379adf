"""`tubelock export` and `tubelock deck` as a person uses them."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fem.decks.deck import Flavour
from fem.decks.problem import problem_deck
from fem.decks.read.cards import Card, read_cards
from fem.system.effects import SAFETY_FACTOR
from tests.support.coarse_tubes import coarse
from tests.support.commands import set_words
from tests.support.decks import exported
from validation import load_case

pytestmark = pytest.mark.quick

COARSE = list(coarse(2, 2, 2))
SMALL = set_words(COARSE)


#: Colour of arrows of loads.
VERMILION = (213, 94, 0)


def heading(path: str | Path) -> str:
    return Path(path).read_text().split("**")[0]


def cards_of(path: Path) -> dict[str, Card]:
    """The last card of each keyword."""
    return {card.keyword: card for card in read_cards(path.read_text().splitlines())}


def said(path: Path) -> str:
    """Heading of a deck without its line breaks."""
    return " ".join(heading(path).split())


@pytest.mark.parametrize("flavour", ["general", "standard", "calculix"])
def test_an_exported_deck_is_read(tubelock, flavour) -> None:
    status, out, _ = tubelock(
        "export", "tsb1-pipe", *SMALL, "-o", "a.inp", "--flavour", flavour, "-v"
    )
    assert status == 0
    assert "*Surface Interaction (1)" in out
    status, out, _ = tubelock("deck", "a.inp", "--json", "a.json")
    assert status == 0
    data = json.loads(Path("a.json").read_text())
    assert (data["blocks"], data["fixed_blocks"]) == (16, 8)
    assert data["dialect"] == ("calculix" if flavour == "calculix" else "abaqus")
    assert data["procedure"] == ("explicit" if flavour == "general" else "static")
    assert {p.name for p in Path().iterdir()} == {"a.inp", "a.json"}


def test_a_deck_is_written_again_and_solved(tubelock) -> None:
    small = (*SMALL, "--set", "assembly.layers=1", "--set", "mesh.radial=1")
    tubelock("export", "tsb1-pipe", *small, "-o", "a.inp", "--flavour", "standard")
    found = []
    for words in (("a.inp", "--write", "b.inp"), ("b.inp",)):
        assert tubelock("deck", *words, "--run", "--json", "a.json")[0] == 0
        found.append(json.loads(Path("a.json").read_text())["measures"]["max_displacement"])
    assert found[0]["value"] == pytest.approx(found[1]["value"], rel=1e-6)


def test_a_deck_is_solved_as_accurately_as_is_asked(tubelock) -> None:
    """On finer meshes than its own, of which a limit of time leaves the first."""
    small = (*SMALL, "--set", "assembly.layers=1", "--set", "mesh.radial=1")
    tubelock("export", "tsb1-pipe", *small, "-o", "a.inp", "--flavour", "standard")
    run = ("deck", "a.inp", "--run", "--json", "a.json")
    status, said, _ = tubelock(*run, "--accuracy", "u=0.01%", "--max-seconds", "1e-9")
    accuracy = json.loads(Path("a.json").read_text())["accuracy"]
    assert (status, accuracy["not_reached"]) == (3, ["max_displacement"])
    assert accuracy["ended_by"] in said
    assert tubelock(*run, "--mesh", "scene", "--accuracy", "u=1%")[0] == 2


def test_sets_of_blocks_hold_each_element_once(tmp_path: Path) -> None:
    """FRAME, and TUBE, which are ranges or other sets."""
    path = exported(tmp_path / "a.inp", "tsb1-pipe", COARSE, flavour="calculix")
    sets: dict[str, list[int]] = {}
    elements = 0
    for card in read_cards(path.read_text().splitlines()):
        rows = [row for _, row in card.rows()]
        if card.keyword == "ELEMENT":
            numbers = [int(row[0]) for row in rows]
            elements += len(numbers)
            if "ELSET" in card.parameters:
                sets.setdefault(card.parameter("ELSET").upper(), []).extend(numbers)
        elif card.keyword == "ELSET":
            members = sets.setdefault(card.parameter("ELSET").upper(), [])
            for row in rows:
                if "GENERATE" in card.parameters:
                    members += range(int(row[0]), int(row[1]) + 1, int(row[2]))
                else:
                    for word in row:
                        members += [int(word)] if word.isdigit() else sets[word.upper()]
    frame, tube = sets["FRAME"], sets["TUBE"]
    assert sorted(frame + tube) == list(range(1, elements + 1))
    assert 2 * len(frame) == len(tube)  # two layers; an end ring on each side, half as high


@pytest.mark.slow
def test_a_deck_is_drawn_with_its_load(tubelock) -> None:
    tubelock("export", "tsb1-beam", *SMALL, "-o", "a.inp", "--flavour", "standard")
    status, out, _ = tubelock("deck", "a.inp", "--open")
    assert status == 0
    assert "out/a/assembly.png" in out
    pixels = np.asarray(Image.open("out/a/assembly.png").convert("RGB"), dtype=int)
    arrows = np.abs(pixels - VERMILION).max(axis=2) < 8
    height = len(pixels)
    assert arrows[: height // 2].sum() > 100  # on the upper free layer alone, and in the legend
    assert not arrows[int(0.6 * height) : int(0.9 * height)].any()


def test_the_same_scene_gives_the_same_bytes(tubelock) -> None:
    for flavour in Flavour:
        for name in ("a.inp", "b.inp"):
            tubelock("export", "tsb2-shaft", *SMALL, "-o", name, "--flavour", flavour)
        assert Path("a.inp").read_bytes() == Path("b.inp").read_bytes()


def test_twelve_layers_are_three_parts(tmp_path: Path) -> None:
    """698 880 elements in 56 instances: each block is written once for each of its shapes."""
    path = exported(tmp_path / "case.inp", "tsb1-pipe", flavour="general")
    assert path.stat().st_size < 5e6
    keywords = Counter(line.split(",")[0] for line in path.read_text().splitlines())
    assert keywords["*Instance"] == 56
    assert keywords["*Part"] == 3


def test_general_contact_has_a_clearance_on_every_joint(tubelock) -> None:
    """One assignment for each pair of patches that contact pairs have."""
    where = ("--set", "contact.clearance=0.05", "-o", "a.inp", "--flavour")
    assigned = []
    for flavour, keyword in (
        ("general", "CONTACT CLEARANCE ASSIGNMENT"),
        ("standard", "CONTACT PAIR"),
    ):
        assert tubelock("export", "tsb1-pipe", *SMALL, *where, flavour)[0] == 0
        cards = read_cards(Path("a.inp").read_text().splitlines())
        assigned.append(
            {tuple(line.split(", ")[:2]) for c in cards if c.keyword == keyword for line in c.data}
        )
        if flavour == "general":
            gap = next(c for c in cards if c.keyword == "CONTACT CLEARANCE")
            assert gap.parameters == {"NAME": "GAP", "ADJUST": "NO", "CLEARANCE": "0.05"}
    assert assigned[0] == assigned[1] != set()


@dataclass(frozen=True)
class Said:
    """What the deck of a tube says and does not say."""

    settings: tuple[str, ...] = ()
    flavour: str | None = None
    cards: Mapping[str, Mapping[str, str | None] | str] = field(default_factory=dict)
    """Some parameters of a keyword, None of one that is not there, or its first row of data."""
    words: tuple[str, ...] = ()
    """Words of the heading and lines."""
    without: tuple[str, ...] = ()
    """Keywords, words and lines that are not there."""
    load: str = "pipe"


EXPLICIT = ("fem.method=explicit", "fem.end_time=1.0", "fem.damping=paper")
UNDAMPED = ("fem.method=explicit", "fem.end_time=1.0", "fem.damping=none", "fem.safety_factor=0.9")
SECTIONS = ("contact.spacing=0.03", "effects.friction.coefficient=0.01", "fem.element=reduced")
SECTIONS += ("effects.gravity=[0.0, 0.0, -9810.0]", "fem.frames=11")
IN_TIME: dict[str, dict[str, str | None]] = {"DYNAMIC": {"EXPLICIT": ""}}
PAPER: dict[str, dict[str, str | None]] = {"DAMPING": {"ALPHA": "2.0", "BETA": "1.e-08"}}
#: A static scene names no damping.
SAID = {
    "static": Said(
        cards={"STATIC": {}, "CONTACT PAIR": {}},
        words=("CFN, CFS",),
        without=("DYNAMIC", "DAMPING", "BULK VISCOSITY", "DLOAD", "Explicit"),
    ),
    "explicit, for a static program": Said(EXPLICIT, "standard", {"STATIC": {}}),
    "static, for an explicit program": Said(
        flavour="general",
        cards=IN_TIME
        | PAPER
        | {"BULK VISCOSITY": "0.06, 1.2", "CONTACT INCLUSIONS": {"ALL EXTERIOR": ""}}
        | {"SURFACE BEHAVIOR": {"PRESSURE-OVERCLOSURE": "EXPONENTIAL"}},
        words=("approaches the static state",),
        without=("FRICTION", "CONTACT PAIR", "CFN, CFS"),
    ),
    "damping of its own": Said(
        ("effects.rayleigh.mass_proportional=7.0",),
        "general",
        {"DAMPING": {"ALPHA": "7.0", "BETA": None}},
    ),
    "explicit": Said(EXPLICIT, cards=IN_TIME | PAPER, without=("CONTACT PAIR",)),
    "explicit without damping": Said(
        UNDAMPED,
        cards={"DYNAMIC": {"SCALE FACTOR": "0.9"}, "BULK VISCOSITY": "0.0, 0.0"}
        | {"AMPLITUDE": {"DEFINITION": "SMOOTH STEP"}},
        without=("DAMPING",),
    ),
    "adaptive damping": Said(
        ("fem.method=explicit", "fem.damping=static"),
        cards=PAPER,
        words=("adaptive damping is its own",),
    ),
    "no cap": Said((), "general", {"SURFACE BEHAVIOR": "0.001, 0.0001"}),
    "a cap": Said(
        ("contact.maximum_stiffness=500",), "general", {"SURFACE BEHAVIOR": "0.001, 0.0001, 500.0"}
    ),
    "gaps": Said(("contact.spacing=0.05",), "calculix", words=("too many cutbacks",)),
    "no gaps": Said((), "calculix", without=("too many cutbacks",)),
    "sections": Said(
        SECTIONS,
        "general",
        {"FRICTION": "0.01,", "ELEMENT": {"TYPE": "C3D8R"}}
        | {"SECTION CONTROLS": {"HOURGLASS": "STIFFNESS"}}
        | {"DLOAD": "FRAME, GRAV, -9810.0, 0.0, 0.0, 1.0"},
        words=("spacing of the blocks: 0.03", "number interval=10"),
    ),
    "traction": Said((), "general", {"DSLOAD": {}}, without=("CLOAD",), load="shaft"),
    "nodal forces": Said((), "standard", {"CLOAD": {}}, without=("DSLOAD",), load="shaft"),
    "differences": Said(
        flavour="calculix",
        words=("table of 200 points", "NODE TO SURFACE", "sampled", "nodal forces", "flat:"),
        load="shaft",
    ),
}


@pytest.mark.parametrize("name", SAID)
def test_a_deck_says_what_its_scene_says(name: str, tmp_path: Path) -> None:
    row, path = SAID[name], tmp_path / "a.inp"
    exported(path, f"tsb1-{row.load}", [*COARSE, *row.settings], flavour=row.flavour)
    cards, text = cards_of(path), f"{said(path)}\n{path.read_text()}"
    for word, expected in row.cards.items():
        if isinstance(expected, str):
            assert cards[word].data[0] == expected
        else:
            found = cards[word].parameters
            assert {key: found.get(key) for key in expected} == expected
    assert [word for word in row.words if word not in text] == []
    assert [word for word in row.without if word in cards or word in text] == []
    assert all(len(line) <= 132 for line in path.read_text().splitlines())


@pytest.mark.parametrize(("end_time", "double"), [(0.01, False), (8.0, True)])
def test_a_long_explicit_deck_recommends_double_precision(end_time, double, tmp_path: Path) -> None:
    """Abaqus does from 300 000 increments on; these have 2 800 and 2.2 million."""
    settings = [*COARSE, *EXPLICIT, f"fem.end_time={end_time}"]
    deck = problem_deck(load_case("tsb1-pipe", settings).problem, Flavour.GENERAL)
    expected = end_time / (SAFETY_FACTOR * deck.element_time_step())
    notes = said(exported(tmp_path / "a.inp", "tsb1-pipe", settings))
    assert f"step: {expected:.2g} increments of" in notes
    assert ("double=both" in notes) is double


def test_explicit_box_for_calculix_gets_a_stable_time_step(tmp_path: Path) -> None:
    settings = ["fem.element=full", "fem.end_time=0.001", "fem.method=explicit"]
    path = exported(tmp_path / "a.inp", "cantilever", settings, flavour="calculix")
    cards = cards_of(path)
    assert cards["ELEMENT"].parameters["TYPE"] == "C3D8"
    assert 0 < float(cards["DYNAMIC"].data[0].split(",")[0]) < 1e-5


def test_heading_counts_the_elements_and_says_how_their_error_is_learnt(tmp_path: Path) -> None:
    path = exported(tmp_path / "a.inp", "tsb1-pipe", COARSE, flavour="standard")
    blocks = load_case("tsb1-pipe", COARSE).problem.blocks
    count = sum(blocks.shape(b).mesh.n_elements for b in range(blocks.n_blocks))
    assert f"mesh: {count} C3D8I" in said(path)
    assert "`tubelock deck FILE --run`" in said(path)


# ---------------------------------------------------------------------------------------------
# Bad input


def test_a_truncated_deck_leaves_nothing_behind(tubelock) -> None:
    tubelock("export", "tsb1-pipe", *SMALL, "-o", "a.inp")
    text = Path("a.inp").read_text()
    Path("a.inp").write_text(text[: len(text) // 3])
    Path("b.inp").write_text("an earlier file")
    status, out, err = tubelock("deck", "a.inp", "--write", "b.inp", "--json", "b.json")
    assert status == 2
    assert out == ""
    assert re.search(r"a\.inp: line \d+: ", err)
    assert Path("b.inp").read_text() == "an earlier file"
    assert {p.name for p in Path().iterdir()} == {"a.inp", "b.inp"}


def test_meshes_alone_are_no_decks(tubelock) -> None:
    Path("a.inp").write_text("*Node\n1, 0., 0., 0.\n** a comment\n*Material, name=A\n")
    status, _, err = tubelock("deck", "a.inp")
    assert status == 2
    assert "line 4: the file ends without a *Step" in err
    Path("b.inp").write_bytes(b"*Heading\ntubelock 0, scene \xff\xfe\n")
    assert tubelock("deck", "b.inp")[0] == 2
