"""Peaks of pressure and stress: exact where the state is, and in the right place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem.answer.forces import joints_of
from fem.answer.pressures import largest_pressure
from fem.contact.normals import ContactNormals
from fem.contact.surfaces import corner_overclosures
from fem.element.functions import FACET_VALUES
from fem.element.kinds import integration_points
from fem.problem import Problem
from fem.state import State
from fem.stresses.ball_averages import means_at_elements
from fem.stresses.recovery import principal_of, recover, recovered_of, stress_peaks
from geometry import Answer, Measure
from geometry.answer import TITLES, measure_rows
from tests.support.answers import on_its_mesh
from tests.support.own_blocks import column

PRESSURE = 0.5


@pytest.fixture(scope="module")
def pressed() -> Answer:
    """Three boxes of 100 × 80 mm under 0.5 MPa: uniaxial stress, the same pressure everywhere."""
    return on_its_mesh(column(PRESSURE), method="static")


@pytest.mark.parametrize("normals", ContactNormals)
def test_overclosures_at_corners_are_those_of_the_surfaces(normals: ContactNormals) -> None:
    """Flat facets that stay parallel to themselves: the gap is bilinear and n does not turn.

    Corners are moved along the normal alone, alike on both sides of a facet but for a gap that
    differs from corner to corner by less than 1e-9 of a side.
    """
    surfaces = replace(column(PRESSURE).problem, normals=normals).system.surfaces
    rng = np.random.default_rng(1)
    gap = 1e-8 * rng.standard_normal((surfaces.n_facets, 4))
    moved = np.zeros((surfaces.n_facets, 8, 3))
    moved[:, 4:] = gap[:, :, None] * surfaces.normals[:, :1]
    found = corner_overclosures(surfaces, moved)
    # Slopes of 1e-9 turn the normal by as much: relative changes of 1e-18, beside round-off.
    assert np.abs(found + gap).max() < 1e-13
    at_points = surfaces.overclosures(moved)
    assert np.abs(found @ FACET_VALUES.T - at_points).max() < 1e-13


def test_a_uniform_state_is_its_own_peak(pressed: Answer) -> None:
    found = pressed.measures
    # The static residual is 1e-8 of the load; a joint is as stiff as the boxes within tenfold.
    assert found["p_max_point"].value == pytest.approx(PRESSURE, rel=1e-6)
    assert found["p_max"].value == pytest.approx(PRESSURE, rel=1e-6)
    assert found["sigma_3_min"].value == pytest.approx(-PRESSURE, rel=1e-6)
    assert abs(found["sigma_1_max"].value) < 1e-6 * PRESSURE
    assert abs(found["sigma_1_averaged"].value) < 1e-6 * PRESSURE
    assert found["max_displacement"].value == pressed.details.largest_displacement
    where = found["max_displacement"].place
    assert where is not None
    assert where["blocks"] == [2]
    assert where["position"][2] == pytest.approx(160.0)
    assert where["face"] == "z+"


def test_joints_carry_the_load(pressed: Answer) -> None:
    joints = joints_of(pressed.details)
    assert joints.block_m.tolist() == [0, 1]
    assert joints.block_s.tolist() == [1, 2]
    # On the upper block: up, with the whole load; no moment about the middle of the joint.
    np.testing.assert_allclose(joints.areas, 8000.0, rtol=1e-12)
    np.testing.assert_allclose(joints.forces, 2 * [[0.0, 0.0, 4000.0]], atol=4000.0 * 1e-6)
    assert np.abs(joints.moments).max() < 4000.0 * 100.0 * 1e-6


def test_balls_average_over_the_part_in_the_block(pressed: Answer) -> None:
    """A constant stays; a linear field becomes its value at the ball's part in the block."""
    group = pressed.details.whole.bodies[0]
    points = integration_points(group.mesh, group.element)
    for radius in (1.0, 20.0, 60.0, 1e3):
        stress = np.zeros((1, len(points), 6))
        stress[0, :, 0], stress[0, :, 1] = 3.0, points[:, 2]
        centres, averaged = means_at_elements(group, stress, radius)
        np.testing.assert_allclose(averaged[..., 0], 3.0, rtol=1e-13)
        # A ball that holds the whole block averages to its middle, small ones to their centre.
        if radius == 1e3:
            np.testing.assert_allclose(averaged[..., 1], 25.0, rtol=1e-12)
        if radius == 1.0:
            np.testing.assert_allclose(averaged[0, :, 1], centres[:, 2], rtol=1e-12)


def test_a_block_that_flies_far_has_no_stress(pressed: Answer) -> None:
    """Of a flight of 1 km the mean is taken off first: sums of 2e6 mm times slopes of 0.1 / mm
    would leave 1e-16 of themselves, times 33 GPa some 1e-6 MPa."""
    group = pressed.details.whole.bodies[0]
    flight = np.full((group.n_copies, group.n_nodes, 3), 2.0**20)
    found = recover(group, flight, finite_rotation=True).stress
    assert np.abs(found).max() < 1e-9


@pytest.mark.parametrize(
    ("scene", "mesh"),
    [
        ("tsb1-pipe", ("mesh.around=24", "mesh.radial=2", "mesh.axial=4")),
        ("thb0-tunnel", ("mesh.edge=4", "mesh.radial=2")),
    ],
)
def test_blocks_of_one_kind_have_the_nodal_stresses_of_the_one_that_is_computed(
    scene: str, mesh: tuple[str, ...]
) -> None:
    """Those of each from its own displacements, turned and turned over."""
    state = on_its_mesh(scene, ("assembly.layers=2", *mesh), method="static").details
    shown, whole = state.whole.deformable_blocks, state.whole
    assert state.system.n_slots < len(shown)
    for block in shown.tolist():
        of_body = recovered_of(state)[whole.body_number[block]]
        expected = of_body.principal[whole.copy_of[block]]
        np.testing.assert_allclose(
            principal_of(state, block), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )


