"""The flat deck for CalculiX: what it says, and what two other programs make of our decks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem import ElementType, ExponentialLaw, LinearPenalty, Problem, concrete
from fem.decks.deck import Deck, Flavour
from fem.decks.faces import contact_patches, half_facet_angle
from fem.decks.keywords import DeckError
from fem.decks.laws import TABLE_POINTS, law_table
from fem.decks.problem import deck_lines, problem_deck, write_deck_file
from fem.decks.read.cards import read_cards
from fem.decks.read.deck import deck_of_lines
from fem.problem import Motion
from fem.static.solve import static_state
from fem.system.effects import RayleighDamping
from geometry.errors import RefusedError
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import named_load
from geometry.mesh import HexMesh
from tests.support.blocks import tsb
from tests.support.ccx import CalculixError, calculix_available, run_calculix
from tests.verification.calculix import (
    BAR_RUN,
    bar_problem,
    bar_rows,
    calculix_of,
    calculix_through_converter,
    column_deck,
    column_rows,
    converter_available,
    crossing_deck,
    crossing_rows,
    tube_deck,
    tube_problem,
    tube_rows,
)
from validation import load_case

pytestmark = pytest.mark.quick

needs_ccx = pytest.mark.skipif(not calculix_available(), reason="CalculiX (ccx) is not installed")
needs_converter = pytest.mark.skipif(not converter_available(), reason="abq2ccx is not installed")

COARSE = SineBlockDivisions(12, 2, 2)


def card(deck: Deck, keyword: str):
    return next(c for c in read_cards(deck_lines(deck)) if c.keyword == keyword)


# ---------------------------------------------------------------------------------------------
# What the deck says


@pytest.mark.parametrize(
    ("law", "largest"), [(ExponentialLaw(), 10.0), (ExponentialLaw(maximum_stiffness=1000.0), 5.0)]
)
def test_law_table_follows_the_law(law: ExponentialLaw, largest: float) -> None:
    """Chords of a convex curve in steps h err by h²/8 · p'' at most.

    p''/p = (1 + 2/X) / (1 - e⁻ˣ) / c0² falls with X: the bound is that of 0.001 MPa, X = 2.4.
    """
    table = law_table(law)
    assert len(table) <= TABLE_POINTS
    assert (np.diff(table, axis=0) > 0).all()
    assert table[0].tolist() == [0.0, -law.clearance_at_zero_pressure]
    pressure = np.geomspace(1e-3, largest, 400)
    overclosure = law.overclosure(pressure)
    x = overclosure[0] / law.clearance_at_zero_pressure + 1.0
    step = np.diff(table[:3, 1])[0] / law.clearance_at_zero_pressure
    bound = step**2 / 8.0 * (1.0 + 2.0 / x) / -np.expm1(-x)
    assert bound < 7e-4
    assert np.abs(np.interp(overclosure, table[:, 1], table[:, 0]) / pressure - 1).max() < bound


def test_law_table_of_a_penalty_is_exact() -> None:
    law = LinearPenalty(250.0)
    table = law_table(law)
    depth = np.array([0.0, 1e-4, 0.1, 2.0])
    assert np.allclose(np.interp(depth, table[:, 1], table[:, 0]), 250.0 * depth, rtol=1e-12)


def test_meshio_reads_the_flat_deck(tmp_path: Path) -> None:
    """Nodes, elements and volume as placed: rounded at 1e-13 of the largest coordinate."""
    import meshio

    deck = tube_deck(COARSE)
    path = tmp_path / "flat.inp"
    write_deck_file(path, deck)
    mesh = meshio.read(path)
    ours = np.concatenate([deck.nodes(b) for b in range(deck.assembly.n_blocks)])
    assert np.abs(mesh.points - ours).max() < 1e-13 * np.abs(ours).max()
    elements = np.concatenate([cells.data for cells in mesh.cells])
    volume, _ = HexMesh(mesh.points, elements).extent()
    assert volume == pytest.approx(deck.assembly.volumes.sum(), rel=1e-12)
    free = np.concatenate(mesh.cell_sets["LAYER-01"])
    assert len(free) == 4 * deck.assembly.shapes[0].mesh.n_elements


def test_a_static_deck_of_blocks_that_move_is_refused() -> None:
    moving = replace(tube_problem(COARSE), motion=Motion(np.ones(3), np.zeros(3)))
    with pytest.raises(RefusedError, match="a static state has none"):
        problem_deck(moving, Flavour.CALCULIX)


@pytest.mark.parametrize(
    ("problem", "run", "message"),
    [
        (replace(bar_problem(), element=ElementType.INCOMPATIBLE), {}, "computes C3D8I wrongly"),
        (bar_problem(), {"rayleigh": RayleighDamping(2.0, 1e-8)}, "stiffness_proportional"),
        (tube_problem(COARSE), {}, "no contact law"),
        (bar_problem(), {"end_time": None}, "end_time is missing"),
    ],
)
def test_what_calculix_computes_wrongly_is_refused(problem, run, message) -> None:
    with pytest.raises(DeckError, match=message):
        problem_deck(problem, Flavour.CALCULIX, replace(BAR_RUN, **run))


def test_a_run_without_a_time_step_gets_one_in_which_calculix_is_accurate() -> None:
    """A quarter of the critical one at the most, that of a bar √(ρ/E) h of its elements."""
    deck = problem_deck(bar_problem(), Flavour.CALCULIX, replace(BAR_RUN, time_step=None))
    step = float(card(deck, "DYNAMIC").data[0].split(",")[0])
    passes = 10.0 / bar_problem().materials[0].bar_wave_speed
    assert 0.1 * passes < step < 0.25 * passes


# ---------------------------------------------------------------------------------------------
# CalculiX


@needs_ccx
def test_column(tmp_path: Path) -> None:
    """A uniform state: both programs must agree within the table of the law, 0.1 %."""
    for row in column_rows(tmp_path):
        assert row.agrees, row


@needs_ccx
def test_column_whose_facets_do_not_match(tmp_path: Path) -> None:
    """The same with 3 × 3 facets on 2 × 2; the bound is derived in `crossing_rows`."""
    for row in crossing_rows(tmp_path):
        assert row.agrees, row


@pytest.mark.parametrize("flavour", [Flavour.GENERAL, Flavour.STANDARD])
def test_instance_decks_remember_that_facets_do_not_match(flavour) -> None:
    """One pair of whole faces, the finer one slave; what is read back is solved by the search."""
    lines = list(deck_lines(crossing_deck(flavour)))
    pairs = [k for k, line in enumerate(lines) if line.startswith("*Contact Pair")]
    assert len(pairs) == (flavour is Flavour.STANDARD)
    for k in pairs:
        assert "type=SURFACE TO SURFACE" in lines[k]
        assert lines[k + 1] == "L01-B01.Z-MIN, L00-B01.Z-MAX"
    found = static_state(deck_of_lines(lines).problem().system)
    assert found.pressures == pytest.approx(0.01, rel=1e-6)


@needs_ccx
def test_tube(tmp_path: Path) -> None:
    """One layer; the tolerance is half the angle between facets (see `tube_rows`)."""
    for row in tube_rows(tmp_path, COARSE):
        assert row.tolerance < 0.15
        assert row.agrees, row


@needs_ccx
def test_no_node_of_a_joint_is_lost_where_blocks_slide_over_a_rim(tmp_path: Path) -> None:
    """Blocks move out by 0.011 mm, more than the reach of 1e-3 sqrt(A), at most 0.009 mm.

    The difference of displacements is below half the angle between facets.
    """
    keys = ["mesh.around=24", "mesh.radial=1", "mesh.axial=4", "assembly.layers=1"]
    deck = problem_deck(load_case("tsb1-pipe", keys).problem, Flavour.CALCULIX)
    found = calculix_of(deck, tmp_path)
    joints = deck.assembly.interfaces
    moving = deck.problem.deforming[joints.block_m] | deck.problem.deforming[joints.block_s]
    first = np.array(deck.first_node)[joints.block_s, None]
    slaves = np.unique((joints.quads_s + first)[moving])
    assert np.unique(found.slave_nodes).tolist() == slaves.tolist()
    largest = np.linalg.norm(found.displacements, axis=1).max()
    assert largest > 0.009
    shape = deck.assembly.shapes[0]
    angle = max(half_facet_angle(shape, face) for face in shape.contact_faces)
    own = static_state(deck.problem.system).displacements
    ours = max(np.linalg.norm(of, axis=-1).max() for of in own)
    assert largest == pytest.approx(ours, rel=angle)


@needs_ccx
def test_bar_in_explicit_dynamics(tmp_path: Path) -> None:
    """To the printed digits: half a unit in the seventh."""
    for row in bar_rows(tmp_path):
        assert row.agrees, row


@needs_ccx
@needs_converter
@pytest.mark.slow
def test_instance_deck_and_flat_deck_are_the_same_problem(tmp_path: Path) -> None:
    """CalculiX twice: instances expanded by abq2ccx, and our flat deck.

    The converter's table of the law is within 0.2 % of the pressure, ours within 0.04 %.
    """
    deck = tube_deck(COARSE)
    flat = calculix_of(deck, tmp_path).displacements
    converted = calculix_through_converter(deck, tmp_path).displacements
    assert converted.shape == flat.shape
    assert np.abs(converted - flat).max() < 2e-3 * np.abs(flat).max()


@needs_ccx
def test_errors_in_the_log_are_errors(tmp_path: Path) -> None:
    """A deck that CalculiX rejects is no result, whatever the exit status."""
    path = tmp_path / "bad.inp"
    lines = [line for line in deck_lines(column_deck()) if not line.startswith("*Solid Section")]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(CalculixError, match=r"ERROR"):
        run_calculix(path)


# ---------------------------------------------------------------------------------------------
# abq2ccx


@needs_converter
@pytest.mark.parametrize("case", ["pipe", "shaft"])
def test_converter_expands_every_instance_and_drops_nothing(tmp_path: Path, case: str) -> None:
    import abq2ccx

    assembly = SineTube(tsb(), COARSE, 2).build()
    load = named_load(case, 0.01).on(assembly)
    deck = problem_deck(Problem(assembly, load, concrete), Flavour.STANDARD)
    path = tmp_path / "pairs.inp"
    write_deck_file(path, deck)
    result = abq2ccx.convert_file(str(path))
    assert result.ok
    assert len(result.report.instances) == assembly.n_blocks
    n_nodes = sum(assembly.shape(b).mesh.n_nodes for b in range(assembly.n_blocks))
    n_elements = sum(assembly.shape(b).mesh.n_elements for b in range(assembly.n_blocks))
    assert len(result.geometry.nodes) == n_nodes
    assert f"{n_elements}" in {w.strip(",") for w in result.text.split()}
    assert result.report.n_commented == 0
    assert result.report.n_warnings == 0
    assert result.text.upper().count("*CONTACT PAIR") == len(contact_patches(deck).pairs)
    if case == "shaft":
        given = np.zeros((n_nodes, 3))
        for c in read_cards(result.text.splitlines()):
            for _, row in c.rows() if c.keyword == "CLOAD" else ():
                given[int(row[0]) - 1, int(row[1]) - 1] += float(row[2])
        assert np.allclose(given.sum(axis=0), load.facet_forces.sum(axis=0), rtol=1e-9, atol=1e-9)
