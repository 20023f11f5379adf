"""Commands that the site shows, run once and kept by content.

A run is kept in ``out/gallery`` under a digest of the command, the scene and all sources of the
program: nothing that is shown comes from other code than the one that is documented. With
``GALLERY=cached`` what is missing is left out and said to be; by default it is run.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "out" / "gallery"
PACKAGES = ("geometry", "mbd", "fem", "validation")

#: The command line of a reader's terminal: as wide as a page, without colours.
_TERMINAL = {
    "COLUMNS": "98",
    "NO_COLOR": "1",
    "TERM": "dumb",
    "MPLBACKEND": "Agg",
    "OMP_NUM_THREADS": "1",
    "PYTHONPATH": str(ROOT),
}


@dataclass(frozen=True)
class Run:
    """What a command printed and wrote."""

    command: str
    """As a reader types it, ``tubelock …``."""
    text: str
    """Standard output."""
    cpu_seconds: float
    """Of the process and its children, start and compilation included [s]."""
    wall_seconds: float
    """[s]"""
    date: str
    """Of the run, ISO."""
    folder: Path
    """Files it wrote."""

    def files(self, suffix: str) -> list[Path]:
        """Files with an ending, in order of their names."""
        return sorted(self.folder.rglob(f"*{suffix}"))


class RunError(RuntimeError):
    """A command of the site that failed."""


@cache
def sources() -> str:
    """Digest of everything the program is made of."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix in {".py", ".toml"} and path.is_file():
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def run(command: str) -> Run | None:
    """Return a run of ``command`` (without ``tubelock``), kept or made now.

    None where runs are not made (``GALLERY=cached``) and none is kept.

    Raises
    ------
    RunError
        For a command that fails: the site shows none.
    """
    folder = KEPT / hashlib.sha256(f"{sources()}\0{command}".encode()).hexdigest()[:20]
    if not (folder / "run.json").is_file():
        if os.environ.get("GALLERY") == "cached":
            return None
        _make(command, folder)
    said = json.loads((folder / "run.json").read_text("utf-8"))
    return Run(folder=folder / "files", **said)


def _make(command: str, folder: Path) -> None:
    """Run a command in an empty folder and keep it whole or not at all."""
    print(f"… tubelock {command}", flush=True)
    KEPT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=KEPT) as place:
        files = Path(place) / "files"
        files.mkdir()
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        clock = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-m", "validation.cli", *shlex.split(command)],
            cwd=files,
            env=os.environ | _TERMINAL,
            capture_output=True,
            text=True,
            check=False,
        )
        wall = time.monotonic() - clock
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise RunError(f"tubelock {command}: exit status {done.returncode}\n{done.stderr}")
        said = {
            "command": f"tubelock {command}",
            "text": done.stdout.rstrip(),
            "cpu_seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            "wall_seconds": wall,
            "date": datetime.now(tz=UTC).date().isoformat(),
        }
        (Path(place) / "run.json").write_text(json.dumps(said, indent=1), "utf-8")
        if not folder.exists():
            shutil.copytree(place, folder)


def emptied(folder: Path) -> None:
    """Make a folder of generated pages, without those of the last build."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)


def shown(found: Run | None, command: str, pictures: Sequence[str] = ()) -> str:
    """Command, pictures it made and what it printed, as Markdown."""
    typed = f"```sh\ntubelock {command}\n```\n"
    if found is None:
        return typed + "\n*Not run for this build of the site (`GALLERY=cached`).*\n"
    drawn = "".join(f"\n![{Path(picture).stem}]({picture})\n" for picture in pictures)
    text = "\n".join(line.rstrip() for line in found.text.splitlines())
    stamp = f"{found.cpu_seconds:.1f} CPU s with start and compilation, {found.date}"
    return f"{typed}{drawn}\n```text\n{text}\n```\n\n*{stamp}*\n"
