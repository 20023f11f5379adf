"""A family of blocks is one file: its record is found by its name, and everything works with it."""

from __future__ import annotations

import importlib
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import geometry
from tests.support.face import (
    CASES,
    SCENE_TYPES,
    AssemblyScene,
    Flavour,
    NamedLoad,
    PlacedBlocks,
    Polyhedron,
    PressureLoad,
    RoundScene,
    build_deck,
    build_polyhedra,
    builtin_names,
    check_scene,
    round_types,
)
from tests.support.face import scene_families_module as families
from validation import load_case

#: A family that nobody knows of: a tube of plain bricks, as short as a record can be.
NEW = '''
from typing import Literal

from validation.scene.family import BlockSection, RoundScene
from validation.scene.families.sine import TubeMeshSection
from validation.scene.sections import Positive


class PlainSection(BlockSection):
    """``[block] type = "plain"``: a piece of a cylinder."""

    type: Literal["plain"]
    inner_radius: Positive
    thickness: Positive


class PlainScene(RoundScene):
    """A tube of plain bricks."""

    block: PlainSection
    mesh: TubeMeshSection

    def build(self):
        from geometry.families.sine_block import SineBlockDivisions, SineBlockParameters
        from geometry.families.tube import sine_tube

        shape = SineBlockParameters(
            height=100.0, amplitude=0.0, frequency=1.0, blocks_per_layer=4,
            inner_radius=self.block.inner_radius, thickness=self.block.thickness,
        )
        return sine_tube(shape, SineBlockDivisions(**self.mesh.model_dump()), self.assembly.layers)
'''
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
"""
USE = """
import json
from fem.decks.statement import Flavour
from validation.build.deck import build_deck
from validation.run.rigid.explosion import run_explosion
from validation.run.rigid.answer import run_rigid
from validation.run.solve import run_static
from validation import load_case
from validation.scene.family import round_types
from validation.scene.keys.schema import scene_schema
file = load_case("plain.toml")
schema = scene_schema()["properties"]["block"]["properties"]["type"]["enum"]
print(json.dumps({
    "rigid": str(solve(file.with_method("rigid")).details.mechanism),
    "static": run_static(file.name, file.scene).solution.contact.p_eff,
    "deck": build_deck(file, Flavour.GENERAL).name,
    "explodes": run_explosion(file).explodes,
    "schema": "plain" in schema,
    "round": round_types(),
}))
"""


def test_a_new_family_is_one_file(tmp_path: Path) -> None:
    """A file beside the others is found; rigid, static, deck, explosion and schema take it."""
    import json
    import shutil

    room = tmp_path / "validation"
    shutil.copytree(Path(families.__file__).parents[2], room)
    (room / "scene" / "families" / "plain.py").write_text(NEW)
    (tmp_path / "plain.toml").write_text(SCENE)
    run = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["rigid"] in ("neutral", "suppressed", "activated", "locked")
    assert found["static"] > 0.0
    assert found["deck"] == "plain"
    assert found["schema"]
    assert found["round"] == '"sine" or "plain" or "hexagon"'


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
    small = ["mesh.around=12", "mesh.radial=1", "mesh.axial=2", "assembly.layers=1"]
    file = load_case("tsb1-pipe", ["load.case=stripes", *small])
    (load,) = build_deck(file, Flavour.GENERAL).loads
    assert isinstance(load, PressureLoad)
    assert load.blocks.tolist() == [4, 6]
    assert (load.face, load.pressure) == ("inner", 0.01)
    assert file.scene.load_words.startswith("pressure on every second block 0.01 MPa")


def test_every_family_is_in_the_table_once() -> None:
    assert AssemblyScene.families.items() <= SCENE_TYPES.items()
    assert set(AssemblyScene.families) == {
        *("sine", "hexagon", "brick", "planar-sine", "osteomorphic", "boxes", "box"),
        *("roller", "ball"),
    }
    assert round_types() == '"sine" or "hexagon"'
    for scene in AssemblyScene.families.values():
        module = importlib.import_module(scene.__module__)
        assert module.__name__.startswith("validation.scene.families.")


@pytest.mark.parametrize("name", builtin_names())
def test_coarse_meshes_have_no_more_elements(name: str) -> None:
    scene = load_case(name).scene
    if not isinstance(scene, AssemblyScene):
        return
    counts, coarse = scene.element_counts, scene.coarse_mesh(6, 2, 3)
    for key, value in coarse.items():
        assert value != counts[key] or isinstance(scene, RoundScene)
        pairs = (
            zip(value, counts[key], strict=True) if key == "divisions" else [(value, counts[key])]
        )
        assert all(0 < a <= b for a, b in pairs)


#: A small scene of each family of triangulated blocks, and the same blocks made in Python.
LAYERS = {
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


@pytest.mark.parametrize("kind", SCENE_TYPES.keys() - AssemblyScene.families.keys() - {"mesh"})
def test_a_scene_states_the_dataclass_that_python_takes(kind: str) -> None:
    """Keys of its sections are the fields, and both build the same blocks."""
    data, stated = LAYERS[kind]
    scene = check_scene({**data, "block": {"type": kind, **data["block"]}})
    keys = [*type(scene.block).model_fields, *type(scene.assembly).model_fields]
    assert sorted(keys) == sorted(["type", *(field.name for field in fields(stated))])
    assert scene.stated == stated
    same_blocks(build_polyhedra(scene, Path()), stated.build())
