"""Printed contact forces are those of the last residual of the static solver."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fem import CoulombFriction, Problem, Static, concrete, solve_static
from fem.answer.answer import answer_of
from fem.static import newton
from fem.static.linear_step.linearisation import StaticError
from geometry import SineBlock, pipe, tube
from geometry.parts.balance import joint_wrenches

BLOCK = SineBlock(
    height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
)


def ring(**options: Any) -> Problem:
    """One layer of a tube under pressure and its weight; the sector model has one block in four."""
    blocks = tube(BLOCK, layers=1, mesh=(12, 1, 2))
    return Problem(blocks, pipe(0.01), concrete, gravity=(0.0, 0.0, -9810.0), **options)


CASES = {
    "matched": {},
    "matched, friction": {"friction": CoulombFriction(0.2)},
    "searched": {"finite_sliding": True},
    "searched, friction": {"finite_sliding": True, "friction": CoulombFriction(0.2)},
    "searched, degree 2": {"finite_sliding": True, "degree": 2},
}


@pytest.mark.parametrize("options", CASES.values(), ids=CASES)
def test_joint_forces_are_the_contact_vector_of_the_last_residual(
    options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of each block of the sector: the sum of the solver's nodal contact forces is the force of its
    joints in the whole tube, to 1e-12 of their sum."""
    last: list[tuple[Any, Any]] = []
    of_solver = newton.unbalanced_forces

    def recorded(problem: Any, state: Any) -> Any:
        last[:] = [(problem, state)]
        return of_solver(problem, state)

    monkeypatch.setattr(newton, "unbalanced_forces", recorded)
    solution = solve_static(ring(**options), Static(mesh="scene", error_estimate=False)).details
    if not last:
        pytest.skip("solved in contact forces")
    problem, state = last[0]
    system = problem.system
    traction, _ = problem.system.law.tractions(state.gaps.x, state.anchor)
    vector = system.points.scatter(state.gaps.gradient, system.points.weights[..., None] * traction)
    assembly = solution.deformable.assembly
    # What is printed is what was solved, to the bit: not computed again from world displacements.
    if solution.contact_state.interface is not None:
        pressures = solution.contact_state.point_pressures
        np.testing.assert_array_equal(pressures, solution.pressures.ravel())
    joints = joint_wrenches(assembly, solution.joints, assembly.centroids)
    size = np.linalg.norm(solution.joints.forces, axis=1).sum()
    for slot, block in enumerate(system.blocks.tolist()):
        force = assembly.rotations[block] @ vector[system.nodes_of(slot)].sum(axis=0)
        np.testing.assert_allclose(joints[block, :3], force, rtol=0.0, atol=1e-12 * size)


@pytest.mark.parametrize("options", [{}, {"finite_sliding": True}], ids=["matched", "searched"])
def test_an_answer_whose_forces_do_not_balance_is_rejected(options: dict[str, Any]) -> None:
    """A thousandth of the largest joint force is missing: the error names one of its blocks."""
    solution = solve_static(ring(**options), Static(mesh="scene", error_estimate=False)).details
    assert solution.imbalance.largest < 1e-7
    state, joints = solution.contact_state, solution.joints
    k = int(np.linalg.norm(joints.forces, axis=1).argmax())
    pair = int(joints.block_m[k]), int(joints.block_s[k])
    points = state.joint(*pair)
    less = np.ones(len(state.facet))
    less[points] = 0.999
    wrong = replace(solution)
    vars(wrong)["contact_state"] = replace(state, point_pressures=less * state.point_pressures)
    assert 1e-4 < wrong.imbalance.force <= 1e-3  # of the joint, or of the load where that is larger
    with pytest.raises(StaticError, match=f"of block ({pair[0]}|{pair[1]}) are out of balance"):
        answer_of(wrong)
