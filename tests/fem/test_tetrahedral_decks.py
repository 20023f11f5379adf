"""Blocks that gmsh filled with tetrahedra are tetrahedra of ten nodes in decks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fem import solve_static, write_deck
from fem.decks.meshes import TetrahedralMesh, tetrahedral_block
from fem.decks.problem import problem_deck
from fem.decks.statement import Flavour
from tests.support.ccx import calculix_available, run_calculix
from validation import load_case

pytestmark = pytest.mark.quick

#: One octahedron within six fixed ones, under its weight [mm/s²].
RINGS = {"assembly.rings": 0, "effects.gravity": [0.0, 0.0, -9810.0], "fem.mesh": "scene"}


def octahedra():
    return load_case("octahedra", RINGS).problem


def ten_nodes():
    block = octahedra().blocks.shapes[0]
    mesh = tetrahedral_block(block).mesh
    assert isinstance(mesh, TetrahedralMesh)
    return block, mesh


def test_tetrahedra_fill_the_block_of_their_hexahedra() -> None:
    """Right-handed ones of the same volume, with the middles of edges where edges are straight."""
    block, mesh = ten_nodes()
    corners = mesh.nodes[mesh.members[:, :4]]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(block.volume, rel=1e-12)
    ends = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])
    middles = corners[:, ends].mean(axis=2)
    np.testing.assert_allclose(mesh.nodes[mesh.members[:, 4:]], middles, atol=1e-9)


def test_forces_on_tetrahedra_have_the_same_resultant_and_moment() -> None:
    """Shape functions of degree two reproduce constants and coordinates, so work is the same."""
    block, mesh = ten_nodes()
    forces = np.random.default_rng(1).normal(size=block.mesh.nodes.shape)
    moved = mesh.on_tetrahedra(forces)
    np.testing.assert_allclose(moved.sum(axis=0), forces.sum(axis=0), atol=1e-10)
    before = np.cross(block.mesh.nodes, forces).sum(axis=0)
    after = np.cross(mesh.nodes[: mesh.n_nodes], moved).sum(axis=0)
    np.testing.assert_allclose(after, before, atol=1e-8)


@pytest.mark.parametrize(
    ("flavour", "name"),
    [(Flavour.CALCULIX, "C3D10"), (Flavour.STANDARD, "C3D10"), (Flavour.GENERAL, "C3D10M")],
)
def test_deck_names_tetrahedra_and_that_our_elements_are_others(flavour, name) -> None:
    deck = problem_deck(octahedra(), flavour)
    assert all(isinstance(shape.mesh, TetrahedralMesh) for shape in deck.assembly.shapes)
    assert f"elements: {name}, the tetrahedra of gmsh" in " ".join(deck.notes)


@pytest.mark.skipif(not calculix_available(), reason="CalculiX (ccx) is not installed")
@pytest.mark.slow
def test_calculix_finds_our_answer_with_tetrahedra(tmp_path: Path) -> None:
    """The reaction is the weight; the displacement is that of the contact law, to its chords.

    Blocks of 33 GPa hardly deform here. Ours has 112 hexahedra of degree 2 a block; the law is a
    table of 200 points in CalculiX, and it presses at nodes of a mesh of 28 tetrahedra.
    """
    problem = octahedra()
    found = run_calculix(write_deck(problem, tmp_path / "octahedra.inp", program="calculix"))
    reaction = sum(np.sum(np.atleast_2d(force), axis=0) for force in found.reactions.values())
    weight = 2.4e-9 * 9810.0 * problem.blocks.volumes[~problem.blocks.fixed].sum()
    np.testing.assert_allclose(reaction, [0.0, 0.0, weight], atol=1e-4 * weight)
    ours = solve_static(problem)["max_displacement"].value
    theirs = np.linalg.norm(found.displacements, axis=1).max()
    assert theirs == pytest.approx(ours, rel=2e-3)
