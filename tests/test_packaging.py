"""The wheel: everything the command needs is in it, and it runs where there is no checkout."""

import ast
import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
PACKAGES = ("geometry", "mbd", "fem", "validation")


def _run(*command: str | Path, folder: Path) -> None:
    """Run a command that finds no module of this checkout by its environment."""
    words = [str(word) for word in command]
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_module_gives_a_name_once() -> None:
    """A constant that a second one of its name replaces is another constant to all before it."""
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        body = ast.parse(path.read_text("utf-8")).body
        targets = [node.targets if isinstance(node, ast.Assign) else () for node in body]
        names = [name.id for each in targets for name in each if isinstance(name, ast.Name)]
        assert len(names) == len(set(names)), path


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel of this checkout, built without network."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("dist")
    _run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, folder=ROOT)
    (built,) = folder.glob("*.whl")
    return built


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    tracked = subprocess.run(
        ["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if tracked.returncode:
        pytest.skip("no git, or no checkout: which files belong to the packages is not known")
    expected = {name for name in tracked.stdout.splitlines() if (ROOT / name).is_file()}
    assert expected - set(zipfile.ZipFile(wheel).namelist()) == set()


@pytest.mark.slow
def test_the_wheel_runs_outside_the_checkout(wheel: Path, tmp_path: Path) -> None:
    """Rigid and deformable blocks, in an environment that has the dependencies and the wheel.

    The dependencies are those of this environment, seen through a path file: path files in a folder
    named by a path file are not read, so that an editable installation of the checkout stays out.
    """
    # The installer of this environment, where it has one, installs into the other.
    other = () if importlib.util.find_spec("pip") is None else ("--without-pip",)
    _run(sys.executable, "-m", "venv", *other, tmp_path / "env", folder=tmp_path)
    paths = {"base": str(tmp_path / "env"), "platbase": str(tmp_path / "env")}
    site = Path(sysconfig.get_path("purelib", "venv", paths))
    python = Path(sysconfig.get_path("scripts", "venv", paths)) / "python"
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + os.linesep, "utf-8")
    pip = (sys.executable, "-m", "pip", "--python", python) if other else (python, "-m", "pip")
    install = (*pip, "install", "--quiet", "--no-index", "--no-deps", "--no-compile")
    _run(*install, wheel, folder=tmp_path)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    tubelock = python.with_name("tubelock")
    small = ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2")
    settings = [word for setting in small for word in ("--set", setting)]
    _run(tubelock, "mbd", "tsb1-pipe", *settings, "--json", "rigid.json", folder=elsewhere)
    settings += ["--set", "fem.mesh=scene"]
    _run(tubelock, "fem", "tsb1-pipe", *settings, "--json", "fem.json", folder=elsewhere)
    rigid, deformable = (
        json.loads((elsewhere / name).read_text("utf-8")) for name in ("rigid.json", "fem.json")
    )
    assert rigid["mechanism"] == "locked"
    assert deformable["method"] == "static"
    assert deformable["max_displacement"] > 0
    code = "import fem, sys; sys.exit(not fem.__file__.startswith(sys.argv[1]))"
    _run(python, "-c", code, str(site), folder=elsewhere)


def test_the_version_is_stated_once_and_quoted_right() -> None:
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {PROJECT['version']}\n" in citation
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert f"## [{PROJECT['version']}]" in changes or "## [Unreleased]" in changes


def test_extras_are_named_where_installing_is_explained() -> None:
    words = (ROOT / "docs" / "start" / "install.md").read_text("utf-8")
    assert [name for name in PROJECT["optional-dependencies"] if f"`{name}`" not in words] == []
