"""Scenes of triangulated blocks from text to verdict: your own files, questions, bad input."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from fem import solve_static
from geometry import Polyhedron, RefusedError, TetrahedraLayer, TractionLoad, convex_polyhedron
from mbd import contact_jacobian
from tests.support.answers import PLAIN, on_its_mesh
from tests.support.commands import command
from tests.support.linear_programs import solve_linear_programs
from validation import Case, load_case, solve

EDGE = 60.0
TETRAHEDRON = TetrahedraLayer(EDGE, 3, 3).build().shapes[0]


def _answer(file: Case) -> dict[str, object]:
    return solve(file.with_method("rigid")).as_dict()


def _save(path: Path, shape: Polyhedron, scale: float = 1.0) -> None:
    meshio.write(path, meshio.Mesh(scale * shape.points, [("triangle", shape.triangles)]))


def _box(x: float, y: float, z: float) -> Polyhedron:
    """A box about the origin."""
    signs = [[a, b, c] for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)]
    return convex_polyhedron("box", np.array(signs) * [x, y, z])


def _layer_scene(folder: Path, units: str = "mm") -> Path:
    """A user's scene: one STL file, a list of places, the outer ring fixed."""
    _save(folder / "tetra.stl", TETRAHEDRON, 1e-3 if units == "m" else 1.0)
    lines = ["[block]", 'type = "mesh"', f'units = "{units}"', "[[parts]]", 'file = "tetra.stl"']
    layer = TetrahedraLayer(EDGE, 3, 3).build()
    for turn, shift, fixed in zip(layer.rotations, layer.translations, layer.fixed, strict=True):
        angle = 90.0 if abs(turn[0, 1]) > 0.5 else 0.0
        lines += [
            "[[parts.places]]",
            f"at = {shift.tolist()}",
            f"angle = {angle}",
            f"fixed = {str(bool(fixed)).lower()}",
        ]
    path = folder / "layer.toml"
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("units", ["mm", "m"])
def test_a_layer_of_stl_tetrahedra_is_interlocked_by_edges_alone(
    tmp_path: Path, units: str
) -> None:
    answer = _answer(load_case(str(_layer_scene(tmp_path, units))))
    assert answer["interlocked"] is False
    assert answer["edges_and_corners"]["mechanism"] == "locked"  # type: ignore[index]
    assert answer["n_blocks"] == 9
    family = _answer(load_case("tetrahedra", ["assembly.columns=3", "assembly.rows=3"]))
    # STL holds single precision: patches change by 1e-6, none is lost.
    assert answer["n_patches"] == family["n_patches"]
    assert answer["n_contacts"] == family["n_contacts"]


def test_what_is_not_asked_is_absent_and_what_is_asked_is_answered() -> None:
    plain = _answer(load_case("octahedra", ["assembly.rings=0"]))
    assert not {"friction", "collapse", "margin"} & set(plain)
    asked = _answer(load_case("octahedra", ["assembly.rings=0", "rigid.margin=true"]))
    assert asked["margin"]["interlocked"] is True  # type: ignore[index]
    wall = _answer(load_case("wall", ["assembly.columns=2", "assembly.rows=2"]))
    assert wall["friction"]["holds"] is True  # type: ignore[index]
    collapse = wall["collapse"]
    assert isinstance(collapse, dict)
    # The live load is a tenth of gravity; sliding at μ = 0.6 takes six of them.
    assert collapse["factor"] == pytest.approx(6.0, abs=1e-4)
    assert collapse["certified"] is True


def test_friction_can_be_asked_of_a_tube() -> None:

    settings = ["mesh.edge=6", "mesh.radial=3", "assembly.layers=4"]
    slippery = solve(
        load_case("thb0-pipe", [*settings, "effects.friction=0.01"], method="rigid")
    ).as_dict()
    assert slippery["friction"]["holds"] is False
    assert slippery["friction"]["work"] > 0
    assert slippery["friction"]["smallest_contact_work"] >= -1e-6 * slippery["friction"]["work"]
    rough = solve(
        load_case("thb0-pipe", [*settings, "effects.friction=1.0"], method="rigid")
    ).as_dict()
    assert rough["friction"]["holds"] is True
    assert "friction" not in solve(load_case("thb0-pipe", settings, method="rigid")).as_dict()


