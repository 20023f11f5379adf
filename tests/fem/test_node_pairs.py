"""Friction in pairs of nodes: the same linear problem as one sparse matrix of everything."""

from __future__ import annotations

import numpy as np
import pytest

from fem import CoulombFriction
from fem.assembly.local_system import local_system
from fem.assembly.symmetry import largest_cyclic_orbits
from fem.contact.surfaces import ContactNormals
from fem.static.friction import friction_rows
from fem.static.linear_step.condensed import CondensedStep
from fem.static.linear_step.linearisation import Linearisation, SparseStep
from geometry.mesh import FloatArray
from tests.support.pressed_pipe import pipe


@pytest.mark.parametrize("normals", list(ContactNormals))
def test_one_linear_problem_is_that_of_one_sparse_matrix(normals: ContactNormals) -> None:
    """Some points open, some stick and some slide, whose friction leans their forces.

    Current normals are those of random displacements of 1e-4 mm, which is what they turn by over
    facets of some millimetres: the mean of both sides changes the solution by that share.
    """
    friction = CoulombFriction(0.3)
    deformable = pipe(friction=friction, normals=normals)
    system = local_system(deformable, largest_cyclic_orbits(deformable))
    rows, random = friction_rows(system, friction), np.random.default_rng(1)
    before = 1e-4 * random.standard_normal((system.n_nodes, 3))
    kinematics = system.kinematics(before, normals)
    at = 2e-3 * random.standard_normal(kinematics.overclosure.shape)
    normal = Linearisation(
        weights=system.surfaces.weights,
        gradient=kinematics.gradient,
        constant=kinematics.overclosure - system.gather(kinematics.gradient, before),
        at=at,
        pressure=system.law.pressure(at),
        stiffness=system.law.stiffness(at),
    )
    slip = rows.slip(before)
    linear = rows.linearise(normal, slip, slip + 1e-3 * random.standard_normal(slip.shape))
    assert linear.push is not None
    assert (linear.stiffness[:, : at.shape[1]] == 0.0).any()
    touched = np.unique(system.corner_nodes[system.corner_nodes < system.n_nodes])

    def solved(step: SparseStep | CondensedStep) -> FloatArray:
        return step(linear, before)[touched]

    step = CondensedStep(system, friction=True)
    sparse, pairs = solved(SparseStep(system)), solved(step)
    share = 1e-8 if normals is ContactNormals.REFERENCE else 1e-3
    assert np.abs(pairs - sparse).max() < share * np.abs(sparse).max()
    # The same pairs press again: what is kept of them is as it was.
    np.testing.assert_array_equal(solved(step), pairs)
