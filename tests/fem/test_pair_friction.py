"""Friction of pairs of blocks: each joint slides at its own limit, whichever solver is asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem import (
    CoulombFriction,
    read_deck,
    solve_static,
    write_deck,
)
from fem.decks.keywords import DeckError
from geometry.errors import RefusedError
from geometry.parts.pairs import pair_values
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.limits.collapse import collapse_load
from mbd.limits.force_range import force_ranges
from mbd.limits.plane import in_space
from mbd.limits.sliding_collapse import sliding_collapse
from mbd.options import FrictionLaw
from tests.support.answers import PLAIN
from tests.support.pushed_bricks import (
    EDGE,
    ROUGH,
    SCENE,
    SMOOTH,
    dice,
    frictionless_answer,
    pushed,
)
from validation import load_case, solve

FRICTION = CoulombFriction(0.2, of_pairs=((0, 1, ROUGH), (2, 0, SMOOTH)))


# ---------------------------------------------------------------------------------------------
# Rigid blocks


@pytest.mark.parametrize("law", list(FrictionLaw))
@pytest.mark.parametrize("rough", [0.3, 0.0])
def test_rigid_dice_are_pushed_by_their_own_friction(law: FrictionLaw, rough: float) -> None:
    """A push grows on one die until it slides: at μ of its joint times its weight, exactly; μ = 0
    leaves none. The ranges of the joints' shear-free forces stay those of the weight."""
    blocks = dice()
    contacts = contact_jacobian(blocks, blocks.fixed)
    of_pairs = ((0, 1, rough), (0, 2, SMOOTH))
    friction = pair_values(0.2, of_pairs, contacts.block_m, contacts.block_s)
    frictional = frictional_contacts(blocks, contacts, friction, law)
    dead, live = np.zeros((2, 12))
    dead[[2, 8]] = -1.0
    for die, mu in ((0, rough), (1, SMOOTH)):
        live[:] = 0.0
        live[6 * die] = 1.0
        live[6 * die + 4] = -0.5 * EDGE / contacts.length  # at the height of the joint
        found = collapse_load(frictional, dead, live)
        assert found.factor == pytest.approx(mu, abs=1e-6)
        slid = sliding_collapse(frictional, dead, live)
        assert slid.factor == pytest.approx(mu, abs=1e-6)
    ranges = force_ranges(
        contacts, dead, np.full(len(contacts.index), 0.1), frictional=in_space(frictional)
    )
    assert ranges.least == pytest.approx([1.0, 1.0], abs=1e-6)


def test_one_friction_for_all_is_that_of_each_contact() -> None:
    """Of rigid contacts one number for each; of pairs one for all that have the same."""
    blocks = dice()
    contacts = contact_jacobian(blocks, blocks.fixed)
    alike = frictional_contacts(blocks, contacts, np.full(len(contacts.index), 0.3))
    assert alike.friction == pytest.approx(np.full(len(contacts.index), 0.3), rel=0, abs=0)
    assert pair_values(0.3, (), contacts.block_m, contacts.block_s) == 0.3


# ---------------------------------------------------------------------------------------------
# Decks and scenes


def test_decks_have_an_interaction_for_each_friction(tmp_path: Path) -> None:
    """Read back, the same pairs; general contact has one friction and says so."""
    problem = pushed(FRICTION)
    problem = replace(problem, load=replace(problem.load_case, held=()))
    write_deck(problem, tmp_path / "dice.inp")
    read = read_deck(tmp_path / "dice.inp").problem().coulomb
    assert read is not None
    assert list(read.on(np.array([0, 0]), np.array([1, 2]))) == [ROUGH, SMOOTH]
    with pytest.raises(DeckError, match=r"contact.pairs: general contact has one friction"):
        write_deck(problem, tmp_path / "general.inp", program="abaqus-explicit")


def test_a_scene_names_pairs_by_block_and_by_material(tmp_path: Path) -> None:
    (tmp_path / "pairs.toml").write_text(SCENE, "utf-8")
    file = load_case(str(tmp_path / "pairs.toml"))
    friction = file.problem.coulomb
    assert friction is not None
    assert (friction.coefficient, friction.of_pairs) == (0.4, ((0, 1, 0.2), (1, 2, 0.1)))
    assert "others between pairs" in solve(file.with_method("rigid")).details.words


def test_friction_of_some_joints_needs_that_of_the_others(tmp_path: Path) -> None:
    """Frictionless others would be a trap; what decides effects leaves out both."""
    (tmp_path / "pairs.toml").write_text(SCENE, "utf-8")
    case = load_case(tmp_path / "pairs.toml")
    data = case.keys
    bare = load_case(data | {"effects": {}})
    with pytest.raises(RefusedError, match=r"without that of the others; expected \[effects.fric"):
        _ = bare.problem
    smooth = solve_static(replace(case.problem, friction=None), PLAIN)
    moved = frictionless_answer(tmp_path / "pairs.toml")["measures"]["max_displacement"]["value"]
    assert moved == pytest.approx(smooth["max_displacement"].value, rel=1e-9)