def test_command_writes_contacts_and_pictures(tmp_path: Path) -> None:
    scene = _layer_scene(tmp_path)
    status, out, err = command("mbd", str(scene), "--fields", "-o", str(tmp_path / "out"))
    assert status == 0, err
    assert "with edges and corners: locked" in out
    contacts = meshio.read(tmp_path / "out" / "contacts.vtu")
    area = 0.0
    for a, b, c in contacts.points[contacts.cells[0].data]:
        area += 0.5 * float(np.linalg.norm(np.cross(b - a, c - a)))
    answer = _answer(load_case(str(scene)))
    assert area == pytest.approx(float(str(answer["contact_area"])), rel=1e-9)
    assert (tmp_path / "out" / "contacts.png").stat().st_size > 10_000


def _refusal(path: Path, settings: list[str] | None = None) -> str:
    with pytest.raises(RefusedError) as error:
        _answer(load_case(str(path), settings or []))
    return str(error.value)


def test_bad_own_blocks_are_refused_with_one_line(tmp_path: Path) -> None:
    scene = _layer_scene(tmp_path)
    text = scene.read_text()
    shape = TETRAHEDRON

    scene.write_text(text.replace("fixed = true", "fixed = false"))
    assert "no block is fixed" in _refusal(scene)
    scene.write_text(text.replace("[60.0, 60.0, 0.0]", "[60.0, 60.0, 400.0]"))
    assert "touches no other block" in _refusal(scene)
    scene.write_text(text.replace("[30.0, 30.0, 0.0]", "[30.0, 30.0, 4.0]"))
    message = _refusal(scene)
    assert "overlap by" in message
    assert "\n" not in message
    scene.write_text(text.replace("tetra.stl", "none.stl"))
    assert "no such file" in _refusal(scene)
    scene.write_text(text)
    _save(tmp_path / "tetra.stl", shape, 1e-3)
    assert "a block measures" in _refusal(scene)
    _save(tmp_path / "tetra.stl", Polyhedron("open", shape.points, shape.triangles[:3]))
    assert "expected a closed surface" in _refusal(scene)
    _save(tmp_path / "tetra.stl", shape)
    assert "assembly.fixed: got block 99" in _refusal(scene, ["assembly.fixed=[99]"])
    assert "unknown key" in _refusal(scene, ["block.unit='mm'"])
    bad = ["loads=[{blocks=[99], force=[1.0, 0.0, 0.0]}]"]
    assert "numbered 0 to" in _refusal(scene, bad)


def test_places_are_turned_about_any_axis_by_angles_that_mean_something(tmp_path: Path) -> None:
    """1e300 degrees ended in a segmentation fault; lengths of axes overflowed or vanished."""
    _save(tmp_path / "cube.stl", _box(100.0, 100.0, 100.0))
    for size in (1e-50, 1.0, 1e50):
        (tmp_path / "cubes.toml").write_text(
            '[block]\ntype = "mesh"\n[[parts]]\nfile = "cube.stl"\nplaces = [{fixed = true}, '
            f"{{at = [0, 0, 100], axis = [0.0, {size}, 0.0], angle = 90.0}}]\n"
        )
        turned = load_case(tmp_path / "cubes.toml", method="rigid").problem.blocks.rotations[1]
        np.testing.assert_allclose(turned @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-15)
    scene = _layer_scene(tmp_path)
    first = "angle = 0.0"
    text = scene.read_text()
    assert first in text
    for angle in ("1e300", "-1e5"):
        scene.write_text(text.replace(first, f"axis = [0.0, 1.0, 0.0]\nangle = {angle}", 1))
        assert "angle: got" in _refusal(scene)


def test_other_commands_know_these_scenes(tmp_path: Path) -> None:
    picture = tmp_path / "layer.png"
    words = ("show", "cubes", "--set", "assembly.rings=0", "-o", str(picture))
    assert command(*words)[0] == 0
    assert picture.stat().st_size > 5_000
    small = ["--set", "assembly.columns=2", "--set", "assembly.rows=2"]
    status, _, err = command("fem", "tetrahedra", *small)
    assert status == 2
    assert "the faces of the blocks do not carry the load" in err


def test_blocks_beyond_the_digits_of_coordinates_are_refused(tmp_path: Path) -> None:
    """1e12 mm away coordinates are rounded to 1e-4 mm; gaps of 6e-3 mm are told apart."""
    scene = _layer_scene(tmp_path)
    text = scene.read_text().replace("at = [", "at = [1e12, ", 1)
    first = text.split("at = [1e12, ")[1].split("]")[0]
    x, y, z = (float(word) for word in first.split(","))
    far = scene.read_text().replace(f"at = [{first}]", f"at = [{x + 1e12}, {y}, {z}]")
    scene.write_text(far)
    with pytest.raises(RefusedError, match=r"1e\+12 mm from the origin.*move the assembly"):
        _answer(load_case(str(scene)))


