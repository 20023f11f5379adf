from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fem import Problem, concrete
from fem.accuracy.ladder import PRESSURES, Rung, on_rung, split
from fem.element.hexahedron import gauss_gradients, mean_gradients
from fem.system.rows import (
    LoadError,
    SmoothStepAmplitude,
    TabularAmplitude,
    pressure_forces,
    traction_forces,
)
from geometry import ColumnBox, SineBlock, box_column, shaft, tube
from geometry.block import box_block
from geometry.families.boxes import BrickStack
from geometry.loads import CircumferentialLoad, LineLoad, LoadCase, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, QuadSurface, boundary_quads
from geometry.parts.regions import NodeForces
from tests.support.fem_problems import distorted_box, loaded_nodes

pytestmark = pytest.mark.quick


def test_pressure_on_an_element_s_surface_is_minus_p_times_dv_dx() -> None:
    """Divergence theorem: ∫ N_a n dA over the six warped faces is V B_a; both sides are exact."""
    mesh = distorted_box((1, 1, 1))
    mean, volume = mean_gradients(*gauss_gradients(mesh.nodes[mesh.elements]))
    forces = pressure_forces(mesh.nodes, boundary_quads(mesh), 2.5)
    assert forces[mesh.elements[0]] == pytest.approx(-2.5 * volume[0] * mean[0], abs=1e-14)


def test_pressure_totals_are_exact_and_a_closed_surface_is_in_equilibrium() -> None:
    mesh = distorted_box()
    quads = boundary_quads(mesh)
    closed = pressure_forces(mesh.nodes, quads, 3.0)
    assert abs(closed.sum(axis=0)).max() < 1e-13
    assert abs(np.cross(mesh.nodes, closed).sum(axis=0)).max() < 1e-12
    pressures = np.random.default_rng(0).normal(size=len(quads))
    total = pressure_forces(mesh.nodes, quads, pressures).sum(axis=0)
    exact = -pressures @ QuadSurface(mesh.nodes, quads).area_vectors
    assert total == pytest.approx(exact, abs=1e-13)


def test_traction_totals_on_planar_facets_and_of_all_copies() -> None:
    block = box_block((3.0, 2.0, 1.0), (3, 2, 2))
    traction = np.array([1.0, -2.0, 0.5])
    forces = traction_forces(block.mesh.nodes, block.faces["x+"], traction)
    assert forces.sum(axis=0) == pytest.approx(2.0 * traction, rel=1e-14)
    # The resultant of a uniform traction acts at the centroid of the face.
    moment = np.cross(block.mesh.nodes, forces).sum(axis=0)
    assert moment == pytest.approx(np.cross([3.0, 1.0, 0.5], 2.0 * traction), rel=1e-13)
    rng = np.random.default_rng(1)
    copies = block.mesh.nodes + 0.1 * rng.normal(size=(3, block.mesh.n_nodes, 3))
    quads = block.faces["z-"]
    for load, value in ((pressure_forces, 0.7), (traction_forces, traction)):
        together = load(copies, quads, value)
        for copy in range(3):
            alone = load(copies[copy], quads, value)
            assert together[copy] == pytest.approx(alone, abs=1e-14)


def test_circumferential_traction_has_constant_size_and_runs_counter_clockwise() -> None:
    tube = BrickStack((1.0, 1.0, 1.0), (1, 1, 1), columns=1, layers=1).build()
    about = replace(tube, origin=np.array([1.0, 2.0, 3.0]), axis=np.array([0.0, 0.0, 1.0]))
    points = np.array([[3.0, 2.0, 9.0], [1.0, 7.0, 0.0]])
    load = CircumferentialLoad(np.array([1]), "outer", 0.01)
    assert load.tractions(about, points) == pytest.approx(
        np.array([[0.0, 0.01, 0.0], [-0.01, 0.0, 0.0]]), abs=1e-17
    )


def _resultant(problem: Problem) -> FloatArray:
    """Force and moment about the origin of all nodal forces, (6,) [N, N mm]."""
    at, forces = loaded_nodes(problem.system)
    return np.concatenate([forces.sum(axis=0), np.cross(at, forces).sum(axis=0)])


SINE = SineBlock(
    height=160.0,
    amplitude=16.0,
    frequency=1.5,
    blocks_per_layer=4,
    inner_radius=190.0,
    thickness=32,
)
FORCE = np.array([30.0, -40.0, 50.0])


def test_a_force_and_a_moment_have_the_resultant_that_was_stated_on_every_mesh() -> None:
    """On a curved face and on a block as a whole: other meshes have other areas and centroids."""
    blocks = tube(SINE, layers=1, mesh=(12, 1, 4))
    one = blocks.free_blocks[:1]
    area = QuadSurface(blocks.nodes(int(one[0])), blocks.shape(int(one[0])).faces["outer"]).areas
    spread = (TractionLoad(one, "outer", FORCE / area.sum(), force=FORCE),)
    wrenches = np.zeros((blocks.n_blocks, 6))
    wrenches[one] = [*FORCE, 700.0, 800.0, 900.0]
    about = np.cross(blocks.centroids[one[0]], FORCE) + wrenches[one[0], 3:]
    on_face = LoadCase(blocks, "force", spread, blocks.fixed)
    whole = LoadCase(blocks, "wrench", (), blocks.fixed, body_wrenches=wrenches)
    for rung in (None, *PRESSURES[:3]):
        face, body = (Problem(blocks, load, concrete) for load in (on_face, whole))
        if rung is not None:
            face, body = (on_rung(problem, rung) for problem in (face, body))
        assert _resultant(face)[:3] == pytest.approx(FORCE, rel=1e-12)
        assert _resultant(body) == pytest.approx(np.concatenate([FORCE, about]), rel=1e-10)


