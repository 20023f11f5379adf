"""What stands apart can be removed: the rest is imported, lists its commands and solves."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from math import isfinite
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("geometry", "mbd", "fem", "validation")
#: Modules that stand apart, by the contract that says who may import them.
APART: dict[str, list[str]] = {
    contract["name"].partition(":")[0]: contract["protected_modules"]
    for contract in tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"][
        "importlinter"
    ]["contracts"]
    if contract["type"] == "protected"
}
HELP = """
import geometry, mbd, fem, validation
from validation.cli import main
print(validation.__file__)
main()
"""
SOLVE = """
import importlib, json, pkgutil, geometry, mbd, fem, validation
for package in (geometry, mbd, fem, validation):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
tube = {"assembly.layers": 1, "mesh.around": 12, "mesh.radial": 1, "mesh.axial": 2}
one = {"fem.mesh": "scene", "fem.error_estimate": False}
moving = {"fem.method": "explicit", "fem.end_time": 1e-4}
cases = {
    "rigid": validation.load_case("tsb1-pipe", tube, method="rigid"),
    "one mesh": validation.load_case("tsb1-pipe", tube | one),
    "converged": validation.load_case("tsb1-pipe", tube),
    "explicit": validation.load_case("tsb1-pipe", tube | moving),
}
answers = {name: validation.solve(case) for name, case in cases.items()}
measures = {name: {key: [m.value, m.error] for key, m in answer.measures.items()}
            for name, answer in answers.items()}
print(json.dumps(measures))
"""


def without(modules: Iterable[str], folder: Path) -> Path:
    """Copy the packages into a folder and remove modules; sources keep their times."""
    for package in PACKAGES:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=ignored)
    for module in modules:
        place = folder.joinpath(*module.split("."))
        if place.is_dir():
            shutil.rmtree(place)
        else:
            place.with_suffix(".py").unlink()
    return folder


def ran(program: str, folder: Path, *words: str) -> str:
    """What a program prints with the packages of a folder."""
    done = subprocess.run(
        [sys.executable, "-c", program, *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.quick
@pytest.mark.parametrize("name", APART)
def test_the_help_needs_nothing_that_stands_apart(name: str, tmp_path: Path) -> None:
    place, _, text = ran(HELP, without(APART[name], tmp_path), "--help").partition("\n")
    assert Path(place).is_relative_to(tmp_path)
    assert "Structural analysis" in text


def test_the_core_needs_nothing_that_stands_apart(tmp_path: Path) -> None:
    """All other modules are imported, and the four runs answer, without any of it."""
    folder = without((module for modules in APART.values() for module in modules), tmp_path)
    measures = json.loads(ran(SOLVE, folder))
    assert set(measures) == {"rigid", "one mesh", "converged", "explicit"}
    for found in measures.values():
        assert found
        assert all(isfinite(value) for value, _ in found.values())
    assert measures["one mesh"]["max_displacement"][0] > measures["explicit"]["max_displacement"][0]
    assert measures["converged"]["max_displacement"][1] > 0.0
