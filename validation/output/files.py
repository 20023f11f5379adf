"""Files of the command line: folders checked before the work, whole or absent, with origin."""

from __future__ import annotations

import csv
import datetime
import functools
import glob
import hashlib
import json
import math
import os
import platform
import sys
import tempfile
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geometry.machine.system import write_whole
from validation.errors import InputError

if TYPE_CHECKING:
    from validation.case import Case

#: Names of all frames for ParaView.
FRAMES = "frame_[0-9]*.vtu"
#: Endings of pages, which have pictures inside.
PAGES = (".html", ".htm")


def prepare_folder(folder: Path) -> Path:
    """Create a folder and make sure that it can be written, before any work is done."""
    taken = next((f for f in (folder, *folder.parents) if f.is_file()), None)
    if taken is not None:
        raise InputError(f"{taken}: is a file; expected a folder, or a name that is free")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror or error}); "
            "choose a folder you may write"
        ) from None
    return folder


@contextmanager
def output_folder(folder: Path | None) -> Iterator[None]:
    """Prepare a folder, and take it away again if the work fails before anything is in it."""
    if folder is None:
        yield
        return
    made = [f for f in (folder, *folder.parents) if not f.exists()]
    prepare_folder(folder)
    try:
        yield
    except BaseException:
        for empty in made:
            try:
                empty.rmdir()
            except OSError:
                break
        raise


def remove_others(folder: Path, names: Collection[str], written: Collection[str]) -> None:
    """Remove what an earlier answer left under ``names``, patterns too, that are not written."""
    for name in set(names).difference(written):
        for path in folder.glob(name):
            if path.name not in written:
                path.unlink()


def prepare_file(path: Path) -> Path:
    """Make sure that a file can be written later; nothing is created but its folder."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; expected the name of a file to write")
    if path.exists() and not path.is_file():
        # A whole file is renamed into place, which would put it in the place of a device.
        raise InputError(f"{path}: is no ordinary file; expected a file name, or --json - to pipe")
    prepare_folder(path.parent)
    if path.exists() and not os.access(path, os.W_OK):
        raise InputError(f"{path}: exists and cannot be overwritten; choose another name")
    return path


def require_picture(path: Path) -> None:
    """Reject a name of a picture of blocks that does not say PNG."""
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: expected a file name that ends in .png")


def write_csv(path: Path, heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write rows as CSV (RFC 4180, header line, numbers in full precision)."""

    def write(partial: Path) -> None:
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(heads)
            writer.writerows(rows)

    write_whole(path, write)


def _finite(data: Any) -> Any:
    """Return the same data with None in place of numbers that are not finite."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def write_json(target: str | None, data: Any) -> None:
    """Write data as JSON, numbers in full precision, to a file or to standard output (``-``).

    JSON has no infinity: a quantity that is none, or has no value, is null.
    """
    if target is None:
        return
    text = json.dumps(_finite(data), indent=2, allow_nan=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_whole(Path(target), lambda path: path.write_text(text, "utf-8"))


#: Version of what ``--json`` writes. It rises when a key goes or changes its meaning.
JSON_VERSION = 5
#: Libraries whose versions can move the last digits of an answer.
_LIBRARIES = ("numpy", "scipy", "numba")
#: Sources that answers depend on; pictures, tables and commands may change.
_SOURCES = {
    "geometry": ("**/*.py",),
    "mbd": ("**/*.py",),
    "fem": ("**/*.py",),
    "validation": ("scene/**/*.py", "build/**/*.py", "*.py", "study/design.py"),
}


def version() -> str:
    """Version of the installed program."""
    try:
        return metadata.version("tubelock")
    except metadata.PackageNotFoundError:
        return "not installed"


@functools.cache
def program() -> str:
    """Version and digest of the sources that answers come from, such as ``0.1.0+3f2a9c0d17b4``."""
    digest = hashlib.sha256()
    for package, patterns in _SOURCES.items():
        folder = str(resources.files(package))
        found = (glob.glob(pattern, root_dir=folder, recursive=True) for pattern in patterns)
        for name in sorted(name.replace(os.sep, "/") for names in found for name in names):
            digest.update(f"{package}/{name}".encode())
            with open(f"{folder}/{name}", "rb") as source:
                digest.update(source.read())
    return f"{version()}+{digest.hexdigest()[:12]}"


@dataclass(frozen=True)
class Provenance:
    """Origin that every file of one call states."""

    case: Case | None = None
    """What was asked about; None where the call has none or several."""

    def line(self) -> str:
        """One line: program, scene, load, mesh, day."""
        parts = [f"tubelock {program()}"]
        if self.case is not None:
            stated = self.as_json()["scene"]
            parts += [
                f"{section} {_words(stated[section])}"
                for section in ("name", "assembly", "load", "mesh")
                if stated.get(section)
            ]
        return "; ".join([*parts, _day()])

    def as_json(self) -> dict[str, Any]:
        """Under the key ``provenance`` of every JSON: enough to ask the same question again."""
        result: dict[str, Any] = {
            "program": f"tubelock {program()}",
            "date": _day(),
            "python": platform.python_version(),
            "libraries": {name: metadata.version(name) for name in _LIBRARIES},
        }
        if self.case is not None:
            result["scene"] = {"name": self.case.name, **self.case.keys}
        return result


def processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        lines = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
        names = {key.strip(): value.strip() for key, value in lines.items()}
        return f"{names['model name']}, family {names['cpu family']} model {names['model']}"
    except (OSError, KeyError):
        return platform.processor() or platform.machine()


def _day() -> str:
    """Today, or the day that reproducible builds name."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch:
        return datetime.datetime.fromtimestamp(int(epoch), datetime.UTC).date().isoformat()
    return datetime.date.today().isoformat()


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_words(inner)}" for key, inner in value.items())
    if isinstance(value, list):
        return "[" + ", ".join(_words(inner) for inner in value) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def stamped(data: Any, origin: Provenance, unused: tuple[str, ...] | None = None) -> dict[str, Any]:
    """Data of an answer with version and origin; a list stands under ``rows``.

    ``unused_keys`` are those of the scene on which the answer does not depend; None: not known.
    """
    content = data if isinstance(data, dict) else {"rows": data}
    named = {} if unused is None else {"unused_keys": list(unused)}
    return {"json_version": JSON_VERSION, **content, **named, "provenance": origin.as_json()}


def stamp_vtu(path: Path, origin: Provenance) -> None:
    """Write the origin into a ``.vtu`` file, as a comment that no reader minds.

    A string among the field data would be shown by ParaView, but meshio rejects to read it.
    """
    text = path.read_bytes()
    head, result, rest = text.partition(b"<VTKFile")
    words = origin.line().replace("--", "- -")
    if result:
        path.write_bytes(head + f"<!-- {words} -->\n".encode() + result + rest)
