"""Values of fine meshes that cheaper settings are judged by, with their provenance in the file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files


@dataclass(frozen=True)
class Reference:
    """A value and how well it is known."""

    value: float
    """[unit]"""
    uncertainty: float
    """Half of the interval that holds the exact value [unit]."""
    unit: str
    """MPa or mm."""

    def error(self, value: float) -> float:
        """Relative error of a value [-]."""
        return value / self.value - 1.0

    @property
    def known_to(self) -> float:
        """Relative uncertainty [-]."""
        return self.uncertainty / abs(self.value)


def references() -> dict[str, dict[str, Reference]]:
    """All references: quantities by scene, ``"tsb1-pipe, assembly.layers = 2"``."""
    text = files("validation.study.costs").joinpath("references.toml").read_text("utf-8")
    return {
        scene: {quantity: Reference(**entry) for quantity, entry in entries.items()}
        for scene, entries in tomllib.loads(text).items()
    }
