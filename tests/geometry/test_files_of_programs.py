"""Blocks of 3MF, Rhino and OBJ files: as many, in the order and with the names of the file."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.files.block_files import read_blocks
from geometry.files.readers import left_out
from geometry.mesh import MeshError
from tests.support.drawn_blocks import BOX, Drawn, cuboid, triangles_of, write_obj

pytestmark = pytest.mark.quick

_INCH = 25.4


def _mesh(drawn: Drawn) -> str:
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in drawn[0].tolist())
    faces = triangles_of(drawn).tolist()
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    return f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"


def _write_3mf(path: Path, objects: str, items: str) -> None:
    core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    model = f'<model unit="inch" xmlns="{core}"><resources>{objects}</resources><build>{items}'
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", f"{model}</build></model>")


_PIER, _LINTEL = cuboid((0, 0, 0), (4, 4, 8)), cuboid((0, 0, 0), (20, 4, 4))
_OBJECTS = (
    f'<object id="1" name="pier">{_mesh(_PIER)}</object>'
    f'<object id="2" type="model" name="lintel">{_mesh(_LINTEL)}</object>'
    f'<object id="9" type="support" name="scaffold">{_mesh(_PIER)}</object>'
)


def _at(kind: str, number: int, place: str, turn: str = "1 0 0 0 1 0 0 0 1") -> str:
    return f'<{kind} objectid="{number}" transform="{turn} {place}"/>'


def test_blocks_of_3mf_follow_the_build_items_and_supports_are_none(tmp_path: Path) -> None:
    mirrored = "-1 0 0 0 1 0 0 0 1"
    items = [(1, "0 0 0"), (9, "8 0 0"), (2, "0 0 8")]
    built = "".join(_at("item", *item) for item in items) + _at("item", 1, "20 0 0", mirrored)
    _write_3mf(tmp_path / "a.3mf", _OBJECTS, built)
    blocks = read_blocks(tmp_path / "a.3mf")
    assert [block.given_name for block in blocks] == ["pier", "lintel", "pier 2"]
    assert left_out(tmp_path / "a.3mf") == ["scaffold (its type is support)"]
    lows = [block.points.min(axis=0) for block in blocks]
    np.testing.assert_allclose(lows, _INCH * np.array([[0, 0, 0], [0, 0, 8], [16, 0, 0]]))
    volumes = [block.volume for block in blocks]
    np.testing.assert_allclose(volumes, _INCH**3 * np.array([128, 320, 128]))


def test_components_of_3mf_are_placed_by_all_matrices_above_them(tmp_path: Path) -> None:
    parts = _at("component", 1, "0 0 0") + _at("component", 2, "0 0 8")
    frame = f'<object id="3"><components>{parts}</components></object>'
    quarter = "0 1 0 -1 0 0 0 0 1"  # x to y: rows are what the axes become
    _write_3mf(tmp_path / "a.3mf", _OBJECTS + frame, _at("item", 3, "100 50 0", quarter))
    pier, lintel = read_blocks(tmp_path / "a.3mf")
    np.testing.assert_allclose(pier.points.min(axis=0), _INCH * np.array([96, 50, 0]))
    np.testing.assert_allclose(lintel.points.max(axis=0), _INCH * np.array([100, 70, 12]))


def test_circles_of_3mf_components_get_one_line(tmp_path: Path) -> None:
    circle = f'<object id="4"><components>{_at("component", 4, "0 0 0")}</components></object>'
    _write_3mf(tmp_path / "a.3mf", circle, _at("item", 4, "0 0 0"))
    with pytest.raises(MeshError, match="contain each other"):
        read_blocks(tmp_path / "a.3mf")


def _rhino_mesh(rhino3dm: Any, drawn: Drawn) -> Any:
    mesh = rhino3dm.Mesh()
    for point in drawn[0].tolist():
        mesh.Vertices.Add(*point)
    for face in BOX:
        mesh.Faces.AddFace(*face)
    return mesh


def test_instances_of_rhino_are_placed_where_they_stand(tmp_path: Path) -> None:
    rhino3dm = pytest.importorskip("rhino3dm")
    file = rhino3dm.File3dm()
    file.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Meters

    def define(name: str, *geometry: Any) -> Any:
        attributes = tuple(rhino3dm.ObjectAttributes() for _ in geometry)
        file.InstanceDefinitions.Add(
            name, "", "", "", rhino3dm.Point3d(0, 0, 0), geometry, attributes
        )
        return next(one.Id for one in file.InstanceDefinitions if one.Name == name)

    def instance(definition: Any, x: float, z: float = 0.0) -> Any:
        moved = rhino3dm.Transform.Translation(x, 0, z)
        return rhino3dm.InstanceReference(definition, moved)

    pier = define("pier", _rhino_mesh(rhino3dm, cuboid((0, 0, 0), (0.1, 0.1, 0.2))))
    pair = define("pair", instance(pier, 0.0), instance(pier, 0.4))
    file.Objects.AddInstanceObject(instance(pair, 1.0))
    file.Objects.AddInstanceObject(instance(pier, 2.0, 0.5))
    file.Write(str(tmp_path / "a.3dm"), 7)
    blocks = read_blocks(tmp_path / "a.3dm")
    lows = [block.points.min(axis=0) for block in blocks]
    # Rhino's meshes are of single precision.
    np.testing.assert_allclose(lows, [[1000, 0, 0], [1400, 0, 0], [2000, 0, 500]], atol=1e-3)
    assert len({block.given_name for block in blocks}) == 3


def test_what_rhino_hides_is_left_out_with_a_line(tmp_path: Path) -> None:
    rhino3dm = pytest.importorskip("rhino3dm")
    file = rhino3dm.File3dm()
    file.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    layers = {}
    for name, above, shown in (("on", None, True), ("off", None, False), ("below", "off", True)):
        layer = rhino3dm.Layer()
        layer.Name, layer.Visible = name, shown
        if above is not None:
            layer.ParentLayerId = file.Layers[layers[above]].Id
        layers[name] = file.Layers.Add(layer)
    for k, (name, layer) in enumerate((("a", "on"), ("b", "off"), ("c", "below"), ("d", "on"))):
        of = rhino3dm.ObjectAttributes()
        of.Name, of.LayerIndex = name, layers[layer]
        if name == "d":
            of.Mode = rhino3dm.ObjectMode.Hidden
        box = cuboid((20 * k, 0, 0), (20 * k + 10, 10, 10))
        file.Objects.AddMesh(_rhino_mesh(rhino3dm, box), of)
    file.Write(str(tmp_path / "a.3dm"), 7)
    (block,) = read_blocks(tmp_path / "a.3dm")
    assert block.given_name == "a"
    lines = left_out(tmp_path / "a.3dm")
    assert lines == ["b (layer off is off)", "c (layer off is off)", "d (hidden)"]


def test_tabs_and_comments_of_obj_leave_names_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "a.obj"
    write_obj(file, {"post": cuboid((0, 0, 0), (1, 1, 2)), "cap #2": cuboid((0, 0, 2), (1, 1, 3))})
    lines = [line.replace(" ", "\t", 1) + " # c" for line in file.read_text().splitlines()]
    file.write_text("\n".join(lines))
    assert [block.given_name for block in read_blocks(file)] == ["post", "cap #2"]
