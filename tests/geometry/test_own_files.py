"""Imported files: formats, names, supports, the vertical axis, faults and their repair."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry import PolyhedralAssembly, Polyhedron, RefusedError, convex_polyhedron, read_blocks
from geometry.files.block_files import diagnosed_blocks
from geometry.files.named_surfaces import Y_UP
from geometry.files.write_solids import flat_faces, write_solids
from tests.support.commands import command
from validation import load_case, solve

pytestmark = pytest.mark.quick

#: Corners of a box by signs, and its sides seen from outside.
_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
_SIDES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def obj(
    path: Path,
    boxes: dict[str, tuple[list[float], list[float]]],
    sides: list[list[int]] = _SIDES,
    *,
    head: str = "o",
    each: Callable[[int], str] = lambda _: "",
) -> Path:
    """Write boxes by name, lowest corner and size as one OBJ file."""
    lines, first = [], 1
    for name, (at, size) in boxes.items():
        lines += [f"{head} {name}"] if head else []
        lines += ["v {} {} {}".format(*p) for p in np.array(at) + _CORNERS * size]
        for k, side in enumerate(sides):
            lines += [each(k)] if each(k) else []
            lines.append("f " + " ".join(str(first + corner) for corner in side))
        first += 8
    path.write_text("\n".join(lines) + "\n")
    return path


STACK = {
    "base": ([0.0, 0.0, 0.0], [300.0, 300.0, 100.0]),
    "block": ([50.0, 50.0, 100.0], [100.0, 100.0, 200.0]),
}


def scene_of(file: Path, *lines: str) -> Path:
    path = file.with_suffix(".toml")
    path.write_text(
        "\n".join(
            [
                "[block]",
                'type = "mesh"',
                *(line for line in lines if line.startswith(("up", "repair"))),
                "[[parts]]",
                f'file = "{file.name}"',
                *(line for line in lines if line.startswith(("places", "leave_out"))),
                "[assembly]",
                *(line for line in lines if line.startswith("fixed")),
                "[effects]",
                "gravity = [0, 0, -9810]",
            ]
        )
    )
    return path


def rigid(file: Path, *lines: str):  # type: ignore[no-untyped-def]
    loaded = load_case(str(scene_of(file, *lines)))
    return solve(loaded.with_method("rigid"))  # type: ignore[arg-type]


def test_objects_of_an_obj_are_blocks_with_names(tmp_path: Path) -> None:
    blocks = read_blocks(obj(tmp_path / "a.obj", STACK))
    assert [block.given_name for block in blocks] == ["base", "block"]
    np.testing.assert_allclose([block.volume for block in blocks], [9e6, 2e6], rtol=1e-12)


def test_objects_may_share_faces_that_look_the_same_way(tmp_path: Path) -> None:
    # Two boxes in each other by a face: one surface cannot say which matter is whose.
    same = {"a": ([0.0] * 3, [100.0] * 3), "b": ([0.0] * 3, [100.0, 100.0, 50.0])}
    assert len(read_blocks(obj(tmp_path / "named.obj", same))) == 2
    with pytest.raises(RefusedError):
        read_blocks(obj(tmp_path / "unnamed.obj", same, head=""))


def test_groups_that_are_the_sides_of_one_solid_are_one_block(tmp_path: Path) -> None:
    file = obj(tmp_path / "a.obj", {"": STACK["base"]}, head="", each=lambda k: f"g side {k}")
    (block,) = read_blocks(file)
    assert block.volume == pytest.approx(9e6, rel=1e-12)


def test_a_name_that_comes_again_goes_on(tmp_path: Path) -> None:
    file = obj(tmp_path / "a.obj", STACK)
    lines = file.read_text().splitlines()
    last = lines.pop(-1)
    first = lines.index("o block")
    lines.insert(first, "o block")
    file.write_text("\n".join([*lines, "o base", "o block", last]) + "\n")
    assert [b.given_name for b in read_blocks(file)] == ["base", "block"]


@pytest.mark.parametrize(
    ("sides", "changes"),
    [
        (_SIDES + _SIDES[:2], ("4 triangles that were there twice dropped",)),
        ([*_SIDES[:-1], _SIDES[-1][::-1]], ("2 triangles turned",)),
        (_SIDES[:-1], ("1 flat hole closed",)),
        (
            [*_SIDES[:4], _SIDES[4][::-1], _SIDES[0]],
            (
                "2 triangles that were there twice dropped",
                "2 triangles turned",
                "1 flat hole closed",
            ),
        ),
    ],
)
def test_faults_are_named_and_mended_on_request(
    tmp_path: Path, sides: list[list[int]], changes: tuple[str, ...]
) -> None:
    file = obj(tmp_path / "a.obj", {"base": STACK["base"]}, sides)
    with pytest.raises(RefusedError, match=r"base: .*repair = true"):
        read_blocks(file)
    ((_, faults),) = diagnosed_blocks(file)
    assert faults
    (block,) = read_blocks(file, repair=True)
    assert block.volume == pytest.approx(9e6, rel=1e-12)
    assert block.repairs == changes


def test_a_slit_is_no_flat_hole(tmp_path: Path) -> None:
    """A corner on an edge of a neighbour: the slit was closed by triangles without area."""
    file = obj(tmp_path / "a.obj", {"base": STACK["base"]})
    lines = file.read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("f "))
    face = [int(number) for number in lines[at].split()[1:]]
    vertices = [line.split()[1:] for line in lines if line.startswith("v ")]
    ends = np.array([vertices[k - 1] for k in face[:2]], dtype=np.float64)
    lines[at] = f"f {face[0]} {len(vertices) + 1} " + " ".join(map(str, face[1:]))
    lines.insert(at, "v " + " ".join(map(str, ends.mean(axis=0))))
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(RefusedError, match=r"the surface is open: 3 edges"):
        read_blocks(file, repair=True)


def test_a_clean_file_is_not_changed_by_repair(tmp_path: Path) -> None:
    file = obj(tmp_path / "a.obj", STACK)
    for plain, mended in zip(read_blocks(file), read_blocks(file, repair=True), strict=True):
        assert mended.repairs == ()
        np.testing.assert_array_equal(plain.points, mended.points)
        np.testing.assert_array_equal(plain.triangles, mended.triangles)


def placed(shapes: list[Polyhedron], fixed: list[bool], *, step: float = 1.0) -> PolyhedralAssembly:
    n = len(shapes)
    return PolyhedralAssembly(
        name="written",
        shapes=tuple(shapes),
        shape_of=np.arange(n),
        rotations=np.tile(np.eye(3), (n, 1, 1)),
        translations=step * np.arange(3.0 * n).reshape(n, 3),
        fixed=np.array(fixed),
        names=tuple(f"part {k}" for k in range(n)),
    )


def some_solids() -> list[Polyhedron]:
    rng = np.random.default_rng(5)
    return [
        convex_polyhedron("hull", 100.0 * rng.standard_normal((12, 3))),
        convex_polyhedron("box", 50.0 * _CORNERS),
    ]


@pytest.mark.parametrize("suffix", [".obj", ".json"])
def test_written_solids_are_read_again(tmp_path: Path, suffix: str) -> None:
    assembly = placed(some_solids(), [True, False])
    write_solids(tmp_path / f"a{suffix}", assembly)
    read = read_blocks(tmp_path / f"a{suffix}")
    assert [block.given_name for block in read] == list(assembly.names)
    assert [block.held for block in read] == [suffix == ".json", False]
    np.testing.assert_allclose([b.volume for b in read], assembly.volumes, rtol=1e-12)
    np.testing.assert_allclose(
        np.array([b.centroid for b in read]), assembly.centroids, rtol=0, atol=1e-9
    )


def test_flat_faces_are_polygons() -> None:
    hull, box = some_solids()
    assert sorted(map(len, flat_faces(box))) == [4] * 6
    assert sorted(map(len, flat_faces(hull))) == [3] * len(hull.triangles)


def test_compas_reads_what_is_written(tmp_path: Path) -> None:
    compas = pytest.importorskip("compas")
    pytest.importorskip("compas_assembly")
    write_solids(tmp_path / "a.json", placed(some_solids(), [True, False]))
    assembly = compas.json_load(tmp_path / "a.json")
    volumes = [abs(block.volume()) for block in assembly.blocks()]
    np.testing.assert_allclose(volumes, [s.volume for s in some_solids()], rtol=1e-9)


@pytest.mark.parametrize(("suffix", "unit"), [(".glb", "meter"), (".3mf", "cm")])
def test_formats_with_units_are_read_in_millimetres(tmp_path: Path, suffix: str, unit: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    length = {"meter": 1000.0, "cm": 10.0}[unit]
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(extents=(1, 2, 3)), node_name="lintel")
    if suffix == ".3mf":
        scene.units = "centimeter"
    scene.export(tmp_path / f"a{suffix}")
    if suffix == ".3mf":
        scene.units = unit
    (block,) = read_blocks(tmp_path / f"a{suffix}")
    assert block.given_name
    extent = [1, 3, 2] if suffix == ".glb" else [1, 2, 3]  # the y axis of glTF points up
    if suffix == ".3mf":
        length = block.volume ** (1 / 3) / 6 ** (1 / 3)
        assert length in (pytest.approx(1.0), pytest.approx(10.0))
    np.testing.assert_allclose(np.ptp(block.points, axis=0), length * np.array(extent), rtol=1e-6)


def test_rhino_meshes_and_their_unit(tmp_path: Path) -> None:
    rhino3dm = pytest.importorskip("rhino3dm")
    file = rhino3dm.File3dm()
    file.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Centimeters
    mesh = rhino3dm.Mesh()
    for x, y, z in (10 * _CORNERS).tolist():
        mesh.Vertices.Add(x, y, z)
    for side in _SIDES:
        mesh.Faces.AddFace(*side)
    of = rhino3dm.ObjectAttributes()
    of.Name = "keystone"
    file.Objects.AddMesh(mesh, of)
    file.Objects.AddPoint(rhino3dm.Point3d(0, 0, 0))
    file.Write(str(tmp_path / "a.3dm"), 7)
    (block,) = read_blocks(tmp_path / "a.3dm")
    assert block.given_name == "keystone"
    assert block.volume == pytest.approx(1e6, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "{"),
        ("a.json", '{"vertex": 3}'),
        ("a.json", '{"vertex": {"0": {}}, "face": {"0": ["1", "2"]}}'),
        ("a.json", "[" * 100_000),
        ("a.glb", "glTF"),
        ("a.gltf", "{}"),
        ("a.3mf", "PK"),
        ("a.3dm", "3D Geometry"),
    ],
)
def test_files_that_are_none_get_one_line(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(RefusedError, match=name) as raised:
        read_blocks(tmp_path / name)
    assert "\n" not in str(raised.value)


def test_blocks_are_fixed_by_name(tmp_path: Path) -> None:
    file = obj(tmp_path / "a.obj", STACK)
    run = rigid(file, 'fixed = ["base"]')
    assert run.details.blocks.fixed.tolist() == [True, False]
    assert run.as_dict()["block_names"] == ["base", "block"]
    with pytest.raises(RefusedError, match=r"got block 'bas', but names are base, block"):
        rigid(file, 'fixed = ["bas"]')


def test_supports_of_a_file_are_supports(tmp_path: Path) -> None:
    lower, upper = read_blocks(obj(tmp_path / "a.obj", STACK))
    write_solids(tmp_path / "b.json", placed([lower, upper], [True, False], step=0.0))
    assert rigid(tmp_path / "b.json").details.blocks.fixed.tolist() == [True, False]


def test_y_up_gives_the_answer_of_z_up(tmp_path: Path) -> None:
    upright = rigid(obj(tmp_path / "z.obj", STACK), "fixed = [0]")
    lying = {
        name: ((Y_UP.T @ at + np.minimum(Y_UP.T @ size, 0)).tolist(), abs(Y_UP.T @ size).tolist())
        for name, (at, size) in STACK.items()
    }
    file = obj(tmp_path / "y.obj", lying)
    turned = rigid(file, "fixed = [0]", 'up = "y"')
    np.testing.assert_allclose(
        turned.details.blocks.centroids, upright.details.blocks.centroids, atol=1e-9
    )
    forces = [float(run.details.contact_forces.sum()) for run in (turned, upright)]
    assert forces[0] == pytest.approx(forces[1], rel=1e-9)
    assert not turned.report.get("notes")
    assert not upright.report.get("notes")
    doubt = rigid(file, "fixed = [0]").report["notes"]["which way is up"]
    assert "every support lies on the -y side" in doubt
    assert 'block.up = "y"' in doubt


def test_supports_that_lie_below_are_not_aside(tmp_path: Path) -> None:
    """A long flat brick that overhangs: its middle lies farther aside of its base than above it."""
    bricks = {"base": ([0.0, 0.0, 0.0], [200.0, 100.0, 50.0])}
    bricks["brick"] = ([110.0, 0.0, 50.0], [160.0, 100.0, 50.0])
    assert not rigid(obj(tmp_path / "a.obj", bricks), "fixed = [0]").report.get("notes")


def test_overlaps_are_named_with_a_tolerance_that_works(tmp_path: Path) -> None:
    deep = STACK | {"block": ([50.0, 50.0, 95.0], [100.0, 100.0, 200.0])}
    file = obj(tmp_path / "a.obj", deep)
    with pytest.raises(
        RefusedError, match=r"blocks 0 \(base\) and 1 \(block\) overlap by 5 mm"
    ) as e:
        rigid(file, "fixed = [0]")
    tolerance = str(e.value).partition("detection.tolerance = ")[2].split()[0]
    loaded = load_case(str(scene_of(file, "fixed = [0]")), [f"detection.tolerance={tolerance}"])
    assert solve(loaded.with_method("rigid")).details.holds  # type: ignore[arg-type]


def checked(file: Path) -> dict[str, Any]:
    """What ``tubelock check`` finds in a file."""
    _, out, _ = command("check", str(file), "--json", "-")
    found: dict[str, Any] = json.loads(out)
    return found


def test_check_lists_faults_overlaps_and_gaps(tmp_path: Path) -> None:
    boxes = STACK | {
        "beside": ([151.0, 50.0, 100.0], [100.0, 100.0, 200.0]),
        "deep": ([0.0, 0.0, -95.0], [300.0, 300.0, 100.0]),
    }
    file = obj(tmp_path / "a.obj", boxes)
    check = checked(file)
    assert not check["clean"]
    (overlap,), (gap,) = check["overlaps"], check["gaps"]
    assert overlap["blocks"] == [0, 3]
    assert overlap["depth"] == pytest.approx(5.0, rel=1e-9)
    assert gap["blocks"] == [1, 2]
    assert gap["gap"] == pytest.approx(1.0, rel=1e-9)
    assert command("check", str(file))[0] == 1
    clean = obj(tmp_path / "b.obj", STACK)
    assert command("check", str(clean))[0] == 0
    small = {name: ([0.0, 0.0, 0.3 * k], [0.3] * 3) for k, name in enumerate("ab")}
    assert checked(obj(tmp_path / "c.obj", small))["likely_unit"] == "m"


def test_repair_writes_what_check_finds_clean(tmp_path: Path) -> None:
    file = obj(tmp_path / "a.obj", STACK, _SIDES + _SIDES[:1])
    for name in ("b.obj", "b.json"):
        assert command("check", str(file), "--repair", str(tmp_path / name))[0] == 0
        assert checked(tmp_path / name)["clean"]
    lid = obj(tmp_path / "open.obj", {"a": STACK["base"]}, _SIDES[:3])
    status, _, said = command("check", str(lid), "--repair", str(tmp_path / "c.obj"))
    assert (status, said.count("\n")) == (2, 1)
    assert "cannot be repaired" in said
    assert not (tmp_path / "c.obj").exists()


def test_a_sliver_has_no_pressure_of_its_own(tmp_path: Path) -> None:
    """A ridge 0.01 mm wide beside a face of 100 mm carries what its corner points carry."""
    block = convex_polyhedron(
        "block",
        [[x, y, z] for y in (0, 100) for x, z in ((0, 0), (100, 0), (0, 90), (100, 90))],
    )
    # The base has a second plane under the last hundredth of a millimetre, too flat to matter.
    base = convex_polyhedron(
        "base",
        [
            [x, y, z]
            for y in (0, 100)
            for x, z in ((0, 0), (99.99, 0), (100.0, -2e-5), (0, -50), (100.0, -50))
        ],
    )
    assembly = PolyhedralAssembly(
        name="ridge",
        shapes=(base, block),
        shape_of=np.arange(2),
        rotations=np.tile(np.eye(3), (2, 1, 1)),
        translations=np.zeros((2, 3)),
        fixed=np.array([True, False]),
    )
    found = assembly.interfaces
    areas = found.patches.areas
    assert len(areas) == 2
    assert areas.min() < 2.0
    forces = np.arange(1.0, found.n_contacts + 1.0)
    pressures = found.patch_pressures(np.arange(found.n_contacts), forces)
    np.testing.assert_allclose(pressures, forces.sum() / areas.sum(), rtol=1e-12)


def _facets(at: float, *, indent: str = "") -> str:
    """Twelve triangles of a box of 10 mm, as text."""
    lines = []
    for a, b, c, d in _SIDES:
        for corners in ((a, b, c), (a, c, d)):
            lines += ["facet normal 0 0 0", "outer loop"]
            lines += ["vertex {} {} {}".format(*(10 * _CORNERS[k] + [at, 0, 0])) for k in corners]
            lines += ["endloop", "endfacet"]
    return "\n".join(indent + line for line in lines)


def test_stl_as_text_of_any_writer_and_its_names(tmp_path: Path) -> None:
    one = f"solid a b\r\n{_facets(0.0, indent='  ')}\n\nendsolid a b\n"
    two = f"solid right\n{_facets(30.0)}\nendsolid right\n"
    (tmp_path / "two.stl").write_text(one + two, newline="")
    blocks = read_blocks(tmp_path / "two.stl")
    assert [block.given_name for block in blocks] == ["a b", "right"]
    np.testing.assert_allclose([block.volume for block in blocks], 1000.0, rtol=1e-12)
    for cut in (len(one) + 40, len(one) + len(two) - 20):
        (tmp_path / "cut.stl").write_text((one + two)[:cut], newline="")
        with pytest.raises(RefusedError, match=r"cut short|expected vertex"):
            read_blocks(tmp_path / "cut.stl")


def test_the_density_of_the_material_is_that_of_the_weight(tmp_path: Path) -> None:
    file = scene_of(obj(tmp_path / "a.obj", STACK), "fixed = [0]")
    text = file.read_text()
    material = "[material]\ndensity = 7.85e-9\nyoung_modulus = 2.1e5\npoisson_ratio = 0.3\n"
    file.write_text(text + "\n" + material)
    loaded = load_case(str(file))
    run = solve(loaded.with_method("rigid"))  # type: ignore[arg-type]
    weight = 7.85e-9 * 2e6 * 9810.0
    assert run.details.contact_forces.sum() == pytest.approx(weight, rel=1e-9)


def test_faulty_solids_are_left_out_by_name_or_number(tmp_path: Path) -> None:
    # Beside the stack stands a box without a lid.
    lid = ([400.0, 0.0, 0.0], [50.0, 50.0, 50.0])
    file = obj(tmp_path / "a.obj", STACK | {"extra": lid})
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:-1]))  # one side of the last box is lost
    with pytest.raises(RefusedError, match=r"extra.*open.*parts\.leave_out = \[2\]"):
        rigid(file, "fixed = [0]")
    for which in ('"extra"', "2"):
        run = rigid(file, "fixed = [0]", f"leave_out = [{which}]")
        assert run.details.blocks.names == ("base", "block")
        assert run.report["notes"]["left out"] == f"a.obj: {which.strip(chr(34))}"
        assert run.details.holds
    with pytest.raises(RefusedError, match=r"parts\.leave_out: got block 'lid'"):
        rigid(file, "fixed = [0]", 'leave_out = ["lid"]')
    with pytest.raises(RefusedError, match="names all 3 solids"):
        rigid(file, "fixed = [0]", "leave_out = [0, 1, 2]")
