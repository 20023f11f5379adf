"""Blocks of several materials: bars in series, beams, weights, sectors, decks, wrong input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem import (
    CoulombFriction,
    Explicit,
    Frames,
    LinearPenalty,
    Material,
    Problem,
    read_deck,
    solve_explicit,
    solve_static,
)
from fem.decks.deck import Flavour
from fem.decks.problem import problem_deck, write_deck_file
from fem.static.solve import static_state
from geometry.block import box_block
from geometry.families.boxes import ColumnBox, box_column
from geometry.files.mesh_io import write_hex_mesh
from geometry.loads import LoadCase, PressureLoad, TractionLoad
from tests.fixtures.commands import small_meshes
from tests.support.answers import PLAIN
from tests.support.ccx import calculix_available, run_calculix
from tests.support.commands import answered
from validation import load_case, solve

SOFT = Material(density=1e-9, young_modulus=3_000.0, poisson_ratio=0.0)
STIFF = Material(density=5e-9, young_modulus=60_000.0, poisson_ratio=0.0)
#: Of each box of the column [mm], the pressure on it [MPa], the stiffness of the joint [MPa/mm].
WIDTH, HEIGHTS, PRESSURE, JOINT = 20.0, (100.0, 60.0), 2.0, 1e4


def column(*faces: TractionLoad, divisions: int = 2, **stated: object) -> Problem:
    """Two boxes of one shape but for their height, the lower soft, under a pressure."""
    sizes = [(WIDTH, WIDTH, height) for height in HEIGHTS]
    counts = [(divisions, divisions, max(2, round(0.25 * divisions * h / 5.0))) for h in HEIGHTS]
    blocks = box_column([ColumnBox(*both) for both in zip(sizes, counts, strict=True)])
    top = PressureLoad(np.array([1]), "z+", PRESSURE)
    load = LoadCase(blocks, "pressed", (top, *faces), np.array([True, False]))
    keywords = {"law": LinearPenalty(JOINT), "frames": Frames.DEFORMABLE} | stated
    return Problem(blocks, load, [SOFT, STIFF], **keywords, check_units=False)  # type: ignore[arg-type]


def series() -> float:
    """Shortening of two bars and their joint in series [mm]."""
    bars = zip(HEIGHTS, (SOFT, STIFF), strict=True)
    return PRESSURE * (sum(h / m.young_modulus for h, m in bars) + 1.0 / JOINT)


def top_of(answer) -> float:  # type: ignore[no-untyped-def]
    return -float(answer.fields["displacement"][:, 2].min())


def test_two_bars_in_series() -> None:
    """Uniform stress without lateral strain: exact to the residual of 1e-8; an explicit run
    damped to a residual of 1e-4 of the load is as near, and so are finer meshes."""
    problem = column()
    assert len(problem.system.bodies) == 2
    assert top_of(solve_static(problem, PLAIN)) == pytest.approx(series(), rel=1e-7)
    with small_meshes(1, 2):
        assert top_of(solve_static(problem)) == pytest.approx(series(), rel=1e-6)
    assert top_of(solve_explicit(problem, Explicit())) == pytest.approx(series(), rel=1e-3)


@pytest.mark.parametrize("flavour", [Flavour.STANDARD, Flavour.GENERAL])
def test_decks_have_a_material_for_each_part(flavour: Flavour, tmp_path: Path) -> None:
    """Two boxes of one shape and two materials are two parts; read back, the same problem."""
    even = replace(column(), blocks=box_column([ColumnBox((20.0, 20.0, 50.0), (2, 2, 2))] * 2))
    load = LoadCase(even.blocks, "pressed", even.load_case.faces, np.array([True, False]))
    deck = problem_deck(replace(even, load=load), flavour)
    write_deck_file(tmp_path / "two.inp", deck)
    read = read_deck(tmp_path / "two.inp").problem()
    assert read.materials == (SOFT, STIFF)
    if flavour is Flavour.STANDARD:
        moved = static_state(read.system).displacements
        shortening = PRESSURE * (50.0 / 3_000.0 + 50.0 / 60_000.0 + 1.0 / JOINT)
        assert -moved[1][:, :, 2].min() == pytest.approx(shortening, rel=1e-7)


@pytest.mark.skipif(not calculix_available(), reason="CalculiX (ccx) is not installed")
def test_calculix_on_the_deck_of_two_materials(tmp_path: Path) -> None:
    """Its increments end at a residual of 1e-6; friction holds the upper box in place."""
    deck = problem_deck(column(friction=CoulombFriction(0.3, 1e3)), Flavour.CALCULIX)
    write_deck_file(tmp_path / "two.inp", deck)
    found = run_calculix(tmp_path / "two.inp").displacements
    assert -found[:, 2].min() == pytest.approx(series(), rel=1e-4)


def test_a_beam_of_two_materials_bends_as_beam_theory_says() -> None:
    """A pressed column under a shear at its top: Timoshenko's beam of two moduli (shear coefficient
    5/6 without lateral strain) and a joint with springs along its normal and its slip.

    16 elements of 5 mm per 100 mm, quadratic in bending: the error is of (5/100)² = 0.25 %.
    """
    shear, stick = 0.01, 1e3
    side = TractionLoad(np.array([1]), "z+", np.array([shear, 0.0, 0.0]))
    problem = column(side, divisions=4, friction=CoulombFriction(0.5, stick))
    answer = solve_static(problem, PLAIN)
    area, bending = WIDTH**2, WIDTH**4 / 12.0
    force, (lower, upper) = shear * area, HEIGHTS
    length = lower + upper
    tip = (length**3 - upper**3) / (3.0 * SOFT.young_modulus * bending)
    tip += upper**3 / (3.0 * STIFF.young_modulus * bending) + upper**2 / (JOINT * bending)
    for height, material in zip(HEIGHTS, (SOFT, STIFF), strict=True):
        tip += height / (5.0 / 6.0 * 0.5 * material.young_modulus * area)
    tip = force * (tip + 1.0 / (stick * area))
    assert answer.fields["displacement"][:, 0].max() == pytest.approx(tip, rel=5e-3)


def test_rigid_and_deformable_blocks_weigh_by_their_own_density() -> None:
    """The joint carries the upper box alone, whichever solver is asked, and its mass is told."""
    weight = 9810.0 * STIFF.density * WIDTH**2 * HEIGHTS[1]
    still = column(gravity=(0.0, 0.0, -9810.0))
    still = replace(still, load=LoadCase(still.blocks, "none", (), np.array([True, False])))
    assert still.rigid_weight[1, 2] == pytest.approx(-weight, rel=1e-12)  # type: ignore[index]
    answer = solve_static(still, PLAIN)
    force = answer.contacts["pressure"] @ answer.contacts["area"]
    assert force == pytest.approx(weight, rel=1e-7)
    assert 9810.0 * answer.report["dimensions"]["mass"] == pytest.approx(weight, rel=1e-12)


# ---------------------------------------------------------------------------------------------
# Scenes


def stated(scene: str, *settings: str) -> Problem:
    return load_case(scene, settings).problem


def test_a_scene_names_the_materials_of_blocks() -> None:
    problem = stated(
        "column",
        "materials.steel.blocks=[1]",
        "materials.light={name='concrete',density=1e-9}",
        "materials.light.blocks=[2]",
    )
    given = [(m.density, m.young_modulus) for m in problem.materials]
    assert given == [(2.4e-9, 33e3), (7.85e-9, 210e3), (1e-9, 33e3)]


def test_parts_of_files_name_their_material(tmp_path: Path) -> None:
    write_hex_mesh(tmp_path / "brick.inp", box_block((100.0, 80.0, 50.0), (2, 2, 1)).mesh)
    (tmp_path / "own.toml").write_text(
        '[block]\ntype = "mesh"\n[[parts]]\nfile = "brick.inp"\nfixed = true\n'
        '[[parts]]\nfile = "brick.inp"\nmaterial = "steel"\nplaces = [{at = [0, 0, 50]}]\n'
        '[[parts]]\nfile = "brick.inp"\nmaterial = "oak"\nplaces = [{at = [0, 0, 100]}]\n'
        "[materials.oak]\ndensity = 0.7e-9\nyoung_modulus = 11000.0\npoisson_ratio = 0.3\n"
        "[effects]\ngravity = [0, 0, -9810]\n"
    )
    file = load_case(str(tmp_path / "own.toml"))
    problem = file.problem
    assert [m.density for m in problem.materials] == [2.4e-9, 7.85e-9, 0.7e-9]
    rigid = solve(file.with_method("rigid"))  # type: ignore[arg-type]
    joints = np.sort(np.unique(rigid.details.contact_forces.round(9)))
    each = 4e5 * 9810.0 * np.array([0.7e-9, 7.85e-9 + 0.7e-9])
    # Four points carry each joint alike.
    assert joints == pytest.approx(each / 4.0, rel=1e-6)


def test_constants_of_a_known_name_are_not_given_keys() -> None:
    """What a scene does not state is neither written down as its input nor called ignored."""
    file = load_case("column", ["materials.steel.blocks=[1]"])
    assert file.scene.materials["steel"].young_modulus == 210000.0
    assert file.keys["materials"] == {"steel": {"blocks": [1]}}
    assert load_case(file.keys).scene.materials == file.scene.materials
    settings = ["--set", "materials.steel.blocks=[1]", "--set", "fem.degree=2"]
    unused = answered("mbd", "column", *settings)[0]["unused_keys"]
    assert "fem.degree" in unused
    assert not [key for key in unused if "steel" in key]
