"""Scenes of triangulated blocks from text to verdict: your own files, questions, bad input."""

from __future__ import annotations

import json
from pathlib import Path

import meshio
import numpy as np
import pytest
from typer.testing import CliRunner

from geometry.errors import RefusedError
from geometry.families.platonic_layers import tetrahedra_layer, tetrahedron
from geometry.polyhedra.polyhedron import Polyhedron
from validation.cli.app import app
from validation.errors import InputError
from validation.run.rigid.polyhedra import run_polyhedra
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import SceneFile, load_scene

EDGE = 60.0


def _answer(file: SceneFile) -> dict[str, object]:
    assert isinstance(file.scene, PolyhedralScene)
    return run_polyhedra(file, file.scene).json()


def _save(path: Path, shape: Polyhedron, scale: float = 1.0) -> None:
    meshio.write(path, meshio.Mesh(scale * shape.points, [("triangle", shape.triangles)]))


def _layer_scene(folder: Path, units: str = "mm") -> Path:
    """A user's scene: one STL file, a list of places, the outer ring fixed."""
    _save(folder / "tetra.stl", tetrahedron(EDGE), 1e-3 if units == "m" else 1.0)
    lines = ["[block]", 'type = "mesh"', f'units = "{units}"', "[[parts]]", 'file = "tetra.stl"']
    layer = tetrahedra_layer(EDGE, 3, 3)
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
def test_a_layer_of_stl_tetrahedra_is_judged_interlocked(tmp_path: Path, units: str) -> None:
    answer = _answer(load_scene(str(_layer_scene(tmp_path, units))))
    assert answer["interlocked"] is True
    assert answer["n_blocks"] == 9
    family = _answer(load_scene("tetrahedra", ["assembly.columns=3", "assembly.rows=3"]))
    # STL holds single precision: patches change by 1e-6, none is lost.
    assert answer["n_patches"] == family["n_patches"]
    assert answer["n_contacts"] == family["n_contacts"]


@pytest.mark.parametrize(
    ("name", "locked"),
    [
        ("tetrahedra", True),
        ("octahedra", True),
        ("cubes", True),
        ("wall", False),
        ("arch", False),
        ("voxel-puzzle", True),
    ],
)
def test_built_in_scenes_have_their_known_verdicts(name: str, locked: bool) -> None:
    settings = ["rigid.margin=false"] if name == "tetrahedra" else []
    answer = _answer(load_scene(name, settings))
    assert answer["interlocked"] is locked
    json.dumps(answer, allow_nan=False)


def test_what_is_not_asked_is_absent_and_what_is_asked_is_answered() -> None:
    plain = _answer(load_scene("octahedra", ["assembly.rings=0"]))
    assert not {"friction", "collapse", "margin"} & set(plain)
    asked = _answer(load_scene("octahedra", ["assembly.rings=0", "rigid.margin=true"]))
    assert asked["margin"]["interlocked"] is True  # type: ignore[index]
    wall = _answer(load_scene("wall", ["assembly.columns=2", "assembly.rows=2"]))
    assert wall["friction"]["holds"] is True  # type: ignore[index]
    collapse = wall["collapse"]
    assert isinstance(collapse, dict)
    # The live load is a tenth of gravity; sliding at μ = 0.6 takes six of them.
    assert collapse["factor"] == pytest.approx(6.0, abs=1e-4)
    assert collapse["certified"] is True


def test_friction_can_be_asked_of_a_tube() -> None:
    from validation.run.rigid.answer import run_rigid

    settings = ["mesh.edge=6", "mesh.radial=3", "assembly.layers=4"]
    slippery = run_rigid(load_scene("thb0-pipe", [*settings, "rigid.friction=0.01"])).json()
    assert slippery["friction"]["holds"] is False
    assert slippery["friction"]["work"] > 0
    assert slippery["friction"]["smallest_contact_work"] >= -1e-6 * slippery["friction"]["work"]
    rough = run_rigid(load_scene("thb0-pipe", [*settings, "rigid.friction=1.0"])).json()
    assert rough["friction"]["holds"] is True
    assert "friction" not in run_rigid(load_scene("thb0-pipe", settings)).json()


