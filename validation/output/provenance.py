"""Where an answer comes from: program, day, scene with load and mesh, and the libraries below."""

from __future__ import annotations

import datetime
import functools
import hashlib
import os
import platform
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.case import Case

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
        folder = Path(str(resources.files(package)))
        found = (path for pattern in patterns for path in folder.glob(pattern))
        texts = {path.relative_to(folder).as_posix(): path for path in found}
        for name, path in sorted(texts.items()):
            digest.update(f"{package}/{name}".encode())
            digest.update(path.read_bytes())
    return f"{version()}+{digest.hexdigest()[:12]}"


@dataclass(frozen=True)
class Provenance:
    """Origin that every file of one call states."""

    scene: Case | None = None
    """Scene that was asked about; None where the call has none or several."""

    def line(self) -> str:
        """One line: program, scene, load, mesh, day."""
        parts = [f"tubelock {program()}"]
        if self.scene is not None:
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
        if self.scene is not None:
            result["scene"] = {"name": self.scene.name, **self.scene.keys}
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
