"""The table of the files of a folder: as they are, repaired, rejected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geometry import read_blocks
from geometry.polyhedra.assembly import polyhedral_assembly
from geometry.polyhedra.overlap import check_assembly
from tests.benchmarks.shell import write_shell
from tests.verification.folder import assemblies, rows

pytestmark = pytest.mark.slow

CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
SIDES = ((1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6))


def cube(number: int, height: float) -> list[str]:
    """A cube of 100 mm on a height, as an object of an OBJ file."""
    corners = 100.0 * CORNERS + [0.0, 0.0, height]
    faces = [" ".join(str(8 * number + k) for k in side) for side in SIDES]
    return [f"o {number}", *(f"v {x} {y} {z}" for x, y, z in corners), *(f"f {f}" for f in faces)]


def test_files_of_a_folder_are_answered_repaired_or_rejected(tmp_path: Path) -> None:
    stack, inside = (cube(0, 0.0) + cube(1, height) for height in (100.0, 95.0))
    twice = cube(0, 0.0)
    for name, lines in (("inside", inside), ("stack", stack), ("twice", [*twice, twice[-1]])):
        (tmp_path / f"{name}.obj").write_text("\n".join(lines), "utf-8")
    found = {row["file"]: row for row in rows(tmp_path)}
    assert {file: row["fate"] for file, row in found.items()} == {
        "inside.obj": "rejected",
        "stack.obj": "as it is",
        "twice.obj": "repaired",
    }
    assert "overlap by 5 mm" in found["inside.obj"]["why"]
    assert found["twice.obj"]["why"] == "a single block"
    assert "statically admissible" in found["stack.obj"]["rigid"]
    assert found["stack.obj"]["deformable"].startswith("u ")


def test_numbered_files_of_a_folder_are_one_assembly(tmp_path: Path) -> None:
    for number in (*range(8), 9):
        (tmp_path / f"Part_{number:02d}.obj").touch()
    for name in ("sphere-1.stl", "sphere-2.stl", "lid.obj"):
        (tmp_path / name).touch()
    found = {name: len(files) for name, files in assemblies(tmp_path).items()}
    assert found == {"Part_*.obj": 9, "lid.obj": 1, "sphere-1.stl": 1, "sphere-2.stl": 1}


def test_blocks_of_the_shell_are_closed_and_stand_side_by_side(tmp_path: Path) -> None:
    rim = write_shell(tmp_path / "shell.obj", 4)
    blocks = read_blocks(tmp_path / "shell.obj")
    assert 0 < len(rim) < len(blocks)
    # Above and below a plan of 12 m × 10 m, thicker where it is steep.
    assert sum(block.volume for block in blocks) > 12e3 * 10e3 * 300.0
    assembly = polyhedral_assembly(
        "shell",
        [(block, np.eye(3), np.zeros(3)) for block in blocks],
        np.isin(np.arange(len(blocks)), rim),
    )
    check_assembly(assembly)
