"""Input decks of other programs: read, checked, solved, written again, rejected by their line."""

from __future__ import annotations

import contextlib
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import fem
from fem import ElementType, Static, read_deck
from fem.accuracy.converge import AccuracyError
from fem.decks.keywords import DeckError
from fem.decks.read.cards import read_cards
from fem.decks.read.deck import InputDeck, deck_of_lines
from fem.decks.read.words import IDLE, READ, Dialect
from fem.problem import ProblemError
from fem.static.solve import static_state
from fem.system.build import curved
from geometry.errors import RefusedError
from geometry.mesh import HEX_EDGES
from geometry.parts.regions import region_nodes
from tests.support.answers import PLAIN
from tests.support.ccx import calculix_available, run_calculix
from tests.support.coarse_tubes import coarse
from tests.support.commands import answered
from tests.support.cubes_deck import CUBES, changed, changed_lines
from tests.support.decks import exported, solved, written_again
from tests.support.fem_problems import loaded_nodes
from tests.support.press_fit import MU, block, block_pressure
from tests.verification.macneal_harder import beam_lines, solved_lines, tip_moves

pytestmark = pytest.mark.quick

COARSE = list(coarse(2, 2, 2))


def top_moves(deck: InputDeck) -> float:
    """Displacement of the loaded face along z [mm]."""
    result = static_state(deck.problem().system)
    return float(min(moved[..., 2].min() for moved in result.displacements))


def test_two_cubes_shorten_as_springs_in_series() -> None:
    """Two bars p L / E and the contact p / k: 2 / 1000 + 2 / 1000 + 2 / 500 mm."""
    deck = deck_of_lines(CUBES)
    assert deck.dialect is Dialect.CALCULIX
    assert deck.without_influence == ("*Node Print",)
    deck.validate()
    assert top_moves(deck) == pytest.approx(-0.008, rel=1e-9)


def test_spelling_does_not_matter(tmp_path: Path) -> None:
    """Case, blanks, comments, continued keyword lines and included files are the same deck."""
    first = CUBES.index("*Element, type=C3D8, elset=LOWER")
    (tmp_path / "mesh.inc").write_text("\n".join(CUBES[:first]))
    rest = [line.lower().replace(",", " ,  ") for line in CUBES[first:]]
    rest = [line.replace("*solid section", "*SolidSection") for line in rest]
    spelt = ["** a comment", "*INCLUDE, INPUT=mesh.inc", "", *rest]
    where = spelt.index("*contact pair ,   interaction=i ,   type=surface to surface")
    spelt[where : where + 1] = ["*contact  pair,", "interaction = i, type=surface to surface"]
    (tmp_path / "cubes.inp").write_text("\r\n".join(spelt))
    assert top_moves(read_deck(tmp_path / "cubes.inp")) == top_moves(deck_of_lines(CUBES))


def test_parts_and_instances_are_the_flat_deck() -> None:
    """The upper cube as an instance of the lower one, turned about its own axis."""
    first, last = CUBES.index("11, 0, 0, 1"), CUBES.index("*Element, type=C3D8, elset=UPPER")
    element = CUBES.index("*Element, type=C3D8, elset=LOWER")
    part = [*CUBES[:first], *CUBES[element:last], "*Solid Section, elset=LOWER, material=M"]
    start = CUBES.index("*Material, name=M")
    lines = [
        *("*Heading", "*Part, name=CUBE", *part, "*End Part", "*Assembly, name=A"),
        *("*Instance, name=LOW, part=CUBE", "*End Instance"),
        *("*Instance, name=UP, part=CUBE", "0., 0., 1."),
        *("0.5, 0.5, 0., 0.5, 0.5, 1., 90.", "*End Instance"),
        *("*Nset, nset=FOOT, instance=LOW", "1, 2, 3, 4"),
        *("*Elset, elset=LOWS, instance=LOW", "1", "*Surface, name=TOP", "LOWS, S2"),
        *("*Elset, elset=UPS, instance=UP", "1", "*Surface, name=UNDER", "UPS, S1"),
        *("*Nset, nset=CORNER, instance=UP", "1", "*Nset, nset=NEXT, instance=UP", "3"),
        *("*End Assembly", *CUBES[start:]),
    ]
    text = "\n".join(lines).replace("*Solid Section, elset=UPPER, material=M\n", "")
    head, _, tail = text.partition("*End Assembly")
    tail = tail.replace("*Solid Section, elset=LOWER, material=M\n", "")
    tail = tail.replace("NEXT, 2", "NEXT, 1, 2")
    deck = deck_of_lines(
        (head + "*End Assembly" + tail.replace("UPPER,", "UP.LOWER,")).splitlines()
    )
    assert deck.dialect is Dialect.ABAQUS
    problem = deck.problem()
    assert problem.element is ElementType.B_BAR
    assert problem.blocks.names == ("LOW", "UP")
    assert top_moves(deck) == pytest.approx(-0.008, rel=1e-9)


