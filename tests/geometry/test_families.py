"""A family of blocks is one file: its record is found by its name, and everything works with it."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import geometry
import validation
from fem.decks.deck import Flavour
from fem.decks.problem import problem_deck
from geometry import (
    Assembly,
    BrickStack,
    ColumnBox,
    Indenter,
    OsteomorphicWall,
    PlanarSineWall,
    Polyhedron,
    PressureLoad,
    SeparateBoxes,
    box_column,
)
from geometry.loads import CASES, NamedLoad
from geometry.parts.placed import PlacedBlocks
from tests.support.coarse_tubes import coarse
from tests.support.commands import command
from validation import builtin_names, load_case

#: A family that nobody knows of: a tube of plain bricks, its dataclass and its record.
NEW = {
    "geometry/families/plain.py": '''
from dataclasses import dataclass

from geometry.families.sine_block import SineBlockDivisions, SineBlock
from geometry.families.tube import SineTube
from geometry.parts.options import Count, Length, Options


@dataclass(frozen=True)
class PlainTube(Options):
    """A tube of plain bricks."""

    inner_radius: Length
    """[mm]"""
    thickness: Length
    """[mm]"""
    layers: Count
    around: Count
    radial: Count
    axial: Count

    def build(self):
        shape = SineBlock(
            height=100.0, amplitude=0.0, frequency=1.0, blocks_per_layer=4,
            inner_radius=self.inner_radius, thickness=self.thickness,
        )
        divisions = SineBlockDivisions(self.around, self.radial, self.axial)
        return SineTube(shape, divisions, self.layers).build()
''',
    "validation/scene/families/plain.py": """
from validation.scene.family import RoundScene, family

plain = "geometry.families.plain:PlainTube"
family(RoundScene, "plain", plain, assembly="layers", mesh="around radial axial")
""",
}
SCENE = """
[block]
type = "plain"
inner_radius = 120.0
thickness = 40.0
[assembly]
layers = 2
[mesh]
around = 8
radial = 2
axial = 2
[load]
case = "tunnel"
pressure = 0.01
[material]
density = 2.4e-9
young_modulus = 33000.0
poisson_ratio = 0.2
[contact]
[fem]
method = "static"
mesh = "scene"
error_estimate = false
"""
USE = """
import contextlib, io, json, sys
from importlib.metadata import entry_points
from fem import read_deck
from validation import load_case, solve

def tubelock(*words):
    sys.argv, out, said = ["tubelock", *words], io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        with contextlib.suppress(SystemExit):
            entry_points(group="console_scripts", name="tubelock")["tubelock"].load()()
    return out.getvalue(), said.getvalue()

