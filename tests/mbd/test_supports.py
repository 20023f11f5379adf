"""Rigid blocks with supports along single directions, pressed regions and line loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry import Assembly
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import LineLoad, LoadCase, PressureLoad, TractionLoad
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import HeldFace, Plane
from geometry.polyhedra.assembly import as_polyhedral
from mbd import MechanismClass, analyse, contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.limits.collapse import collapse_load
from mbd.limits.force_range import force_ranges
from mbd.limits.plane import in_space
from mbd.limits.pushes import Pushes, interlocking_margin
from mbd.limits.sliding_collapse import sliding_collapse
from mbd.system import RigidSystem, Stated

pytestmark = pytest.mark.quick

X, Y, Z = np.eye(3)
#: Sides of the brick [mm] and force per area [MPa].
A, B, C = 80.0, 60.0, 40.0
Q = 0.05


def bricks(layers: int = 1) -> Assembly:
    """A fixed brick with free ones on it."""
    return box_column([ColumnBox((A, B, C), (4, 2, 2))] * (1 + layers))


def side(assembly: AnyBlocks, block: int, axis: np.ndarray) -> Plane:
    """The plane of the face of a brick towards an axis."""
    size = np.abs(axis) @ [A, B, C]
    return Plane(assembly.centroids[block] + 0.5 * size * axis, axis)


def roller(assembly: AnyBlocks, block: int, axis: np.ndarray, **stated) -> HeldFace:
    unit = np.abs(axis)[None, :]
    return HeldFace(block, side(assembly, block, axis), unit, **stated)


def push(assembly: AnyBlocks, block: int, axis: np.ndarray, traction: np.ndarray) -> TractionLoad:
    return TractionLoad(np.array([block]), side(assembly, block, axis), traction)


def case(assembly, *faces, held=(), lines=(), weight=0.0) -> LoadCase:
    wrench = np.zeros((assembly.n_blocks, 6))
    wrench[:, 2] = -weight
    return LoadCase(assembly, "case", faces, assembly.fixed, held, lines, body_wrenches=wrench)


@pytest.fixture(params=[False, True], ids=["hexahedra", "triangles"])
def stack(request) -> AnyBlocks:
    return as_polyhedral(bricks()) if request.param else bricks()


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_roller_holds_from_both_sides_and_takes_the_whole_traction(stack, sense):
    """Q on a face of B × C: the roller at the other end of the brick carries Q B C either way."""
    load = case(stack, push(stack, 1, X, sense * Q * X), weight=10.0)
    assert not analyse(stack, load=load).details.equilibrium.holds
    answer = analyse(stack, load=replace(load, held=(roller(stack, 1, -X, name="wall"),)))
    assert answer.report["carried"]
    force = np.array(answer.report["reactions"]["wall"]["force"])
    np.testing.assert_allclose(force, [-sense * Q * B * C, 0, 0], atol=1e-6 * Q * B * C)
    # The roller takes no vertical force: the base carries both weights, and both sum up.
    total = np.hypot(Q * B * C, 20.0)
    assert answer["total_reaction"].value == pytest.approx(total, rel=1e-6)


def test_three_rollers_lock_a_brick_and_two_leave_the_third_direction(stack):
    load = case(stack, weight=1.0)
    rollers = tuple(roller(stack, 1, -axis) for axis in (X, Y, Z))
    assert (
        analyse(stack, load=replace(load, held=rollers)).details.mechanism is MechanismClass.LOCKED
    )
    left = analyse(stack, load=replace(load, held=rollers[1:])).details
    motion = left.classification.certificate.virtual_displacement[0]
    assert left.mechanism is MechanismClass.NEUTRAL
    np.testing.assert_allclose(np.abs(motion), np.eye(6)[0], atol=1e-8)


def test_a_face_held_in_all_directions_is_a_fixed_block():
    """What lies on it is carried alike; the support takes weight and joint force of its brick."""
    pair = bricks(2)
    load = case(pair, weight=10.0)
    answer = analyse(pair, load=replace(load, held=(HeldFace(1, side(pair, 1, Y), name="clamp"),)))
    fixed = np.array([True, True, False])
    other = analyse(pair, load=replace(load, fixed=fixed))
    (joint,) = (j for j in answer.report["joints"] if j["blocks"] == [1, 2])
    (same,) = other.report["joints"]
    assert joint["normal_force"] == pytest.approx(same["normal_force"], rel=1e-9)
    force = answer.report["reactions"]["clamp"]["force"]
    np.testing.assert_allclose(force, [0, 0, 20.0], atol=1e-6)


def test_a_line_load_and_a_pressed_region_by_hand(stack):
    """Line load p along the upper edge at x = A/2 and a pressure on the top.

    A support along z under the brick takes it all: force and moment about the origin by statics.
    """
    top = stack.centroids[1] + 0.5 * np.array([A, B, C])
    p = np.array([0.0, 0.0, -2.0])
    line = LineLoad(np.array([1]), top - [0, B, 0], top, p)
    pressed = PressureLoad(np.array([1]), side(stack, 1, Z), Q)
    load = case(stack, pressed, lines=(line,), held=(roller(stack, 1, -Z),))
    answer = analyse(stack, load=load)
    found = next(iter(answer.report["reactions"].values()))
    forces = np.array([p * B, [0, 0, -Q * A * B]])
    points = np.array([top - [0, B / 2, 0], top - [A / 2, B / 2, 0]])
    np.testing.assert_allclose(found["force"], -forces.sum(axis=0), atol=1e-9 * Q * A * B)
    moment = np.cross(points, forces).sum(axis=0)
    np.testing.assert_allclose(found["moment"], -moment, atol=1e-9 * Q * A * B * A)
    assert answer.report["carried"]


def _triangles(blocks: AnyBlocks) -> bool:
    return not isinstance(blocks, Assembly)


def test_supports_turn_with_everything():
    """The problem in another frame has the same answer in that frame."""
    turn = Rotation.from_rotvec([0.3, -0.7, 0.5]).as_matrix()
    stack = bricks()
    held = (roller(stack, 1, -X), roller(stack, 1, Y))
    traction = Q * (X + 0.3 * Y)
    load = case(stack, push(stack, 1, X, traction), held=held, weight=10.0)
    turned = replace(
        stack,
        rotations=turn @ stack.rotations,
        translations=stack.translations @ turn.T,
        axis=turn @ stack.axis,
    )
    wrench = np.zeros((turned.n_blocks, 6))
    wrench[:, :3] = -10.0 * turn[:, 2]
    other = LoadCase(
        turned,
        "case",
        (TractionLoad(np.array([1]), _turned(side(stack, 1, X), turn), turn @ traction),),
        turned.fixed,
        tuple(
            HeldFace(1, _turned(h.face, turn), h.directions @ turn.T, name=f"{k}")
            for k, h in enumerate(held)
        ),
        body_wrenches=wrench,
    )
    first = list(analyse(stack, load=load).report["reactions"].values())
    second = list(analyse(turned, load=other).report["reactions"].values())
    for one, two in zip(first, second, strict=True):
        np.testing.assert_allclose(turn @ one["force"], two["force"], atol=1e-6)


@pytest.mark.parametrize(("tilt", "left"), [(1e-11, 0.0), (1e-6, 1e-5)])
def test_a_weight_that_a_roller_takes_is_no_load(stack, tilt, left):
    """Of weight W a roller at a small angle leaves W times the angle, or digits: no load."""
    along = np.array([[tilt, 0.0, 1.0]]) / np.hypot(tilt, 1.0)
    load = case(stack, held=(HeldFace(1, side(stack, 1, -Z), along),), weight=10.0)
    rows = contact_jacobian(stack, load.fixed, load.held).rows(load.wrenches)
    assert np.linalg.norm(rows[:3]) == pytest.approx(left, rel=1e-6, abs=0.0)


def _turned(plane: Plane, turn: np.ndarray) -> Plane:
    return Plane(turn @ plane.point, turn @ plane.normal)


def test_friction_limits_and_ranges_count_rollers():
    """A brick of weight W on a base with μ: a roller takes a push along x; along y μ W remains.

    The push along y acts at the base, so that the brick slides and does not tip.
    """
    stack, mu, weight = bricks(), 0.3, 100.0
    held = (roller(stack, 1, -X),)
    dead = case(stack, push(stack, 1, X, Q * X), held=held, weight=weight)
    live = np.zeros((stack.n_blocks, 6))
    arm = -0.5 * C
    live[1] = [0, 1, 0, *np.cross([0, 0, arm], Y)]
    contacts = contact_jacobian(stack, dead.fixed, dead.held)
    frictional = frictional_contacts(stack, contacts, mu)
    force = contacts.rows(dead.wrenches)
    along = contacts.rows(live)
    assert frictional_equilibrium(frictional, force).holds
    unheld = contact_jacobian(stack, dead.fixed)
    without = frictional_contacts(stack, unheld, mu)
    assert frictional_equilibrium(without, unheld.rows(dead.wrenches)).mechanism is not None
    collapse = collapse_load(frictional, force, along)
    assert collapse.certified
    assert collapse.factor == pytest.approx(mu * weight, rel=1e-5)
    np.testing.assert_allclose(collapse.mechanism[0], 0.0, atol=1e-9)
    sliding = sliding_collapse(frictional, force, along)
    assert sliding.certified
    assert sliding.factor == pytest.approx(mu * weight, rel=1e-5)
    shown = frictional_equilibrium(frictional, force).forces[:, 0]
    ranges = force_ranges(contacts, force, shown, frictional=in_space(frictional))
    np.testing.assert_allclose([ranges.least[0], ranges.largest[0]], weight, rtol=1e-5)


def test_resistance_to_pushes_counts_rollers(stack):
    load = case(stack, weight=10.0)
    free = Pushes(RigidSystem(Stated(stack, load))).held
    assert not free["+x"]
    held = replace(load, held=(roller(stack, 1, -X),))
    assert Pushes(RigidSystem(Stated(stack, held))).held["+x"]
    assert Pushes(RigidSystem(Stated(stack, held))).held["-x"]
    assert not Pushes(RigidSystem(Stated(stack, held))).held["+y"]
    contacts = contact_jacobian(stack, held.fixed, held.held)
    margin = interlocking_margin(contacts)
    assert np.isinf(margin.areas[0, 0]).all()
    assert margin.areas[0, 1].max() == 0.0


def test_names_of_faces_are_those_of_the_file(stack):
    if not _triangles(stack):
        pytest.skip("hexahedra have names")
    with pytest.raises(ValueError, match="has no face 'outer'; expected a plane or a box"):
        case(stack, held=(HeldFace(1, "outer"),))


def test_an_unnamed_support_is_called_by_its_region_in_six_digits() -> None:
    plane = Plane(np.array([0.1 + 0.2, -0.0, 1000.0 / 3.0]), np.array([0.0, 0.0, 1.0]))
    assert HeldFace(0, plane).title == "the plane through (0.3, 0, 333.333) normal to (0, 0, 1)"
