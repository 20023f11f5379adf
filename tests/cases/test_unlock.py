"""Short tubes that their frames lock, not their blocks."""

from __future__ import annotations

import json

import pytest

from mbd import MechanismClass
from tests.support.face import class_with_layers, frame_warning, layers_to_unlock
from validation import load_case, solve

pytestmark = pytest.mark.quick

COARSE = ("mesh.edge=4", "mesh.radial=2")


def test_the_least_number_of_layers_is_least() -> None:
    """Locked with one layer less, not locked with it: by the classes themselves."""
    file = load_case("thb0-pipe", COARSE)
    found = layers_to_unlock(file)
    assert found.layers is not None
    assert found.layers > 1
    assert class_with_layers(file, found.layers) is not MechanismClass.LOCKED
    assert class_with_layers(file, found.layers - 1) is MechanismClass.LOCKED
    sine = load_case("tsb1-pipe", ["mesh.around=12", "mesh.radial=2", "mesh.axial=2"])
    assert layers_to_unlock(sine, most=4).layers is None


def test_a_short_tube_says_that_its_frames_lock_it() -> None:
    short = load_case("thb0-pipe", [*COARSE, "assembly.layers=1"])
    warning = frame_warning(short, solve(short.with_method("rigid")))
    assert warning is not None
    assert "with 12 layers the tube is activated" in warning
    # Long tubes, tubes that are not locked and tubes of Sine Blocks have nothing to say.
    long = load_case("thb0-pipe", COARSE)
    assert frame_warning(long, solve(long.with_method("rigid"))) is None
    sine = load_case(
        "tsb1-pipe", ["mesh.around=12", "mesh.radial=2", "mesh.axial=2", "assembly.layers=1"]
    )
    assert frame_warning(sine, solve(sine.with_method("rigid"))) is None


def test_the_command_warns_and_finds(tubelock) -> None:
    settings = [part for value in (*COARSE, "assembly.layers=1") for part in ("--set", value)]
    status, out, _ = tubelock("mbd", "thb0-pipe", *settings, "--layers-to-unlock", "--json", "-")
    assert status == 0
    data = json.loads(out)
    assert "locked by the frames" in data["frame_warning"]
    found = data["layers_to_unlock"]
    assert found["classes"][str(found["layers"])] == "activated"
