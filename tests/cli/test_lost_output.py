"""Text that cannot be printed ends no computation; an interruption is always told as one."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.support.coarse_tubes import coarse
from tests.support.commands import set_words

COMMAND = [sys.executable, "-m", "validation.cli"]
SMALL = list(coarse(1, 2))
RIGID = ["mbd", "tsb1-pipe", *set_words(SMALL)]
FILES = {"contact_pressures.png", "joints.csv", "answer.json"}


def finished(*arguments: str, **options: object) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([*COMMAND, *arguments], check=False, **options)  # type: ignore[call-overload]


def told(done: subprocess.CompletedProcess[bytes]) -> list[bytes]:
    """Lines on standard error but progress, which a slow machine prints; in ASCII or not."""
    progress = rb" (\xe2\x80\xa6|\\u2026) [\d.]+ \w+$"
    return [line for line in done.stderr.splitlines() if not re.search(progress, line)]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_device_loses_the_table_and_no_file(tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:
        done = finished(*RIGID, "-o", str(tmp_path / "o"), stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert b"error: standard output: No space left on device" in done.stderr
    assert {p.name for p in (tmp_path / "o").iterdir()} == FILES


@pytest.mark.thorough
def test_a_reader_that_goes_away_loses_no_file_and_hears_nothing(tmp_path: Path) -> None:
    """The status of a process that a closed pipe ends is 128 + 13; 1 means a red hard case."""
    reading, writing = os.pipe()
    os.close(reading)
    done = finished(*RIGID, "-o", str(tmp_path / "o"), stdout=writing, stderr=subprocess.PIPE)
    os.close(writing)
    assert (done.returncode, told(done)) == (141, [])
    assert {p.name for p in (tmp_path / "o").iterdir()} == FILES


@pytest.mark.thorough
def test_characters_that_the_output_lacks_are_replaced(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = finished(*(*RIGID, "-o", str(tmp_path / "o")), env=environment, capture_output=True)
    assert (done.returncode, told(done)) == (0, [])
    assert b"locked" in done.stdout
    assert {p.name for p in (tmp_path / "o").iterdir()} == FILES


@pytest.mark.thorough
def test_a_file_name_that_the_locale_lacks_is_one_line(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text('[block]\ntype = "mesh"\n[[parts]]\nfile = "ä.stl"\n', "utf-8")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    (tmp_path / "ä.stl").touch()
    command = ("mbd", str(scene), "--json", str(tmp_path / "a.json"))
    done = finished(*command, env=os.environ | plain, capture_output=True)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1
    assert b"\\xe4.stl" in done.stderr
    assert b"set PYTHONUTF8=1" in done.stderr


@pytest.mark.parametrize(
    ("module", "wait"),
    [
        pytest.param("typer", 0.0, marks=pytest.mark.thorough),
        ("numpy", 0.0),
        pytest.param("fem.state", 1.0, marks=pytest.mark.thorough),
    ],
)
def test_an_interruption_is_told_whenever_it_comes(
    tmp_path: Path, module: str, wait: float
) -> None:
    """While commands are loaded Python ended half of the processes by the signal itself."""
    many = ["fem", "tsb1-pipe", "--set", "assembly.layers=12", "-q", "-o", str(tmp_path / "o")]
    command = [sys.executable, "-X", "importtime", *COMMAND[1:], *many]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **quiet) as process:
        assert process.stderr is not None
        while process.stderr.readline().rpartition(b"|")[2].strip() != module.encode():
            assert process.poll() is None, f"{module} was not loaded"
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        told = [line for line in process.stderr if not line.startswith(b"import time:")]
    assert (process.returncode, len(told)) == (130, 1)
    assert re.fullmatch(rb"stopped( after \d+ s)?: nothing was saved\n", told[0])


#: Command that is interrupted inside a callback, whose exceptions Python ignores.
INTERRUPTED_IN_A_CALLBACK = """
import signal, sys, time, types, validation.cli, weakref
class Anything: pass
def run():
    anything = Anything()
    watch = weakref.ref(anything, lambda _: signal.raise_signal(signal.SIGINT))
    del anything
    time.sleep(300)
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.modules["validation.cli.app"] = types.SimpleNamespace(main=run)
validation.cli.main()
"""


def test_an_interruption_inside_a_callback_is_not_lost() -> None:
    command = [sys.executable, "-c", INTERRUPTED_IN_A_CALLBACK]
    done = subprocess.run(command, check=False, capture_output=True)
    assert (done.returncode, done.stderr) == (130, b"stopped: nothing was saved\n")
