"""Blocks that gmsh filled with tetrahedra are the hexahedra of their answer in decks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fem import solve_static, write_deck
from fem.decks.deck import Flavour
from fem.decks.problem import deck_lines, problem_deck
from tests.support.answers import PLAIN
from tests.support.ccx import calculix_available, run_calculix
from validation import load_case

pytestmark = pytest.mark.quick

#: One octahedron within six fixed ones, under its weight [mm/s²].
RINGS = {"assembly.rings": 0, "effects.gravity": [0.0, 0.0, -9810.0], "fem.mesh": "scene"}


def octahedra():
    return load_case("octahedra", RINGS).problem


@pytest.mark.parametrize("flavour", list(Flavour))
def test_deck_names_its_elements(flavour) -> None:
    deck = problem_deck(octahedra(), flavour)
    assert any(line.startswith("*Element, type=C3D8I") for line in deck_lines(deck))
    notes = " ".join(deck.notes)
    assert "four of each tetrahedron" in notes
    assert "tubelock's answer has degree 2" in notes


@pytest.mark.skipif(not calculix_available(), reason="CalculiX (ccx) is not installed")
@pytest.mark.slow
def test_calculix_finds_our_answer(tmp_path: Path) -> None:
    """The reaction is the weight; the displacement is that of the contact law, to its chords.

    Blocks of 33 GPa hardly deform here. Ours has 112 hexahedra of degree 2 a block; the law is a
    table of 200 points in CalculiX, and it presses at nodes of hexahedra of degree 1.
    """
    problem = octahedra()
    found = run_calculix(write_deck(problem, tmp_path / "octahedra.inp", program="calculix"))
    reaction = sum(np.sum(np.atleast_2d(force), axis=0) for force in found.reactions.values())
    weight = 2.4e-9 * 9810.0 * problem.blocks.volumes[~problem.blocks.fixed].sum()
    np.testing.assert_allclose(reaction, [0.0, 0.0, weight], atol=1e-4 * weight)
    ours = solve_static(problem, PLAIN)
    largest = ours["max_displacement"].value
    theirs = np.linalg.norm(found.displacements, axis=1).max()
    assert theirs == pytest.approx(largest, rel=2e-3)
