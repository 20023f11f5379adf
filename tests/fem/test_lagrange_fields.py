"""Fields of curved blocks at any place, of every layer, and as Lagrange cells of ParaView."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from fem.accuracy.transfer import interpolation
from fem.element.lagrange import Lagrange, LagrangeMesh, with_degree
from fem.static.linear_step.grid_block import windows
from fem.stresses import ball_averages
from fem.stresses.ball_averages import MovedBodies, _Cells, _tension, averaged_tension
from fem.stresses.recovery import cells_of, grid_places
from fem.system.body import placed_body
from geometry.block import Places
from geometry.files.mesh_io import write_lagrange_cells
from geometry.mesh import FloatArray
from geometry.refinement import charts_of
from tests.support.blocks import random_rotation
from tests.support.commands import set_words
from tests.support.curved_blocks import CONCRETE, block

GRADIENT = 1e-4 * np.array([[1.0, 0.3, -0.2], [0.1, -0.5, 0.4], [0.0, 0.2, 0.7]])


def affine(degree: int) -> MovedBodies:
    """A constant displacement gradient in one block."""
    mesh = with_degree(block(), degree).mesh
    members = mesh.elements[:, [0, 4, 3, 7, 1, 5, 2, 6]]  # last direction fastest
    if isinstance(mesh, LagrangeMesh):
        members = mesh.members
    moved = (mesh.nodes @ GRADIENT.T)[None]
    return MovedBodies(Lagrange(degree), CONCRETE, mesh.nodes, members, moved)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_affine_fields_are_exact_at_any_place(degree: int) -> None:
    """One principal stress for all: round-off of a difference of coordinates over an element."""
    strain = 0.5 * (GRADIENT + GRADIENT.T)
    lame, shear = CONCRETE.lame_modulus, CONCRETE.shear_modulus
    stress = lame * np.trace(strain) * np.eye(3) + 2.0 * shear * strain
    expected = np.linalg.eigvalsh(stress)[::-1]
    state = affine(degree)
    first, second, third = np.indices((3, 9, 2)).reshape(3, -1)
    places = (np.linspace(0.0, 1.0, 9)[second], np.array([0.0, 0.3, 1.0])[first])
    at = Places(np.zeros(54, np.int64), np.column_stack([*places, np.array([0.5, 0.9])[third]]))
    shape = with_degree(block(), degree)
    assert charts_of(shape).elements.shape[0] == 1
    to = interpolation(shape, at)
    found = to @ state.displacements[0]
    assert found == pytest.approx((to @ shape.mesh.nodes) @ GRADIENT.T, abs=1e-14)
    cells = cells_of(state)
    assert cells.principal == pytest.approx(
        np.broadcast_to(expected, cells.principal.shape), abs=1e-9
    )
    assert cells.displacement[0] == pytest.approx(cells.positions @ GRADIENT.T, abs=1e-14)
    nodal = placed_body(shape.mesh, CONCRETE).nodal_stress(state.displacements)
    voigt = stress[[0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]]
    assert nodal == pytest.approx(np.broadcast_to(voigt, nodal.shape), abs=1e-9)


def box(counts: tuple[int, ...], size: float) -> MovedBodies:
    """A cube of a size at rest, cut into elements of degree two."""
    nodes = [np.linspace(0.0, size, 2 * n + 1) for n in counts]
    positions = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    numbers = np.arange(positions[..., 0].size).reshape(positions.shape[:3])
    flat = positions.reshape(-1, 3)
    elements = windows(numbers, counts, 2)
    return MovedBodies(Lagrange(2), CONCRETE, flat, elements, np.zeros((1, *flat.shape)))


@pytest.mark.parametrize(
    ("counts", "size"), [((1, 1, 1), 60.0), ((3, 4, 2), 60.0), ((1, 1, 1), 60e3)]
)
def test_tension_is_averaged_over_the_part_of_a_ball_in_the_body(
    counts: tuple[int, ...], size: float
) -> None:
    """Stress that grows along x is largest at the face x = 1; half, quarter and eighth balls there
    all have their centroid at 3/8 of the radius. Sums over cells of 0.3 and 0.15 of the radius are
    extrapolated with the square of their size: what is left is of the fourth power, 1 %.

    The Gauss points of one element are all farther from that face than the mean. An element may be
    thousands of balls wide: only its parts near those that are looked at closely are cut.
    """
    radius, growth = 10.0, 1e-6
    bodies = box(counts, size)
    bodies.displacements[0, :, 0] = 0.5 * growth * bodies.positions[:, 0] ** 2
    found, largest = averaged_tension(bodies, radius)
    slope = (CONCRETE.lame_modulus + 2.0 * CONCRETE.shear_modulus) * growth
    assert found.value == pytest.approx(slope * (size - 0.375 * radius), abs=0.01 * slope * radius)
    assert found.position[0] == pytest.approx(size)
    assert found.value < largest.value < slope * size


def renumbered(bodies: MovedBodies, seed: int) -> MovedBodies:
    """The same bodies: elements turned, elements and nodes in another order."""
    rng = np.random.default_rng(seed)
    line = bodies.element.degree + 1
    order = rng.permutation(len(bodies.positions))
    members = np.argsort(order)[rng.permutation(bodies.elements)].reshape(-1, line, line, line)
    turned = []
    for element in members:
        around, other = rng.permutation(3), rng.permutation(3)
        quarters = np.rot90(element, rng.integers(4), tuple(around[:2]))
        turned.append(np.rot90(quarters, rng.integers(4), tuple(other[:2])).ravel())
    nodes, moved = bodies.positions[order], bodies.displacements[:, order]
    return MovedBodies(bodies.element, CONCRETE, nodes, np.array(turned), moved)


@pytest.mark.parametrize("seed", range(4))
def test_the_largest_averaged_tension_does_not_depend_on_the_numbering(seed: int) -> None:
    """Round-off decides between equal places, whose values are equal."""
    bodies = box((2, 2, 2), 60.0)
    noise = np.random.default_rng(seed).standard_normal(bodies.displacements.shape)
    bodies.displacements[:] = 1e-3 * noise
    expected = averaged_tension(bodies, 15.0)[0].value
    for other in range(3):
        found = averaged_tension(renumbered(bodies, other), 15.0)[0].value
        assert found == pytest.approx(expected, rel=1e-9)


def test_a_bar_in_tension_is_looked_at_closely_at_some_places(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All places have the largest average; closer looks at each of them filled any memory.

    The first look, with cells of half a radius, is at the whole bar: no later one has more places.
    """
    looks = list[int]()

    def counted(cells: _Cells, centres: FloatArray, radius: float, size: float) -> FloatArray:
        looks.append(len(centres))
        assert looks[-1] <= max(looks[:2])
        return _tension(cells, centres, radius, size)

    monkeypatch.setattr(ball_averages, "_tension", counted)
    bodies = box((2, 2, 2), 60.0)
    bodies.displacements[:] = 1e-4 * bodies.positions * [1.0, 0.0, 0.0]
    found, largest = averaged_tension(bodies, 5.0)
    strain = 1e-4 * np.diag([1.0, 0.0, 0.0])
    stress = CONCRETE.lame_modulus * 1e-4 * np.eye(3) + 2.0 * CONCRETE.shear_modulus * strain
    assert found.value == pytest.approx(stress[0, 0], rel=1e-9)
    assert largest.value == pytest.approx(stress[0, 0], rel=1e-9)