#: Cubes of 1e-10 t/mm³; a gravity of 1e10 mm/s² is then 1 N/mm³.
HEAVY = changed("*Elastic", "*Density\n1e-10\n*Elastic", changed("UPPER, P2, 2.", "{}", CUBES))


def top_under(rows: str, dialect: Dialect = Dialect.ABAQUS) -> float:
    """Displacement of the top of heavy cubes under rows of *Dload [mm]."""
    return top_moves(deck_of_lines(changed("{}", rows, HEAVY), dialect=dialect))


def test_gravity_without_a_set_is_that_of_all_blocks() -> None:
    """What CAE writes for the whole model; CalculiX needs a set."""
    along = "GRAV, 1e10, 0., 0., -1."
    both = top_under(f"UPPER, {along}\nLOWER, {along}")
    assert top_under(f", {along}") == pytest.approx(both, rel=1e-9)
    # Columns of ρ g L² / 2 E each, the lower under the weight of the other, and the joint: W / k.
    assert both == pytest.approx(-(0.5 + 0.5 + 1.0) * 1e-3 - 1.0 / 500.0, rel=1e-6)
    with pytest.raises(DeckError, match=r"\*Dload: got ''; expected a set of elements"):
        top_under(f", {along}", Dialect.CALCULIX)


@pytest.mark.parametrize("block", ["UPPER", "LOWER"])
def test_gravity_of_some_blocks_is_their_force_per_volume(block: str) -> None:
    weight = top_under(f"{block}, GRAV, 1e10, 0., 0., -1.\nUPPER, P2, 2.")
    force = top_under(f"{block}, BZ, -1.\nUPPER, P2, 2.")
    assert weight == pytest.approx(force, rel=1e-12)
    assert weight < -0.008


def test_gravity_of_a_fixed_block_does_not_matter() -> None:
    """The lower cube is held at all nodes: gravity of the other is that of all that move."""
    held = changed("FOOT, 1, 3", "FOOT, 1, 3\nHEAD, 1, 3", HEAVY)
    held = changed("*Nset, nset=FOOT", "*Nset, nset=HEAD\n5, 6, 7, 8\n*Nset, nset=FOOT", held)
    lines = changed("{}", "UPPER, GRAV, 1e10, 0., 0., -1.", held)
    problem = deck_of_lines(lines).problem()
    assert problem.gravity == pytest.approx([0.0, 0.0, -1e10])
    assert problem.load_case.body_wrenches is None


def test_what_has_no_influence_is_named() -> None:
    """An orientation of an isotropic material, and its expansion: no temperature is read."""
    axes = "*Orientation, name=O, system=RECTANGULAR\n0., 1., 0., 1., 0., 0.\n*Material"
    lines = changed("*Material", axes, changed("elset=UPPER, m", "elset=UPPER, orientation=O, m"))
    deck = deck_of_lines(changed("*Elastic", "*Expansion\n1e-5,\n*Elastic", lines))
    assert top_moves(deck) == top_moves(deck_of_lines(CUBES))
    assert {"*Solid Section, orientation", "*Expansion"} <= set(deck.without_influence)


def test_forces_on_nodes_count_once_beside_pressures_that_turn() -> None:
    both = changed("UPPER, P2, 2.", "UPPER, P2, 2.\n*Cload\n15, 3, -1.")
    for lines in (both, changed("*Step\n", "*Step, nlgeom\n", both)):
        total = loaded_nodes(deck_of_lines(lines).problem().system)[1].sum(axis=0)
        assert total == pytest.approx([0.0, 0.0, -3.0], abs=1e-12)


