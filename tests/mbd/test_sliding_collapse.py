"""Sliding without dilation: every law multiplied out, walls and arches of others."""

from __future__ import annotations

import numpy as np
import pytest

from fem import CoulombFriction
from geometry.families.masonry import RunningBondWall, box, wall_of_rows
from geometry.loads import LoadCase
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.polyhedron import convex_polyhedron
from mbd import Rigid, analyse, contact_jacobian
from mbd.contacts.friction import FrictionalContacts, frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.limits.collapse import collapse_load
from mbd.limits.plane import reduced
from mbd.limits.sliding_collapse import check_sliding, sliding_collapse
from mbd.options import FrictionLaw
from mbd.system import Stated
from tests.verification.closed_forms import body_force, incline
from tests.verification.printed_numbers import (
    ARCH_OF_27,
    PRINTED,
    incline_slope,
    straight_arch_stands,
    wall,
    wall_factors,
)

pytestmark = pytest.mark.quick

DOWN, ASIDE = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])


def _contacts(assembly: PolyhedralAssembly, friction: float) -> FrictionalContacts:
    return frictional_contacts(assembly, contact_jacobian(assembly), friction)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("W1", id="ferris-tin-loi-w1"),
        pytest.param("W2", id="ferris-tin-loi-w2", marks=pytest.mark.slow),
        pytest.param("W3", id="ferris-tin-loi-w3"),
    ],
)
def test_walls_of_ferris_and_tin_loi(name: str) -> None:
    found = wall_factors(name)
    associated, sliding = PRINTED[name]
    # With dilation the factor is unique: the printed digits.
    assert found.associated == pytest.approx(associated, abs=5.1e-4)
    # Without, the printed number is a local minimum of a search for the least factor: a state
    # that obeys every law at no more than it is as good an answer, one above it is a worse one.
    assert found.certified
    assert found.factor <= sliding + 5e-4
    assert found.factor == pytest.approx(sliding, rel=0.015)
    # The laws, by other words than the certificate's own.
    problem, assembly = wall(name)
    contacts, mechanism = problem.contacts, found.mechanism
    assert mechanism is not None
    load = body_force(assembly, DOWN + found.factor * ASIDE)[problem.rows]
    live = body_force(assembly, ASIDE)[problem.rows]
    slip = (contacts.matrix.T @ mechanism).reshape(-1, 3)
    pressure, shear = found.forces[:, 0], np.linalg.norm(found.forces[:, 1:], axis=1)
    assert np.linalg.norm(contacts.matrix @ found.forces.ravel() + load) <= 1e-9 * np.linalg.norm(
        load
    )
    assert live @ mechanism > 0
    assert pressure.min() >= 0
    assert (shear <= contacts.friction * pressure * (1 + 1e-12) + 1e-300).all()
    largest = np.abs(slip).max()
    assert slip[:, 0].min() >= -1e-9 * largest
    # No joint that presses opens, and where one slides friction is at its limit.
    pressing = pressure > 1e-7 * pressure.max()
    assert slip[pressing, 0].max() <= 1e-7 * largest
    sliding_joints = pressing & (np.linalg.norm(slip[:, 1:], axis=1) > 1e-7 * largest)
    np.testing.assert_allclose(
        shear[sliding_joints], (contacts.friction * pressure)[sliding_joints], rtol=1e-6
    )
    assert (np.sum(found.forces[:, 1:] * slip[:, 1:], axis=1)[sliding_joints] < 0).all()


def test_the_associated_motion_does_not_pass_as_one_without_dilation() -> None:
    problem, assembly = wall("W1")
    dead, live = (body_force(assembly, way)[problem.rows] for way in (DOWN, ASIDE))
    found = collapse_load(problem.contacts, dead, live)
    assert found.mechanism is not None
    check = check_sliding(
        problem.contacts, dead + found.factor * live, found.forces, found.mechanism
    )
    # Equilibrium and no overlap, but joints that press open by μ times their slip.
    assert check.residual <= 1e-6
    assert check.overlap <= 1e-6
    assert check.opening_work > 1e-3


@pytest.mark.parametrize("friction", [0.1, 0.6])
def test_a_block_slides_without_dilation_at_the_same_slope(friction: float) -> None:
    # One joint: its pressure is the weight, whatever the flow.
    assembly = incline()
    contacts = _contacts(assembly, friction)
    found = sliding_collapse(contacts, body_force(assembly, DOWN), body_force(assembly, ASIDE))
    assert found.certified
    assert found.factor == pytest.approx(friction, abs=1e-7)
    assert found.mechanism is not None
    motion = found.mechanism / found.mechanism[0]
    np.testing.assert_allclose(motion, [1, 0, 0, 0, 0, 0], atol=1e-5)


def test_plane_problem_has_the_factors_of_the_problem_in_space() -> None:
    assembly = RunningBondWall((240.0, 115.0, 71.0), 2, 2).build()
    contacts = contact_jacobian(assembly)
    space = frictional_contacts(assembly, contacts, 0.7)
    dead, live = body_force(assembly, DOWN), body_force(assembly, ASIDE)
    plane = reduced(assembly, contacts, space, dead, live)
    assert 2 * plane.contacts.n_contacts == space.n_contacts
    solid = sliding_collapse(space, dead, live)
    flat = sliding_collapse(plane.contacts, dead[plane.rows], live[plane.rows])
    assert solid.certified
    assert flat.certified
    assert flat.associated == pytest.approx(solid.associated, rel=1e-7)
    assert flat.factor == pytest.approx(solid.factor, rel=1e-7)


