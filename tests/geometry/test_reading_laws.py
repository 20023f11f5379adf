"""Advice of a message works when it is followed; OFF files; blocks named after their files."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from geometry import RefusedError, read_blocks
from tests.support.commands import command

pytestmark = pytest.mark.quick

_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
_SIDES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
_POINTS = [*(100.0 * _CORNERS).tolist(), [50.0, 50.0, 130.0]]
#: A box under a roof of four triangles: a hole in the roof is not always flat.
_HOUSE = [_SIDES[0], *_SIDES[2:], [4, 5, 8], [5, 7, 8], [7, 6, 8], [6, 4, 8]]


def off(path: Path, faces: list[list[int]]) -> Path:
    lines = ["OFF", f"{len(_POINTS)} {len(faces)} 0"]
    lines += [" ".join(map(str, p)) for p in _POINTS]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    path.write_text("\n".join(lines))
    return path


def refusal(path: Path, *, repair: bool) -> str:
    try:
        read_blocks(path, repair=repair)
    except RefusedError as error:
        return str(error)
    return ""


def test_repair_is_advised_where_it_helps_and_nowhere_else(tmp_path: Path) -> None:
    """Two faults at a time in all ways: faces lost, turned, listed twice."""
    advised = set()
    for a, b in combinations(range(len(_HOUSE)), 2):
        for kind in ("lost", "turned", "twice"):
            faces = [face for k, face in enumerate(_HOUSE) if k not in (a, b)]
            faces += {
                "lost": [],
                "turned": [_HOUSE[a][::-1], _HOUSE[b][::-1]],
                "twice": 2 * [_HOUSE[a], _HOUSE[b]],
            }[kind]
            path = off(tmp_path / "a.off", faces)
            before, after = (refusal(path, repair=repair) for repair in (False, True))
            assert before, (kind, a, b)
            assert ("repair = true" in before) == (not after), (kind, a, b, before, after)
            assert "repair = true" not in after
            advised.add("repair = true" in before)
    assert advised == {True, False}


def test_off_files_have_comments_polygons_and_colours(tmp_path: Path) -> None:
    plain = off(tmp_path / "plain.off", _HOUSE)
    lines = plain.read_text().splitlines()
    face = 2 + len(_POINTS)
    lines = [f"# made by hand\nC{lines[0]} {lines[1]}  # counts", "", *lines[2:]]
    lines[3] += " 0.5 0.5 0.5 1.0  # a corner and its colour"
    lines[face] += " 255 0 0"
    (tmp_path / "commented.off").write_text("\n".join(lines))
    (one,), (other,) = (read_blocks(tmp_path / f"{n}.off") for n in ("plain", "commented"))
    assert one.volume == pytest.approx(1.1e6, rel=1e-12)
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.triangles, other.triangles)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "got no line OFF at its start"),
        ("OFF\n1 x\n", "line 2: cannot be read"),
        ("OFF\n# none\n4\n", "line 3: got fewer numbers than expected"),
        ("OFF 1 1 0\n0 0 0\n", "line 1: cannot be read (1 lines follow for 1 points and 1 faces"),
        ("OFF 1 1 0\n0 0 0\n3 0 0 1\n", "line 3: cannot be read (there are 1 points"),
        ("OFF 1 1 0\n0 0 0\n3 0 0\n", "line 3: cannot be read (a face of 2 corners)"),
        ("OFF 1 1 0\n0 0\n3 0 0 0\n", "line 2: cannot be read"),
    ],
)
def test_the_line_of_an_off_file_that_cannot_be_read_is_named(
    tmp_path: Path, text: str, line: str
) -> None:
    (tmp_path / "a.off").write_text(text)
    assert line in refusal(tmp_path / "a.off", repair=False)


def test_one_file_a_block_names_the_block_and_check_looks_at_all_of_a_scene(
    tmp_path: Path,
) -> None:
    for name in ("base", "top"):
        off(tmp_path / f"{name}.off", _SIDES)
    scene = tmp_path / "a.toml"
    for height, status, overlaps in ((100.0, 0, []), (97.0, 1, [[0, 1]])):
        scene.write_text(
            f"""
            [block]
            type = "mesh"
            [[parts]]
            file = "base.off"
            [[parts]]
            file = "top.off"
            places = [{{ at = [10.0, 0.0, {height}] }}]
            [assembly]
            fixed = ["base"]
            """
        )
        ended, out, _ = command("check", str(scene), "--json", "-")
        check = json.loads(out)
        assert ended == status
        assert [block["name"] for block in check["blocks"]] == ["base", "top"]
        assert [block["support"] for block in check["blocks"]] == [True, False]
        assert check["blocks"][1]["lowest_point"][2] == height
        assert [overlap["blocks"] for overlap in check["overlaps"]] == overlaps
        assert all(o["depth"] == pytest.approx(3.0, rel=1e-9) for o in check["overlaps"])
