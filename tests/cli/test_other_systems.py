"""The command runs where the system lacks what POSIX alone has, as Windows does."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import endless
from tests.support.coarse_tubes import coarse
from tests.support.commands import set_words

PACKAGES = ("geometry", "mbd", "fem", "validation")
#: Loaded by every Python process of a test, workers too: takes away what Windows lacks. Libraries
#: keep their modules: they ask for the system by its name. With an environment variable a process
#: is interrupted when it catches interruptions and SIGTERM.
HIDING = """
import builtins, os, psutil, signal

MODULES = {"resource", "fcntl", "pwd", "grp", "termios", "tty", "pty", "posix"}
NAMES = {
    signal: "SIGVTALRM SIGKILL SIGALRM SIGHUP SIGPIPE SIGUSR1 SIGCHLD pthread_sigmask pthread_kill "
    "setitimer ITIMER_VIRTUAL alarm",
    os: "fork forkpty killpg sysconf getuid sched_getaffinity getloadavg",
}
for module, names in NAMES.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
load, catch = builtins.__import__, signal.signal

def hiding(name, globals=None, *rest, **options):
    loader = (globals or {}).get("__name__", "").partition(".")[0]
    if name in MODULES and loader in PACKAGES:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return load(name, globals, *rest, **options)

def interrupting(number, handler):
    before = catch(number, handler)
    if number == signal.SIGTERM and callable(handler):
        signal.raise_signal(signal.SIGINT)
    return before

builtins.__import__ = hiding
if "INTERRUPTED" in os.environ:
    signal.signal = interrupting
"""
START = f"PACKAGES = {PACKAGES}\n{HIDING}"


@pytest.fixture
def poor(tmp_path: Path) -> dict[str, str]:
    """Environment of processes that lack what POSIX alone has."""
    (tmp_path / "hiding").mkdir()
    (tmp_path / "hiding" / "sitecustomize.py").write_text(START, encoding="utf-8")
    return os.environ | {"PYTHONPATH": str(tmp_path / "hiding")}


def tubelock(*words: str, cwd: Path, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "validation.cli", *words]
    return subprocess.run(
        command, cwd=cwd, env=env, capture_output=True, encoding="utf-8", check=False, timeout=300
    )


def reported(done: subprocess.CompletedProcess[str]) -> list[str]:
    """Lines on standard error but those of progress, and of a first run while it compiles."""
    lines = done.stderr.splitlines()
    return [n for n in lines if not ("compiling machine code" in n or re.search(PROGRESS, n))]


#: End of a line that a run of more than two seconds prints, here or on a slower machine.
PROGRESS = r" … [\d.]+ \w+$"
SMALL = coarse(1, 2)


@pytest.mark.parametrize(
    ("command", "key"),
    [
        ("mbd", "load.layer=1"),
        pytest.param("fem", "fem.mesh=scene", marks=pytest.mark.thorough),
    ],
)
def test_an_answer(command: str, key: str, tmp_path: Path, poor: dict[str, str]) -> None:
    settings = set_words((*SMALL, key))
    done = tubelock(command, "tsb1-beam", *settings, cwd=tmp_path, env=poor)
    assert (done.returncode, reported(done)) == (0, [])


@pytest.mark.thorough
def test_an_interrupted_run_goes_on(tmp_path: Path, poor: dict[str, str]) -> None:
    """Ctrl-C ends it with a checkpoint, from which it comes to the same fields."""
    run = ("fem", "cantilever", "--set", "mesh.divisions=[4,1,1]", "--set", "fem.frames=0")
    run += ("--fields",)
    whole = tubelock(*run, "-o", "whole", cwd=tmp_path, env=poor)
    assert (whole.returncode, reported(whole)) == (0, [])
    cut = tubelock(*run, "-o", "cut", cwd=tmp_path, env=poor | {"INTERRUPTED": "yes"})
    assert cut.returncode == 130
    assert "Traceback" not in cut.stderr
    checkpoint = str(Path("cut", "checkpoint.npz"))
    resumed = tubelock(*run, "-o", "cut", "--resume", checkpoint, cwd=tmp_path, env=poor)
    assert resumed.returncode == 0
    fields = [(tmp_path / folder / "fields.vtu").read_bytes() for folder in ("whole", "cut")]
    assert fields[0] == fields[1]


@pytest.mark.thorough
def test_an_interrupted_study_goes_on(tmp_path: Path, poor: dict[str, str]) -> None:
    with endless.endless_sweep(tmp_path, start=START + endless.ENDLESS) as process:
        endless.interrupted(process)
    assert 1 <= endless.rows(tmp_path) <= 3
    done = tubelock(*endless.COMMAND, cwd=tmp_path, env=poor)
    assert (done.returncode, endless.rows(tmp_path)) == (0, 20)
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {"many.toml", "many.jsonl", "hiding", "start"}


@pytest.mark.quick
def test_what_differs_between_systems_is_imported_in_one_file() -> None:
    posix = {"resource", "fcntl", "pwd", "grp", "termios", "tty", "pty", "posix"}
    root = Path(__file__).parents[2]
    users = set()
    for path in (path for package in PACKAGES for path in (root / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            modules = [name.name for name in node.names] if isinstance(node, ast.Import) else []
            modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            users |= {path.relative_to(root)} if posix & set(modules) else set()
    assert users == {Path("geometry", "machine", "system.py")}