@pytest.mark.parametrize("back", [(30.0, 70.0), (0.0, 40.0)], ids=["mirrored", "skewed"])
def test_a_foot_that_narrows_to_the_back_tips_about_its_slanted_side(
    back: tuple[float, float],
) -> None:
    """Its contacts lie on two flat faces, but not one behind the other: no problem in a plane.

    The foot is 100 wide in front, 40 at the back and 100 deep. α tips it about its right side,
    whose line is x(y) beside the centroid: α h = x(ȳ) - x̄ with h half the height.
    """
    foot = [(0.0, 0.0), (100.0, 0.0), (back[1], 100.0), (back[0], 100.0)]
    shape = convex_polyhedron("foot", [[x, y, z] for x, y in foot for z in (0.0, 400.0)])
    floor = box((300.0, 300.0, 20.0))
    places = [
        (floor, np.eye(3), np.array([-100.0, -100.0, -20.0])),
        (shape, np.eye(3), np.zeros(3)),
    ]
    assembly = polyhedral_assembly("foot", places, np.array([True, False]))
    middle, (dead, live) = assembly.centroids[1], np.zeros((2, 2, 6))
    dead[:, 2], live[:, 0] = -assembly.volumes, assembly.volumes
    aside = LoadCase(assembly, "aside", (), assembly.fixed, body_wrenches=live)
    stated = Stated(assembly, aside, dead, CoulombFriction(3.0))
    found = analyse(stated, Rigid(sliding=True, collapse=True)).parts
    side = 100.0 + (back[1] - 100.0) * middle[1] / 100.0
    assert found["sliding"].certified
    assert found["sliding"].factor == pytest.approx((side - middle[0]) / middle[2], rel=1e-6)
    assert found["collapse"].factor == pytest.approx(found["sliding"].factor, rel=1e-6)


@pytest.mark.parametrize("law", FrictionLaw)
def test_a_factor_that_is_not_certified_is_no_value(law: FrictionLaw) -> None:
    """Across the tangents the pyramid is weaker than the cone: its forces do not reach the cone."""
    assembly, across = incline(), ASIDE + np.array([0.0, 0.5, 0.0])
    contacts = frictional_contacts(assembly, contact_jacobian(assembly), 0.4, law)
    found = sliding_collapse(contacts, body_force(assembly, DOWN), body_force(assembly, across))
    (row,) = found.rows
    assert found.certified is (law is FrictionLaw.PYRAMID)
    assert (row.value is not None) is found.certified
    assert found.as_json()["factor"] == row.value


def test_loads_that_friction_never_lets_slide_are_said_to_be() -> None:
    assembly = incline()
    contacts = _contacts(assembly, 0.5)
    dead = body_force(assembly, DOWN)
    never = sliding_collapse(contacts, dead, dead)
    assert np.isinf(never.factor)
    assert not never.certified
    assert "no non-associated sliding state found" in never.status


def test_arch_of_27() -> None:
    # The printed limit has six digits; friction 0.5 is enough, 0.3 is not.
    # Half a unit of the last printed digit of h/R.
    assert straight_arch_stands(ARCH_OF_27 + 0.5e-6)
    assert not straight_arch_stands(ARCH_OF_27 - 0.5e-6)
    assert not straight_arch_stands(ARCH_OF_27 + 2e-6, friction=0.3)


def test_incline_of_a_half() -> None:
    assert incline_slope(0.50) == pytest.approx(0.50, abs=1e-7)
    assert incline_slope(0.49) == pytest.approx(0.49, abs=1e-7)
    down_the_slope = body_force(incline(), np.array([0.5, 0.0, -1.0]))
    for friction, stays in ((0.49, False), (0.51, True)):
        found = frictional_equilibrium(_contacts(incline(), friction), down_the_slope)
        assert found.holds is stays


def test_rows_of_a_wall_are_checked() -> None:
    with pytest.raises(AssemblyError, match="rows of one length"):
        wall_of_rows((400.0, 200.0, 175.0), [[1, 1], [1, 0.5]])
    with pytest.raises(AssemblyError, match="no width of zero"):
        wall_of_rows((400.0, 200.0, 175.0), [[1, 0, 1], [1, 1]])
    with pytest.raises(AssemblyError, match=r"^size: got"):
        wall_of_rows((400.0, -1.0, 175.0), [[1]])
    bonded = RunningBondWall((400.0, 200.0, 175.0), 3, 2).build()
    same = wall_of_rows((400.0, 200.0, 175.0), [[1, 1, 1], [0.5, 1, 1, 0.5]])
    np.testing.assert_allclose(same.translations, bonded.translations)
    np.testing.assert_allclose(same.volumes, bonded.volumes)
    opening = wall_of_rows((400.0, 200.0, 175.0), [[1, -1, 1]])
    assert opening.n_blocks == 3
    assert opening.translations[2, 0] == 800.0