@pytest.mark.parametrize(
    ("shape", "kind", "coarse"),
    [("regular", "C3D8I", False), ("trapezoids", "C3D8I", True), ("regular", "C3D8", True)],
)
def test_a_mesh_that_cannot_bend_is_named(shape, kind, coarse, tmp_path: Path) -> None:
    """Six elements of MacNeal and Harder: trapezoids carry 5 % of the bending, C3D8 9 %."""
    path = tmp_path / "beam.inp"
    path.write_text("\n".join([*beam_lines(shape, kind), ""]), "ascii")
    data, _ = answered("deck", str(path), "--run")
    assert any("mesh: too coarse" in note for note in data["remarks"]) is coarse


def test_a_slender_body_ends_at_the_round_off_of_its_stiffness() -> None:
    """C3D20 out of plane, 0.1 of 6 mm thick: the residual is above 1e-8, the answer within 3 %."""
    lines = beam_lines("regular", "C3D20", 3)
    moved, _, _ = solved_lines(lines, judged=False)
    assert tip_moves(lines, moved, 3) == pytest.approx(0.4321, rel=0.03)


def test_a_clearance_is_closed_first() -> None:
    """The upper cube comes down by it, and everything is as without."""
    clearance = "*Clearance, master=TOP, slave=UNDER, value={}\n*Boundary"
    lines = changed("*Boundary", clearance.format(0.001))
    assert top_moves(deck_of_lines(lines)) == pytest.approx(-0.009, rel=1e-7)
    with pytest.raises(DeckError, match=r"\[0.001, 0.002\] mm in several pairs is not read"):
        deck_of_lines(changed("*Boundary", clearance.format(0.002), lines)).problem()


def test_a_minimum_increment_for_which_calculix_scales_masses_is_rejected() -> None:
    """A least increment without DIRECT."""
    lines = changed("*Elastic", "*Density\n1e-10\n*Elastic")
    start = lines.index("*Contact Pair, interaction=I, type=SURFACE TO SURFACE")
    del lines[start : start + 2]
    for words, least in (("Explicit", ""), ("Explicit, direct", "3e-9")):
        deck_of_lines(
            changed("*Static", f"*Dynamic, {words}\n1e-8, 1e-5, {least}", lines)
        ).problem()
    with pytest.raises(DeckError, match="for which masses are scaled, is not read"):
        deck_of_lines(changed("*Static", "*Dynamic, Explicit\n1e-8, 1e-5, 3e-9", lines)).problem()


def test_large_rotations_that_are_solved_linearly_are_named(tmp_path: Path) -> None:
    """A bar that turns by more than 0.02 rad has left the range of a linear answer."""
    start = CUBES.index("*Element, type=C3D8, elset=UPPER")
    lines = changed("*Step", "*Step, nlgeom", CUBES[:start] + CUBES[start + 2 :])
    text = "\n".join(lines).replace("*Solid Section, elset=UPPER, material=M\n", "")
    head, _, tail = text.partition("*Surface, name=UNDER")
    tail = tail.partition("*Boundary")[2].replace("CORNER, 1, 2\nNEXT, 2\n", "")
    tail = tail.replace("UPPER, P2, 2.", "LOWER, P6, {}")
    material = "*Material, name=M\n*Elastic\n1000., 0.\n*Solid Section, elset=LOWER, material=M\n"
    turns = []
    for pressure, left in ((1.0, False), (50.0, True)):
        body = f"{head}{material}*Boundary{tail.format(pressure)}"
        (tmp_path / "bar.inp").write_text(body, "utf-8")
        data, _ = answered("deck", str(tmp_path / "bar.inp"), "--run")
        notes = data["remarks"]
        assert any("linear in rotations" in note for note in notes)
        turns.append(data["largest_rotation"])
        assert any("elements turn by" in note for note in notes) == left
    assert turns[1] == pytest.approx(50.0 * turns[0], rel=1e-6)  # small rotations are linear
    assert turns[1] > 0.02


