"""What becomes of a line of the command: each runs in a forked process with limits of its own."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import NoReturn

from validation.fuzz.lines import SMALL, line, make_specimens
from validation.output.pictures.canvas import quiet

#: What a refusal may take: CPU time [s] and memory beyond that of the program [bytes].
LONGEST, MOST_MEMORY = 10, 2 * 2**30
#: A line that waits this long without computing waits for nothing [s].
_PATIENCE = 120.0
#: Where lines that passed the door work: a stop there is honest work that is not awaited.
_WORKSHOPS = re.compile(
    r"/(fem/(static|explicit|assembly|contact|element)|mbd|validation/(output/pictures|effects))/"
    r"|/validation/(run|compare|cost)/|/(numba|matplotlib|pyvista)/"
)


class Fate(StrEnum):
    """What became of a line."""

    RIGHT = "right"
    """Answered: exit status 0 or 1, nothing odd on standard error, JSON that is JSON."""
    REFUSED = "refused in one line"
    WORKING = "at work"
    """Stopped by its limits while it computed an answer."""
    ODD = "odd"
    """Several lines, a warning, another exit status, broken JSON, half a file left."""
    TRACEBACK = "traceback"
    CRASHED = "crashed"
    HUNG = "hung"
    """Stopped by its limits before anything was computed."""


#: Fates that are no defect.
FINE = (Fate.RIGHT, Fate.REFUSED, Fate.WORKING)


@dataclass(frozen=True)
class Tried:
    """A line and what became of it."""

    words: tuple[str, ...]
    fate: Fate
    said: str
    """End of standard error, or where it was stopped."""
    seconds: float
    """Wall time [s]."""


def try_line(words: Sequence[str], folder: Path, *, apart: bool = False) -> Tried:
    """Run one line in a folder, in a process of its own with limits.

    Parameters
    ----------
    words
        After ``tubelock``.
    folder
        Working folder.
    apart
        Whether a new interpreter is started.
    """
    out, err = folder / ".stdout", folder / ".stderr"
    start = time.monotonic()
    sys.stdout.flush()
    child = os.fork()
    if not child:
        _child(words, folder, out, err, apart=apart)
    status = _awaited(child, start + _PATIENCE)
    said = err.read_text("utf-8", errors="replace")
    fate, words_of_it = judge(status, out, said, folder)
    return Tried(tuple(words), fate, words_of_it, time.monotonic() - start)


def _child(words: Sequence[str], folder: Path, out: Path, err: Path, *, apart: bool) -> NoReturn:
    """Become the line: nothing of this process is left afterwards."""
    status = 1
    try:
        os.chdir(folder)
        for number, path in ((1, out), (2, err)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST + 2))
        faulthandler.register(signal.SIGXCPU, all_threads=False, chain=True)
        faulthandler.register(signal.SIGALRM, all_threads=False, chain=True)
        if apart:
            program = [sys.executable, "-m", "validation.cli", *words]
            os.execve(sys.executable, program, {**os.environ, "MPLBACKEND": "Agg"})
        resource.setrlimit(resource.RLIMIT_AS, (_memory() + MOST_MEMORY,) * 2)
        status = _run(words)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
        os._exit(status)


def _run(words: Sequence[str]) -> int:
    """Exit status of the command in this process."""
    from validation.cli.app import main

    sys.argv = ["tubelock", *words]
    sys.stdout = os.fdopen(os.dup(1), "w", encoding="utf-8")
    sys.stderr = os.fdopen(os.dup(2), "w", encoding="utf-8")
    try:
        main()
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        print(end.code, file=sys.stderr)
    return 1


def _memory() -> int:
    """Address space of this process [bytes]."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    return pages * resource.getpagesize()


def _awaited(child: int, deadline: float) -> int:
    """Wait status of a process; one that waits for something that never comes is stopped."""
    asked = False
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        if time.monotonic() > deadline + (2.0 if asked else 0.0):
            os.kill(child, signal.SIGKILL if asked else signal.SIGALRM)
            asked = True
        time.sleep(0.005)


