"""Rows of supports: any directions, stated once or again, as long as they do not contradict."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fem.static.solve import StaticOptions, static_state
from fem.system.body import ModelError
from fem.system.rows import Held, HeldRows, TabularAmplitude, held_at, joined_rows
from fem.system.sector import largest_sector
from validation import load_case

SLANTED = np.array([np.cos(0.6), np.sin(0.6), 0.0])


def rows(directions: Any, values: Any) -> Held:
    """Rows of node 2 that nothing moves."""
    n = len(values)
    direction = np.array(directions, dtype=np.float64).reshape(n, 3)
    none, still = np.zeros(n, np.int64), np.full(n, -1)
    held = HeldRows(none, np.full(n, 2), direction, np.array(values), still, (), none, ("x",))
    return held.on(np.zeros(1, np.int64))


def test_variables_are_the_prescribed_displacement_whatever_the_directions() -> None:
    """Random directions of one, two and three dimensions, stated again in other directions."""
    random = np.random.default_rng(3)
    for rank in (1, 2, 3):
        basis = np.linalg.qr(random.standard_normal((3, 3)))[0][:rank]
        directions = random.standard_normal((5, rank)) @ basis
        moved = random.standard_normal(3)
        held = rows(directions, directions @ moved)
        transform, free = held.transform(4)
        assert len(free) == 12 - rank
        u = (transform @ held.variables(4)).reshape(4, 3)
        assert not u[[0, 1, 3]].any()
        # Sums of five products of numbers of order one, twice.
        np.testing.assert_allclose(directions @ u[2], directions @ moved, atol=1e-13)
        force = random.standard_normal((4, 3))
        part = held.part(force)
        np.testing.assert_allclose(part[2], basis.T @ (basis @ force[2]), atol=1e-14)
        assert held.met(u)
        assert not held.met(u + 1e-6 * directions[0])


@pytest.mark.parametrize("values", [(0.1, 0.2, 0.1), (0.0, 0.0, 0.1)])
def test_rows_that_contradict_each_other_are_refused(values: tuple[float, ...]) -> None:
    y = [0.0, 1.0, 0.0]
    with pytest.raises(ModelError, match="node 2 of block 0 is moved in two ways"):
        rows([y, SLANTED, y], (*values[:2], values[2] + 1e-3))


def test_supports_that_are_stated_again_change_nothing() -> None:
    """All rows again, those along x of what moves along a slope."""
    deformable = load_case("shifted-boxes").problem.system
    held = deformable.supports
    turns = deformable.assembly.rotations[held.block]
    moves = held.table >= 0
    assert moves.any()
    assert not moves.all()
    assert held.value.max() == pytest.approx(0.03)
    leaning = moves & np.isclose(np.einsum("nij,nj->ni", turns, held.direction)[:, 0], 1.0)
    directions = np.where(leaning[:, None], SLANTED @ turns, held.direction)
    values = np.where(leaning, 0.03 * SLANTED[0], held.value)
    more = replace(held, direction=directions, value=values)
    again = replace(deformable, supports=joined_rows([held, more]))
    options = StaticOptions(tolerance=1e-10, motion_steps=2)
    once, twice = (static_state(one, options) for one in (deformable, again))
    for a, b in zip(once.displacements, twice.displacements, strict=True):
        assert np.abs(a).max() > 0.01
        np.testing.assert_allclose(b, a, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(("late", "order"), [((), 4), ((1, 3), 2), ((3,), 1)])
def test_supports_that_move_at_other_times_are_no_sector(late: tuple[int, ...], order: int) -> None:
    """One node of each block of a layer goes the same way, that of some blocks later: a sector has
    the ways of all its copies."""
    coarse = {"assembly.layers": 1, "mesh.around": 12, "mesh.radial": 1, "mesh.axial": 2}
    model = load_case("tsb1-pipe", coarse).problem.system
    soon, later = (TabularAmplitude((0.0, end, 1.0), (0.0, 1.0, 1.0)) for end in (0.5, 0.75))
    moved = [
        held_at(
            block,
            np.zeros(1, np.int64),
            np.eye(3)[:1],
            0.01,
            amplitude=later if number in late else soon,
        )
        for number, block in enumerate(model.deformable_blocks.tolist())
    ]
    assert largest_sector(replace(model, supports=joined_rows(moved))).orbits.order == order
