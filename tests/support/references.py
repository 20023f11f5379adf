"""Stored references of scenes, which `tubelock cost` measures errors against."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files

_FILE = files("validation").joinpath("study", "costs", "references.toml")


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
