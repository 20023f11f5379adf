"""Whole command lines at random, a few of those that ``python -m tests.fuzz`` tries."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz import Fate, judge
from tests.support.commands import command
from validation import InputError, load_case

pytestmark = pytest.mark.quick

CUBE = 10.0 * np.array(
    [[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=np.float64
)


def test_what_is_no_file_is_refused_before_it_is_opened(tmp_path: Path) -> None:
    """A pipe that nobody fills, a device without end, a folder, a link to itself."""
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for name in ("pipe", "folder", "loop", "zero", "bytes"):
        for words in ("mbd", "sweep"):
            status, _, line = command(words, str(tmp_path / f"{name}.toml"))
            assert status == 2
            assert re.match(rf"error: .*{name}\.toml: .*; expected", line)
            assert line.count("\n") == 1
    with pytest.raises(InputError, match=r"x: .*name too long"):
        load_case(tmp_path / ("x" * 300))
    assert stat.S_ISFIFO((tmp_path / "pipe.toml").stat().st_mode)


@pytest.mark.parametrize(
    ("status", "said", "fate"),
    [
        (0, "", Fate.RIGHT),
        (2 << 8, "error: scene: got 1; expected 2", Fate.REFUSED),
        (2 << 8, "error: got\nexpected", Fate.ODD),
        (1 << 8, "Traceback (most recent call last):\nValueError", Fate.TRACEBACK),
        (0, "x.py:3: RuntimeWarning: invalid value", Fate.ODD),
        (11, "", Fate.CRASHED),
        (24, '  File "/x/tomllib/_parser.py", line 3 in loads', Fate.HUNG),
        (24, '  File "/x/mbd/equilibrium.py", line 3 in solve', Fate.WORKING),
    ],
)
def test_fates_are_told_apart(tmp_path: Path, status: int, said: str, fate: Fate) -> None:
    assert judge(status, tmp_path / "out", said, tmp_path)[0] is fate


def test_broken_json_and_half_files_are_odd(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text('{"x": NaN}')
    assert judge(0, tmp_path / "out", "", tmp_path)[0] is Fate.ODD
    (tmp_path / "result.json").write_text('{"x": null}')
    assert judge(0, tmp_path / "out", "", tmp_path)[0] is Fate.RIGHT
    (tmp_path / ".partial-a.vtu").touch()
    assert judge(0, tmp_path / "out", "", tmp_path)[0] is Fate.ODD


#: Lines that ended in a traceback, or never, when they were first tried.
LINES = [
    ("mbd", "tsb1-pipe", "--set", f"mesh.around={'9' * 5000}"),
    ("mbd", "loop.toml", "--json", "result.json"),
    ("mbd", "own.toml", "--json", "result.json"),
    ("deck", "block.vtu", "--write", "picture.png"),
    ("deck", "block.h5m"),
    ("sweep", "study.toml", "--rows", "pipe", "-o", "new.jsonl"),
    ("sweep", "study.toml", "-o", "x.jsonl", "--workers", "1" + "0" * 100),
]
OWN = """
[block]
type = "mesh"
[[parts]]
file = "block.vtu"
places = [{ fixed = true }, { at = [0.0, 0.0, 10.0] }]
"""


@pytest.mark.parametrize("words", LINES, ids=lambda words: " ".join(words)[:40])
def test_lines_that_broke_the_program_are_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "block.h5m").write_bytes(b"no mesh")
    (tmp_path / "block.vtu").symlink_to("block.vtu")
    (tmp_path / "own.toml").write_text(OWN)
    (tmp_path / "study.toml").write_text(
        'scene = "tsb1-pipe"\nquantity = "fem"\n[parameters]\n"contact.clearance" = [0.0, 0.01]\n'
    )
    status, _, line = command(*words)
    assert (status, line.count("\n")) == (2, 1), line
    assert line.startswith("error: ")
