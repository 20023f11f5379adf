"""Short tubes that their frames lock, not their blocks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.support.commands import answered, set_words
from validation import load_case, solve

pytestmark = pytest.mark.quick

COARSE = ("mesh.edge=4", "mesh.radial=2")


def unlocking(scene: str, *settings: str, options: tuple[str, ...] = ()) -> dict[str, Any]:
    """What ``tubelock mbd --layers-to-unlock`` finds."""
    return answered("mbd", scene, *set_words(settings), *options, "--layers-to-unlock")[0]


def class_with_layers(layers: int) -> str:
    case = load_case("thb0-pipe", [*COARSE, f"assembly.layers={layers}"], method="rigid")
    return str(solve(case).details.mechanism)


def test_the_least_number_of_layers_is_least(tmp_path: Path) -> None:
    """Locked with one layer less, not locked with it: by the classes themselves; rows are kept."""
    folder = ("-o", str(tmp_path))
    told = unlocking("thb0-pipe", *COARSE, options=folder)["layers_to_unlock"]
    found = told["layers"]
    rows = (tmp_path / "layers.jsonl").read_text().splitlines()
    assert len(rows) == len(told["classes"])
    assert found > 1
    assert class_with_layers(found) != "locked"
    assert class_with_layers(found - 1) == "locked"
    sine = ("mesh.around=12", "mesh.radial=2", "mesh.axial=2")
    assert unlocking("tsb1-pipe", *sine)["layers_to_unlock"]["layers"] is None
