"""Every file says which program, scene, load and mesh it comes from, and when."""

from __future__ import annotations

import contextlib
import csv
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from tests.fixtures.commands import undrawn
from tests.support.coarse_tubes import coarse
from tests.support.commands import command, set_words
from validation import builtin_text, load_case, read_answer
from validation.output.files import Provenance, program, stamp_vtu, stamped
from validation.output.outputs import Outputs
from validation.scene.read import check_scene

SMALL = coarse(1, 2)


def settings() -> list[str]:
    return set_words(SMALL)


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("answer")
    files = ("-o", "out", "--fields", "--json", "answer.json")
    with contextlib.chdir(folder), undrawn():
        assert command("mbd", "tsb1-pipe", *settings(), *files)[0] == 0
    return folder, json.loads((folder / "answer.json").read_text("utf-8"))


def test_the_folder_holds_the_same_data_as_the_file_of_json(
    answer: tuple[Path, dict[str, Any]],
) -> None:
    folder, data = answer
    assert json.loads((folder / "out" / "answer.json").read_text("utf-8")) == data
    assert {"rows", "provenance", "unused_keys"} <= set(data)
    # An answer that is read has what was answered, not what the command added.
    assert "provenance" not in read_answer(folder / "out").report


def test_json_holds_all_that_asks_the_same_question_again(
    answer: tuple[Path, dict[str, Any]],
) -> None:
    _, data = answer
    origin = data["provenance"]
    assert origin["program"] == f"tubelock {program()}"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", origin["date"])
    stated = origin["scene"]
    assert stated.pop("name") == "tsb1-pipe"
    assert check_scene(stated) == load_case("tsb1-pipe", SMALL).scene


def test_field_file_names_scene_load_and_mesh_and_is_still_read(
    answer: tuple[Path, dict[str, Any]],
) -> None:
    folder, data = answer
    path = folder / "out" / "contact_pressures.vtu"
    first = path.read_bytes()[:2000].decode("utf-8", "replace")
    for words in (program(), "name tsb1-pipe", "case pipe", "around 12", "layers 1"):
        assert words in first
    pressures = meshio.read(path).cell_data["contact_pressure"][0]
    assert len(pressures) == data["n_contacts"]


def test_a_list_of_rows_stands_under_one_key() -> None:
    data = stamped([{"a": 1}], Provenance())
    assert data["rows"] == [{"a": 1}]
    assert data["json_version"] == 5
    assert "scene" not in data["provenance"]


def test_stamp_changes_no_number(tmp_path: Path) -> None:
    path = tmp_path / "mesh.vtu"
    points = np.random.default_rng(1).random((4, 3))
    meshio.write(path, meshio.Mesh(points, [("quad", np.array([[0, 1, 2, 3]]))]))
    # Two hyphens would end a comment of XML.
    (tmp_path / "a--b.toml").write_text(builtin_text("tsb1-pipe"), "utf-8")
    stamp_vtu(path, Provenance(load_case(str(tmp_path / "a--b.toml"))))
    assert np.array_equal(meshio.read(path).points, points)


def test_day_is_the_one_that_reproducible_builds_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert Provenance().as_json()["date"] == "1970-01-01"


def test_files_of_the_scene_are_no_outputs(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(builtin_text("tsb1-pipe"), "utf-8")
    with pytest.raises(Exception, match="is a file that this call reads"):
        Outputs(json=str(mine), case=load_case(str(mine))).__enter__()
    assert tomllib.loads(mine.read_text("utf-8"))["block"]["type"] == "sine"


def balanced_joints(out: Path, pressure: float) -> None:
    """Check that the joints of one layer balance its load, and that table and points agree."""
    with (out / "joints.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    column = {name: np.array([float(row[name]) for row in table]) for name in table[0]}
    force = np.column_stack([column[f"force_{axis}_N"] for axis in "xyz"])
    for block in range(4, 8):
        total = force[column["block_s"] == block].sum(axis=0)
        total -= force[column["block_m"] == block].sum(axis=0)
        # Pressure on the inner face of a quarter of the tube: its chord times its height.
        expected = pressure * 120.0 * np.sqrt(2.0) * 200.0
        assert np.linalg.norm(total) == pytest.approx(expected, rel=1e-6)
    size = np.linalg.norm(force, axis=1)
    # Without friction no facet has shear; normal forces of facets that turn sum to more.
    assert (column["normal_force_N"] >= size * (1 - 1e-9)).all()
    assert (column["shear_force_N"] <= 1e-9 * column["normal_force_N"].max()).all()
    points = meshio.read(out / "joints.vtu")
    assert np.array_equal(points.point_data["force"], force)
    assert np.array_equal(points.point_data["block_s"], column["block_s"])


def test_joints_of_rigid_blocks_balance_the_load(answer: tuple[Path, dict[str, Any]]) -> None:
    balanced_joints(answer[0] / "out", 0.01)


@pytest.mark.usefixtures("undrawn")
def test_field_files_of_a_deformable_tube_say_whose_each_row_is(tubelock) -> None:  # type: ignore[no-untyped-def]
    # From the files alone: elements lie in the blocks they name, layers are h high, and what the
    # contact facets press with balances the load p on the inner face of each free block.
    pressure = 0.01
    on_scene = ("--set", 'fem.mesh="scene"', "--set", "fem.error_estimate=false")
    assert tubelock("fem", "tsb1-pipe", *settings(), *on_scene, "--fields", "-o", "out")[0] == 0
    out = Path("out")
    solid, joints = meshio.read(out / "fields.vtu"), meshio.read(out / "contact_pressures.vtu")
    cells = {name: values[0] for name, values in solid.cell_data.items()}
    centroids = solid.points[solid.cells[0].data].mean(axis=1)
    assert set(np.unique(cells["block"])) == {4, 5, 6, 7}
    assert np.all(cells["layer"] == 1)
    assert np.all(cells["group"] == 0)
    angle = np.unwrap(np.arctan2(centroids[:, 1], centroids[:, 0]))
    spread = [np.ptp(angle[cells["block"] == block]) for block in range(4, 8)]
    assert max(spread) < np.pi / 2  # each block spans a quarter of the tube
    facets = {name: values[0] for name, values in joints.cell_data.items()}
    assert np.all(facets["layer_m"] <= 2)
    force = facets["contact_force"]
    # Facets of a coarse sine face are twisted: their normals turn, which only shortens the sum.
    assert np.all(
        np.linalg.norm(force, axis=1) <= facets["contact_pressure"] * facets["area"] * (1 + 1e-12)
    )
    assert np.allclose(np.linalg.norm(facets["normal"], axis=1), 1.0, rtol=1e-12)
    assert np.all(facets["gap"][facets["contact_pressure"] > 1.0e-4] < 0.0)
    balanced_joints(out, pressure)
    for block in range(4, 8):
        total = force[facets["block_s"] == block].sum(axis=0)
        total -= force[facets["block_m"] == block].sum(axis=0)
        # The chord of a quarter of the inner face times its height carries the pressure outward;
        # elements are flat, so that the projected area is exact.
        assert np.linalg.norm(total) == pytest.approx(
            pressure * 120.0 * np.sqrt(2.0) * 200.0, rel=1e-6
        )
