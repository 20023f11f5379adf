"""Files are whole or not there, and no other file is touched while they are written."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from fem import Problem, concrete, write_deck
from geometry import ColumnBox, LoadCase, PressureLoad, box_block, box_column
from geometry.files.mesh_io import write_hex_mesh
from geometry.machine.system import write_whole

pytestmark = pytest.mark.quick


def test_calls_that_write_one_file_at_once_publish_whole_ones(tmp_path: Path) -> None:
    """A shared temporary name is renamed away under the second writer, or holds parts of both."""
    path, together = tmp_path / "answer.json", threading.Barrier(8)
    failures: list[BaseException] = []

    def write(number: int) -> None:
        def fill(partial: Path) -> None:
            assert partial.suffix == path.suffix
            with partial.open("w") as file:
                for _ in range(100):
                    file.write(f"{number}")
                    file.flush()
            together.wait(timeout=60)

        try:
            write_whole(path, fill)
        except BaseException as error:
            failures.append(error)

    writers = [threading.Thread(target=write, args=(k,)) for k in range(8)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert not failures
    assert len(set(path.read_text())) == 1
    assert list(tmp_path.iterdir()) == [path]


def test_no_link_leads_a_result_elsewhere(tmp_path: Path) -> None:
    secret, path = tmp_path / "secret", tmp_path / "p.json"
    secret.write_text("mine")
    (tmp_path / ".partial-p.json").symlink_to(secret)
    write_whole(path, lambda partial: partial.write_text("result"))
    assert (secret.read_text(), path.read_text()) == ("mine", "result")
    # As any other new file.
    plain = tmp_path / "plain"
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode


def test_meshes_and_decks_have_names_of_their_own_until_they_are_whole(tmp_path: Path) -> None:
    """As every file: a link under the name that a half file once had leads nowhere."""
    secret = tmp_path / "secret"
    secret.write_text("mine")
    names = ("a.vtu", "a.inp", "deck.inp")
    for name in names:
        (tmp_path / f".partial-{name}").symlink_to(secret)
    box = box_block((1.0, 1.0, 1.0), (1, 1, 1))
    for name in names[:2]:
        write_hex_mesh(tmp_path / name, box.mesh)
    column = box_column([ColumnBox((100.0, 80.0, 50.0), (1, 1, 1))] * 2)
    pressure = PressureLoad(np.array([1]), "z+", 0.5)
    load = LoadCase(column, "pressure", (pressure,), column.fixed)
    write_deck(Problem(column, load, concrete), tmp_path / names[2])
    assert secret.read_text() == "mine"
    assert all((tmp_path / name).stat().st_size > 100 for name in names)