def test_command_writes_contacts_and_pictures(tmp_path: Path) -> None:
    scene = _layer_scene(tmp_path)
    done = CliRunner().invoke(app, ["mbd", str(scene), "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "interlocked" in done.output
    assert "rigid answer only" in done.output
    contacts = meshio.read(tmp_path / "out" / "contacts.vtu")
    area = 0.0
    for a, b, c in contacts.points[contacts.cells[0].data]:
        area += 0.5 * float(np.linalg.norm(np.cross(b - a, c - a)))
    answer = _answer(load_scene(str(scene)))
    assert area == pytest.approx(float(str(answer["contact_area"])), rel=1e-9)
    assert (tmp_path / "out" / "contacts.png").stat().st_size > 10_000


def _refusal(path: Path, settings: list[str] | None = None) -> str:
    with pytest.raises(RefusedError) as error:
        _answer(load_scene(str(path), settings or []))
    return str(error.value)


def test_bad_own_blocks_are_refused_with_one_line(tmp_path: Path) -> None:
    scene = _layer_scene(tmp_path)
    text = scene.read_text()
    shape = tetrahedron(EDGE)

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
    bad = ["load.forces=[{block=99, force=[1.0, 0.0, 0.0]}]"]
    assert "numbered 0 to" in _refusal(scene, bad)


def test_scales_that_look_wrong_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text('[block]\ntype = "cubes"\nedge = 0.2\n[assembly]\nrings = 0\n')
    message = _refusal(path)
    assert "a block measures 0.2 mm" in message
    assert "metres" in message
    from validation.build.blocks import build_assembly

    metres = [
        f"block.{key}={value}"
        for key, value in (
            ("height", 0.2),
            ("amplitude", 0.02),
            ("inner_radius", 0.12),
            ("thickness", 0.04),
        )
    ]
    tube = load_scene("tsb1-pipe", [*metres, "mesh.around=12", "mesh.radial=2", "mesh.axial=2"])
    with pytest.raises(RefusedError, match="in metres, multiply by 1000"):
        build_assembly(tube.scene)  # type: ignore[arg-type]


def test_other_commands_know_these_scenes(tmp_path: Path) -> None:
    picture = tmp_path / "layer.png"
    done = CliRunner().invoke(
        app, ["show", "cubes", "--set", "assembly.rings=0", "-o", str(picture)]
    )
    assert done.exit_code == 0, done.output
    assert picture.stat().st_size > 5_000
    refused = CliRunner().invoke(app, ["fem", "tetrahedra"])
    assert isinstance(refused.exception, InputError)
    assert "tubelock mbd" in str(refused.exception)


def test_our_side_of_the_peer_comparison_agrees_with_theory() -> None:
    from validation.compare.compas_cra import ours, problems

    for problem in problems():
        if problem.name in ("wall 3 × 3", "arch t/R = 0.12", "arch t/R = 0.1"):
            assert ours(problem)[0].stands is problem.stands


def test_compas_cra_agrees_where_it_is_installed() -> None:
    pytest.importorskip("compas_cra")
    from validation.compare.compas_cra import compas_answers, problems

    for problem in problems():
        if problem.name in ("wall 3 × 3", "arch t/R = 0.12", "arch t/R = 0.1"):
            assert compas_answers(problem, ("rbe",))[0].stands is problem.stands


def test_blocks_beyond_the_digits_of_coordinates_are_refused(tmp_path: Path) -> None:
    """1e12 mm away coordinates are rounded to 1e-4 mm; gaps of 6e-3 mm are told apart."""
    scene = _layer_scene(tmp_path)
    text = scene.read_text().replace("at = [", "at = [1e12, ", 1)
    first = text.split("at = [1e12, ")[1].split("]")[0]
    x, y, z = (float(word) for word in first.split(","))
    far = scene.read_text().replace(f"at = [{first}]", f"at = [{x + 1e12}, {y}, {z}]")
    scene.write_text(far)
    with pytest.raises(RefusedError, match=r"1e\+12 mm from the origin.*move the assembly"):
        _answer(load_scene(str(scene)))
