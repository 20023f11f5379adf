"""Blocks of meshes in memory: what files of the same meshes give, and what is rejected."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem import (
    LinearPenalty,
    Material,
    Problem,
    concrete,
    read_deck,
    solve_static,
    write_deck,
)
from geometry import (
    Assembly,
    HeldFace,
    LoadCase,
    Plane,
    TractionLoad,
    read_blocks,
)
from mbd import analyse
from tests.support.answers import PLAIN
from validation import load_case, solve

trimesh = pytest.importorskip("trimesh")

SIZE = 100.0


def box(*place: float, size: tuple[float, float, float] = (SIZE, SIZE, SIZE)) -> Any:
    """A box with its middle at a place [mm]."""
    made = trimesh.creation.box(size)
    made.apply_translation(place)
    return made


def stack(seed: int, layers: int = 4) -> list[Any]:
    """Boxes of random sizes on each other, moved and turned a little, the base first."""
    generator = np.random.default_rng(seed)
    meshes, floor = [box(0.0, 0.0, -10.0, size=(400.0, 400.0, 20.0))], 0.0
    for _ in range(layers):
        x, y, z = generator.uniform([80.0, 80.0, 20.0], [200.0, 200.0, 90.0])
        mesh = trimesh.creation.box((x, y, z))
        turn = trimesh.transformations.rotation_matrix(generator.uniform(-0.5, 0.5), (0, 0, 1))
        mesh.apply_transform(turn)
        mesh.apply_translation([*generator.uniform(-10.0, 10.0, 2), floor + 0.5 * z])
        # Exactly on each other, as boxes that were drawn so are.
        mesh.vertices[:, 2] = np.where(mesh.vertices[:, 2] < floor + 0.5 * z, floor, floor + z)
        meshes.append(mesh)
        floor += z
    return meshes


def write_obj(path: Path, meshes: list[Any]) -> Path:
    """All digits of all meshes, each as an object of its own."""
    lines, first = [], 1
    for k, mesh in enumerate(meshes):
        lines.append(f"o block {k}")
        lines += ["v " + " ".join(map(repr, row)) for row in mesh.vertices.tolist()]
        lines += ["f " + " ".join(map(str, row)) for row in (mesh.faces + first).tolist()]
        first += len(mesh.vertices)
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("up", ["y", "z"])
def test_every_kind_of_mesh_gives_the_same_blocks(up: Any) -> None:
    pyvista = pytest.importorskip("pyvista")
    compas = pytest.importorskip("compas.datastructures")
    base, top = box(0.0, 0.0, 0.0), box(0.0, 0.0, SIZE)
    flat = np.column_stack([np.full(len(top.faces), 3), top.faces]).ravel()
    kinds = [
        top,
        (top.vertices, top.faces),
        (top.vertices.tolist(), top.faces.tolist()),
        pyvista.PolyData(np.array(top.vertices), flat),
        compas.Mesh.from_vertices_and_faces(top.vertices.tolist(), top.faces.tolist()),
    ]
    first = Assembly.from_blocks([base, kinds[0]], fixed=[0], up=up)
    assert first.interfaces.areas.sum() == pytest.approx(SIZE**2)
    for kind in kinds:
        same = Assembly.from_blocks([base, kind], fixed=[0], up=up)
        np.testing.assert_array_equal(same.points(1), first.points(1))
        np.testing.assert_array_equal(same.interfaces.centroids, first.interfaces.centroids)


def test_units_up_and_surfaces_that_face_inward() -> None:
    base, top = box(0.0, 0.0, 0.0), box(0.0, SIZE, 0.0)
    top.invert()
    for mesh in (base, top):
        mesh.apply_scale(1e-3)
    blocks = Assembly.from_blocks(
        [base, top], names=["base", "top"], fixed="base", units="m", up="y"
    )
    np.testing.assert_allclose(blocks.volumes, SIZE**3)
    np.testing.assert_allclose(blocks.centroids, [[0, 0, 0], [0, 0, SIZE]], atol=1e-9 * SIZE)
    assert blocks.fixed.tolist() == [True, False]
    assert blocks.named(1) == "1 (top)"


def test_holes_are_closed_and_parts_are_blocks() -> None:
    base, top = box(0.0, 0.0, 0.0), box(0.0, 0.0, SIZE)
    top.update_faces(np.arange(len(top.faces)) != 3)
    mended = Assembly.from_blocks([base, top], fixed=[0], repair=True)
    np.testing.assert_allclose(mended.volumes, SIZE**3)
    both = trimesh.util.concatenate([box(0.0, 0.0, 0.0), box(0.0, 0.0, SIZE)])
    parts = Assembly.from_blocks([both], names=["pair"], fixed=["pair part 0"])
    assert parts.names == ("pair part 0", "pair part 1")


@pytest.mark.parametrize("seed", range(2))
def test_meshes_in_memory_give_the_answer_of_their_file(seed: int, tmp_path: Path) -> None:
    """Bit for bit: contacts, forces and measures of rigid blocks."""
    meshes = stack(seed)
    write_obj(tmp_path / "stack.obj", meshes)
    scene = tmp_path / "stack.toml"
    scene.write_text(
        '[block]\ntype = "mesh"\n[[parts]]\nfile = "stack.obj"\n[assembly]\nfixed = [0]\n'
        "[effects]\ngravity = [0, 0, -9810]\nfriction = 0.6\n"
    )
    there = solve(load_case(scene, method="rigid"))
    names = [f"block {k}" for k in range(len(meshes))]
    blocks = Assembly.from_blocks(meshes, names=names, fixed=[0])
    solids = Assembly.from_blocks(read_blocks(tmp_path / "stack.obj"), fixed="block 0")
    assert solids.names == blocks.names
    np.testing.assert_array_equal(solids.interfaces.centroids, blocks.interfaces.centroids)
    here = analyse(Problem(blocks, None, concrete, friction=0.6, gravity=(0, 0, -9810)))
    assert here["least_joint_force"].value > 0.0
    assert {k: m.as_json() for k, m in here.measures.items()} == {
        k: m.as_json() for k, m in there.measures.items()
    }
    assert list(here.contacts) == list(there.contacts)
    for name, values in here.contacts.items():
        np.testing.assert_array_equal(values, there.contacts[name])


def test_any_solid_deforms_as_that_of_its_file(tmp_path: Path) -> None:
    """A cone on a box: tetrahedra of degree 2, whichever door it comes through."""
    pytest.importorskip("gmsh")
    cone = trimesh.creation.cone(radius=30.0, height=50.0, sections=5)
    cone.apply_translation((0.0, 0.0, 0.5 * SIZE))
    meshes = [box(0.0, 0.0, 0.0), cone]
    write_obj(tmp_path / "cone.obj", meshes)
    scene = tmp_path / "cone.toml"
    scene.write_text(
        '[block]\ntype = "mesh"\n[[parts]]\nfile = "cone.obj"\n[assembly]\nfixed = [0]\n'
        "[mesh]\nsize = 60.0\n[effects]\ngravity = [0, 0, -9810]\n"
        '[fem]\nmesh = "scene"\nerror_estimate = false\n'
    )
    there = solve(load_case(scene, method="static"))
    blocks = Assembly.from_blocks(meshes, fixed=[0])
    problem = Problem(blocks, None, concrete, gravity=(0, 0, -9810), size=60.0)
    here = solve_static(problem, PLAIN)
    assert here.problem.degree == there.problem.degree == 2
    assert list(here.measures) == list(there.measures)
    for name, measure in here.measures.items():
        # Both solve one problem to a residual of 1e-8 of its load.
        assert measure.value == pytest.approx(there.measures[name].value, rel=1e-6)


SIX_LINES = re.search(
    r"```python\n(import trimesh.*?)```",
    (Path(__file__).parents[2] / "docs" / "tutorials" / "own-blocks.md").read_text("utf-8"),
    re.DOTALL,
)


def test_six_lines_of_the_manual_give_a_table_of_forces() -> None:
    pytest.importorskip("pandas")
    assert SIX_LINES is not None
    names: dict[str, Any] = {}
    exec(SIX_LINES[1], names)
    table, blocks = names["table"], names["blocks"]
    weight = concrete.density * 9810.0 * blocks.volumes[1]
    assert table[["block_m", "block_s"]].to_numpy().tolist() == [[0, 1], [1, 2]]
    np.testing.assert_allclose(table["force_z_N"], [2.0 * weight, weight], rtol=1e-9)
    np.testing.assert_allclose(table["pressure_MPa"], table["force_z_N"] / table["area_mm2"])


def test_solids_deform_and_are_written(tmp_path: Path) -> None:
    """One problem: both joints of a stack carry what lies on them, by every method."""
    blocks = Assembly.from_blocks([box(0.0, 0.0, k * SIZE) for k in range(3)], fixed=[0])
    stone = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.0)
    top = Plane(np.array([0.0, 0.0, 2.5 * SIZE]), np.array([0.0, 0.0, 1.0]))
    loads = (TractionLoad(np.array([2]), top, np.array([0.0, 0.0, -0.01])),)
    load = LoadCase(blocks, "pressed", loads, blocks.fixed)
    gravity = (0.0, 0.0, -9810.0)
    problem = Problem(blocks, load, stone, law=LinearPenalty(1e3), gravity=gravity, divisions=2)
    weight = stone.density * 9810.0 * SIZE**3
    expected = [0.01 * SIZE**2 + 2.0 * weight, 0.01 * SIZE**2 + weight]
    rigid, static = analyse(problem), solve_static(problem, PLAIN)
    for answer, tolerance in ((rigid, 1e-9), (static, 1e-6)):  # the residual is 1e-8 of the load
        lower = answer.contacts["blocks"].min(axis=1)
        total = [np.abs(answer.contacts["force"][lower == k].sum(axis=0)) for k in (0, 1)]
        np.testing.assert_allclose(np.array(total)[:, 2], expected, rtol=tolerance)
    assert static.problem.blocks.shapes[0].mesh.n_elements == 2**3
    read = read_deck(write_deck(problem, tmp_path / "stack.inp")).problem()
    assert read.blocks.n_blocks == 3
    again = solve_static(read, PLAIN)
    displacement = static["max_displacement"].value
    assert again["max_displacement"].value == pytest.approx(displacement, rel=1e-5)


def test_solids_on_springs_sink_by_their_weight() -> None:
    """p = ρ g h over the stiffness of the bed; nothing else is fixed."""
    blocks = Assembly.from_blocks([box(0.0, 0.0, 0.0), box(0.0, 0.0, SIZE)], fixed=None)
    floor = Plane(np.array([0.0, 0.0, -0.5 * SIZE]), np.array([0.0, 0.0, 1.0]))
    bed = HeldFace(0, floor, spring=0.1)
    load = LoadCase(blocks, "bed", (), blocks.fixed, held=(bed,))
    stiff = Material(density=2.4e-9, young_modulus=1e6, poisson_ratio=0.0)
    options: Any = {"law": LinearPenalty(1e6), "gravity": (0.0, 0.0, -9810.0), "divisions": 2}
    static = solve_static(Problem(blocks, load, stiff, **options), PLAIN)
    sinking = 2.0 * stiff.density * 9810.0 * SIZE / 0.1
    # The boxes themselves shorten by less than ρ g (2 h)² / E, the joint by p over its stiffness.
    give = stiff.density * 9810.0 * ((2.0 * SIZE) ** 2 / 1e6 + SIZE / 1e6)
    assert sinking <= static["max_displacement"].value <= sinking + give
