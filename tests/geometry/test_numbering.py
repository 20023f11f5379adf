"""The rigid answer does not depend on how a file numbers its hexahedra, nodes and elements."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.files.block_files import read_blocks
from geometry.loads import LoadCase
from geometry.mesh import (
    CUBE,
    FloatArray,
    HexMesh,
    boundary_quads,
    grid_points,
    structured_hexahedra,
)
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polygons import surface_of_polygons
from geometry.polyhedra.polyhedron import Polyhedron
from mbd import analyse
from tests.support.numberings import rotated_numberings

SIDE = 100.0


TURNS = rotated_numberings()


def wavy_block(cell: int, axis: int, size: float, seed: int, pieces: int = 2) -> HexMesh:
    """Cube ``cell`` along an axis, whose joints to the next ones are warped by up to ``size``."""
    line = np.linspace(0.0, 1.0, pieces + 1)
    nodes = grid_points(line, line, line)
    nodes[:, axis] += cell
    # One field for all blocks: neighbours have the same joint.
    phase = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, 3)
    wave = np.sin(5.0 * np.roll(nodes, 1, axis=1) + 7.0 * np.roll(nodes, 2, axis=1) + phase)
    return HexMesh(SIDE * nodes + size * wave, structured_hexahedra(pieces, pieces, pieces))


def renumbered(mesh: HexMesh, seed: int) -> HexMesh:
    """The same mesh: corners of each element turned, nodes and elements in another order."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(mesh.n_nodes)
    place = np.argsort(order)
    turn = TURNS[rng.integers(len(TURNS), size=mesh.n_elements)]
    elements = np.take_along_axis(place[mesh.elements], turn, axis=1)
    return HexMesh(mesh.nodes[order], rng.permutation(elements))


def own_blocks(meshes: list[HexMesh], held: tuple[int, ...] = (0, -1)) -> PolyhedralAssembly:
    """Blocks as the files of a user give them; some are fixed."""
    with TemporaryDirectory() as folder:
        shapes = []
        for k, mesh in enumerate(meshes):
            path = Path(folder) / f"block{k}.vtu"
            meshio.write(path, meshio.Mesh(mesh.nodes, [("hexahedron", mesh.elements)]))
            shapes += read_blocks(path)
    fixed = np.zeros(len(shapes), dtype=bool)
    fixed[list(held)] = True
    none = np.eye(3), np.zeros(3)
    assembly = polyhedral_assembly("own", [(shape, *none) for shape in shapes], fixed)
    check_assembly(assembly)
    return assembly


def weight(assembly: PolyhedralAssembly) -> LoadCase:
    wrench = np.zeros((assembly.n_blocks, 6))
    wrench[:, 2] = -1e-5 * assembly.volumes
    return LoadCase(assembly, "weight", (), assembly.fixed, body_wrenches=wrench)


@settings(max_examples=20, deadline=None)
@given(axis=st.integers(0, 2), size=st.sampled_from([0.02, 3.0, 12.0]), seed=st.integers(0, 10**6))
def test_the_answer_does_not_depend_on_the_numbering(axis: int, size: float, seed: int) -> None:
    meshes = [wavy_block(cell, axis, size, seed) for cell in range(3)]
    written = own_blocks(meshes)
    other = own_blocks([renumbered(mesh, seed + k) for k, mesh in enumerate(meshes)])
    assert other.interfaces.n_contacts == written.interfaces.n_contacts
    # The same points and triangles in another order: sums differ by round-off.
    np.testing.assert_allclose(other.volumes, written.volumes, rtol=1e-12)
    np.testing.assert_allclose(
        np.sort(other.interfaces.areas), np.sort(written.interfaces.areas), rtol=1e-9
    )
    first, second = (
        analyse(written, load=weight(written)).details,
        analyse(other, load=weight(other)).details,
    )
    assert first.mechanism is second.mechanism
    assert first.equilibrium.holds is second.equilibrium.holds


def test_patches_of_one_size_each_have_their_own_pressure() -> None:
    """However many there are in a joint: only what clipping left shares that of another."""
    interfaces = own_blocks([wavy_block(cell, 2, 0.5, 1, 4) for cell in range(2)], (0,)).interfaces
    areas = interfaces.patches.areas
    assert len(areas) > 20
    assert areas.min() > 0.5 * areas.mean()
    forces = np.random.default_rng(1).uniform(1.0, 2.0, interfaces.n_contacts)
    every = np.arange(interfaces.n_contacts)
    pressures = interfaces.patch_pressures(every, forces)
    np.testing.assert_allclose(pressures * areas, interfaces.of_patches(every, forces), rtol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_a_moved_shared_corner_is_one_joint_in_every_direction(axis: int) -> None:
    """Cut along one diagonal, the joint across x overlapped, and those across y and z differed."""
    meshes = []
    for cell in range(2):
        corners = SIDE * CUBE.astype(np.float64)
        corners[:, axis] += cell * SIDE
        shared = np.flatnonzero((corners == np.roll([SIDE, SIDE, SIDE], axis)).all(axis=1))
        corners[shared, axis] += 3.0
        meshes.append(HexMesh(corners, np.arange(8)[None]))
    # Four triangles round the middle of the joint, three corners each.
    assert own_blocks(meshes, (0,)).interfaces.n_contacts == 12


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6), warp=st.floats(1e-3, 0.4))
def test_a_warped_face_is_one_surface_from_every_corner(seed: int, warp: float) -> None:
    """As far as a bilinear patch goes: volume is that of the hexahedron, corner by corner."""
    rng = np.random.default_rng(seed)
    nodes = CUBE + warp * rng.uniform(-0.5, 0.5, (8, 3))
    quads = boundary_quads(HexMesh(nodes, np.arange(8)[None]))
    surfaces = [
        Polyhedron("hexahedron", *surface_of_polygons("hexahedron", nodes, [np.roll(quads, k, 1)]))
        for k in range(4)
    ]
    for surface in surfaces[1:]:
        np.testing.assert_allclose(_corner_rows(surface), _corner_rows(surfaces[0]), atol=1e-15)


def _corner_rows(surface: Polyhedron) -> FloatArray:
    rows = surface.corners.mean(axis=1)
    return rows[np.lexsort(np.round(rows, 9).T)]
