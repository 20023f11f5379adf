"""Scenes of earlier versions: `tubelock check` prints the file as this version has it."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from mbd import Rigid
from validation import builtin_text, load_case, sweep
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


def test_friction_under_its_earlier_name_is_that_of_every_copy_of_a_case() -> None:
    case = load_case("tsb1-pipe", ["rigid.friction=0.3"])
    copies = (
        case,
        case.changed({"assembly.layers": 3}),
        case.with_method("explicit"),
        case.with_method(Rigid(norm="force")),
        load_case(case.keys),
    )
    for copy in copies:
        assert copy.scene.effects.friction.coefficient == 0.3
        assert copy.keys["effects"]["friction"]["coefficient"] == 0.3
        assert "friction" not in copy.keys["rigid"]


@pytest.mark.parametrize("scene", ["wall", "tsb1-shaft"])
def test_settings_of_friction_replace_it_under_each_of_its_names(scene: str) -> None:
    """Whether the scene states it or not, and under which name."""
    names = ("rigid.friction", "effects.friction", "effects.friction.coefficient")
    for before in ((), *((f"{name}=0.4",) for name in names)):
        for name in names:
            case = load_case(scene, [*before, f"{name}=0.5"])
            assert case.scene.effects.friction.coefficient == 0.5
            assert case.changed({name: 0.7}).scene.effects.friction.coefficient == 0.7
        assert load_case(scene, [*before, "rigid.friction=0"]).scene.effects.friction is None
        if before:
            case = load_case(scene, [*before, "effects.friction.stick_stiffness=50.0"])
            assert case.scene.effects.friction.coefficient == 0.4


@pytest.mark.slow
def test_a_study_of_friction_is_one_under_each_of_its_names() -> None:
    coarse = ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2")
    found = [
        [row["p_max"] for row in sweep("tsb1-shaft", {name: [0.05, 0.4]}, coarse).rows]
        for name in ("rigid.friction", "effects.friction", "effects.friction.coefficient")
    ]
    assert found[0] == found[1] == found[2]
    assert found[0][0] != found[0][1]


def test_two_values_of_one_thing_are_for_their_author(tubelock) -> None:
    Path("old.toml").write_text(f"{ARCH}[effects]\nfriction = 0.5\n")
    status, out, line = tubelock("check", "old.toml")
    assert (status, out) == (2, "")
    assert "rigid.friction: got 0.7 beside effects.friction = 0.5" in line
