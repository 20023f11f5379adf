"""Ranges of the joints' forces: statics by hand, friction, self-stress, the scene's answer."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog

from geometry.families.masonry import CircularArch, RunningBondWall, box
from geometry.families.platonic_layers import TetrahedraLayer
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium, newton_equilibrium
from mbd.limits.force_range import ForceRanges, force_ranges
from mbd.limits.plane import in_space, reduced
from mbd.options import FrictionLaw
from tests.support.commands import answered
from tests.verification.closed_forms import body_force

pytestmark = pytest.mark.quick

DOWN = np.array([0.0, 0.0, -1.0])


def _ranges(assembly: PolyhedralAssembly, load: FloatArray) -> ForceRanges:
    contacts = contact_jacobian(assembly)
    shown = newton_equilibrium(contacts.jacobian, load)
    assert shown.holds
    found = force_ranges(contacts, load, shown.forces)
    assert found is not None
    return found


def _table(supports: list[float], load_at: float) -> tuple[PolyhedralAssembly, FloatArray]:
    """A plank 100 long on narrow fixed blocks at x, 1 N pressing down at ``load_at``."""
    plank = box((100.0, 10.0, 10.0), "plank")
    places = [(plank, np.eye(3), np.zeros(3))]
    places += [
        (box((2.0, 10.0, 10.0), f"support {x:g}"), np.eye(3), np.array([x - 1.0, 0.0, -10.0]))
        for x in supports
    ]
    fixed = np.array([False, *[True] * len(supports)])
    assembly = polyhedral_assembly("table", places, fixed)
    contacts = contact_jacobian(assembly)
    arm = np.array([load_at, 5.0, 10.0]) - assembly.centroids[0]
    wrench = np.concatenate([DOWN, np.cross(arm, DOWN) / contacts.length])
    return assembly, wrench


def test_two_supports_leave_the_width_of_their_faces() -> None:
    # Pressure can move within each face of width 2: by the lever rule the left force is
    # (70 ± 1 - 40)/(70 ± 1 - 20 ∓ 1), at least 29/50 … (the corners that are nearest or farthest).
    found = _ranges(*_table([20.0, 70.0], 40.0))
    corners = [(right - 40.0) / (right - left) for left in (19.0, 21.0) for right in (69.0, 71.0)]
    np.testing.assert_allclose(found.least, [min(corners), 1 - max(corners)], rtol=1e-6)
    np.testing.assert_allclose(found.largest, [max(corners), 1 - min(corners)], rtol=1e-6)
    assert found.undetermined.all()


def test_a_third_support_takes_all_or_nothing() -> None:
    # Under the load itself it can carry everything; without it the other two do.
    found = _ranges(*_table([20.0, 40.0, 70.0], 40.0))
    assert found.least[1] == pytest.approx(0.0, abs=1e-7)
    assert found.largest[1] == pytest.approx(1.0, rel=1e-6)
    assert (found.least <= found.shown + 1e-9).all()
    assert (found.shown <= found.largest + 1e-9).all()


def test_a_stack_is_determined() -> None:
    shape = box((10.0, 10.0, 10.0))
    places = [(shape, np.eye(3), np.array([0.0, 0.0, 10.0 * k])) for k in range(4)]
    stack = polyhedral_assembly("stack", places, np.array([True, False, False, False]))
    found = _ranges(stack, body_force(stack, DOWN))
    # Each joint carries what stands on it, nothing else.
    np.testing.assert_allclose(found.least, [3000.0, 2000.0, 1000.0], rtol=1e-6)
    np.testing.assert_allclose(found.largest, found.least, rtol=1e-6)
    assert not found.undetermined.any()


def test_a_locked_layer_can_be_prestressed_without_bound() -> None:
    layer = TetrahedraLayer(50.0, 2, 2).build()
    found = _ranges(layer, body_force(layer, DOWN))
    assert found.unbounded.all()
    assert (found.least <= found.shown + 1e-9 * found.load).all()


@pytest.mark.parametrize("law", FrictionLaw)
@pytest.mark.parametrize("turn", [0.0, 20.0, 45.0])
def test_the_least_squeeze_of_a_block_between_two_walls(law: FrictionLaw, turn: float) -> None:
    """F/2μ in whatever direction F pulls; the pyramid, with edges along the axes, asks for more."""
    shape, mu = box((10.0, 10.0, 10.0)), 0.4
    places = [(shape, np.eye(3), np.array([10.0 * k, 0.0, 0.0])) for k in range(3)]
    row = polyhedral_assembly("row", places, np.array([True, False, True]))
    contacts = contact_jacobian(row)
    load = np.array([0.0, np.cos(np.radians(turn)), -np.sin(np.radians(turn)), 0.0, 0.0, 0.0])
    frictional = frictional_contacts(row, contacts, mu, law)
    shown = frictional_equilibrium(frictional, load).forces[:, 0]
    found = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    assert found is not None
    sheared = np.abs(load).sum() if law is FrictionLaw.PYRAMID else 1.0
    np.testing.assert_allclose(found.least, sheared / (2.0 * mu), rtol=1e-6)
    assert (found.least <= found.shown + 1e-6).all()
    assert found.unbounded.all()


def test_friction_widens_every_range() -> None:
    # Every state without friction is one with it.
    wall = RunningBondWall((200.0, 100.0, 80.0), 2, 2).build()
    contacts, load = contact_jacobian(wall), body_force(wall, DOWN)
    without = _ranges(wall, load)
    frictional = frictional_contacts(wall, contacts, 0.5)
    shown = frictional_equilibrium(frictional, load).forces[:, 0]
    found = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    assert found is not None
    slack = 1e-6 * found.load
    assert (found.least <= without.least + slack).all()
    assert (found.largest >= without.largest - slack).all()
    assert found.width.sum() > without.width.sum() + slack


def test_arch_ranges_are_thrust_lines() -> None:
    # The horizontal thrust of an arch in the plane lies in one interval; forces at the two
    # springings mirror each other.
    arch = CircularArch(1000.0, 150.0, 300.0, 7).build()
    contacts, load = contact_jacobian(arch), body_force(arch, DOWN)
    frictional = frictional_contacts(arch, contacts, 0.8)
    shown = frictional_equilibrium(frictional, load).forces[:, 0]
    found = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    assert found is not None
    np.testing.assert_allclose(found.least, found.least[::-1], rtol=1e-5)
    np.testing.assert_allclose(found.largest, found.largest[::-1], rtol=1e-5)
    # Joints press more towards the springings, whatever the state.
    half = found.least[:4]
    assert all(a > b for a, b in pairwise(half))


def test_ranges_in_the_plane_are_those_in_space() -> None:
    # The mean of a state and its mirror image is a state in the plane with the same joint forces.
    wall = RunningBondWall((200.0, 100.0, 80.0), 2, 2).build()
    contacts, load = contact_jacobian(wall), body_force(wall, DOWN + 0.1 * np.eye(3)[0])
    frictional = frictional_contacts(wall, contacts, 0.5, FrictionLaw.PYRAMID)
    shown = frictional_equilibrium(frictional, load).forces[:, 0]
    plane = reduced(wall, contacts, frictional, load)
    assert len(plane.rows) == 3 * len(contacts.free_blocks)
    space = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    flat = force_ranges(contacts, load, shown, frictional=plane)
    assert space is not None
    assert flat is not None
    slack = 1e-6 * space.load
    np.testing.assert_allclose(flat.shown, space.shown)
    np.testing.assert_allclose(flat.least, space.least, atol=slack)
    np.testing.assert_allclose(flat.largest, space.largest, atol=slack)


def test_the_solver_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    """What goes to standard output would be in the middle of ``--json -``."""
    arch = CircularArch(1000.0, 150.0, 300.0, 3).build()
    contacts, load = contact_jacobian(arch), body_force(arch, DOWN)
    frictional = frictional_contacts(arch, contacts, 0.8)
    shown = frictional_equilibrium(frictional, load).forces[:, 0]
    assert force_ranges(contacts, load, shown, frictional=in_space(frictional)) is not None
    assert capfd.readouterr() == ("", "")


def test_ranges_are_those_of_programs_from_scratch() -> None:
    """Each joint's range beside a linear program of its own, with scipy's HiGHS."""
    wall = RunningBondWall((200.0, 100.0, 80.0), 2, 2).build()
    contacts, load = contact_jacobian(wall), body_force(wall, DOWN + 0.1 * np.eye(3)[0])
    mu = 0.5
    frictional = frictional_contacts(wall, contacts, mu, FrictionLaw.PYRAMID)
    shown = frictional_equilibrium(frictional, load).forces[:, 0]
    found = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    assert found is not None
    n = frictional.n_contacts
    sides = np.array([[-mu, 1, 1], [-mu, 1, -1], [-mu, -1, 1], [-mu, -1, -1]])
    for k in range(len(found.least)):
        of = (contacts.block_m == found.block_m[k]) & (contacts.block_s == found.block_s[k])
        cost = np.kron(of.astype(np.float64), [1.0, 0.0, 0.0])
        for sign, value in ((1.0, found.least[k]), (-1.0, found.largest[k])):
            one = linprog(
                sign * cost,
                A_ub=sp.kron(sp.eye_array(n), sides).tocsr(),
                b_ub=np.zeros(4 * n),
                A_eq=frictional.matrix,
                b_eq=-load / found.load,
                bounds=[(None, None)] * (3 * n),
            )
            if np.isinf(value):
                assert one.status == 3  # unbounded
            else:
                assert found.load * sign * one.fun == pytest.approx(value, abs=1e-6 * found.load)


def test_no_admissible_state_has_no_ranges() -> None:
    shape = box((10.0, 10.0, 10.0))
    blocks = [(shape, np.eye(3), np.zeros(3)), (shape, np.eye(3), np.array([0.0, 0.0, 10.0]))]
    pair = polyhedral_assembly("pair", blocks, np.array([True, False]))
    contacts = contact_jacobian(pair)
    load = -body_force(pair, DOWN)
    assert force_ranges(contacts, load, np.zeros(len(contacts.index))) is None


def test_scene_answers_with_ranges_and_sliding(tmp_path: Path) -> None:
    scene = tmp_path / "wall.toml"
    scene.write_text(
        '[block]\ntype = "wall"\nsize = [200, 100, 80]\n[assembly]\ncolumns = 2\nrows = 2\n'
        "[effects]\ngravity = [0, 0, -9810]\n[load]\nacceleration = [981, 0, 0]\n"
        "[effects.friction]\ncoefficient = 0.6\n"
        "[rigid]\ncollapse = true\nsliding = true\nranges = true\n"
    )
    data, out = answered("mbd", str(scene))
    assert "statically indeterminate in" in out
    joints = data["ranges"]["joints"]
    assert data["ranges"]["undetermined"] > 0
    assert all(j["least"] <= j["least_norm"] + 1e-6 <= j["largest"] + 2e-6 for j in joints)
    sliding, collapse = data["sliding"], data["collapse"]
    assert sliding["certified"]
    # Sliding without dilation needs no more than limit analysis allows.
    assert sliding["factor"] <= collapse["factor"] * (1 + 1e-6)
    assert sliding["associated_factor"] == pytest.approx(collapse["factor"], rel=1e-6)
    assert np.asarray(sliding["mechanism"]).shape == (5, 6)


@pytest.mark.parametrize("wide", range(4))
def test_words_count_the_joints_that_have_a_range(wide: int) -> None:
    least, ends = np.ones(3), np.arange(3)
    largest = least + 0.5 * (ends < wide)
    found = ForceRanges(ends, ends + 1, least, largest, shown=least, load=1.0)
    assert found.as_json()["undetermined"] == wide
    (row,) = found.rows
    words = f"indeterminate in {wide} of 3 joints" if wide else "determinate of 3 joints"
    assert f"statically {words}" in str(row)
    assert ("minimum 1 N" in str(row)) == (wide > 0)
