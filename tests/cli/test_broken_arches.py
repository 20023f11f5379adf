"""Thirteen arches as designers send them: `check` and `mbd` say what is wrong with each."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.fixtures.commands import undrawn
from tests.support.drawn_blocks import Drawn, arch, triangles_of, write_obj
from validation.cli.app import app

pytestmark = pytest.mark.quick

_Blocks = dict[str, Drawn]


def _cut(drawn: Drawn) -> Drawn:
    """The same block, of triangles."""
    return drawn[0], [tuple(t) for t in triangles_of(drawn).tolist()]


def _metres(blocks: _Blocks) -> None:
    for name, (points, faces) in blocks.items():
        blocks[name] = points / 1000.0, faces


def _y_up(blocks: _Blocks) -> None:
    for name, (points, faces) in blocks.items():
        blocks[name] = points @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), faces


def _inside_out(blocks: _Blocks) -> None:
    for name, (points, faces) in blocks.items():
        blocks[name] = points, [face[::-1] for face in faces]


def _turned(blocks: _Blocks) -> None:
    points, faces = blocks["V06"]
    blocks["V06"] = points, [face[::-1] if k < 4 else face for k, face in enumerate(faces)]


def _unwelded(blocks: _Blocks) -> None:
    for name, (points, faces) in blocks.items():
        corners = [tuple(range(3 * k, 3 * k + 3)) for k in range(len(faces))]
        blocks[name] = points[np.array(faces).ravel()], corners


def _moved(blocks: _Blocks, distance: float) -> None:
    """The right half along the joint normal of the crown, which is x."""
    for name in ("V07", "V08", "V09", "V10", "V11", "S_right"):
        points, faces = blocks[name]
        blocks[name] = points + np.array([distance, 0.0, 0.0]) / _COSINE, faces


#: Of the angle of the joint between V06 and V07 to the vertical plane.
_COSINE = np.cos(np.pi / 22)


def _missing(blocks: _Blocks) -> None:
    del blocks["V04"]


def _twice(blocks: _Blocks) -> None:
    blocks["V04 copy"] = blocks["V04"]


def _hole(blocks: _Blocks) -> None:
    points, faces = blocks["V06"]
    blocks["V06"] = points, faces[1:]


def _corner(blocks: _Blocks, distance: float) -> None:
    """An intrados corner of V06 along the joint, into V05 or away from it."""
    points, faces = blocks["V06"]
    points = points.copy()
    points[3] += distance * np.array([-np.cos(np.pi / 22), 0.0, -np.sin(np.pi / 22)])
    blocks["V06"] = points, faces


#: Change of the arch, words of `check`, words of `mbd`.
_ARCHES: dict[str, tuple[Callable[[_Blocks], None], list[str], list[str]]] = {
    "metres as mm": (_metres, ["likely unit", "--units m"], ['units = "m"']),
    "y up": (
        _y_up,
        [f"block {k} (V{k + 1:02d}) 1.2678e+07 mm³, lowest at z = -150 mm" for k in range(11)],
        ["not carried", "which way is up", 'block.up = "y"'],
    ),
    "inside out": (
        _inside_out,
        ["13 closed", "12 pairs"],
        ["carried with friction", "statically admissible"],
    ),
    "four triangles turned": (
        _turned,
        ["block 5 (V06)", "face opposite ways"],
        ["V06", "face opposite ways"],
    ),
    "unwelded": (
        _unwelded,
        ["13 closed", "12 pairs"],
        ["carried with friction", "statically admissible"],
    ),
    "gap of 1 mm": (
        lambda blocks: _moved(blocks, 1.0),
        ["gap", "block 5 (V06) and block 6 (V07): 1 mm apart"],
        ["facing area not in contact", "1 mm"],
    ),
    "overlap of 2 mm": (
        lambda blocks: _moved(blocks, -2.0),
        ["overlap", "block 5 (V06) and block 6 (V07): 2 mm deep"],
        ["5 (V06) and 6 (V07) overlap by 2 mm"],
    ),
    "missing": (_missing, ["12 closed", "10 pairs"], ["not carried with friction"]),
    "twice": (
        _twice,
        ["block 3 (V04) and block 13 (V04 copy)", "one block that is there twice"],
        ["3 (V04) and 13 (V04 copy)", "one block that is there twice"],
    ),
    "hole": (_hole, ["block 5 (V06)", "is open"], ["V06", "is open"]),
    "quads": (
        lambda _: None,
        ["13 closed", "12 pairs"],
        ["carried with friction", "statically admissible"],
    ),
    "corner out, into the neighbour": (
        lambda blocks: _corner(blocks, 5.0),
        ["block 4 (V05) and block 5 (V06): 5 mm deep"],
        ["4 (V05) and 5 (V06) overlap by 5 mm"],
    ),
    "corner back, away from the neighbour": (
        lambda blocks: _corner(blocks, -5.0),
        ["facing area not in contact", "5 (V06)"],
        ["facing area not in contact", "blocks 4 (V05) and 5 (V06)"],
    ),
}


def _said(*words: str) -> str:
    result = CliRunner().invoke(app, list(words))
    return re.sub(r"[\s│]+", " ", f"{result.output} {result.exception or ''}")


@pytest.mark.parametrize("name", _ARCHES)
def test_check_and_mbd_say_what_is_wrong(name: str, tmp_path: Path) -> None:
    change, of_check, of_mbd = _ARCHES[name]
    blocks = arch(11, thickness=150.0)
    if name != "quads":
        blocks = {title: _cut(one) for title, one in blocks.items()}
    change(blocks)
    write_obj(tmp_path / "arch.obj", blocks)
    scene = tmp_path / "arch.toml"
    scene.write_text(
        '[block]\ntype = "mesh"\n[[parts]]\nfile = "arch.obj"\n'
        '[assembly]\nfixed = ["S_left", "S_right"]\n[effects]\ngravity = [0, 0, -9810]\n'
        "[effects.friction]\ncoefficient = 0.7\n",
        "utf-8",
    )
    told = _said("check", str(tmp_path / "arch.obj"))
    assert [words for words in of_check if words not in told] == []
    with undrawn():
        told = _said("mbd", str(scene), "-o", str(tmp_path / "out"))
    assert [words for words in of_mbd if words not in told] == []
