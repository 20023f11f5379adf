"""Which program gave an answer: its version and what its solvers' sources say."""

from __future__ import annotations

import functools
import hashlib
from importlib import metadata, resources

#: What answers depend on; pictures, tables and commands may change.
_PACKAGES = (
    "geometry",
    "mbd",
    "fem",
    "validation.scene",
    "validation.build",
    "validation.run",
)


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
    for package in _PACKAGES:
        folder = resources.files(package)
        for name, text in sorted(_sources(folder)):
            digest.update(f"{package}/{name}".encode())
            digest.update(text)
    return f"{version()}+{digest.hexdigest()[:12]}"


def _sources(folder: resources.abc.Traversable, above: str = "") -> list[tuple[str, bytes]]:
    found = []
    for entry in folder.iterdir():
        if entry.is_dir() and entry.name != "__pycache__":
            found += _sources(entry, f"{above}{entry.name}/")
        elif entry.name.endswith(".py"):
            found.append((f"{above}{entry.name}", entry.read_bytes()))
    return found
