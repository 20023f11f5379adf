"""Section forces: equilibrium with the loads on one side of a plane, for every solver."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from fem import (
    CoulombFriction,
    Explicit,
    Frames,
    LinearPenalty,
    Material,
    Problem,
    Static,
    solve_explicit,
    solve_static,
)
from geometry import ColumnBox, LoadCase, RefusedError, box_column
from mbd import analyse
from tests.support.answers import PLAIN, on_its_mesh
from tests.support.arch import arch_run
from tests.support.coarse_tubes import keys
from tests.support.commands import answered
from tests.support.pressed_boxes import AREA, PRESSURE, SHEAR, STICK, boxes
from validation import load_case, read_answer, section, write

pytestmark = pytest.mark.quick

#: Residual of static runs over the load, tenfold.
NEAR = 1e-7


@pytest.mark.parametrize("degree", [1, 3])
def test_a_cantilever_has_its_shear_and_moment(degree) -> None:
    """A traction of -0.05 MPa on 40 × 60 mm at x = 400 mm: V and M = V (L - x), at nodes and
    between them; equations of a linear body are solved to round-off."""
    settings = {"mesh.divisions": [8, 2, 2], "fem.method": "static", "fem.degree": degree}
    run = on_its_mesh("cantilever", settings, method="static")
    x = np.array([1.0, 50.0, 130.0, 200.0, 399.0])
    points = np.column_stack([x, np.zeros(5), np.zeros(5)])
    found = section(run, points, [2.0, 0.0, 0.0])
    load = 0.05 * 40.0 * 60.0
    assert found.areas == pytest.approx(2400.0, rel=1e-9)
    np.testing.assert_allclose(found.centroids[:, 1:], [[20.0, 30.0]] * 5, rtol=1e-9)
    assert np.abs(found.normal_force).max() < 1e-9 * load
    np.testing.assert_allclose(found.shear_forces, [[0.0, -load]] * 5, atol=1e-9 * load)
    moments = np.column_stack([load * (400.0 - x), np.zeros(5)])
    np.testing.assert_allclose(found.bending_moments, moments, atol=1e-9 * load * 400.0)
    assert np.abs(found.twisting_moment).max() < 1e-9 * load * 400.0
    # A corner of legs of 0.5 mm.
    corner = section(run, [399.5, 40.0, 60.0], [1.0, 1.0, 1.0])
    assert corner.areas == pytest.approx(np.sqrt(3.0) / 2.0 * 0.5**2, rel=1e-9)
    # The part behind acts on the part ahead with the opposite forces.
    turned = section(run, points, [-1.0, 0.0, 0.0])
    np.testing.assert_allclose(turned.forces, -found.forces, atol=1e-9 * load)


def test_a_column_carries_the_weight_above() -> None:
    """At nodes and in the middle between them nodal shares of weight are those of the volume."""
    found = box_column([ColumnBox((100.0, 80.0, h), (2, 2, 4)) for h in (40.0, 80.0)])
    load = LoadCase(found, "weight", (), found.fixed.copy())
    material = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
    problem = Problem(found, load, material, gravity=(0.0, 0.0, -9810.0), frames=Frames.DEFORMABLE)
    answer = solve_static(problem, PLAIN)
    z = np.array([5.0, 20.0, 40.0, 50.0, 80.0, 110.0])
    points = np.column_stack([z * 0.0, z * 0.0, z])
    cut = section(answer, points, [0.0, 0.0, 1.0])
    weight = 2.4e-9 * 9810.0 * AREA
    np.testing.assert_allclose(cut.normal_force, -weight * (120.0 - z), rtol=NEAR)
    assert np.abs(cut.bending_moments).max() < NEAR * weight * 120.0 * 100.0
    rigid = section(analyse(problem), points[2], [0.0, 0.0, 1.0])
    assert rigid.normal_force[0] == pytest.approx(-weight * 80.0, rel=1e-6)


@pytest.mark.parametrize("frames", [Frames.RIGID, Frames.DEFORMABLE])
@pytest.mark.parametrize("search", [{}, {"finite_sliding": True, "upper": (3, 2, 2)}])
def test_friction_carries_the_shear_through_a_joint(search, frames) -> None:
    """Moments take the slip of the joint as an arm: N times 1.25e-3 mm."""
    friction = CoulombFriction(0.8, stick_stiffness=STICK)
    problem = boxes(poisson=0.2, shear=SHEAR, friction=friction, frames=frames, **search)
    method = Static(mesh="scene", load_steps=1, error_estimate=False)
    answer = solve_static(problem, method)
    z = np.array([50.0, 65.0, 70.0] if frames is Frames.RIGID else [20.0, 50.0, 65.0])
    cut = section(answer, np.column_stack([0.0 * z, 0.0 * z, z]), [0.0, 0.0, 1.0])
    load = PRESSURE * AREA
    np.testing.assert_allclose(cut.normal_force, -load, rtol=NEAR)
    expected = [[SHEAR * AREA, 0.0]] * 3
    np.testing.assert_allclose(cut.shear_forces, expected, atol=NEAR * load)
    moments = SHEAR * AREA * (80.0 - z)
    slip = 1.1 * SHEAR / STICK
    np.testing.assert_allclose(cut.bending_moments[:, 1], moments, atol=load * slip)


def test_sections_of_an_arch_are_in_equilibrium_with_the_blocks_between() -> None:
    """Between two joints a voussoir's weight, at its centre; horizontal thrust is one number."""
    run = arch_run(0.6)
    arch, angle = run.details.blocks, np.radians(np.arange(60.0, 121.0, 20.0))
    points = 1000.0 * np.column_stack([np.cos(angle), 0.0 * angle, np.sin(angle)])
    normals = np.column_stack([-np.sin(angle), 0.0 * angle, np.cos(angle)])
    # Planes through the centre cut both flanks: 60° those from the right springing on.
    right = [b for b in range(arch.n_blocks) if arch.centroids[b, 2] > 0.0]
    cut = section(run, points, normals, blocks=right)
    assert (cut.normal_force < 0.0).all()
    thrust = np.hypot(cut.points[:, 0], cut.points[:, 2])
    assert ((thrust > 900.0) & (thrust < 1100.0)).all()
    largest = np.abs(cut.normal_force).max()
    for k in range(3):
        inside = ((arch.centroids - points[k]) @ normals[k] > 0.0) & (
            (arch.centroids - points[k + 1]) @ normals[k + 1] < 0.0
        )
        block = int(np.flatnonzero(inside)[0])
        weight = np.array([0.0, 0.0, -2.4e-9 * 9810.0 * arch.volumes[block]])
        total = cut.forces[k + 1] - cut.forces[k] + weight
        assert np.abs(total).max() < 1e-6 * largest
        arms = cut.centroids[[k + 1, k]] - arch.centroids[block]
        moment = cut.moments[k + 1] - cut.moments[k]
        moment += np.cross(arms[0], cut.forces[k + 1]) - np.cross(arms[1], cut.forces[k])
        assert np.abs(moment).max() < 1e-6 * largest * 1100.0


