"""Decks of problems that are made in Python: what they say is what the problem says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fem import Problem, TabularLaw, concrete, read_deck, write_deck
from fem.decks.keywords import DeckError, label, safe_names
from fem.static.solve import static_state
from geometry import Assembly, pipe
from geometry.block import box_block
from geometry.loads import LoadCase, TractionLoad
from geometry.parts.regions import HeldFace
from tests.support.ccx import calculix_available, run_calculix
from tests.support.coarse_tubes import coarse, pressed, ring
from tests.support.decks import exported
from tests.support.fem_problems import by_block


@pytest.fixture(scope="module")
def problem() -> Problem:
    return pressed()


@pytest.mark.parametrize("program", ["abaqus", "abaqus-explicit", "calculix"])
def test_decks_of_a_problem_are_those_of_its_scene(program: str, tmp_path: Path) -> None:
    """The scene's deck but for its heading, which names the scene."""
    flavours = {"abaqus": "standard", "abaqus-explicit": "general"}
    sets = coarse(1, 2)
    mesh = ring(1, (12, 1, 2))
    settings, flavour = (*sets, "fem.method=static"), flavours.get(program, program)
    exported(tmp_path / "scene.inp", "tsb1-pipe", settings, flavour=flavour)
    write_deck(Problem(mesh, pipe(0.01), concrete), tmp_path / "case.inp", program=program)
    texts = [(tmp_path / f"{name}.inp").read_text().splitlines() for name in ("scene", "case")]
    first, second = ([x for x in t[1:] if not x.startswith("**")] for t in texts)
    start = [lines.index(next(x for x in lines if x.startswith("*"))) for lines in (first, second)]
    assert first[start[0] :] == second[start[1] :]


def test_a_table_is_one_for_calculix(problem, tmp_path: Path) -> None:
    tabular = replace(problem, law=TabularLaw([(0.0, 0.0), (0.01, 0.5), (0.02, 2.0)]))
    text = write_deck(tabular, tmp_path / "a.inp", program="calculix").read_text()
    assert "5.0e-01,1.0e-02" in text.replace(" ", "").lower() or "0.5,0.01" in text.replace(" ", "")
    with pytest.raises(DeckError, match="got 'table', which decks have no lines for"):
        write_deck(tabular, tmp_path / "b.inp")
    assert [path.name for path in tmp_path.iterdir()] == ["a.inp"]


def test_names_of_blocks_are_labels_of_their_own_in_decks(problem, tmp_path: Path) -> None:
    """Dots, blanks, digits in front and letters of other languages stay out of labels; names that
    would be the same label, or differ in case alone, get a number. Blocks keep their shapes."""
    blocks = problem.blocks
    given = ["column.inp", "Column inp", "2nd", "Säule", "x" * 100, "x" * 99]
    names = [given[k % len(given)] for k in range(len(blocks.shapes))]
    shapes = tuple(replace(s, name=n) for s, n in zip(blocks.shapes, names, strict=True))
    stated = replace(problem, blocks=replace(blocks, name="my.arch", shapes=shapes))
    read = read_deck(write_deck(stated, tmp_path / "case.inp")).problem().blocks
    assert len({shape.name for shape in read.shapes}) == len(read.shapes) == len(shapes)
    volumes = [stated.blocks.shape(b).mesh.n_elements for b in range(blocks.n_blocks)]
    assert [read.shape(b).mesh.n_elements for b in range(read.n_blocks)] == volumes

    labels = safe_names(given)
    assert labels[:4] == ["column_inp", "column_inp-2", "n2nd", "s_ule"]
    assert len(set(map(label, labels))) == len(given)
    assert safe_names(labels) == labels


@pytest.mark.parametrize("program", ["abaqus", "calculix"])
def test_supports_that_lean_have_axes_of_their_own(program, tmp_path: Path) -> None:
    """A bar turned by 30° about z, on rollers along its sides, stretched along its axis."""
    turn = Rotation.from_euler("z", 30.0, degrees=True).as_matrix()
    bar = box_block((20.0, 10.0, 10.0), (2, 1, 1))
    blocks = Assembly(
        name="bar",
        shapes=(bar,),
        shape_of=np.zeros(1, dtype=np.int64),
        rotations=turn[None],
        translations=np.ones((1, 3)),
        layer=np.ones(1, dtype=np.int64),
        fixed=np.zeros(1, dtype=np.bool_),
    )
    along, aside, up = turn.T
    held = [HeldFace(0, face, axis[None]) for face, axis in (("x-", along), ("y-", aside))]
    held += [HeldFace(0, "z-", up[None]), HeldFace(0, "x+", along[None], 0.01 * along)]
    # A traction across it, on nodes that have axes of their own: as forces along these.
    across = TractionLoad(np.zeros(1, dtype=np.int64), "y+", 33.0 * aside)
    load = LoadCase(blocks, "stretch", (across,), blocks.fixed, held=tuple(held))
    problem = Problem(blocks, load, concrete)
    path = write_deck(problem, tmp_path / "case.inp", program=program)
    with pytest.raises(DeckError, match=r"\*Transform is not read"):
        read_deck(path)
    (moved,) = by_block(static_state(problem.system))[None] @ turn
    places = (blocks.nodes(0) - 1.0) @ turn
    assert moved[:, 0] == pytest.approx(0.01 * places[:, 0] / 20.0, abs=1e-9)
    # Free along y and z: strain 33 / E - 0.2 (0.01 / 20 E + 0.2 33) / E.
    strain = 33.0 / 33000.0 - 0.2 * (0.01 / 20.0 + 0.2 * 33.0 / 33000.0)
    assert moved[:, 1] == pytest.approx(strain * places[:, 1], abs=1e-9)
    if program == "calculix" and calculix_available():
        theirs = run_calculix(path).displacements @ turn
        assert np.abs(theirs - moved).max() < 1e-8