# ---------------------------------------------------------------------------------------------
# Contacts without area


def _panel(folder: Path, extra: str = "") -> Path:
    """Truncated tetrahedra: grid of 100 mm, 25°, 60 mm thick, 3 × 3 free in a fixed ring."""
    half, lean = 30.0, 30.0 * np.tan(np.radians(25.0))
    corners = [
        [a * (50.0 + up * lean), b * (50.0 - up * lean), up * half]
        for up in (-1, 1)
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    _save(folder / "truncated.stl", convex_polyhedron("truncated", corners))
    lines = ["[block]", 'type = "mesh"', "[material]", "young_modulus = 30000.0"]
    lines += ["poisson_ratio = 0.2", "density = 2.4e-9", "[contact]", 'law = "linear"']
    lines += ["stiffness = 1000.0", "[fem]", 'method = "static"', "[effects]"]
    lines += ["gravity = [0.0, 0.0, -9810.0]", extra, "[[parts]]", 'file = "truncated.stl"']
    for i in range(5):
        for j in range(5):
            ring = str(i in (0, 4) or j in (0, 4)).lower()
            lines += ["[[parts.places]]", f"at = [{100.0 * i}, {100.0 * j}, 0.0]"]
            lines += [f"angle = {90.0 * ((i + j) % 2)}", f"fixed = {ring}"]
    path = folder / "panel.toml"
    path.write_text("\n".join(lines))
    return path


def test_what_point_contacts_alone_lock_is_said_to_be(tmp_path: Path) -> None:
    """Locked by edges that cross; by the faces it is a mechanism that the weight drives."""
    run = solve(load_case(_panel(tmp_path), method="rigid"))
    answer = run.as_dict()
    every = answer["edges_and_corners"]
    assert (every["mechanism"], answer["n_crossing_edges"]) == ("locked", 32)
    assert every["certificate"]["kind"] == "self-stress"
    assert every["carried"]
    assert not answer["carried"]
    assert (answer["mechanism"], answer["certificate"]["kind"]) == ("activated", "mechanism")
    # The certificate by multiplication, and by another program on the same contacts.
    bare = contact_jacobian(run.details.blocks.bearing())
    assert len(bare.index) == run.details.n_contacts
    motion = np.array(answer["certificate"]["virtual_displacement"]).ravel()
    assert bare.jacobian.gap_rates(motion).min() > -1e-12
    force = bare.rows(run.details.load.wrenches)
    assert force @ motion > 0.5 * np.linalg.norm(force)
    assert str(solve_linear_programs(bare.jacobian, force).mechanism) == "activated"
    told = ("--json", str(tmp_path / "answer.json"))
    status, out, said = command("mbd", str(tmp_path / "panel.toml"), *told)
    assert status == 0, said
    words = re.sub(r"[│\s]+", " ", out)
    assert "held by edges and corners alone: faces alone do not carry" in words
    assert "held by edges and corners alone: faces alone do not carry" in run.title
    assert "proof with edges and corners" in words


@pytest.mark.parametrize(("degrees", "thickness"), [(25.0, 60.0), (35.0, 30.0)])
def test_faces_are_decided_where_newton_stagnates(
    tmp_path: Path, degrees: float, thickness: float
) -> None:
    """Whether they have a self-stress was "undecided" at a residual of 2e-6, expected 1e-6."""
    half, lines, ring = 0.5 * thickness, list[str](), list[int]()
    for number, (i, j) in enumerate(np.ndindex(5, 5)):
        lean = (1.0 if (i + j) % 2 else -1.0) * np.tan(np.radians(degrees))
        lines.append(f"o block{number}")
        for z in (-half, half):
            for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                place = 100 * i + x * (50 + z * lean), 100 * j + y * (50 - z * lean), z
                lines.append("v " + " ".join(f"{value:.12g}" for value in place))
        quads = ("4 3 2 1", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8")
        for quad in quads:
            lines.append("f " + " ".join(str(8 * number + int(v)) for v in quad.split()))
        ring += [number] if {i, j} & {0, 4} else []
    (tmp_path / "panel.obj").write_text("\n".join(lines) + "\n")
    scene = tmp_path / "panel.toml"
    scene.write_text(
        f'[block]\ntype = "mesh"\nunits = "mm"\n[assembly]\nfixed = {ring}\n'
        '[[parts]]\nfile = "panel.obj"\n[effects]\ngravity = [0, 0, -9810]\n'
    )
    answer = _answer(load_case(str(scene)))
    assert answer["mechanism"] == "activated"
    assert answer["edges_and_corners"]["mechanism"] == "locked"  # type: ignore[index]


@pytest.mark.parametrize("asked", ["fem", "compare"])
def test_deformable_blocks_name_the_mechanism_of_their_faces(tmp_path: Path, asked: str) -> None:
    status, _, err = command(asked, str(_panel(tmp_path)), "--json", "-")
    assert status == 2
    words = "panel: no equilibrium: the faces of the blocks do not carry the load: block"
    assert err.startswith(f"error: {words}")


def test_edges_and_corners_have_no_verdict_where_every_contact_has_an_area() -> None:
    answer = _answer(load_case("cubes"))
    assert answer["n_points_without_area"] == 0
    assert "edges_and_corners" not in answer


@pytest.mark.parametrize(("lift", "carried"), [(5.0, True), (8.0, False)])
def test_weight_holds_faces_together(tmp_path: Path, lift: float, carried: bool) -> None:
    """A brick of 6.4 N on another one, lifted by 5 N or by 8 N."""
    _save(tmp_path / "brick.stl", _box(80.0, 60.0, 56.6))
    lines = ["[block]", 'type = "mesh"', "[material]", "young_modulus = 30000.0"]
    lines += ["poisson_ratio = 0.2", "density = 2.4e-9", "[contact]", 'law = "linear"']
    lines += ["stiffness = 1000.0", "[fem]", 'method = "static"', "[effects]"]
    lines += ["gravity = [0.0, 0.0, -9810.0]"]
    lines += ["[[loads]]", "blocks = [1]", f"force = [0.0, 0.0, {lift}]"]
    for height, fixed in ((0.0, "true"), (56.6, "false")):
        lines += ["[[parts]]", 'file = "brick.stl"', f"fixed = {fixed}"]
        lines += ["[[parts.places]]", f"at = [0.0, 0.0, {height}]"]
    path = tmp_path / "bricks.toml"
    path.write_text("\n".join(lines))
    if carried:
        assert on_its_mesh(path).details.evidence.converged
        return
    with pytest.raises(RefusedError, match="block 1 lifts off block 0"):
        on_its_mesh(path)


def test_a_locked_block_rests_where_its_neighbours_stop_it() -> None:
    """Loads leave a block a gap that deformed surfaces push it through, until it meets a neighbour.

    Every force is then balanced: the loads by the fixed blocks, and each block by its joints. Loads
    on fixed blocks count.
    """
    scene = {
        "block": {"type": "tetrahedra", "edge": 120.0, "thickness": 40.0},
        "assembly": {"columns": 2, "rows": 1},
        "loads": [{"plane": {"z": 20.0}, "pressure": 0.02}],
        "mesh": {"divisions": 3},
    }
    problem = load_case(scene, method="static").problem
    load, wrenches = problem.load_case, np.zeros((8, 6))
    wrenches[0] = [3.0, 4.0, -30.0, 0.0, 0.0, 0.0]
    on_fixed = TractionLoad(np.array([2]), load.faces[0].face, np.array([0.01, 0.0, 0.02]))
    load = replace(load, faces=(*load.faces, on_fixed), body_wrenches=wrenches)
    answer = solve_static(replace(problem, load=load), PLAIN)
    assert answer.report["residual"] <= 1e-8
    assert max(answer.report["imbalance"][name] for name in ("force", "moment")) <= 1e-6
    reactions = answer.report["reactions"].values()
    force, moment = (sum(np.array(one[name]) for one in reactions) for name in ("force", "moment"))
    loads = load.wrenches
    turning = loads[:, 3:] + np.cross(problem.blocks.centroids, loads[:, :3])
    assert force == pytest.approx(-loads[:, :3].sum(axis=0), abs=1e-5)
    lever = answer["max_displacement"].value  # forces act at deformed places
    allowed = lever * np.linalg.norm(loads[:, :3], axis=1).sum()
    assert moment == pytest.approx(-turning.sum(axis=0), abs=allowed)