def test_a_pillar_carries_the_same_rigid_and_static() -> None:
    settings = keys(2, 2)
    problem = load_case("tsb1-pillar", settings).problem
    rigid = section(analyse(problem), [0.0, 0.0, 200.0], [0.0, 0.0, 1.0])
    static = solve_static(problem, PLAIN)
    z = np.array([150.0, 100.0])
    cut = section(static, np.column_stack([0 * z, 0 * z, z]), [0.0, 0.0, 1.0])
    load = rigid.normal_force[0]
    assert cut.normal_force == pytest.approx(load, rel=NEAR)
    assert np.linalg.norm(cut.points[:, :2], axis=1).max() < NEAR * 120.0
    with pytest.raises(RefusedError, match="cuts block 0, which is rigid"):
        section(static, [0.0, 0.0, -50.0], [0.0, 0.0, 1.0])


def test_an_explicit_run_has_the_forces_of_its_end() -> None:
    """A damped run ends at a residual of 1e-4 of the load; tenfold."""
    friction = CoulombFriction(0.8, stick_stiffness=STICK)
    problem = boxes(shear=SHEAR, friction=friction, frames=Frames.DEFORMABLE, finite_sliding=True)
    cut = section(
        solve_explicit(problem, Explicit()),
        [[0, 0, 50], [0, 0, 65]],
        [0, 0, 1],
    )
    np.testing.assert_allclose(cut.normal_force, -PRESSURE * AREA, rtol=1e-3)
    np.testing.assert_allclose(cut.shear_forces[:, 0], SHEAR * AREA, rtol=1e-2)


