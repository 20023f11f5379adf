"""Stored references of scenes: answers of meshes finer than those that tests and tables solve."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

_FILE = Path(__file__).with_name("references.toml")


@dataclass(frozen=True)
class Reference:
    """A value, and what it is known to."""

    value: float
    uncertainty: float


def references() -> dict[str, dict[str, Reference]]:
    """Quantities by scene, ``"tsb1-pipe, assembly.layers = 2"``."""
    return {
        scene: {name: Reference(of["value"], of["uncertainty"]) for name, of in known.items()}
        for scene, known in tomllib.loads(_FILE.read_text("utf-8")).items()
    }
