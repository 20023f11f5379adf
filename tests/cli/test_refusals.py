"""Bad input gets one line, exit status 2 and no file: every row of tests/refusals.toml."""

from __future__ import annotations

import contextlib
import os
import shlex
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fem
import geometry
import mbd
import validation
from geometry import RefusedError
from tests.support.commands import command
from tests.support.cubes_deck import CUBES, changed

pytestmark = pytest.mark.quick

ROWS = tomllib.loads((Path(__file__).parents[1] / "refusals.toml").read_text("utf-8"))
#: Files of the folder in which commands are typed, and expressions of Python.
FILES, PYTHON = ROWS.pop("files"), ROWS.pop("python")
#: Changes of decks, by their files.
DECKS: dict[str, dict[str, str]] = ROWS.pop("lines-of-decks")
DIALECTS = {"cubes.inp": "calculix", "in-time.inp": "abaqus"}
REFUSALS: dict[str, str] = {words: line for rows in ROWS.values() for words, line in rows.items()}


def typed(words: str) -> Iterator[str]:
    """Words of a row as the command takes them: KEY=VALUE is a setting, unless of an option."""
    before = ""
    for word in shlex.split(words):
        if "=" in word and not word.startswith("-") and before != "--accuracy":
            yield "--set"
        yield word
        before = word


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() if path.is_file() else b"" for path in folder.iterdir()}


@pytest.fixture(scope="module", name="folder")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where commands are typed: no line changes it."""
    folder = tmp_path_factory.mktemp("typed")
    for name, text in FILES.items():
        (folder / name).write_text(text, "utf-8")
    # What is no file, and is never opened: a pipe that nobody fills, links in a circle, a folder.
    os.mkfifo(folder / "pipe.toml")
    (folder / "loop.toml").symlink_to("loop.toml")
    (folder / "zero.toml").symlink_to("/dev/zero")
    (folder / "folder.toml").mkdir()
    (folder / "link.toml").symlink_to("scene.toml")
    return folder


@pytest.mark.parametrize("words", REFUSALS)
def test_bad_input_gets_the_line_of_the_table(folder: Path, words: str) -> None:
    before = contents(folder)
    with contextlib.chdir(folder):
        assert command(*typed(words)) == (2, "", f"error: {REFUSALS[words]}\n")
    assert contents(folder) == before


@pytest.mark.parametrize(("name", "change"), [(n, c) for n, rows in DECKS.items() for c in rows])
def test_a_deck_gets_the_line_of_the_table(tmp_path: Path, name: str, change: str) -> None:
    lines = FILES[name].splitlines() if name in FILES else CUBES
    for one in change.split(" && "):
        old, new = one.split(" => ")
        lines = changed(old, new, lines)
    (tmp_path / name).write_text("\n".join([*lines, ""]), "utf-8")
    with contextlib.chdir(tmp_path):
        found = command("deck", name, "--dialect", DIALECTS[name])
    assert found == (2, "", f"error: {name}: {DECKS[name][change]}\n")


class Names(dict[str, Any]):
    """Public names, and what expressions are about: a tube of one layer under pressure."""

    def __missing__(self, name: str) -> Any:
        package = next(p for p in (geometry, mbd, fem, validation) if name in dir(p))
        return getattr(package, name)


@pytest.fixture(scope="module", name="names")
def _names() -> Names:
    sizes = {"height": 200, "amplitude": 20, "frequency": 1.5, "blocks_per_layer": 4}
    sine = geometry.SineBlock(**sizes, inner_radius=120, thickness=40)
    blocks = geometry.tube(sine, layers=1, mesh=(12, 1, 2))
    load = geometry.pipe(0.01).on(blocks)
    problem = fem.Problem(blocks, geometry.pipe(0.01), fem.concrete)
    cube = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    quads = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    low, high = ((100.0 * cube + [0.0, 0.0, z], quads) for z in (0.0, 100.0))
    box = {"block": {"type": "box", "size": [100.0, 50.0, 40.0]}, "mesh": {"divisions": [2, 1, 1]}}
    search = {"scene": "tsb1-pipe", "minimise": "p_max", "evaluations": 6}
    search |= {"variables": {"block.amplitude": [10, 20]}}
    solids = geometry.Assembly.from_blocks([low, high], fixed=[0])
    four = [(100.0 * cube + [0.0, 0.0, 100.0 * k], quads) for k in range(4)]
    stack = geometry.Assembly.from_blocks(four, fixed=[0])
    weight = {"friction": 0.6, "gravity": (0.0, 0.0, -9810.0)}
    tower = fem.Problem(stack, None, fem.concrete, **weight)
    return Names(locals() | {"np": np, "replace": replace})


@pytest.mark.parametrize("words", PYTHON)
def test_misuse_from_python_gets_the_line_of_the_table(names: Names, words: str) -> None:
    with pytest.raises(RefusedError) as refused:
        eval(words, {}, names)
    assert str(refused.value) == PYTHON[words]