def averaged_over(radius: float, problem: Problem) -> Problem:
    """The problem with balls of that radius [mm]."""
    return replace(problem, material=replace(problem.material, averaging_radius=radius))


def test_a_bent_block_is_torn_where_it_bends_most() -> None:
    """Displacements of pure bending, σxx = E z / R: the peak is the integration point farthest out.

    Full integration sees the strain of the corner displacements exactly in the quadratic field's
    own x-direction: σ_xx at a Gauss point is E times the mean slope between its element's corners.
    """
    deformable = averaged_over(1e3, column(PRESSURE).problem).system
    group, radius = deformable.bodies[0], 1e6
    shape = [(g.n_copies, g.n_nodes, 3) for g in deformable.bodies]
    displacements = tuple(np.zeros(s) for s in shape)
    x = deformable.assembly.shapes[0].mesh.nodes
    displacements[0][0] = np.column_stack([x[:, 0] * x[:, 2], 0 * x[:, 0], 0 * x[:, 0]]) / radius
    found = stress_peaks(State(deformable.computed, deformable.computed.localised(displacements)))
    z = integration_points(group.mesh, group.element)[:, 2].max()
    # Beside ε_xx = z/R there is a shear x/R: σ₁ of the plane state with both.
    assert found.sigma_1.position[2] == pytest.approx(z, rel=1e-12)
    assert found.sigma_1.face is not None
    assert found.sigma_1.blocks == (0,)
    # The mean over the whole block: half the height, half the length in shear.
    tension, shear = 33e3 * 25.0 / radius, 16.5e3 * 50.0 / radius
    mean = tension / 2 + np.hypot(tension / 2, shear)
    assert found.sigma_1_averaged.value == pytest.approx(mean, rel=1e-9)


def test_no_mean_is_above_the_largest_tension() -> None:
    """Tension that grows towards one corner: Gauss points of large elements are far from it."""
    problem = column(PRESSURE).changed({"fem.degree": 2}).problem
    deformable = averaged_over(5.0, problem).system
    x = [g.mesh.nodes for g in deformable.bodies]
    along = [1e-9 * np.prod(nodes**2, axis=1)[:, None] * [1.0, 0.0, 0.0] for nodes in x]
    displacements = tuple(
        np.repeat(u[None], g.n_copies, axis=0)
        for u, g in zip(along, deformable.bodies, strict=True)
    )
    found = stress_peaks(State(deformable.computed, deformable.computed.localised(displacements)))
    assert 0.0 < found.sigma_1_averaged.value < found.sigma_1.value


def test_pressure_peaks_at_the_corner_that_is_pressed_most() -> None:
    """A block turned about one edge: the gap is linear, so the law is known at the far corners."""
    deformable = column(PRESSURE).problem.system
    turn = 1e-4
    displacements = tuple(np.zeros((g.n_copies, g.n_nodes, 3)) for g in deformable.bodies)
    for block in (1, 2):
        x = deformable.assembly.nodes(block)
        group, copy = deformable.body_number[block], deformable.copy_of[block]
        displacements[group][copy][:, 2] = -turn * x[:, 0]
    state = State(deformable.computed, deformable.computed.localised(displacements))
    law = deformable.contact.law
    peak = largest_pressure(state)
    assert peak is not None
    # Normals turned by 1e-4 change the gap by 1e-8 of itself; the law multiplies by 1 + X = 7.
    reach = float(deformable.assembly.nodes(1)[:, 0].max())
    assert peak.value == pytest.approx(float(law.pressure(reach * turn)), rel=1e-7)
    assert peak.value > 1.2 * state.contact_state.point_pressures.max()
    assert peak.position[0] == pytest.approx(reach)
    assert peak.blocks == (0, 1)


def test_values_print_the_digits_their_error_leaves() -> None:
    assert Measure(1.2345, "MPa", 0.0432).value_words == "1.234 ± 0.043 MPa"
    assert Measure(1.2345, "MPa", 0.3).value_words == "1.23 ± 0.30 MPa"
    assert Measure(123.45, "MPa", 23.0).value_words == "123 ± 23 MPa"
    assert Measure(0.5, "MPa").value_words == "0.5 MPa"
    # A bar far below the fifth digit is a share; the value has no more digits than anyone reads.
    assert Measure(0.0018906899, "mm", 7.5e-9).value_words == "0.0018907 mm ± 0.0004 %"
    # An error bar wider than 30 % of the value is no number to use.
    wide = Measure(1.2345, "MPa", 4.0).value_words
    assert wide == "not resolved on this mesh: 1.2 MPa ± 324 %"


def test_places_are_printed(pressed: Answer) -> None:
    text = str(pressed)
    assert "largest contact pressure at a point" in text
    assert "blocks 0 and 1," in text or "blocks 1 and 2," in text
    assert "layer" not in text, "layers are those of tubes"


def test_values_that_no_mesh_resolves_share_a_row() -> None:
    wide, grows = Measure(1.0, "MPa", 4.0), Measure(2.0, "MPa", remark="grows at this edge")
    known = {"p_max_point": wide, "p_max_facet": Measure(0.5, "MPa", 0.01)}
    shown = measure_rows(known | {"sigma_1_max": grows, "mises_max": grows})
    rows = {row.title: row.words for row in shown}
    assert list(rows) == [TITLES["p_max_facet"].words, "not resolved on this mesh"]
    both = f"{TITLES['sigma_1_max'].words}; {TITLES['mises_max'].words}: grows at this edge"
    assert rows["not resolved on this mesh"] == both
