"""Blocks of meshes in memory: what files of the same meshes give, and what is rejected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import geometry
from geometry import DetectionOptions
from tests.support.face import RefusedError, polyhedral_assembly, read_blocks

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
    first = geometry.blocks([base, kinds[0]], fixed=[0], up=up)
    assert first.interfaces.areas.sum() == pytest.approx(SIZE**2)
    for kind in kinds:
        same = geometry.blocks([base, kind], fixed=[0], up=up)
        np.testing.assert_array_equal(same.points(1), first.points(1))
        np.testing.assert_array_equal(same.interfaces.centroids, first.interfaces.centroids)


def test_units_up_and_surfaces_that_face_inward() -> None:
    base, top = box(0.0, 0.0, 0.0), box(0.0, SIZE, 0.0)
    top.invert()
    for mesh in (base, top):
        mesh.apply_scale(1e-3)
    blocks = geometry.blocks([base, top], names=["base", "top"], fixed="base", units="m", up="y")
    np.testing.assert_allclose(blocks.volumes, SIZE**3)
    np.testing.assert_allclose(blocks.centroids, [[0, 0, 0], [0, 0, SIZE]], atol=1e-9 * SIZE)
    assert blocks.fixed.tolist() == [True, False]
    assert blocks.named(1) == "1 (top)"


def test_holes_are_closed_and_parts_are_blocks() -> None:
    base, top = box(0.0, 0.0, 0.0), box(0.0, 0.0, SIZE)
    top.update_faces(np.arange(len(top.faces)) != 3)
    mended = geometry.blocks([base, top], fixed=[0], repair=True)
    np.testing.assert_allclose(mended.volumes, SIZE**3)
    both = trimesh.util.concatenate([box(0.0, 0.0, 0.0), box(0.0, 0.0, SIZE)])
    parts = geometry.blocks([both], names=["pair"], fixed=["pair part 0"])
    assert parts.names == ("pair part 0", "pair part 1")


BASE, TOP = (box(0.0, 0.0, 0.0), box(0.0, 0.0, SIZE))
OPEN = TOP.copy()
OPEN.update_faces(np.arange(len(OPEN.faces)) != 3)


@pytest.mark.parametrize(
    ("meshes", "options", "words"),
    [
        (BASE, {}, "meshes: got a Trimesh; expected a list of meshes"),
        ([BASE, 3], {}, r"meshes\[1\]: got a int; expected a trimesh.Trimesh, a pyvista.PolyData"),
        ([BASE, (TOP.vertices, TOP.faces + 1)], {}, "a face has vertex 8; expected .* 0 to 7"),
        ([BASE, (TOP.vertices, TOP.faces + 0.5)], {}, r"meshes\[1\]: cannot be read"),
        ([BASE, (TOP.vertices[:, :2], TOP.faces)], {}, r"shape \(8, 2\); expected \(n, 3\)"),
        ([BASE, (TOP.vertices, [])], {}, r"meshes\[1\]: got no faces"),
        ([BASE, (np.nan * TOP.vertices, TOP.faces)], {}, r"meshes\[1\]: a vertex is not finite"),
        ([BASE, OPEN], {}, r"meshes\[1\]: the surface is open: 3 edges .* repair = true"),
        ([BASE, OPEN], {"names": ["low", "high"]}, r"meshes\[1\]: high: the surface is open"),
        ([BASE, TOP], {"names": ["a", "a"]}, "names: 'a' is there 2 times; expected each once"),
        ([BASE, TOP], {"names": ["a"]}, "names: got 1 for 2 meshes"),
        ([BASE, TOP], {"names": "ab"}, "names: got 'ab'; expected a list of names"),
        ([BASE, TOP], {"fixed": ()}, "no block is fixed"),
        ([BASE, TOP], {"fixed": [0, 1]}, "all 2 blocks are fixed"),
        ([BASE, TOP], {"fixed": [2]}, "fixed: got block 2, but there are 2 blocks"),
        ([BASE, TOP], {"fixed": [True, False]}, "fixed: got True; expected numbers or names"),
        ([BASE, TOP], {"fixed": "bse", "names": ["base", "top"]}, "got block 'bse', but names are"),
        ([BASE, TOP], {"units": "km"}, "units: got 'km'; expected one of mm, cm, m, inch"),
        ([BASE, TOP], {"up": "x"}, "up: got 'x'; expected 'y' or 'z'"),
        ([BASE, box(0.0, 0.0, 101.0)], {}, "block 1 touches no other block within 0.01 mm"),
        ([BASE, box(0.0, 0.0, 90.0)], {}, "blocks 0 and 1 overlap by 10 mm"),
        ([], {"fixed": ()}, "got no blocks"),
    ],
)
def test_bad_input_is_rejected_in_one_line(
    meshes: Any, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(RefusedError, match=words) as error:
        geometry.blocks(meshes, **{"fixed": [0]} | options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("options", [{"tolerance": -1.0}, {"angle": 90.0}, {"points": "middle"}])
def test_tolerances_are_checked_when_they_are_made(options: dict[str, Any]) -> None:
    (name,) = options
    with pytest.raises(RefusedError, match=f"{name}: got .*; expected"):
        DetectionOptions(**options)


@pytest.mark.parametrize("seed", range(5))
def test_meshes_in_memory_touch_where_those_of_a_file_do(seed: int, tmp_path: Path) -> None:
    meshes = stack(seed)
    here = geometry.blocks(meshes, fixed=[0])
    solids = read_blocks(write_obj(tmp_path / "stack.obj", meshes))
    placed = [(solid, np.eye(3), np.zeros(3)) for solid in solids]
    there = polyhedral_assembly("stack", placed, here.fixed)
    assert here.interfaces.n_contacts >= 4 * 4
    np.testing.assert_array_equal(here.interfaces.centroids, there.interfaces.centroids)
    np.testing.assert_array_equal(here.interfaces.areas, there.interfaces.areas)
    np.testing.assert_array_equal(here.centroids, there.centroids)
