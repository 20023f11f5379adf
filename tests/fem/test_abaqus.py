"""Input decks for Abaqus: grammar, what they say, and reading back without loss."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fem import (
    CoulombFriction,
    ElementType,
    Explicit,
    ExponentialLaw,
    LinearPenalty,
    Material,
    Problem,
)
from fem.decks.deck import Deck, Flavour
from fem.decks.keywords import NUMBER_LENGTH, DeckError, label, real
from fem.decks.placement import canonical, canonical_axis_angle, rotation_matrix
from fem.decks.problem import deck_lines, problem_deck
from fem.decks.read.cards import Card, read_cards
from fem.decks.read.deck import deck_of_lines
from fem.decks.read.model import damping_of_step
from fem.problem import Frames, Motion
from fem.system.build import block_load_forces
from fem.system.effects import BulkViscosity, RayleighDamping
from geometry import Assembly
from geometry.block import box_block
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import LoadCase, PressureLoad, TractionLoad, named_load
from geometry.mesh import HEX_FACES
from geometry.parts.regions import HeldFace
from tests.support.blocks import random_rotation, tsb
from tests.support.fem_problems import loaded_nodes

pytestmark = pytest.mark.quick

CONCRETE = Material(density=2.4e-9, young_modulus=33_000.0, poisson_ratio=0.2)
EXPLICIT = Explicit(end_time=0.5, ramp_time=0.1, safety_factor=0.9, damping="none")


@pytest.fixture(scope="module")
def tube() -> Assembly:
    return canonical(SineTube(tsb(), SineBlockDivisions(12, 2, 2), 2).build())


def tube_deck(
    tube: Assembly,
    case: str = "pipe",
    *,
    as_printed: bool = False,
    flavour: Flavour = Flavour.GENERAL,
    method: Explicit = EXPLICIT,
    **changes,
) -> Deck:
    load = named_load(case, 0.01, as_printed=as_printed).on(tube)
    problem = Problem(tube, load, CONCRETE, **changes)
    return problem_deck(problem, flavour, method if flavour is Flavour.GENERAL else None)


def box_deck(*, flavour: Flavour = Flavour.GENERAL, **changes) -> Deck:
    boxes = Assembly(
        name="boxes",
        shapes=(box_block((30.0, 20.0, 10.0), (3, 2, 1)),),
        shape_of=np.zeros(2, dtype=np.int64),
        rotations=np.array([np.eye(3), random_rotation(4)]),
        translations=np.array([[0.0, 0.0, 0.0], [0.1, 100.0 / 3.0, -2e-7]]),
        layer=np.zeros(2, dtype=np.int64),
        fixed=np.zeros(2, dtype=np.bool_),
        unmatched_allowed=True,
    )
    loads = (
        PressureLoad(np.array([0, 1]), "x+", -0.3),
        TractionLoad(np.array([1]), "y+", np.array([0.0, 1.0 / 3.0, -2e-5])),
    )
    held = (HeldFace(0, "x-"), HeldFace(1, "z+", np.eye(3)[1:]))
    options = {
        "element": ElementType.REDUCED,
        "gravity": np.array([0.0, 1e-3, -9810.0]),
        "check_blocks": False,
        **changes,
    }
    problem = Problem(
        boxes, LoadCase(boxes, "boxes", loads, boxes.fixed, held=held), CONCRETE, **options
    )
    method = Explicit(
        end_time=1e-3,
        time_step=1e-6,
        ramp_time=0.0,
        damping="none",
        rayleigh=RayleighDamping(3.0),
        bulk_viscosity=BulkViscosity(0.06, 1.2),
    )
    notes = "one, with a comma", "two: with a colon"
    return problem_deck(
        problem, flavour, method if flavour is Flavour.GENERAL else None, notes=notes
    )


def text_of(deck: Deck) -> list[str]:
    return list(deck_lines(deck))


# ---------------------------------------------------------------------------------------------
# Numbers, labels, placements


@given(st.floats(min_value=-1e300, max_value=1e300))
def test_numbers_fit_keep_their_value_and_are_stable(value: float) -> None:
    """20 characters hold 13 digits besides sign, point and exponent: 5e-14 off at most."""
    text = real(value)
    assert len(text) <= NUMBER_LENGTH
    assert "." in text
    assert float(text) == pytest.approx(value, rel=5e-13, abs=0.0)
    assert real(float(text)) == text
    if len(repr(value)) <= NUMBER_LENGTH - 1:
        assert float(text) == value


def test_numbers_that_are_none_are_refused() -> None:
    for value in (float("nan"), float("inf"), -float("inf")):
        with pytest.raises(DeckError, match="finite"):
            real(value)


def test_labels_are_labels_and_differ() -> None:
    labels = [label(name) for name in ("inner", "sine-block", "x-", "x+", "z+", "edge_0")]
    assert all(re.fullmatch(r"[A-Z][A-Z0-9_-]*", text) for text in labels)
    assert len(set(labels)) == len(labels)
    for name in ("", "2d", "a b", "Inner", "ä", "a" * 81):
        with pytest.raises(DeckError, match="expected lower-case"):
            label(name)


@pytest.mark.parametrize("seed", range(20))
def test_rotations_survive_writing_and_reading(seed: int) -> None:
    """14 digits of axis and angle: 1e-13 in the matrix; then nothing changes any more."""
    rotation = random_rotation(seed)
    axis, degrees = canonical_axis_angle(rotation)
    matrix = rotation_matrix(axis, degrees)
    assert np.abs(matrix - rotation).max() < 1e-13
    again, degrees_again = canonical_axis_angle(matrix)
    assert (again == axis).all()
    assert degrees_again == degrees


def test_right_angles_are_exact() -> None:
    quarter = rotation_matrix(np.array([0.0, 0.0, 1.0]), 90.0)
    assert (quarter == np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])).all()
    assert canonical_axis_angle(quarter)[1] == 90.0


# ---------------------------------------------------------------------------------------------
# Grammar


PAIRS = {"flavour": Flavour.STANDARD}
#: Decks of a tube, or of boxes.
DECKS: dict[str, Callable[[Assembly], Deck]] = {
    "pipe": tube_deck,
    "pairs": lambda tube: tube_deck(tube, **PAIRS),
    "friction": lambda tube: tube_deck(tube, friction=CoulombFriction(0.01, 500.0)),
    "shaft": lambda tube: tube_deck(tube, "shaft"),
    "nodal shaft": lambda tube: tube_deck(tube, "shaft", **PAIRS),
    "shaft as printed": lambda tube: tube_deck(tube, "shaft", as_printed=True),
    "beam": lambda tube: tube_deck(tube, "beam"),
    "no cap": lambda tube: tube_deck(tube, law=ExponentialLaw(1e-3, 1e-4, np.inf)),
    "pairs, cap": lambda tube: tube_deck(tube, **PAIRS, law=ExponentialLaw(1e-3, 1e-4, 77.0)),
    "pillar": lambda tube: tube_deck(tube, "pillar", law=LinearPenalty(123.4)),
    "spacing": lambda tube: tube_deck(tube, spacing=0.03),
    "pairs, clearance": lambda tube: tube_deck(tube, **PAIRS, clearance=0.02, spacing=0.03),
    "elastic frame": lambda tube: tube_deck(tube, frames=Frames.DEFORMABLE),
    "sliding": lambda tube: tube_deck(tube, **PAIRS, finite_sliding=True),
    "boxes": lambda _: box_deck(),
    "static boxes": lambda _: box_deck(
        flavour=Flavour.STANDARD, gravity=None, element=ElementType.B_BAR
    ),
}


NAMED_BY = {
    "MATERIAL": "MATERIAL",
    "AMPLITUDE": "AMPLITUDE",
    "SURFACE INTERACTION": "INTERACTION",
    "ORIENTATION": "ORIENTATION",
    "SECTION CONTROLS": "CONTROLS",
}


def definitions(cards: list[Card]) -> list[tuple[str, str]]:
    """Kind and name of everything a deck defines, sets and surfaces with their part."""
    part, found = "", []
    for card in cards:
        name = card.parameters.get("NAME", "")
        if card.keyword in {"PART", "END PART"}:
            part = name
        if card.keyword in {"NSET", "ELSET"}:
            found.append((card.keyword, f"{part}:{card.parameters[card.keyword]}"))
        elif card.keyword == "SURFACE":
            found.append(("SURFACE", f"{part}:{name}"))
        elif card.keyword in {"PART", "INSTANCE", *NAMED_BY}:
            found.append((card.keyword, name))
    return found


def references(cards: list[Card]) -> list[tuple[str, str]]:
    """Kind and name of everything a deck refers to."""
    part, found = "", []
    part_of = {c.parameters["NAME"]: c.parameters["PART"] for c in cards if c.keyword == "INSTANCE"}
    kinds = {"BOUNDARY": "NSET", "INITIAL CONDITIONS": "NSET", "DLOAD": "ELSET", "ELSET": "ELSET"}
    kinds |= {"DSLOAD": "SURFACE", "CONTACT PAIR": "SURFACE"}
    for card in cards:
        if card.keyword in {"PART", "END PART"}:
            part = card.parameters.get("NAME", "")
        for kind, parameter in NAMED_BY.items():
            if card.keyword != kind and parameter in card.parameters:
                found.append((kind, card.parameters[parameter]))
        rows = [row for _, row in card.rows()] if card.keyword != "HEADING" else []
        if card.keyword == "SURFACE":
            found += [("ELSET", f"{part}:{row[0]}") for row in rows]
        elif card.keyword == "CONTACT PROPERTY ASSIGNMENT":
            found += [("SURFACE INTERACTION", row[2]) for row in rows]
        elif card.keyword in kinds:
            entries = [e.split(".") for row in rows for e in row if e.split(".")[0] in part_of]
            found += [(kinds[card.keyword], f"{part_of[i]}:{name}") for i, name in entries]
    return found


@pytest.mark.parametrize("name", DECKS)
def test_grammar(tube, name) -> None:
    """Lines, labels and lists keep the input rules; every name that is used is defined once."""
    lines = text_of(DECKS[name](tube))
    assert all(len(line) <= 132 and line.isascii() for line in lines)
    cards = read_cards(lines)
    assert cards[-1].keyword == "END STEP"
    defined = definitions(cards)
    assert len(set(defined)) == len(defined)
    for _, label_ in defined:
        word = label_.rpartition(":")[2]
        assert re.fullmatch(r"[A-Z][A-Z0-9_-]{0,79}", word)
    used = references(cards)
    assert {"ELSET", "MATERIAL"} <= {kind for kind, _ in used}
    assert set(used) <= set(defined)
    for card in cards:
        if card.keyword in {"NODE", "ELEMENT"}:
            numbers = [int(row[0]) for _, row in card.rows()]
            assert numbers == list(range(1, len(numbers) + 1))
        if card.keyword in {"NSET", "ELSET"}:
            assert all(len(row) <= 16 for _, row in card.rows())
        if card.keyword in {"NODE", "INSTANCE"}:
            assert all(len(e) <= NUMBER_LENGTH for _, row in card.rows() for e in row)
    assert {"DSLOAD", "DLOAD", "CLOAD"} & {card.keyword for card in cards}


def test_abaqus_numbers_the_sides_as_we_do() -> None:
    """S1 to S6 of C3D8 by corner numbers, from the element library of the Abaqus manual."""
    manual = ["1234", "5876", "1562", "2673", "3784", "4851"]
    for corners, face in zip(manual, HEX_FACES, strict=True):
        assert {int(c) - 1 for c in corners} == set(face.tolist())


def test_nodal_forces_of_the_printed_shaft_have_the_resultant_of_the_scene(tube) -> None:
    """Integrated over the bilinear patches, as the solver does, along the arc of each facet. Those
    of other loads are read back: `test_deck_round_trip.py`."""
    deck = tube_deck(tube, "shaft", as_printed=True)
    force = {name: np.zeros(3) for name in deck.labels}
    for card in read_cards(text_of(deck)):
        for _, row in card.rows() if card.keyword == "CLOAD" else ():
            force[row[0].split(".")[0]][int(row[1]) - 1] += float(row[2])
    case = named_load("shaft", 0.01, as_printed=True).on(tube)
    for block in range(tube.n_blocks):
        forces, size = block_load_forces(tube, case, block), np.linalg.norm(case.facet_forces)
        wanted = 0.0 if forces is None else tube.rotations[block] @ forces.sum(axis=0)
        assert np.abs(force[deck.labels[block]] - wanted).max() < 1e-9 * size


# ---------------------------------------------------------------------------------------------
# Models of imported decks


def test_an_imported_deck_gives_the_same_explicit_model() -> None:
    deck = box_deck()
    system = deck.problem.system
    read = deck_of_lines(text_of(deck))
    again = read.problem().system
    a, b = (loaded_nodes(m)[1].sum(axis=0) for m in (system, again))
    assert np.abs(a - b).max() < 1e-12 * np.abs(a).max()
    assert damping_of_step(read.model, read.steps[0]).rayleigh == deck.effects.rayleigh
    assert (again.gravity == system.gravity).all()


# ---------------------------------------------------------------------------------------------
# Bad input


def test_every_truncation_is_noticed(tube) -> None:
    """Cut anywhere, the error names a line of the file; nothing is returned."""
    lines = text_of(tube_deck(tube, flavour=Flavour.STANDARD))
    for end in range(3, len(lines) - 1, 37):
        with pytest.raises(DeckError, match=r"^line \d+: "):
            deck_of_lines(lines[:end])
    cut = [*lines[:20], lines[20][: len(lines[20]) // 2]]
    with pytest.raises(DeckError, match=r"^line \d+: .*(truncated|entries|number)"):
        deck_of_lines(cut)


def test_a_removed_contact_pair_is_named(tube) -> None:
    """Its surfaces are in no other pair: the blocks pass through each other there, as in Abaqus."""
    lines = text_of(tube_deck(tube, flavour=Flavour.STANDARD))
    first = next(k for k, line in enumerate(lines) if line.startswith("*Contact Pair"))
    whole, less = deck_of_lines(lines), deck_of_lines(lines[:first] + lines[first + 2 :])
    n_contacts = [deck.problem().system.surfaces.n_facets for deck in (whole, less)]
    assert n_contacts[1] < n_contacts[0]
    assert not any("no *Contact Pair has both" in note for note in whole.model.notes)
    assert any("no *Contact Pair has both" in note for note in less.model.notes)


@pytest.mark.parametrize("spin", [0.0, 1e-3, 3.0])
def test_bodies_that_move_at_the_start_do_so_in_the_deck(spin: float) -> None:
    """Without rotation by the velocities of nodes; else about an axis through each centre."""
    axis = np.array([0.0, 0.6, 0.8])
    deck = box_deck(motion=Motion(np.array([1.5, 0.0, -2.0]), spin * axis))
    (at,) = (k for k, line in enumerate(text_of(deck)) if line.startswith("*Initial Conditions"))
    kind, *lines = text_of(deck)[at : at + 5]
    if spin == 0.0:
        assert kind.endswith("type=VELOCITY")
        said = [line.split(", ")[1:] for line in lines[: 2 * len(deck.sets)]]
        assert said == [["1", "1.5"], ["3", "-2.0"]] * len(deck.sets)
        return
    assert kind.endswith("type=ROTATING VELOCITY")
    for block, (moved, ends) in enumerate(zip(lines[::2], lines[1::2], strict=True)):
        numbers = [float(word) for word in moved.split(",")[1:]]
        assert numbers == pytest.approx([spin, 1.5, 0.0, -2.0], rel=1e-12)
        start, end = np.array([float(word) for word in ends.split(",")]).reshape(2, 3)
        assert start == pytest.approx(deck.nodes(block).mean(axis=0), abs=1e-9)
        assert (end - start) / np.linalg.norm(end - start) == pytest.approx(axis, abs=1e-9)