SCENE = """
[block]
type = "boxes"
boxes = [
    {size = [100, 80, 50], divisions = [1, 1, 1]},
    {size = [100, 80, 60], divisions = [1, 1, 1]},
]
[load]
pressure = 0.5
[material]
density = 2.4e-9
young_modulus = 33000
poisson_ratio = 0.2
[fem]
method = "static"
degree = 1
[[sections]]
point = [0, 0, 50]
normal = [0, 0, 1]
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "pressed.toml"
    path.write_text(SCENE, "utf-8")
    return path


@pytest.mark.parametrize("command", ["fem", "mbd"])
@pytest.mark.usefixtures("undrawn")
def test_a_scene_names_its_sections(command, scene, tmp_path, tubelock) -> None:
    data, out = tmp_path / "data.json", tmp_path / "out"
    status, shown, _ = tubelock(command, str(scene), "-o", str(out), "--json", str(data))
    assert status == 0
    assert "section 1" in shown
    ignored = [line for line in shown.splitlines() if line.startswith("ignored")]
    assert not any("sections" in line for line in ignored)
    row = json.loads(data.read_text("utf-8"))["sections"][0]
    assert row["normal_force"] == pytest.approx(-4000.0, rel=1e-6)
    assert row["area"] == pytest.approx(8000.0, rel=1e-9)
    with (out / "section_forces.csv").open(newline="", encoding="utf-8") as file:
        found = next(csv.DictReader(file))
    assert float(found["normal_force_N"]) == row["normal_force"]
    assert float(found["bending_moments_2_Nmm"]) == row["bending_moments"][1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("point = [0, 0, 200]", "cuts nothing; expected a plane"),
        (
            "point = [0, 0, 50]\nblocks = [7]",
            "sections[0].blocks: got block 7, but there",
        ),
    ],
)
def test_planes_without_forces_are_rejected(change, words, scene, tubelock) -> None:
    scene.write_text(SCENE.replace("point = [0, 0, 50]", change), "utf-8")
    status, _, said = tubelock("fem", str(scene))
    assert status != 0
    assert words in said


def test_what_has_no_section_forces_says_so(tmp_path) -> None:
    answer = solve_static(boxes(), PLAIN)
    with pytest.raises(RefusedError, match=r"got blocks \[9\]"):
        section(answer, [0.0, 0.0, 50.0], [0.0, 0.0, 1.0], blocks=[9])
    write(answer, tmp_path)
    with pytest.raises(RefusedError, match="solve the problem again"):
        section(read_answer(tmp_path), [0.0, 0.0, 50.0], [0.0, 0.0, 1.0])


def test_a_box_between_two_rigid_ones_hangs_by_friction() -> None:
    """Its weight goes to both alike; a plane along the column passes through rigid blocks."""
    found = box_column([ColumnBox((100.0, 80.0, h), (2, 2, 2)) for h in (40.0, 60.0, 40.0)])
    load = LoadCase(found, "held", (), np.array([True, False, True]))
    material = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
    squeezed = Problem(
        found,
        load,
        material,
        law=LinearPenalty(200.0),
        clearance=-1e-3,
        friction=0.5,
        gravity=(0.0, -9810.0, 0.0),
    )
    answer = solve_static(squeezed, PLAIN)
    cut = section(answer, [[0, 0, 40], [0, 0, 70], [0, 0, 100]], [0, 0, 1])
    weight = 2.4e-9 * 9810.0 * AREA * 60.0
    # The part ahead pushes the part behind: below, the box hangs on the lower block.
    expected = weight * np.array([-0.5, 0.0, 0.5])
    squeeze = np.abs(cut.normal_force).max()
    np.testing.assert_allclose(cut.shear_forces[:, 1], expected, atol=NEAR * squeeze)
    with pytest.raises(RefusedError, match="cuts block 0, which is rigid"):
        section(answer, [0, 0, 70], [1, 0, 0])
    # Of the box alone: it is squeezed along the column, hardly across it.
    across = section(answer, [0, 0, 70], [1, 0, 0], blocks=[1])
    assert across.areas[0] == pytest.approx(80.0 * 60.0, rel=1e-9)
    assert abs(across.normal_force[0]) < 0.2 * squeeze


def test_friction_between_boxes_held_on_both_sides_of_a_plane() -> None:
    """Along a squeezed column, all boxes deform: supports and weights behind the plane are what the
    part ahead balances, friction across the joints included."""
    found = box_column([ColumnBox((100.0, 80.0, h), (2, 2, 2)) for h in (40.0, 60.0, 40.0)])
    load = LoadCase(found, "held", (), np.array([True, False, True]))
    material = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
    law, frames = LinearPenalty(200.0), Frames.DEFORMABLE
    squeezed = Problem(
        found, load, material, law=law, clearance=-1e-3, friction=0.5, frames=frames,
        gravity=(0.0, -9810.0, 0.0),
    )  # fmt: skip
    answer = solve_static(squeezed, PLAIN)
    cut, details = section(answer, [20.0, 0.0, 70.0], [1.0, 0.0, 0.0]), answer.details
    total, size = np.zeros(3), 0.0
    for group, held in zip(details.whole.bodies, details.support_forces, strict=True):
        force = held + group.lumped_mass[:, None] * np.array([0.0, -9810.0, 0.0])
        behind = group.reference_positions()[..., 0] < 20.0
        total, size = total + force[behind].sum(axis=0), size + np.abs(force).sum()
    assert np.abs(total).max() > 1e-3 * size
    np.testing.assert_allclose(cut.forces[0], -total, atol=NEAR * size)


def test_springs_to_the_ground_are_reactions(tmp_path, tubelock) -> None:
    """A bar on springs at one end, pulled at the other: a plane through the elements on springs
    carries the pull and no part of what the springs do."""
    text = """
    [block]
    type = "box"
    size = [400, 40, 60]
    [mesh]
    divisions = [8, 2, 2]
    [material]
    density = 2.4e-9
    young_modulus = 33000
    poisson_ratio = 0.2
    [load]
    "x+" = { traction = [0.3, 0, 0] }
    [fem]
    method = "static"
    degree = 1
    [[supports]]
    face = "x-"
    spring = 50.0
    [[sections]]
    point = [5, 0, 0]
    normal = [1, 0, 0]
    """
    (tmp_path / "bar.toml").write_text(text, "utf-8")
    row = answered("fem", str(tmp_path / "bar.toml"))[0]["sections"][0]
    assert row["normal_force"] == pytest.approx(0.3 * 2400.0, rel=1e-7)
    assert np.abs(row["bending_moments"]).max() < 1e-7 * 0.3 * 2400.0 * 400.0
