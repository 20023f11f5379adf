"""Blocks that bound no solid get one line with their name, from `check` and from `mbd`."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.support.drawn_blocks import Drawn, cuboid, write_obj
from validation.cli.app import app

pytestmark = pytest.mark.quick

_FLOOR, (_POINTS, _FACES) = cuboid((0, 0, 0), (100, 100, 50)), cuboid((0, 0, 50), (100, 100, 100))
_LOST = np.where(np.arange(24).reshape(8, 3) == 10, np.nan, _POINTS)
_SHEET = [_FACES[0], _FACES[0][::-1]]


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ((_POINTS, _SHEET), "volume 0 mm³; expected a positive volume"),
        ((_POINTS, _FACES[:-1]), "is open: 4 edges"),
        ((_POINTS, [_FACES[0][::-1], *_FACES[1:]]), "face opposite ways at 4 edges"),
        ((_LOST, _FACES), "a vertex is not finite"),
    ],
    ids=["no volume", "open", "mixed", "NaN"],
)
def test_bad_blocks_are_named_in_one_line(block: Drawn, words: str, tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", {"floor": _FLOOR, "top": block})
    scene = tmp_path / "a.toml"
    scene.write_text(
        '[block]\ntype = "mesh"\n[[parts]]\nfile = "a.obj"\n[assembly]\nfixed = ["floor"]\n',
        "utf-8",
    )
    for command in (["check", str(tmp_path / "a.obj")], ["mbd", str(scene)]):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 1
        told = str(result.exception) if command[0] == "mbd" else result.output
        assert command[0] == "check" or "\n" not in told
        told = re.sub(r"[\s│]+", " ", f"{result.output} {result.exception or ''}")
        assert "top" in told
        assert words in told