case = load_case("plain.toml")
tubelock("export", "plain.toml", "--flavour", "general", "-o", "deck.inp")
tubelock("mbd", "plain.toml", "--disassemble", "--json", "explosion.json")
schema = json.loads(tubelock("scenes", "--schema")[0])["properties"]["block"]["properties"]
schema = schema["type"]["enum"]
print(json.dumps({
    "rigid": solve(case.with_method("rigid")).details.mechanism,
    "static": solve(case)["p_eff"].value,
    "deck": read_deck("deck.inp").problem().blocks.n_blocks,
    "explodes": json.load(open("explosion.json"))["disassembly"]["explodes"],
    "schema": "plain" in schema,
    "refused": tubelock("mbd", "brick-stack", "--disassemble")[1],
}))
"""


def test_a_new_family_is_a_dataclass_and_its_record(tmp_path: Path) -> None:
    """Two files, nothing else: rigid, static, deck, explosion and schema take it."""
    import json
    import shutil

    for package in (geometry, validation):
        shutil.copytree(Path(package.__file__).parent, tmp_path / package.__name__)
    for name, text in NEW.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "plain.toml").write_text(SCENE)
    run = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["rigid"] in ("neutral", "suppressed", "activated", "locked")
    assert found["static"] > 0.0
    assert found["deck"] == 16
    assert isinstance(found["explodes"], bool)
    assert found["schema"]
    assert all(f'"{kind}"' in found["refused"] for kind in ("sine", "plain", "hexagon"))


def test_a_load_case_is_one_record(monkeypatch: pytest.MonkeyPatch) -> None:
    """Door, statement, deck and titles take one that nobody knows of; each has its own name."""
    assert set(CASES) == {"beam", "pillar", "pipe", "shaft", "tunnel"}
    assert all(case.name == name for name, case in CASES.items())
    stripes = NamedLoad(
        name="stripes",
        words="pressure on every second block",
        face="inner",
        blocks=lambda assembly, _: assembly.free_blocks[::2],
    )
    monkeypatch.setitem(CASES, "stripes", stripes)
    small = list(coarse(1, 2))
    file = load_case("tsb1-pipe", ["load.case=stripes", *small])
    (load,) = problem_deck(file.problem, Flavour.GENERAL).problem.load_case.faces
    assert isinstance(load, PressureLoad)
    assert load.blocks.tolist() == [4, 6]
    assert (load.face, load.pressure) == ("inner", 0.01)
    assert file.scene.load_words.startswith("pressure on every second block 0.01 MPa")


def test_every_family_is_in_the_schema_once() -> None:
    status, out, _ = command("scenes", "--schema")
    assert status == 0
    assert json.loads(out)["properties"]["block"]["properties"]["type"]["enum"] == [
        *("ball", "box", "boxes", "brick", "hexagon", "osteomorphic", "planar-sine", "roller"),
        *("sine", "arch", "cubes", "mesh", "octahedra", "tetrahedra", "versatile", "voxels"),
        "wall",
    ]
    said = command("mbd", "brick-stack", "--disassemble")[2]
    assert '"sine" or "hexagon"' in said


@pytest.mark.parametrize("name", builtin_names())
def test_coarse_meshes_have_no_more_elements(name: str) -> None:
    scene: Any = load_case(name).scene
    if not hasattr(scene, "element_counts"):
        return
    counts, coarse = scene.element_counts, scene.coarse_mesh(6, 2, 3)
    for key, value in coarse.items():
        assert value != counts[key] or scene.block.type in {"sine", "hexagon"}
        pairs = (
            zip(value, counts[key], strict=True) if key == "divisions" else [(value, counts[key])]
        )
        assert all(0 < a <= b for a, b in pairs)


#: Families whose scenes name a load case.
NAMED_LOADS = {"brick", "planar-sine", "osteomorphic"}
#: Outline of the blocks of walls.
WALL = {"width": 80.0, "thickness": 40.0, "height": 60.0, "amplitude": 5.0}
#: A small scene of each family, and the dataclass that Python takes.
STATED = {
    "box": (
        {
            "block": {"size": [40.0, 30.0, 20.0]},
            "assembly": {"copies": 2},
            "mesh": {"divisions": [4, 3, 2]},
        },
        SeparateBoxes((40.0, 30.0, 20.0), (4, 3, 2), 2),
    ),
    "brick": (
        {
            "block": {"size": [40.0, 30.0, 20.0]},
            "assembly": {"columns": 2, "layers": 1},
            "mesh": {"divisions": [4, 3, 2]},
        },
        BrickStack((40.0, 30.0, 20.0), (4, 3, 2), columns=2, layers=1),
    ),
    "planar-sine": (
        {
            "block": WALL | {"frequency": 1.5, "shift": 0.5},
            "assembly": {"columns": 1, "layers": 2},
            "mesh": {"divisions": [12, 2, 2]},
        },
        PlanarSineWall(**WALL, frequency=1.5, shift=0.5, columns=1, layers=2, divisions=(12, 2, 2)),
    ),
    "osteomorphic": (
        {
            "block": WALL,
            "assembly": {"columns": 1, "layers": 2},
            "mesh": {"divisions": [4, 2, 2]},
        },
        OsteomorphicWall(**WALL, columns=1, layers=2, divisions=(4, 2, 2)),
    ),
    "ball": (
        {"block": {"radius": 100.0, "contact": 5.0}, "mesh": {"elements": 3}},
        Indenter("ball", 100.0, 5.0, 3),
    ),
    "roller": (
        {"block": {"radius": 100.0, "contact": 5.0, "thickness": 2.0}, "mesh": {"elements": 3}},
        Indenter("roller", 100.0, 5.0, 3, 2.0),
    ),
    "tetrahedra": (
        {"block": {"edge": 50.0, "thickness": 20.0}, "assembly": {"columns": 2, "rows": 1}},
        geometry.TetrahedraLayer(50.0, 2, 1, thickness=20.0),
    ),
    "octahedra": (
        {"block": {"edge": 50.0}, "assembly": {"rings": 1}},
        geometry.OctahedraLayer(50.0, 1),
    ),
    "cubes": (
        {"block": {"edge": 50.0, "arrangement": "square"}, "assembly": {"rings": 0}},
        geometry.CubesLayer(50.0, 0, "square"),
    ),
    "versatile": (
        {
            "block": {"side": 60.0, "height": 40.0, "arrangement": "p4"},
            "assembly": {"columns": 2, "rows": 1},
        },
        geometry.VersatilePanel(60.0, 40.0, 2, 1, "p4"),
    ),
    "wall": (
        {"block": {"size": [200.0, 100.0, 80.0]}, "assembly": {"columns": 2, "rows": 3}},
        geometry.RunningBondWall((200.0, 100.0, 80.0), 2, 3),
    ),
    "arch": (
        {
            "block": {"radius": 1000.0, "thickness": 200.0, "depth": 300.0},
            "assembly": {"voussoirs": 5, "embrace": 120.0},
        },
        geometry.CircularArch(1000.0, 200.0, 300.0, 5, 120.0),
    ),
    "voxels": (
        {"block": {"size": 10.0, "layers": [["AA", "BB"]]}, "assembly": {"fixed": "A"}},
        geometry.VoxelPuzzle([["AA", "BB"]], 10.0, "A"),
    ),
}


def same_blocks(one: PlacedBlocks, other: PlacedBlocks) -> None:
    """Shapes, places and what is fixed, to the last bit."""
    for name in ("shape_of", "rotations", "translations", "fixed"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for shape, same in zip(one.shapes, other.shapes, strict=True):
        nodes = [s.points if isinstance(s, Polyhedron) else s.mesh.nodes for s in (shape, same)]
        np.testing.assert_array_equal(*nodes)


def keys(scene: Any, *sections: str) -> list[str]:
    """Keys of sections, but the type of the block."""
    kinds = [type(getattr(scene, name)) for name in sections]
    return sorted(key for kind in kinds for key in kind.model_fields if key != "type")


def names(stated: Any) -> list[str]:
    return sorted(field.name for field in fields(stated) if field.name != "type")


@pytest.mark.parametrize("kind", STATED)
def test_a_scene_states_the_dataclass_that_python_takes(kind: str) -> None:
    """Keys of its sections are the fields, and both build the same blocks."""
    data, stated = STATED[kind]
    load = {"load": {"case": "tunnel", "pressure": 0.01}} if kind in NAMED_LOADS else {}
    case = load_case({**data, **load, "block": {"type": kind, **data["block"]}})
    scene: Any = case.scene
    assert keys(scene, *data) == names(stated)
    assert scene.stated == stated
    expected = stated.build()
    built = case if isinstance(expected, Assembly) else case.with_method("rigid")
    same_blocks(built.problem.blocks, expected)


@pytest.mark.parametrize(
    ("name", "mesh", "divisions"),
    [
        ("tsb1-pipe", {"around": 12, "radial": 1, "axial": 2}, (12, 1, 2)),
        ("thb0-pipe", {"edge": 4, "radial": 1}, (4, 1)),
    ],
)
def test_block_and_mesh_of_a_tube_are_dataclasses_of_their_own(
    name: str, mesh: dict[str, int], divisions: tuple[int, ...]
) -> None:
    """Those that `tube` takes; `[assembly]` has the other fields of the tube's."""
    scene: Any = load_case(name, {"mesh": mesh, "assembly.layers": 2}).scene
    stated = scene.stated
    assert keys(scene, "block") == names(stated.block)
    assert keys(scene, "mesh") == names(stated.divisions)
    assert keys(scene, "assembly") == sorted(set(names(stated)) - {"block", "divisions"})
    same_blocks(scene.build(), geometry.tube(stated.block, layers=2, mesh=divisions))


def test_boxes_of_a_column_are_a_dataclass() -> None:
    column: Any = load_case("column").scene
    boxes = [ColumnBox(**box.model_dump()) for box in column.block.boxes]
    assert sorted(type(column.block.boxes[0]).model_fields) == names(boxes[0])
    same_blocks(column.build(), box_column(boxes))