def test_steps_follow_each_other() -> None:
    """Loads stay, are stated anew or go with op=NEW; without friction the last state counts."""
    second = "*End Step\n*Step\n*Static\n*Dload{}\n{}\n*End Step"
    added = changed("*End Step", second.format("", "UPPER, BZ, -1."))
    assert top_moves(deck_of_lines(added)) == pytest.approx(-0.0115, rel=1e-9)
    anew = changed("*End Step", second.format("", "UPPER, P2, 1."))
    deck = deck_of_lines(anew)
    assert top_moves(deck) == pytest.approx(-0.004, rel=1e-9)
    assert any("end of step 2" in note for note in deck.model.notes)
    other = changed("*End Step", second.format(", op=NEW", "2, P2, 3."))
    assert top_moves(deck_of_lines(other)) == pytest.approx(-0.012, rel=1e-9)
    with pytest.raises(DeckError, match="shares members with a load of an earlier step"):
        deck_of_lines(changed("*End Step", second.format("", "2, P2, 3."))).problem()
    heavy = changed("UPPER, P2, 2.", "UPPER, BZ, -2.", other)
    with pytest.raises(DeckError, match="BZ that op=NEW of a later step ends is not read"):
        deck_of_lines(heavy).problem()


def rough_cubes() -> list[str]:
    """Cubes with friction that tilt freely: a pusher moves the upper one along x."""
    rough = changed("500.\n", "500.\n*Friction\n0.2, 5000.\n")
    rough = changed("nset=CORNER\n11\n*Nset, nset=NEXT\n12", "nset=BED\n11, 12, 13, 14", rough)
    rough = changed("*Surface, ", "*Nset, nset=PUSHER\n15, 18\n*Surface, ", rough)
    return changed("CORNER, 1, 2\nNEXT, 2", "BED, 2", rough)


def pushed(lines: list[str]) -> tuple[float, fem.Answer]:
    """Force of friction along x on the lower cube [N], by the table of the joint.

    The joint tilts, so the force of its pressure has a share of the force along x. Both together
    are what the pusher needs.
    """
    deck = deck_of_lines(lines)
    answer = solved(deck)
    sides = [of["force"][0] for name, of in answer.report["reactions"].items() if name != "foot"]
    along = float(answer.contacts["force"][:, 0].sum())
    assert sum(sides) + along == pytest.approx(0.0, abs=1e-6)
    state = answer.details.contact_state
    return -float(state.point_areas @ state.point_frictions[:, 0]), answer


#: An edge of the upper cube moves along x by so much.
MOVE = "PUSHER, 1, 1, {}\n"


@pytest.mark.slow
def test_loads_and_then_motions_slide_with_friction() -> None:
    """Pressed with 2 MPa, then moved so far that the joint slides: μ p A = 0.4 N, and back.

    Loads and motions at once, in one step after the other, and by a table that turns back.
    """
    more = "*End Step\n*Step\n*Static\n*Boundary\n{}*End Step"
    once = changed("*Dload", f"*Boundary\n{MOVE.format(0.02)}*Dload", rough_cubes())
    there = changed("*End Step", more.format(MOVE.format(0.02)), rough_cubes())
    last = "\n".join(there).removesuffix("*End Step") + more.format(MOVE.format(-0.02))
    bent = changed("*Step", "*Amplitude, name=A\n0., 0., 0.4, 1., 1., -1.\n*Step", rough_cubes())
    turned = more.replace("*Boundary", "*Boundary, amplitude=A").format(MOVE.format(0.02))
    table = changed("*End Step", turned, bent)
    for lines, force in ((once, 0.4), (last.splitlines(), -0.4), (table, -0.4)):
        assert pushed(lines)[0] == pytest.approx(force, rel=2e-3)
    both = f"*Boundary, amplitude=A\n{MOVE.format(0.02)}*Dload"
    with pytest.raises(DeckError, match="amplitudes that bend beside loads without, is not read"):
        deck_of_lines(changed("*Dload", both, bent)).problem()


def test_a_block_is_pushed_out_of_its_fit() -> None:
    """Interference δ / (w / E + 1 / k) in the first step, μ p A along the wall in the second.

    The deck that is written again has both steps.
    """
    deck = deck_of_lines(block(6))
    again = deck_of_lines(written_again(deck))
    assert [len(one.steps) for one in (deck, again)] == [2, 2]
    for one in (deck, again):
        (curve,) = solved(one).report["motions"]
        assert abs(curve["force"][-1]) == pytest.approx(MU * block_pressure() * 16.0, rel=1e-6)