@pytest.mark.parametrize("around", [12, 24])
def test_the_torque_of_a_traction_around_the_axis_is_that_of_the_cylinder(around: int) -> None:
    """2π r² h p on curved elements, to the sixth power of the half angle φ of a facet.

    Straight facets lie inside: less by φ²/2 and below it.
    """
    problem = Problem(tube(SINE, layers=1, mesh=(around, 1, 4)), shaft(0.01), concrete)
    exact = 0.01 * 2.0 * np.pi * SINE.outer_radius**2 * SINE.height
    half = np.pi / (SINE.blocks_per_layer * around)
    straight = _resultant(problem)[5] / exact
    assert 1.0 - 0.5 * half**2 * 1.01 < straight < 1.0 - 0.49 * half**2
    for curved in (replace(problem, degree=2), *(on_rung(problem, r) for r in PRESSURES[:3])):
        assert _resultant(curved)[5] == pytest.approx(exact, rel=2e-6)


def test_loads_on_flat_faces_have_one_resultant_on_every_mesh() -> None:
    """Pressure, traction, line, node: half-space sums by hand, about the origin."""
    column = box_column([ColumnBox((60.0, 40.0, 30.0), (2, 2, 2))] * 2)
    top, corner = np.array([1]), np.array([[30.0, 20.0, 60.0]])
    faces = (PressureLoad(top, "z+", 0.5), TractionLoad(top, "x+", FORCE / 1000.0))
    line = LineLoad(top, np.array([-30.0, 20.0, 60.0]), corner[0], FORCE / 60.0)
    node = NodeForces(top, corner, FORCE[None])
    load = LoadCase(column, "all", faces, column.fixed, lines=(line,), nodes=(node,))
    parts = [
        (np.array([0.0, 0.0, -0.5 * 60.0 * 40.0]), [0.0, 0.0, 60.0]),
        (FORCE * 40.0 * 30.0 / 1000.0, [30.0, 0.0, 45.0]),
        (FORCE, [0.0, 20.0, 60.0]),
        (FORCE, corner[0]),
    ]
    exact = sum(np.concatenate([force, np.cross(at, force)]) for force, at in parts)
    problem = Problem(column, load, concrete)
    for other in (problem, split(problem, 2, 1), split(problem, 1, 3)):
        assert _resultant(other) == pytest.approx(exact, rel=1e-11)
    skew = on_rung(replace(problem, load=replace(load, lines=(), nodes=())), Rung(3, 5, 2, 3, 2, 9))
    assert _resultant(skew) == pytest.approx(
        sum(np.concatenate([force, np.cross(at, force)]) for force, at in parts[:2]), rel=1e-11
    )


def test_bad_loads_are_refused_by_name() -> None:
    mesh = distorted_box((1, 1, 1))
    quads = boundary_quads(mesh)
    with pytest.raises(LoadError, match="pressure"):
        pressure_forces(mesh.nodes, quads, float("nan"))
    with pytest.raises(LoadError, match="pressure: got shape"):
        pressure_forces(mesh.nodes, quads, np.zeros(len(quads) + 1))
    with pytest.raises(LoadError, match="traction"):
        traction_forces(mesh.nodes, quads, np.zeros(2))
    with pytest.raises(LoadError, match="amplitude"):
        SmoothStepAmplitude(0.0)
    with pytest.raises(LoadError, match="increasing"):
        TabularAmplitude((0.0, 0.0), (1.0, 2.0))
    with pytest.raises(LoadError, match="as many"):
        TabularAmplitude((0.0, 1.0), (1.0,))


@given(st.floats(1e-6, 1e3), st.floats(-10.0, 10.0), st.floats(0.0, 1.0))
def test_smooth_step_rises_monotonically_symmetrically_and_flat_at_both_ends(
    duration: float, start: float, xi: float
) -> None:
    """a(xi) + a(1 - xi) = 1, a' = 30 xi² (1 - xi)²: checked by finite differences."""
    step = SmoothStepAmplitude(duration)
    h = 1e-4
    low, high = max(xi - h, 0.0), min(xi + h, 1.0)
    # Time xi · duration in units of duration loses an eps or two.
    assert step(xi * duration) + step((1.0 - xi) * duration) == pytest.approx(1.0, abs=1e-14)
    slope = (step(high * duration) - step(low * duration)) / (high - low)
    middle = 0.5 * (low + high)
    # Third derivative below 60: central differences are within 60 h² / 6, round-off 1e-15 / h.
    assert slope == pytest.approx(30.0 * middle**2 * (1.0 - middle) ** 2, abs=2e-7)
    later = SmoothStepAmplitude(duration, start)
    assert later(start - 1.0) == 0.0
    assert later(start + 2.0 * duration) == 1.0


def test_amplitudes_of_tables() -> None:
    ramp = TabularAmplitude((1.0, 3.0), (0.0, 1.0))
    assert [ramp(t) for t in (0.0, 1.0, 2.0, 3.0, 9.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    table = TabularAmplitude((0.0, 1.0, 3.0), (0.0, 2.0, -2.0))
    assert [table(t) for t in (-1.0, 0.5, 2.0, 4.0)] == [0.0, 1.0, 0.0, -2.0]
