"""Studies whose later designs never end: what is stopped on the way is, on any machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Loaded by every Python process of a study, workers too: designs from the fourth on never end.
ENDLESS = """
import builtins, functools, sys, time
imported = builtins.__import__

def importing(name, *rest, **options):
    module = imported(name, *rest, **options)
    study = sys.modules.get("validation.study.run")
    run = getattr(study, "run_design", None)
    if run is not None and not hasattr(run, "__wrapped__"):
        @functools.wraps(run)
        def endless(of, number):
            while number >= 3:
                time.sleep(1.0)
            return run(of, number)
        study.run_design = endless
    return module

builtins.__import__ = importing
"""
#: Twenty designs of a few milliseconds.
STUDY = """
scene = "brick-stack"
[parameters]
load.pressure = { from = 0.01, to = 0.2, step = 0.01 }
[settings]
load.case = "beam"
mesh.divisions = [2, 1, 1]
assembly = { columns = 2, layers = 3 }
"""
COMMAND = ("sweep", "many.toml", "-o", "many.jsonl", "--workers", "2")


def rows(folder: Path) -> int:
    """Rows in the file of results; 0 before it is there."""
    path = folder / "many.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


@contextmanager
def endless_sweep(folder: Path, start: str = ENDLESS) -> Iterator[subprocess.Popen[str]]:
    """A sweep in processes of its own that has written a row and does not end.

    All its processes run the text when they start.
    """
    (folder / "many.toml").write_text(STUDY, encoding="utf-8")
    (folder / "start").mkdir(exist_ok=True)
    (folder / "start" / "sitecustomize.py").write_text(start, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, "-m", "validation.cli", *COMMAND],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder / "start")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        start_new_session=True,
    )
    try:
        while not rows(folder):
            assert process.poll() is None, process.communicate()[1]
            time.sleep(0.01)
        yield process
    finally:
        if not group_ended(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def interrupted(process: subprocess.Popen[str], by: signal.Signals = signal.SIGINT) -> str:
    """Interrupt a sweep and all its processes, as Ctrl-C in a terminal does; standard error.

    SIGTERM goes to the sweep alone, as those send it who end processes.
    """
    (os.killpg if by is signal.SIGINT else os.kill)(process.pid, by)
    printed, told = process.communicate()
    assert (process.returncode, printed) == (130, "")
    assert "of 20 designs are in many.jsonl; run the same command to go on" in told
    assert not {"Traceback", "resource_tracker"}.intersection(told.replace(":", " ").split())
    return told


def group_ended(group: int) -> bool:
    """Whether no process of a group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False
