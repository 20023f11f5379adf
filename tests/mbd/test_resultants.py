"""The answer with friction is the one that is shown: forces, joints, field and words."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from fem import Problem, concrete
from geometry import Assembly
from geometry.families.masonry import CircularArch
from geometry.loads import LoadCase
from geometry.parts.measures import (
    JointResultants,
    SectionError,
    chain,
    joint_resultants,
    planes,
    sections_through_joints,
)
from geometry.polyhedra.polyhedron import convex_polyhedron
from mbd import analyse, contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from tests.support.answers import on_its_mesh
from tests.support.arch import ARCH, arch_run
from tests.support.assemblies import dovetail
from tests.support.commands import command, set_words
from tests.support.dome import voussoirs
from tests.support.own_blocks import column
from tests.support.rubbing import KINDS, drawn
from validation import load_case, solve

pytestmark = pytest.mark.quick


def test_normal_forces_of_an_arch_are_those_of_compas_cra() -> None:
    """Nine straight voussoirs of 20°, the outer two held: 1260, 995, 751, 607 N by its RBE solver.

    Both take the smallest contact forces; theirs lets joints pull at a price, so the last of the
    three digits may differ.
    """
    arch = CircularArch(1000.0, 200.0, 200.0, 7, embrace=140.0).build(pieces=1)
    contacts = contact_jacobian(arch)
    frictional = frictional_contacts(arch, contacts, 0.6)
    weight = np.zeros((7, 6))
    weight[:, 2] = -2.4e-9 * 9810.0 * arch.volumes[arch.free_blocks]
    found = frictional_equilibrium(frictional, weight.ravel())
    normals = arch.interfaces.normals[contacts.index]
    joints = joint_resultants(
        arch.interfaces, contacts.index, frictional.world(found.forces, normals)
    )
    theirs = np.array([1260.0, 995.0, 751.0, 607.0])
    np.testing.assert_allclose(joints.normal_force, [*theirs, *theirs[::-1]], rtol=5e-3)


def test_joint_resultants_balance_each_block() -> None:
    run = arch_run(0.6)
    assembly, joints = run.details.blocks, run.details.joints
    total = np.zeros((assembly.n_blocks, 6))
    total[:, :3] = run.details.load.wrenches[:, :3]
    for k, (m, s) in enumerate(zip(joints.block_m, joints.block_s, strict=True)):
        # The moment of a joint is that of its normal force at the point, and a twist.
        for block, sign in ((m, -1.0), (s, 1.0)):
            arm = joints.centroids[k] - assembly.centroids[block]
            total[block, :3] += sign * joints.forces[k]
            total[block, 3:] += sign * (joints.moments[k] + np.cross(arm, joints.forces[k]))
    free = ~assembly.fixed
    largest = float(joints.normal_force.max())
    # The solver's tolerance on the balance, relative to the load; an arm of the arch's size.
    assert np.abs(total[free, :3]).max() < 1e-6 * largest
    assert np.abs(total[free, 3:]).max() < 1e-6 * largest * 1100.0


def test_thrust_lies_in_the_joints_and_shear_in_the_cone() -> None:
    run = arch_run(0.6)
    joints = run.details.joints
    row = chain(joints)
    assert row is not None
    assert (joints.block_s[row[:-1]] == joints.block_m[row[1:]]).all()
    # Joints press and cannot pull: where they act lies within the thickness of 200 mm.
    radius = np.hypot(joints.points[:, 0], joints.points[:, 2])
    assert ((radius > 900.0) & (radius < 1100.0)).all()
    assert (joints.shear_force <= 0.6 * joints.normal_force * (1 + 1e-9)).all()
    # A mirror image: joints left and right carry the same.
    np.testing.assert_allclose(joints.normal_force, joints.normal_force[::-1], rtol=1e-6)


def test_eccentricity_is_where_a_single_force_acts() -> None:
    """A force of 5 N at (2, 3) of a joint in the plane z = 0, and a twist about it."""

    class One:
        block_m, block_s = np.array([0]), np.array([1])
        centroids, normals = np.array([[2.0, 3.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
        areas, n_contacts = np.array([4.0]), 1

    middle = np.array([[1.0, 1.0, 0.0]])
    joint = joint_resultants(One(), np.array([0]), np.array([[1.0, 0.0, 5.0]]), middle)
    np.testing.assert_allclose(joint.eccentricity, [[1.0, 2.0, 0.0]])
    np.testing.assert_allclose(joint.points, [[2.0, 3.0, 0.0]])
    assert joint.normal_force[0] == pytest.approx(5.0)
    assert joint.shear_force[0] == pytest.approx(1.0)
    assert joint.bending_moment[0] == pytest.approx(5.0 * np.hypot(1.0, 2.0))
    assert joint.twisting_moment[0] == pytest.approx(-2.0)  # x·f_y - y·f_x at (1, 2)


def joints_between(*pairs: tuple[int, int]) -> JointResultants:
    n, zero = len(pairs), np.zeros((len(pairs), 3))
    m, s = np.array(pairs).T
    upward = np.tile([0.0, 0.0, 1.0], (n, 1))
    return JointResultants(
        block_m=m,
        block_s=s,
        areas=np.ones(n),
        centroids=zero,
        normals=upward,
        forces=zero,
        moments=zero,
        pressing=np.zeros(n),
        along_faces=zero,
    )


def test_only_a_row_of_blocks_has_a_line() -> None:
    order = chain(joints_between((0, 2), (1, 3), (2, 3)))
    assert order is not None
    assert order.tolist() == [0, 2, 1]
    assert chain(joints_between((0, 1), (0, 2), (0, 3))) is None
    assert chain(joints_between((0, 1), (1, 2), (0, 2))) is None
    assert chain(joints_between((0, 1), (2, 3), (3, 4), (2, 4))) is None


def written_contacts(folder: Path, friction: float) -> meshio.Mesh:
    settings = set_words((*ARCH, f"effects.friction={friction}"))
    status, _, said = command("mbd", "arch", *settings, "--fields", "-o", str(folder))
    assert status == 0, said
    return meshio.read(folder / "contacts.vtu")


@pytest.mark.usefixtures("undrawn")
def test_the_field_that_is_written_carries_the_load(tmp_path: Path) -> None:
    """Before, it was that of the frictionless attempt, which failed."""
    run = arch_run(0.6)
    assert not run.details.equilibrium.holds
    mesh = written_contacts(tmp_path, 0.6)
    p = mesh.points[mesh.cells_dict["triangle"]]
    area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    on_first = mesh.cell_data["block_m"][0] == 0
    on_last = mesh.cell_data["block_s"][0] == run.details.blocks.n_blocks - 1
    traction = mesh.cell_data["patch_traction"][0]
    lifted = (area[on_first, None] * traction[on_first]).sum(axis=0)
    lifted -= (area[on_last, None] * traction[on_last]).sum(axis=0)
    weight = 2.4e-9 * 9810.0 * run.details.blocks.volumes[~run.details.blocks.fixed].sum()
    np.testing.assert_allclose(lifted, [0.0, 0.0, weight], atol=1e-5 * weight)
    answer = run.as_dict()
    assert answer["carried"]
    assert answer["answer"] == "carried with friction μ = 0.6 (without: not carried)"
    assert len(answer["joints"]) == 8
    keys = set(answer["joints"][0])
    pressed = on_its_mesh(column(0.01), method="static")
    motion = {"smallest_gap", "largest_gap", "largest_slip"}  # rigid blocks do not move
    assert set(pressed.as_dict()["joints"][0]) == keys | motion


@pytest.mark.usefixtures("undrawn")
def test_an_attempt_that_failed_is_no_field(tmp_path: Path) -> None:
    run = arch_run(0.05)
    assert "patch_pressure" not in written_contacts(tmp_path, 0.05).cell_data
    answer = run.as_dict()
    assert answer["answer"] == "not carried with friction μ = 0.05"
    assert answer["largest_contact_force"] is None
    assert answer["joints"] == []


def tube(scene: str, *more: str) -> dict[str, Any]:
    small = ("mesh.edge=2", "mesh.radial=1", "assembly.layers=2")
    return solve(load_case(scene, (*small, *more), method="rigid")).as_dict()


def test_a_tube_shows_the_answer_with_friction() -> None:
    answer = tube("thb0-tunnel", "effects.friction=0.6")
    assert answer["answer"] == "carried with friction μ = 0.6 (without: carried)"
    largest = answer["measures"]["p_max_facet"]["value"]
    assert 0.0 < answer["measures"]["p_max"]["value"] <= largest


def test_what_must_be_pressed_beforehand_has_forces_and_what_is_not_carried_has_none() -> None:
    """Rings in tension open: friction carries the load where something else presses the joints."""
    answer = tube("thb0-pipe", "effects.friction=0.6")
    assert answer["carried"]
    assert answer["answer"].startswith("carried if pressed beforehand (a hint, not proved)")
    assert answer["imbalance"]["force"] < 1e-6
    assert tube("thb0-pipe")["joints"] == []


def test_a_section_takes_moments_about_the_centre_of_its_joints_areas() -> None:
    """Areas 1 and 3 mm² at x = 0 and 8 mm: the centre is at 6 mm, equal forces of 2 N have arms of
    -6 and 2 mm."""
    joints = replace(
        joints_between((0, 1), (0, 2)),
        areas=np.array([1.0, 3.0]),
        centroids=np.array([[0.0, 0.0, 0.0], [8.0, 0.0, 0.0]]),
        forces=np.array([[0.0, 0.0, 2.0]] * 2),
    )
    centroids = np.array([[4.0, 0.0, -1.0], [0.0, 0.0, 1.0], [8.0, 0.0, 1.0]])
    found = sections_through_joints(joints, centroids, planes([4.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
    assert found.areas == pytest.approx([4.0])
    assert found.centroids[0] == pytest.approx([6.0, 0.0, 0.0])
    assert found.forces[0] == pytest.approx([0.0, 0.0, -4.0])  # on the part behind the plane
    assert found.moments[0] == pytest.approx([0.0, -8.0, 0.0])
    unknown = planes([4.0, 0.0, 0.0], [0.0, 0.0, 1.0], blocks=[99])
    with pytest.raises(SectionError, match=r"got blocks \[99\]; expected 0 to 2"):
        sections_through_joints(joints, centroids, unknown)


def test_a_dovetail_that_hangs_presses_on_both_of_its_flanks() -> None:
    """A lift of W: each flank carries W / 2 over the sine of its slope, 10 / √(10² + 25²)."""
    assembly = dovetail()
    lift = np.zeros((2, 6))
    lift[1, 2] = 10.0
    answer = analyse(assembly, load=LoadCase(assembly, "", (), assembly.fixed, body_wrenches=lift))
    assert answer["least_joint_force"].value == pytest.approx(10.0 * np.hypot(10, 25) / 10)
    assert answer.details.joints.shear_force[0] < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_without_friction_joints_have_neither_shear_nor_tension(kind: str) -> None:
    """Whatever their shape; what is left is the rounding of unit normals."""
    result = analyse(drawn(kind, np.random.default_rng(1))).details
    joints = result.joints
    assert (joints.normal_force >= 0.0).all()
    assert (joints.shear_force <= 1e-14 * result.n_contacts * (1.0 + joints.normal_force)).all()


def test_a_support_that_closes_on_itself_has_the_thrust_of_its_parts() -> None:
    """A dome on eight fixed blocks, and on one plate: what leads outwards on the plate is the sum
    of the thrusts of the eight, though together they are none."""
    blocks = voussoirs(120.0, 8, np.linspace(30.0, 90.0, 4))
    plate = np.array([(x, y, z) for x in (-2e3, 2e3) for y in (-2e3, 2e3) for z in (-100, 0)])
    dome = {name: block for name, block in blocks.items() if not name.startswith("base")}
    thrusts = []
    for base in (
        {name: block for name, block in blocks.items() if name.startswith("base")},
        {"base": convex_polyhedron("plate", plate.astype(np.float64))},
    ):
        both = dome | base
        assembly = Assembly.from_blocks(both.values(), names=list(both), fixed=list(base))
        problem = Problem(assembly, None, concrete, friction=0.7, gravity=(0.0, 0.0, -9810.0))
        reactions = analyse(problem).as_dict()["reactions"].values()
        thrusts.append([reaction["horizontal"] for reaction in reactions])
        total = sum(np.array(reaction["force"]) for reaction in reactions)
    assert len(thrusts[0]) == 8
    assert thrusts[1] == pytest.approx([sum(thrusts[0])], rel=1e-6)
    assert np.linalg.norm(total[:2]) < 1e-6 * thrusts[1][0]
    assert thrusts[1][0] > 0.1 * total[2]
