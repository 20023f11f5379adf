"""Which program gave an answer: its version and what its solvers' sources say."""

from __future__ import annotations

import functools
import hashlib
from importlib import metadata, resources
from pathlib import Path

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
        folder = Path(str(resources.files(package)))
        texts = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*.py")}
        for name, path in sorted(texts.items()):
            digest.update(f"{package}/{name}".encode())
            digest.update(path.read_bytes())
    return f"{version()}+{digest.hexdigest()[:12]}"
