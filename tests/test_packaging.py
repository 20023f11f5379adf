"""Wheel and source archive: everything the command needs is in them, and they run elsewhere."""

import ast
import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from collections.abc import Callable
from functools import cache
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
PACKAGES = ("geometry", "mbd", "fem", "validation")


def _run(*command: str | Path, folder: Path) -> str:
    """Output of a command that finds no module of this checkout by its environment."""
    words = [str(word) for word in command]
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_module_gives_a_name_once() -> None:
    """A constant that a second one of its name replaces is another constant to all before it."""
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        body = ast.parse(path.read_text("utf-8")).body
        targets = [node.targets if isinstance(node, ast.Assign) else () for node in body]
        names = [name.id for each in targets for name in each if isinstance(name, ast.Name)]
        assert len(names) == len(set(names)), path


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the "wheel" or "sdist" of this checkout, built without network."""
    pytest.importorskip("hatchling")

    @cache
    def build(kind: str) -> Path:
        folder = tmp_path_factory.mktemp(kind)
        _run(sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", folder, folder=ROOT)
        (archive,) = folder.iterdir()
        return archive

    return build


def _files(wheel: Path) -> set[str]:
    return {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}


def test_every_file_of_the_packages_is_in_the_wheel_and_nothing_else(
    built: Callable[[str], Path],
) -> None:
    tracked = subprocess.run(
        ["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if tracked.returncode:
        pytest.skip("no git, or no checkout: which files belong to the packages is not known")
    assert _files(built("wheel")) == {
        name for name in tracked.stdout.splitlines() if (ROOT / name).is_file()
    }


def test_the_source_archive_makes_the_same_wheel(
    built: Callable[[str], Path], tmp_path: Path
) -> None:
    with tarfile.open(built("sdist")) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    assert source.name == f"tubelock-{PROJECT['version']}"
    _run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path, folder=source)
    (again,) = tmp_path.glob("*.whl")
    assert _files(again) == _files(built("wheel"))


def _try_commands(python: Path, site: Path, elsewhere: Path) -> None:
    """Run rigid and deformable blocks with an installed command, far from the checkout."""
    elsewhere.mkdir()
    tubelock = python.with_name("tubelock")
    assert "tsb1-pipe" in _run(tubelock, "scenes", folder=elsewhere)
    words = ["tsb1-pipe", "--json", "-"]
    for setting in ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2"):
        words += ["--set", setting]
    rigid = json.loads(_run(tubelock, "mbd", *words, folder=elsewhere))
    assert rigid["mechanism"] == "locked"
    words += ["--set", "fem.mesh=scene"]
    deformable = json.loads(_run(tubelock, "fem", *words, folder=elsewhere))
    assert deformable["method"] == "static"
    assert deformable["max_displacement"] > 0
    code = "import fem, geometry, mbd, validation; print(fem.__file__)"
    assert _run(python, "-c", code, folder=elsewhere).startswith(str(site))


def _empty_environment(folder: Path, *options: str) -> tuple[Path, Path]:
    """Python and the folder of libraries of a new environment."""
    _run(sys.executable, "-m", "venv", *options, folder, folder=folder.parent)
    paths = {"base": str(folder), "platbase": str(folder)}
    scripts = Path(sysconfig.get_path("scripts", "venv", paths))
    return scripts / "python", Path(sysconfig.get_path("purelib", "venv", paths))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_both_archives_install_into_an_empty_environment(
    kind: str, built: Callable[[str], Path], tmp_path: Path
) -> None:
    """With what they declare, from the network, and without any tool of those who change code."""
    python, site = _empty_environment(tmp_path / "env")
    index = (str(python), "-m", "pip", "download", "--quiet", "--no-deps", "typer")
    if subprocess.run(index, cwd=tmp_path, capture_output=True, check=False).returncode:
        pytest.skip("no network: what the archives need cannot be installed")
    _run(python, "-m", "pip", "install", "--quiet", built(kind), folder=tmp_path)
    assert not {"pytest", "mypy", "hatchling", "sphinx"} & {p.name for p in site.iterdir()}
    _try_commands(python, site, tmp_path / "elsewhere")


def _required() -> dict[str, Distribution]:
    """Distributions of this environment that the project requires, directly or not, by name."""
    found: dict[str, Distribution] = {}
    names = [Requirement(line) for line in PROJECT["dependencies"]]
    while names:
        required = distribution(names.pop().name)
        if required.name not in found:
            found[required.name] = required
            lines = [Requirement(line) for line in required.requires or ()]
            names += [r for r in lines if r.marker is None or r.marker.evaluate({"extra": ""})]
    return found


def _link(required: Distribution, site: Path) -> None:
    """Link the files of an installed distribution, but its commands, into another environment."""
    for file in required.files or ():
        beside = file.parts[0] == ".."  # a shared library outside the folder of libraries
        name = Path(file) if beside else Path(file.parts[0])
        place = site / name
        if not ({"bin", "share", "__pycache__"} & set(name.parts) or place.exists()):
            place.resolve().parent.mkdir(parents=True, exist_ok=True)
            place.symlink_to(Path(str(required.locate_file(name))).resolve())


@pytest.mark.slow
def test_the_wheel_runs_with_its_declared_dependencies_alone(
    built: Callable[[str], Path], tmp_path: Path
) -> None:
    """In an environment without tools of those who change code: what is not declared is missing."""
    # The installer of this environment, where it has one, installs into the other.
    other = () if importlib.util.find_spec("pip") is None else ("--without-pip",)
    python, site = _empty_environment(tmp_path / "env", *other)
    required = _required()
    assert not {"pytest", "mypy", "hatchling", "pandas"} & set(required)
    for each in required.values():
        _link(each, site)
    pip = (sys.executable, "-m", "pip", "--python", python) if other else (python, "-m", "pip")
    install = (*pip, "install", "--quiet", "--no-index", "--no-deps", "--no-compile")
    _run(*install, built("wheel"), folder=tmp_path)
    _try_commands(python, site, tmp_path / "elsewhere")


def test_the_version_is_stated_once_and_quoted_right() -> None:
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {PROJECT['version']}\n" in citation
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert f"## [{PROJECT['version']}]" in changes


def test_extras_are_named_where_installing_is_explained() -> None:
    words = (ROOT / "docs" / "start" / "install.md").read_text("utf-8")
    assert [name for name in PROJECT["optional-dependencies"] if f"`{name}`" not in words] == []