def test_a_state_after_another_is_one_of_the_same_blocks() -> None:
    """Static, on one mesh: what cannot go on from another state is named."""
    problem = deck_of_lines(CUBES).problem()
    with pytest.raises(ProblemError, match="after: got a statement that differs in clearance"):
        replace(problem, after=replace(problem, clearance=0.1))
    with pytest.raises(ProblemError, match="after: got a statement that differs in materials"):
        replace(problem, after=replace(problem, material=fem.concrete, check_units=False))
    later = replace(problem, after=problem)
    with pytest.raises(ProblemError, match="after: explicit runs begin at rest"):
        fem.solve_explicit(later)
    with pytest.raises(AccuracyError, match="a problem after another has no error bars"):
        fem.solve_static(later, Static(mesh="converged"))
    one, two = (fem.solve_static(p, PLAIN) for p in (problem, later))
    assert two["max_displacement"].value == pytest.approx(one["max_displacement"].value, rel=1e-9)


def test_a_wall_with_a_corner_in_the_block_is_named() -> None:
    """Its hexahedron has a flat tetrahedron, in which no point lies."""
    deck = deck_of_lines(changed("38, 5.0, -1.0, 5.0", "38", block(6)))
    with pytest.raises(RefusedError, match=r"blocks 0 .* and 1 .* overlap by"):
        deck.problem()


def test_words_of_symmetry_hold_the_components_of_their_planes() -> None:
    lines = changed("FOOT, 1, 3", "FOOT, ZSYMM\nFIRST, XSYMM\nFIRST, YSYMM\nOTHER, YSYMM")
    lines = changed("*Surface, ", "*Nset, nset=FIRST\n1\n*Nset, nset=OTHER\n2\n*Surface, ", lines)
    assert top_moves(deck_of_lines(lines)) == pytest.approx(-0.008, rel=1e-9)


