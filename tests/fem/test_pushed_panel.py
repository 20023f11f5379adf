"""A panel of truncated tetrahedra whose middle block is pushed through, with friction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from fem.accuracy.statics import static_options
from fem.answer.forces import external_work, load_work, push_curves_of
from fem.state import State
from fem.static.solve import static_state
from fem.system.reactions import PushCurve
from geometry import Answer
from geometry.families.platonic_layers import tetrahedron
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.limits.force_range import force_ranges
from mbd.limits.plane import in_space
from validation import Case, load_case, solve

FRICTION = 0.3


@dataclass(frozen=True)
class Pushed:
    """Static answer and its curve."""

    result: State
    curve: PushCurve


def pushed(case: Case) -> Pushed:
    problem = case.problem
    deformable = problem.system
    result = static_state(deformable, static_options(problem, case.method))
    (curve,) = push_curves_of(result)
    return Pushed(result, curve)


def panel(*overrides: str) -> Case:
    return load_case("pushed-panel", overrides)


def without_pressure(case: Case, *, freed: bool = True) -> Case:
    """The panel that nothing presses, its ring fixed where it is not freed."""
    data = {key: value for key, value in case.keys.items() if key not in {"supports", "loads"}}
    if not freed:
        data["assembly"] = {**data["assembly"], "freed": []}
    return load_case(data)


def ringed(*overrides: str) -> Case:
    """The panel in a fixed ring, which nothing presses."""
    return without_pressure(panel(*overrides), freed=False)


@pytest.fixture(scope="module")
def pressed() -> Pushed:
    """Past the bend of the curve."""
    return pushed(panel("mesh.divisions=1", "load.push.distance=0.12", "fem.motion_steps=6"))


@pytest.fixture(scope="module")
def squeezed() -> State:
    """Side forces alone."""
    return pushed(panel("mesh.divisions=1", "load.push.distance=1e-9", "fem.motion_steps=1")).result


def test_joint_forces_lie_within_the_ranges_of_rigid_blocks(squeezed: State) -> None:
    """Forces of elements are in equilibrium with the side forces and obey Coulomb's law at every
    point, so that some rigid state has the same: the normal force of each joint is no less than its
    least and no more than its largest."""
    problem = panel().with_method("rigid").problem
    solids, load = problem.blocks, problem.rigid_load
    load = replace(load, held=tuple(support for support in load.held if not support.moves))
    faces = solids.with_faces_alone()
    load = replace(load, assembly=faces)
    contacts = contact_jacobian(faces, load.fixed, load.held)
    force = contacts.rows(load.wrenches)
    cones = frictional_contacts(faces, contacts, FRICTION)
    shown = frictional_equilibrium(cones, force).forces[:, 0]
    ranges = force_ranges(contacts, force, shown, frictional=in_space(cones))

    state = squeezed.contact_state
    found = np.array(
        [
            (state.point_areas * state.point_pressures)[state.joint(m, s)].sum()
            for m, s in zip(ranges.block_m, ranges.block_s, strict=True)
        ]
    )
    total = float(np.abs(force).sum())
    assert np.isfinite(ranges.largest).sum() == 24  # all but those between blocks of one guide
    assert (found >= ranges.least - squeezed.residual * total).all()
    assert (found <= ranges.largest + squeezed.residual * total).all()
    assert (ranges.least > 0.0).sum() == 24


@pytest.fixture(scope="module")
def rigid() -> Answer:
    return solve(panel().with_method("rigid"))


def test_no_force_is_larger_than_the_rigid_limit(pressed: Pushed, rigid: Answer) -> None:
    """Associated limit analysis bounds every state with Coulomb's friction, as far as the panel is
    the one as built: blocks of 60 mm that move by 0.12 mm turn its faces by no more than 0.2 %."""
    limit = rigid.parts["push_limit"].associated.factor
    assert np.isfinite(limit)
    assert pressed.result.evidence.converged
    assert pressed.curve.displacements[-1] == pytest.approx(0.12, rel=1e-12)
    assert pressed.curve.peak[0] <= 1.002 * limit


def test_the_work_of_the_push_is_stored_and_lost(pressed: Pushed, squeezed: State) -> None:
    """Strain, contact, elastic slips and friction take the work of the push and the side forces.
    The curve rises and is concave: trapezia are too small, the force at the end of each step is
    too large."""
    before, after, curve = squeezed, pressed.result, pressed.curve
    work = external_work(after) - external_work(before) - (load_work(after) - load_work(before))
    assert (np.diff(curve.forces) > 0.0).all()
    assert (np.diff(curve.forces, 2) < 0.0).all()
    assert curve.work <= work <= curve.forces[1:] @ np.diff(curve.displacements)


def test_rigid_blocks_say_the_limit_of_the_push(rigid: Answer) -> None:
    """Certified from both sides, by faces alone; a fixed ring jams with associated friction, and
    without dilation nothing that presses holds the block."""
    limit = rigid.as_dict()["push_limit"]
    assert limit["certified"]
    assert limit["upper_bound"] == pytest.approx(limit["associated"], rel=1e-6)
    assert 0.0 < limit["non_associated"] < limit["associated"]

    limit = solve(ringed().with_method("rigid")).as_dict()["push_limit"]
    assert limit["unbounded"]
    assert limit["associated"] is None
    assert limit["non_associated"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.thorough
def test_steps_far_longer_than_the_contact_law_are_taken() -> None:
    """Nothing presses the blocks before, and steps of 1 mm are a thousand lengths of the law: each
    starts where the one before leads to, the first from shorter ones. The push of a block that
    nothing presses stays below a hundredth of that between the side forces."""
    far = pushed(ringed("mesh.divisions=1", "load.push.distance=2", "fem.motion_steps=2"))
    assert far.result.evidence.converged
    assert far.curve.displacements[-1] == pytest.approx(2.0, rel=1e-12)
    assert 0.0 < far.curve.peak[0] < 0.01 * 4800.0


@pytest.mark.quick
def test_truncated_tetrahedra_have_the_volume_of_their_sections() -> None:
    """(a + c z)(a - c z) over |z| < t / 2, a half the edge, c = √2: a² t - c² t³ / 12."""
    edge, thickness = 100.0, 30.0
    shape = tetrahedron(edge, thickness)
    assert len(shape.points) == 8
    expected = (edge / 2) ** 2 * thickness - 2.0 * thickness**3 / 12.0
    assert shape.volume == pytest.approx(expected, rel=1e-12)
    whole = tetrahedron(edge, edge / np.sqrt(2.0))
    assert whole.volume == pytest.approx(tetrahedron(edge).volume, rel=1e-12)


@pytest.mark.parametrize(
    ("clearance", "freed"),
    [
        pytest.param(0.0, True, id="nothing presses the ring"),
        pytest.param(0.5, False, id="gaps"),
    ],
)
def test_a_push_that_meets_nothing_has_a_curve_of_no_force(clearance: float, freed: bool) -> None:
    """Blocks that nothing holds from behind, or that stand in gaps of 0.5 mm, give way: what runs
    into them moves them. No rigid ring of blocks jams at 2 mm, so that every force is zero."""
    loose = panel("mesh.divisions=1", "load.push.distance=2", "fem.motion_steps=2")
    loose = loose.changed({"contact.clearance": clearance})
    found = pushed(without_pressure(loose, freed=freed))
    assert found.result.evidence.converged
    assert found.curve.displacements[-1] == pytest.approx(2.0, rel=1e-12)
    assert not found.curve.forces.any()
    assert found.curve.free_after == 0.0
