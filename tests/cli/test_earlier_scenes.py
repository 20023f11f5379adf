"""Scenes of earlier versions: `tubelock check` prints the file as this version has it."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from validation import builtin_text, load_case
from validation.scene.earlier import GONE, MOVED

pytestmark = pytest.mark.quick

ARCH = """\
#:schema scene.json
[block]
type = "arch"
radius = 1000.0
thickness = 150.0
depth = 300.0
[assembly]
voussoirs = 9
[rigid]   # how
collapse = false
friction = 0.7  # measured
[load]
gravity = [0.0, 0.0, -9810.0]   # down
density = "2400 kg/m3"
[material]
young_modulus = 33000.0
poisson_ratio = 0.2
"""


def test_moved_keys_take_their_comments_along(tubelock) -> None:
    Path("old.toml").write_text(ARCH)
    status, new, told = tubelock("check", "old.toml")
    assert (status, told) == (1, "")
    for key, place in MOVED.items():
        assert f"# Changed: {key} is {place}\n" in new
    assert "friction = 0.7  # measured\n" in new
    assert "gravity = [0.0, 0.0, -9810.0]   # down\n" in new
    Path("new.toml").write_text(new)
    scene = load_case("new.toml").scene
    assert scene.effects.gravity == (0.0, 0.0, -9810.0)
    assert scene.effects.friction.coefficient == 0.7
    assert scene.material.density == 2.4e-9
    # What is new is read as it is.
    status, said, told = tubelock("check", "new.toml")
    assert (status, told) == (0, "")
    assert "new.toml" in said


def test_values_over_several_lines_and_sections_in_braces_move_too(tubelock) -> None:
    gravity = "[\n  0.0, 0.0,\n  -9810.0,\n]"
    text = ARCH.replace("[0.0, 0.0, -9810.0]   # down", gravity)
    text = 'effects = { auto = "1%" }\n' + text.replace("[rigid]   # how", "[rigid]")
    Path("old.toml").write_text(text)
    status, new, _ = tubelock("check", "old.toml")
    assert status == 1
    data = tomllib.loads(new)
    assert data["effects"] == {"auto": "1%", "gravity": [0.0, 0.0, -9810.0], "friction": 0.7}
    assert data["load"] == {}


@pytest.mark.parametrize("key", [*GONE, "fem.damping", "fem.end_time"])
def test_keys_that_say_nothing_are_left_out_and_rejected_by_name(tubelock, key: str) -> None:
    section, name = key.split(".")
    value = '"static"' if name == "damping" else "1.0"
    text = builtin_text("tsb1-pipe")
    text = text if f"[{section}]" in text else f"{text}\n[{section}]\n"
    Path("old.toml").write_text(text.replace(f"[{section}]", f"[{section}]\n{name} = {value}"))
    status, _, line = tubelock("mbd", "old.toml")
    assert status == 2
    assert key in line
    assert line.count("\n") == 1
    status, new, _ = tubelock("check", "old.toml", "--json", "a.json")
    assert status == 1
    assert f"# Changed: {key} is left out" in new
    Path("new.toml").write_text(new)
    assert load_case("new.toml").scene == load_case("tsb1-pipe").scene
    assert json.loads(Path("a.json").read_text())["changes"] == [f"{key} is left out"]


def test_two_values_of_one_thing_are_for_their_author(tubelock) -> None:
    Path("old.toml").write_text(f"{ARCH}[effects]\nfriction = 0.5\n")
    status, out, line = tubelock("check", "old.toml")
    assert (status, out) == (2, "")
    assert "rigid.friction: got 0.7 beside effects.friction = 0.5" in line
