"""Contact laws of pairs of blocks: each joint closes by its own law, whichever solver is used."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem import (
    CoulombFriction,
    ExponentialLaw,
    LinearPenalty,
    Material,
    PairLaws,
    Problem,
    TabularLaw,
    concrete,
    read_deck,
    solve_static,
    write_deck,
)
from fem.contact.law import ContactLaw
from fem.decks.keywords import DeckError
from fem.static.solve import static_state
from fem.system.sector import largest_sector
from geometry import shaft
from tests.support.answers import PLAIN
from tests.support.coarse_tubes import ring
from tests.support.pushed_bricks import EDGE, PRESSURE, SCENE, STONE, frictionless_answer, pushed
from validation import load_case

SOFT, STIFF = LinearPenalty(50.0), LinearPenalty(500.0)
#: Elastic shortening of a die up to its middle [mm].
SHORTENED = PRESSURE / STONE.young_modulus * EDGE / 2.0


def pressed(law: ContactLaw, *, sliding: bool = False) -> Problem:
    """Dice under a pressure on a plate, without friction."""
    problem = pushed(0.0, sliding=sliding)
    return replace(problem, law=law, load=replace(problem.load_case, held=()))


def sunk(displacements: tuple[np.ndarray, ...]) -> np.ndarray:
    """How far the middle of each die sank."""
    return -displacements[0][:, :, 2].mean(axis=1)


def test_laws_of_ones_own_are_taken_by_pairs() -> None:
    """A table with the slope of the linear law, on one joint."""
    table = TabularLaw([(0.0, 0.0), (0.1, 5.0)])
    found = static_state(pressed(PairLaws(STIFF, ((0, 2, table),))).system)
    expected = PRESSURE / np.array([500.0, 50.0]) + SHORTENED
    assert sunk(found.displacements) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("what", ["law", "friction", "material"])
def test_a_sector_needs_the_same_of_all_round_the_axis(what: str) -> None:
    """Joints or blocks of a layer keep the symmetry, a single one breaks it."""
    blocks = ring(2, (12, 1, 2))
    m, s = blocks.interfaces.block_m, blocks.interfaces.block_s
    lower = {(int(a), int(b)) for a, b in zip(m, s, strict=True) if blocks.layer[[a, b]].max() == 1}
    layer = np.flatnonzero(blocks.layer == 1).tolist()
    steel = Material(density=7.85e-9, young_modulus=210_000.0, poisson_ratio=0.3)
    for count, order in ((None, 4), (1, 1)):
        pairs, some = sorted(lower)[:count], layer[:count]
        stated = {
            "law": PairLaws(ExponentialLaw(), tuple((*pair, SOFT) for pair in pairs)),
            "friction": CoulombFriction(0.1, of_pairs=tuple((*pair, 0.5) for pair in pairs)),
            "material": [steel if b in some else concrete for b in range(blocks.n_blocks)],
        }
        problem = replace(Problem(blocks, shaft(0.01), concrete), **{what: stated[what]})
        assert largest_sector(problem.system).orbits.order == order


def test_decks_have_an_interaction_for_each_law(tmp_path: Path) -> None:
    """Read back, the same laws; general contact has one and says so, headings have one cap."""
    problem = pressed(PairLaws(ExponentialLaw(), ((0, 2, SOFT),)))
    write_deck(problem, tmp_path / "dice.inp")
    assert read_deck(tmp_path / "dice.inp").problem().law == problem.law
    lines = (tmp_path / "dice.inp").read_text("utf-8").splitlines()
    assert sum(line.startswith("*Surface Interaction") for line in lines) == 2
    with pytest.raises(DeckError, match=r"contact.pairs: general contact has one friction and one"):
        write_deck(problem, tmp_path / "general.inp", program="abaqus-explicit")
    capped = PairLaws(ExponentialLaw(), ((0, 2, ExponentialLaw(maximum_stiffness=500.0)),))
    with pytest.raises(DeckError, match=r"got 500 and inf MPa/mm .*expected the same"):
        write_deck(pressed(capped), tmp_path / "capped.inp")
    write_deck(problem, tmp_path / "ccx.inp", program="calculix")
    tables = (tmp_path / "ccx.inp").read_text("utf-8").count("pressure-overclosure=TABULAR")
    assert tables == 2


def test_a_scene_names_laws_by_block_and_by_material(tmp_path: Path) -> None:
    text = SCENE.replace("friction = 0.1", 'law = "linear"\nstiffness = 500.0')
    (tmp_path / "laws.toml").write_text(text, "utf-8")
    file = load_case(str(tmp_path / "laws.toml"))
    problem = file.problem
    assert problem.contact_law == PairLaws(ExponentialLaw(), ((1, 2, STIFF),))
    assert problem.coulomb is not None
    assert problem.coulomb.of_pairs == ((0, 1, 0.2),)
    # What decides effects leaves out friction, and no law.
    smooth = solve_static(replace(problem, friction=None), PLAIN)
    moved = frictionless_answer(tmp_path / "laws.toml")["measures"]["max_displacement"]["value"]
    assert moved == pytest.approx(smooth["max_displacement"].value, rel=1e-9)