def judge(status: int, out: Path, said: str, folder: Path) -> tuple[Fate, str]:
    """What a wait status, what was printed and what was left behind say of a line."""
    end = "\n".join(said.strip().splitlines()[-12:])
    if os.WIFSIGNALED(status):
        return _stopped(os.WTERMSIG(status), said), end
    odd = next(_oddities(out, said, folder), "")
    if "Traceback" in said:
        fate = Fate.TRACEBACK
    elif odd:
        fate, end = Fate.ODD, f"{odd}: {end}"
    elif os.WEXITSTATUS(status) in (0, 1) and "error:" not in said.lower():
        fate = Fate.RIGHT
    else:
        fate = _refusal(os.WEXITSTATUS(status), said.strip())
    return fate, end


def _stopped(number: int, said: str) -> Fate:
    """Judge a process that a signal ended."""
    if number not in (signal.SIGXCPU, signal.SIGALRM, signal.SIGKILL):
        return Fate.CRASHED
    return Fate.WORKING if _WORKSHOPS.search(said) else Fate.HUNG


def _oddities(out: Path, said: str, folder: Path) -> Iterator[str]:
    """What no line may leave behind, whatever became of it."""
    yield from (f"left {path.name}" for path in folder.rglob(".partial-*"))
    yield from _broken_json(out, folder)
    if "Warning" in said:
        yield "a warning"


def _refusal(status: int, said: str) -> Fate:
    """Judge what is said of a line that was not answered."""
    if "more memory than there is" in said:
        return Fate.WORKING
    usage = said.startswith("Usage: ") and said.splitlines()[-1].startswith("Error: ")
    # What a command says on its way may stand before it; the refusal itself is the last line.
    lines = [line.startswith("error: ") for line in said.splitlines()]
    one = sum(lines) == 1 and lines[-1]
    return Fate.REFUSED if status == 2 and (usage or one) else Fate.ODD


def _broken_json(out: Path, folder: Path) -> Iterator[str]:
    """What is wrong with JSON that was written: NaN and Infinity are none."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    for path in (out, *folder.glob("result.json"), *folder.glob("out/*.json")):
        if not path.is_file():
            continue
        text = path.read_text("utf-8", errors="replace")
        if path != out or text.startswith("{"):
            try:
                json.loads(text, parse_constant=refuse)
            except ValueError as error:
                yield f"{path.name}: {error}"


def try_lines(numbers: Sequence[int], seed: int, *, apart: int = 0) -> Iterator[Tried]:
    """Make and try lines of a seed, every ``apart``-th as a program of its own; 0: none."""
    with tempfile.TemporaryDirectory() as workshop:
        specimens = Path(workshop) / "specimens"
        specimens.mkdir()
        with _silent():
            make_specimens(specimens, _run)
            _warm(specimens)
        for number in numbers:
            folder = Path(workshop) / "line"
            folder.mkdir()
            words = line(seed, number, folder, specimens)
            yield try_line(words, folder, apart=bool(apart) and number % apart == 0)
            subprocess.run(["rm", "-rf", str(folder)], check=True)


def _warm(folder: Path) -> None:
    """Import and load what lines need, once, so that each is tried in a blink."""
    import matplotlib.pyplot  # noqa: F401
    import pyvista  # noqa: F401

    for name, settings in SMALL.items():
        words = [word for setting in settings for word in ("--set", setting)]
        for command in ("mbd", "fem"):
            _run([command, name, *words, "--json", str(folder / "warm.json")])


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Send what is printed nowhere; lines that are run put streams of their own in the place."""
    streams = sys.stdout, sys.stderr
    with quiet(1), quiet(2):
        try:
            yield
        finally:
            sys.stdout, sys.stderr = streams
