"""Fields of curved blocks at any place, of every layer, and as Lagrange cells of ParaView."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from fem.element.lagrange import LagrangeElement
from fem.element.lagrange_stress import MovedBodies, averaged_tension, grid_places
from fem.static.lagrange_block import face_pressure, windows
from fem.static.lagrange_fields import GridFields, every_layer, lagrange_cells
from fem.static.lagrange_tube import LayeredJoints, TubeState, solve_layered_tube
from geometry.files.mesh_io import write_lagrange_cells
from tests.test_fem_lagrange import CONCRETE, lattice
from tests.test_validation_accuracy import scene
from tests.test_validation_cli import tubelock  # noqa: F401 - fixture
from validation.run.curved.accuracy import Rung
from validation.run.curved.solve import Solved, solve_curved

GRADIENT = 1e-4 * np.array([[1.0, 0.3, -0.2], [0.1, -0.5, 0.4], [0.0, 0.2, 0.7]])


@pytest.fixture(scope="module")
def halved() -> Solved:
    """Two layers of TSB1, computed by one block."""
    tube = scene("tsb1-pipe", "assembly.layers=2")
    return solve_curved("tube", tube, Rung(2, 12, 1, 2, 1.0, 2.0).mesh(3))


def affine(degree: int) -> TubeState:
    """A constant displacement gradient in one layer."""
    block = lattice(degree)
    moved = (block.positions @ GRADIENT.T)[None]
    layered = LayeredJoints(1, ())
    return TubeState(block, layered, np.zeros(0), np.zeros(0), moved, 0, 0.0)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_affine_fields_are_exact_at_any_place(degree: int) -> None:
    """One principal stress for all: round-off of a difference of coordinates over an element."""
    strain = 0.5 * (GRADIENT + GRADIENT.T)
    lame, shear = CONCRETE.lame_modulus, CONCRETE.shear_modulus
    stress = lame * np.trace(strain) * np.eye(3) + 2.0 * shear * strain
    expected = np.linalg.eigvalsh(stress)[::-1]
    state = affine(degree)
    places = (np.array([0.0, 0.3, 1.0]), np.linspace(0.0, 1.0, 9), np.array([0.5, 0.9]))
    found = GridFields(state, places)
    positions = state.lattice.at(state.lattice.positions, places).reshape(-1, 3)
    assert found.displacement[0] == pytest.approx(positions @ GRADIENT.T, abs=1e-14)
    assert found.principal == pytest.approx(np.tile(expected, (1, 54, 1)), abs=1e-9)
    cells = lagrange_cells(state)
    assert cells.principal == pytest.approx(
        np.broadcast_to(expected, cells.principal.shape), abs=1e-9
    )
    assert cells.displacement[0] == pytest.approx(cells.positions @ GRADIENT.T, abs=1e-14)


@pytest.mark.parametrize("counts", [(1, 1, 1), (3, 4, 2)])
def test_tension_is_averaged_over_the_part_of_a_ball_in_the_body(counts: tuple[int, ...]) -> None:
    """Stress that grows along x is largest at the face x = 1; half, quarter and eighth balls there
    all have their centroid at 3/8 of the radius. Sums over cells of 0.3 and 0.15 of the radius are
    extrapolated with the square of their size: what is left is of the fourth power, 1 %.
    """
    size, radius, growth = 60.0, 10.0, 1e-6
    lines = tuple(np.linspace(0.0, size, n + 1) for n in counts)
    nodes = [LagrangeElement(2, CONCRETE).nodes_between(line) for line in lines]
    positions = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    numbers = np.arange(positions[..., 0].size).reshape(positions.shape[:3])
    moved = np.zeros_like(positions)
    moved[..., 0] = 0.5 * growth * positions[..., 0] ** 2
    elements = windows(numbers, counts, 2)
    flat = positions.reshape(-1, 3)
    bodies = MovedBodies(LagrangeElement(2, CONCRETE), flat, elements, moved.reshape(1, -1, 3))
    found = averaged_tension(bodies, radius)
    slope = (CONCRETE.lame_modulus + 2.0 * CONCRETE.shear_modulus) * growth
    assert found.value == pytest.approx(slope * (size - 0.375 * radius), abs=0.01 * slope * radius)
    assert found.position[0] == pytest.approx(size)


def test_the_upper_half_is_the_lower_one_turned(halved: Solved) -> None:
    """All layers computed: the same states up to the residual of Newton's method, 1e-9 of u."""
    tube, state = scene("tsb1-pipe", "assembly.layers=2"), halved.state
    assert state.layered.halved
    assert tube.contact is not None
    force = face_pressure(state.lattice, "inner", tube.load.pressure)
    layered = LayeredJoints(2, state.layered.turned)
    full = solve_layered_tube(state.lattice, layered, force, tube.contact.built)
    size = np.abs(full.displacements).max()
    assert every_layer(state) == pytest.approx(full.displacements, abs=1e-6 * size)


@pytest.mark.parametrize("degree", [2, 3])
def test_lagrange_cells_hold_the_volume_of_the_block(degree: int, tmp_path: Path) -> None:
    """ParaView's cells are ours: each node in its place, the volume that of the exact shape.

    VTK splits a cell of degree k into k³ pieces of straight edges; round a sine of 20 mm with
    twelve pieces a wave that loses less than one per cent, a wrong order of nodes far more.
    """
    cells = lagrange_cells(affine(degree))
    n_cells = len(cells.positions)
    file = tmp_path / "cells.vtu"
    moved = cells.displacement.reshape(-1, 3)
    data = {"displacement": moved}
    places = grid_places(degree)
    write_lagrange_cells(file, cells.positions, places, data, {"number": np.arange(n_cells)})
    grid = pv.read(file)
    assert set(grid.celltypes.tolist()) == {pv.CellType.LAGRANGE_HEXAHEDRON}
    assert np.asarray(grid.points) @ GRADIENT.T == pytest.approx(
        np.asarray(grid.point_data["displacement"]), abs=1e-12
    )
    exact = 0.5 * np.pi / 2.0 * (160.0**2 - 120.0**2) * 200.0
    assert grid.compute_cell_sizes()["Volume"].sum() == pytest.approx(exact, rel=0.01)


def test_command_writes_fields_pictures_and_joints(tubelock) -> None:  # type: ignore[no-untyped-def] # noqa: F811
    mesh = [f"mesh.{key}" for key in ("around=12", "radial=1", "axial=2")]
    settings = [
        word for key in ("assembly.layers=1", "fem.degree=2", *mesh) for word in ("--set", key)
    ]
    status, out, _ = tubelock("fem", "tsb1-pipe", *settings, "-o", "curved")
    assert status == 0
    written = {path.name for path in Path("curved").iterdir()}
    assert {"fields.vtu", "stresses.png", "contact_pressures.vtu", "joints.csv"} <= written
    grid = pv.read("curved/fields.vtu")
    assert grid.n_cells == 24
    assert "fields" in out