@pytest.mark.parametrize("kind", ["C3D4", "C3D10"])
def test_tetrahedra_fill_the_same_cube(kind) -> None:
    """A cube of six tetrahedra, split into hexahedra: its volume, and uniform stress exactly."""
    corners = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    tets = [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]
    places = [tuple(map(float, corner)) for corner in corners]
    rows = []
    for tet in tets:
        row = list(tet)
        if kind == "C3D10":
            for a, b in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)):
                middle = tuple(map(float, (corners[tet[a]] + corners[tet[b]]) / 2))
                if middle not in places:
                    places.append(middle)
                row.append(places.index(middle))
        rows.append(row)
    foot = [str(k + 1) for k, place in enumerate(places) if place[2] == 0.0]
    lines = ["*Node", *(f"{k + 1}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(places))]
    lines += [f"*Element, type={kind}, elset=E"]
    lines += [f"{k + 1}, {', '.join(str(n + 1) for n in row)}" for k, row in enumerate(rows)]
    lines += ["*Nset, nset=FOOT", ", ".join(foot), "*Elset, elset=TOPS", "3, 4, 5"]
    lines += ["*Material, name=M", "*Elastic", "1000., 0.", "*Solid Section, elset=E, material=M"]
    lines += ["*Nset, nset=FIRST", "1", "*Nset, nset=OTHER", "2"]
    # Node 1 is held along more directions than the rest of the foot, which is a whole face still.
    lines += ["*Boundary", "FOOT, 3", "FIRST, 1, 2", "OTHER, 2", "*Step", "*Static", "*Dload"]
    # Elements 0 3 7 6, 0 7 4 6 and 0 4 5 6: their sides on z = 1 are 7 6 (none), 7 4 6 and 4 5 6.
    lines += ["4, P3, 2.", "5, P3, 2.", "*End Step"]
    deck = deck_of_lines(lines)
    problem = deck.problem()
    assert problem.blocks.volumes.sum() == pytest.approx(1.0, rel=1e-12)
    assert any("split into four hexahedra" in note for note in deck.model.notes)
    assert top_moves(deck) == pytest.approx(-0.002, rel=1e-9)


def test_nodes_along_an_edge_are_that_edge_on_other_meshes() -> None:
    """A curved element held along one edge: its three nodes, and all of those of other degrees."""
    corners = [(x, y, z) for z in (0, 2) for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))]
    places = corners + [
        tuple((a + b) // 2 for a, b in zip(corners[i], corners[j], strict=True))
        for i, j in HEX_EDGES.tolist()
    ]
    lines = ["*Node", *(f"{k + 1}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(places))]
    lines += ["*Element, type=C3D20, elset=E", ", ".join(map(str, (1, *range(1, 21))))]
    edge = [str(k + 1) for k, (x, _, z) in enumerate(places) if x == z == 0]
    lines += ["*Nset, nset=EDGE", ", ".join(edge), "*Material, name=M", "*Elastic", "1000., 0."]
    lines += ["*Solid Section, elset=E, material=M", "*Boundary", "EDGE, 1, 3"]
    lines += ["*Step", "*Static", "*Dload", "1, P2, 2.", "*End Step"]
    problem = deck_of_lines(lines).problem()
    (held,) = problem.load_case.held
    for degree in (1, 2, 3):
        blocks = curved(problem.blocks, degree)
        assert len(region_nodes(blocks, 0, held.face)) == degree + 1
    lines[lines.index(", ".join(edge))] = ", ".join(edge[:2])
    with pytest.raises(DeckError, match="edge, nodes of no whole faces or edges"):
        deck_of_lines(lines).problem()


@pytest.mark.skipif(not calculix_available(), reason="CalculiX (ccx) is not installed")
def test_calculix_has_one_answer_to_a_deck_and_to_the_one_written_again(tmp_path: Path) -> None:
    """Seven digits are printed; both are off ours by the tension of open contact springs, 1e-3."""
    (tmp_path / "cubes.inp").write_text("\n".join([*CUBES, ""]))
    with (tmp_path / "again.inp").open("w") as file:
        file.writelines(f"{line}\n" for line in written_again(deck_of_lines(CUBES)))
    moved = [run_calculix(tmp_path / name).displacements for name in ("cubes.inp", "again.inp")]
    first, second = (float(u[:, 2].min()) for u in moved)
    assert first == pytest.approx(second, rel=1e-5)
    assert first == pytest.approx(-0.008, rel=1e-3)


def test_words_mean_other_things_in_the_other_dialect() -> None:
    """EXPONENTIAL: p0 at contact in both; a hundredth of it at -c0 in CalculiX, none in Abaqus."""
    lines = changed("LINEAR\n500.", "EXPONENTIAL\n0.01, 2.0")
    ours, theirs = (
        deck_of_lines(lines, dialect=dialect).problem().contact_law
        for dialect in (Dialect.ABAQUS, Dialect.CALCULIX)
    )
    places = np.array([-0.01, 0.0])
    assert ours.pressure(places) == pytest.approx([0.0, 2.0])
    assert theirs.pressure(places) == pytest.approx([0.02, 2.0], rel=1e-3)
    rough = changed("500.\n", "500.\n*Friction\n0.2, 5000.\n")
    friction = deck_of_lines(rough).problem().coulomb
    assert friction is not None
    assert (friction.coefficient, friction.stick_stiffness) == (0.2, 5000.0)
    with pytest.raises(DeckError, match=r"\*Friction, with 2 numbers is not read"):
        deck_of_lines(rough, dialect=Dialect.ABAQUS).problem()
    hard = changed("LINEAR\n500.", "HARD")
    assert deck_of_lines(hard, dialect=Dialect.ABAQUS).problem().contact_law.stiffness_per_area
    with pytest.raises(DeckError, match="pressure-overclosure=HARD of 0 numbers is not read"):
        deck_of_lines(hard).problem()


def test_surfaces_that_touch_without_a_pair_are_rejected() -> None:
    """A third cube beside the upper one: its contact surface touches, its pair is missing."""
    more = "\n".join(f"{21 + k}, {x + 1}, {y}, {z}" for k, (x, y, z) in enumerate(BESIDE))
    lines = changed("*Element, type=C3D8, elset=LOWER", f"{more}\n*Element, type=C3D8, elset=LOWER")
    third = "*Element, type=C3D8, elset=THIRD\n3, 21, 22, 23, 24, 25, 26, 27, 28\n*Nset, nset=FOOT"
    lines = changed("*Nset, nset=FOOT", third, lines)
    lines = changed("UPPER, S1", "UPPER, S1\nUPPER, S4", lines)
    section = "*Solid Section, elset=THIRD, material=M\n*Surface, name=SIDE\nTHIRD, S6\n"
    lines = changed("*Surface Interaction", f"{section}*Surface Interaction", lines)
    lines = changed("*Boundary", "SIDE, TOP\n*Boundary", lines)
    with pytest.raises(DeckError, match=r"touch or nearly so, and no \*Contact Pair"):
        deck_of_lines(lines).problem()


BESIDE = [(x, y, z) for z in (1, 2) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
_LINES = written_again(deck_of_lines(CUBES))


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.sampled_from([CUBES, _LINES]), st.randoms(use_true_random=False))
def test_random_changes_raise_no_other_error(deck, source) -> None:
    """A line dropped, doubled, swapped or broken: a deck, or one line that says why not."""
    lines = changed_lines(deck, source)
    with contextlib.suppress(RefusedError):
        deck_of_lines(lines).validate()


def test_included_files_are_below_the_folder_of_the_deck(tmp_path: Path) -> None:
    """Another file, a device, a link and a pipe are one line, and nothing of them is read."""
    folder = tmp_path / "decks"
    (folder / "mesh").mkdir(parents=True)
    first = CUBES.index("*Element, type=C3D8, elset=LOWER")
    for place in (folder / "mesh" / "nodes.inc", tmp_path / "nodes.inc"):
        place.write_text("\n".join(CUBES[:first]))
    (folder / "link.inc").symlink_to(tmp_path / "nodes.inc")
    os.mkfifo(folder / "pipe.inc")
    with (folder / "huge.inc").open("wb") as file:
        file.truncate(1 << 31)  # a file of zeros that no disk holds

    def included(name: str) -> InputDeck:
        lines = [f"*Include, input={name}", *CUBES[first:], ""]
        (folder / "cubes.inp").write_text("\n".join(lines))
        return read_deck(folder / "cubes.inp")

    assert top_moves(included("mesh/nodes.inc")) == pytest.approx(-0.008, rel=1e-9)
    for name, why in {
        "../nodes.inc": "expected a file in the folder of the deck or below",
        str(tmp_path / "nodes.inc"): "expected a file in the folder of the deck or below",
        "link.inc": "expected a file in the folder of the deck or below",
        "/dev/zero": "is a pipe or a device",
        "pipe.inc": "is a pipe or a device",
        "mesh": "is a folder",
        "none.inc": "no such file",
        "huge.inc": "has 2 GiB; expected a deck of 1 GiB at most",
        "cubes.inp": "10 files deep",
    }.items():
        with pytest.raises(DeckError, match=rf"line 1: \*Include: .*{why}"):
            included(name)
    with pytest.raises(DeckError, match=r"d\.inp: no such file; expected a deck"):
        read_deck(tmp_path / "d.inp")
    assert read_cards(['*Part, name="A, B"'])[0].parameter("NAME") == "A, B"


def test_the_manual_lists_the_words_that_are_read() -> None:
    """One table: every keyword and parameter that is read or has no influence, and no others."""
    manual = Path("docs/tutorials/decks.md").read_text("utf-8")
    table = manual.partition("| keyword |")[2].partition("\n\n")[0]
    rows = [line.split("|")[1:-1] for line in table.splitlines()[2:]]
    listed = {
        name.strip(" `*").upper(): frozenset(re.findall(r"`([^`]+)`", parameters.upper()))
        for names, parameters, *_ in rows
        for name in names.split(",")
    }
    assert listed == {name: frozenset().union(*words) for name, words in READ.items()}
    idle = manual.partition("No influence: ")[2].partition(".")[0]
    assert {name.strip(" `*\n").upper() for name in idle.split(",")} == IDLE


@pytest.mark.parametrize("flavour", ["standard", "calculix", "general"])
def test_a_deck_written_again_keeps_names_and_angles(flavour: str, tmp_path: Path) -> None:
    """Blocks, surfaces, and the angle of facets in the heading are those of the export."""
    settings = [*COARSE, "mesh.radial=1"]
    path = exported(tmp_path / "tube.inp", "tsb1-pipe", settings, flavour=flavour)
    first, again = path.read_text().splitlines(), written_again(read_deck(path))

    def words(lines: list[str], start: str) -> set[str]:
        return {re.sub("-PATCH-.*", "", line) for line in lines if line.startswith(start)}

    for start in ("*Part", "*Instance", "*Surface, type", "*Nset", "*Element"):
        assert words(first, start) == words(again, start), start
    angles = [
        re.findall(r"here (\S+) rad", " ".join(lines).replace(" note:", ""))
        for lines in (first, again)
    ]
    assert angles[0] == angles[1]
    assert bool(angles[0]) is (flavour == "calculix")
