"""Friction in pairs of nodes: the same linear problem as one sparse matrix of everything."""

from __future__ import annotations

import numpy as np
import pytest

from fem import CoulombFriction
from fem.contact.normals import ContactNormals
from fem.static.linear_step.condensation import FlexibilityStore
from fem.static.linear_step.condensed import CondensedStep
from fem.static.linear_step.grid import grid_blocks
from fem.static.linear_step.grid_pairs import GridPairStep
from fem.static.linear_step.linearisation import Linearisation, SparseStep
from fem.system.sector import largest_sector
from geometry.mesh import FloatArray
from tests.support.pressed_pipe import pipe


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("normals", list(ContactNormals))
def test_one_linear_problem_is_that_of_one_sparse_matrix(
    normals: ContactNormals, degree: int
) -> None:
    """Blocks condensed on their nodes in contact, and those of a higher degree by their columns.

    Some points open, some stick and some slide, whose friction leans their forces.

    Current normals are those of random displacements of 1e-4 mm, which is what they turn by over
    facets of some millimetres: the mean of both sides changes the solution by that share.
    """
    friction = CoulombFriction(0.3)
    divisions = (12, 2, 4) if degree == 1 else (12, 1, 2)
    deformable = pipe(divisions=divisions, friction=friction, normals=normals, degree=degree)
    system = largest_sector(deformable)
    random = np.random.default_rng(1)
    before = 1e-4 * random.standard_normal((system.n_nodes, 3))
    gaps = system.points.gaps(before)
    at = gaps.x.copy()
    at[..., 0] = 2e-3 * random.standard_normal(gaps.overclosure.shape)
    anchor = at[..., 1:] + 1e-3 * random.standard_normal(at[..., 1:].shape)
    linear = Linearisation(
        weights=system.points.weights,
        gradient=gaps.gradient,
        constant=gaps.x - system.points.gather(gaps.gradient, before),
        at=at,
        traction=system.law.tractions(at, anchor)[0],
        slope=system.law.slope(at, anchor),
    )
    assert not linear.symmetric
    assert (linear.slope == 0.0).all(axis=(2, 3)).any()
    touched = np.unique(system.points.rows[system.points.rows < system.n_nodes])
    grids = grid_blocks(system.whole)
    assert (grids is None) == (degree == 1)

    def solved(step: SparseStep | CondensedStep | GridPairStep) -> FloatArray:
        return step(linear, before)[0][touched if grids is None else slice(None)]

    step = (
        CondensedStep(system, friction=True)
        if grids is None
        else GridPairStep(system, grids, FlexibilityStore())
    )
    sparse, pairs = solved(SparseStep(system)), solved(step)
    share = 1e-8 if normals is ContactNormals.REFERENCE else 1e-3
    assert np.abs(pairs - sparse).max() < share * np.abs(sparse).max()
    # The same pairs press again: what is kept of them is as it was.
    np.testing.assert_array_equal(solved(step), pairs)