@pytest.mark.parametrize("degree", [2, 3])
def test_lagrange_cells_hold_the_volume_of_the_block(degree: int, tmp_path: Path) -> None:
    """ParaView's cells are ours: each node in its place, the volume that of the exact shape.

    VTK splits a cell of degree k into k³ pieces of straight edges; round a sine of 20 mm with
    twelve pieces a wave that loses less than one per cent, a wrong order of nodes far more.
    """
    cells = cells_of(affine(degree))
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


def test_command_writes_fields_pictures_and_joints(tubelock) -> None:  # type: ignore[no-untyped-def]
    mesh = [f"mesh.{key}" for key in ("around=12", "radial=1", "axial=2")]
    settings = set_words(("assembly.layers=1", "fem.degree=2", *mesh))
    status, out, _ = tubelock("fem", "tsb1-pipe", *settings, "-o", "curved", "--fields")
    assert status == 0
    written = {path.name for path in Path("curved").iterdir()}
    assert {"fields.vtu", "stresses.png", "contact_pressures.vtu", "joints.csv"} <= written
    grid = pv.read("curved/fields.vtu")
    assert grid.n_cells == 4 * 24
    assert "fields" in out


@pytest.mark.parametrize("seed", range(3))
def test_balls_that_are_too_many_are_sought_by_larger_ones(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """The place is sought where larger balls have the most tension: the average there is the same.

    A stress that varies over the body has its largest average in the same place for any ball that
    is small in comparison. A distant point of an element is left out of boxes of near ones alone.
    """
    bodies = box((2, 2, 2), 60.0)
    rotation = random_rotation(seed)
    bodies.displacements[0] = 1e-6 * (bodies.positions @ rotation) ** 2 @ rotation.T
    expected = averaged_tension(bodies, 4.0)
    monkeypatch.setattr(ball_averages, "_MOST_CELLS", 1_000)
    monkeypatch.setattr(ball_averages, "_MOST_POINTS", 1_000)
    found = averaged_tension(bodies, 4.0)
    for one, other in zip(found, expected, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-6)
        assert one.position == pytest.approx(other.position, abs=1e-6)
