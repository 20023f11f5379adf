"""The paper's tube on coarse meshes: as settings, words of a command, blocks or a problem."""

from __future__ import annotations

from functools import cache
from typing import Any

from fem import Problem, concrete
from geometry import Assembly, pipe
from geometry import tube as tube_of
from tests.support.blocks import tsb
from validation import Case, load_case

#: Words of a command: a tube of one layer.
SMALL = ["--set", "assembly.layers=1", "--set", "mesh.around=24", "--set", "mesh.radial=2"]


def keys(radial: int, axial: int, layers: int = 1) -> dict[str, int]:
    """Settings of a scene by key: 12 elements around."""
    return {
        "assembly.layers": layers,
        "mesh.around": 12,
        "mesh.radial": radial,
        "mesh.axial": axial,
    }


def coarse(radial: int, axial: int, layers: int = 1) -> tuple[str, ...]:
    """The same in words."""
    return tuple(f"{key}={value}" for key, value in keys(radial, axial, layers).items())


COARSE = coarse(2, 4)


def tube(name: str, *settings: str) -> Case:
    """A scene of tubes on the coarse mesh."""
    return load_case(name, [*COARSE, *settings])


@cache
def ring(layers: int = 1, mesh: tuple[int, int, int] = (12, 1, 2)) -> Assembly:
    """Blocks of a tube."""
    return tube_of(tsb(), layers=layers, mesh=mesh)


def pressed(layers: int = 1, mesh: tuple[int, int, int] = (12, 1, 2), **stated: Any) -> Problem:
    """A tube under pressure."""
    return Problem(ring(layers, mesh), pipe(0.01), concrete, **stated)
