"""The first row answers what was asked; what only lies there is held down by its weight."""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import pytest

from geometry import box_block
from tests.support.commands import answered, command, set_words
from validation import load_case, report, solve

pytestmark = pytest.mark.quick

ARCH = ("block.thickness=200.0", "assembly.voussoirs=7", "assembly.embrace=140.0")


def cubes(folder: Path, places: list[list[float]], fixed: list[int], more: str = "") -> Path:
    """Cubes of 100 mm at places, which weigh 9.81 N each."""
    mesh = box_block((100.0, 100.0, 100.0), (1, 1, 1)).mesh
    cube = meshio.Mesh(mesh.nodes, [("hexahedron", mesh.elements)])
    meshio.write(folder / "cube.vtu", cube)
    at = ", ".join(f"{{at = {place}}}" for place in places)
    path = folder / "cubes.toml"
    path.write_text(
        f'[block]\ntype = "mesh"\n[[parts]]\nfile = "cube.vtu"\nplaces = [{at}]\n[assembly]\n'
        f"fixed = {fixed}\n[material]\ndensity = 1e-9\nyoung_modulus = 33000.0\n"
        "poisson_ratio = 0.2\n[effects]\n"
        f"gravity = [0.0, 0.0, -9810.0]\n{more}"
    )
    return path


def rows(folder: Path, *words: str) -> list[str]:
    """Rows of the table that ``tubelock mbd`` prints."""
    status, out, err = command("mbd", *words, "-o", str(folder / "out"))
    assert status == 0, err
    return [line for line in out.splitlines() if line.startswith("│")]


def test_the_rows_of_the_data_are_those_that_are_printed(tmp_path: Path) -> None:
    """In their order, and the value of a row that begins with a number is that number."""
    path = cubes(tmp_path, [[0, 0, 0], [0, 0, 100]], [0])
    found, said = answered("mbd", str(path))
    lines = [line.split("│")[1:3] for line in said.splitlines() if line.startswith("│")]
    data = found["rows"]
    titles = [row["title"] for row in data]
    assert [line[0].strip() for line in lines if line[0].strip()] == list(dict.fromkeys(titles))
    printed = "".join("".join(line[1] for line in lines).split())
    assert printed == "".join("".join(row["words"] for row in data).split())
    for row in data:
        first = re.match(rf"([-\d.e+]+) {row['unit']}", row["words"])
        if row["unit"] and first is not None:
            assert float(first[1]) == pytest.approx(row["value"], rel=1e-3)
    (peak,) = [row for row in data if row["title"] == "largest contact pressure"]
    assert peak["value"] == pytest.approx(9.81 / 100.0**2, rel=1e-9)


def test_an_arch_that_stands_with_friction_is_said_to_stand(tmp_path: Path) -> None:
    settings = set_words(ARCH)
    first, *others = rows(tmp_path, "arch", *settings)
    assert first.split("│")[1].strip() == "verdict"
    assert first.split("│")[2].strip() == "carried with friction μ = 1 (without: not carried)"
    assert any("activated: a mechanism exists" in row.split("│")[2] for row in others)


def test_words_of_the_paper_stand_in_its_own_row() -> None:
    """What is asked first is whether the load is carried, in words of statics."""
    answer = solve(load_case("brick-stack", method="rigid"))
    assert "not carried" in answer.title
    rows = answer.as_dict()["rows"]
    named = [row for row in rows if re.search("activat|suppress|neutral", row["words"])]
    assert [row["title"] for row in named] == ["class of the paper (no friction)"]


def test_a_block_that_only_lies_there_is_held_down_by_its_weight(tmp_path: Path) -> None:
    """Nothing but its weight resists a push upwards; the block below resists one downwards."""
    path = cubes(tmp_path, [[0, 0, 0], [0, 0, 100]], [0])
    (row,) = [row for row in rows(tmp_path, str(path)) if "resistance to pushes" in row]
    assert "resists pushes along -z; held down by its weight against pushes along +z" in row
    answer = solve(load_case(path, method="rigid")).as_dict()
    assert answer["pushes"]["held_against"]["+z"]
    assert answer["pushes"]["held_by_load"] == ["+z"]


def test_a_state_held_by_prestress_is_yellow_and_its_forces_have_a_caveat(tmp_path: Path) -> None:
    """A cube between two fixed ones needs W / 2 μ from each."""
    more = "[effects.friction]\ncoefficient = 0.5\n"
    path = cubes(tmp_path, [[0, 0, 0], [100, 0, 0], [200, 0, 0]], [0, 2], more)
    file = load_case(str(path))
    run = solve(file.with_method("rigid"))
    words = "carried if pressed beforehand (a hint, not proved): at least 9.81 N between 0 (cube)"
    assert run.details.words.startswith(words)
    assert "if pressed beforehand (a hint, not proved)" in run.title
    assert run["least_joint_force"].value == pytest.approx(9.81, rel=1e-6)
    page = report(file, tmp_path / "page.html", quick=True).read_text("utf-8")
    assert words in page
    first, *others = rows(tmp_path, str(path))
    assert "carried if pressed beforehand (a hint, not proved): at least 9.81 N" in first
    assert any("whether the load brings it about is not proved" in row for row in others)
