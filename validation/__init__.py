"""Scenes, files of answers, pictures, comparisons, studies, the paper and the command line.

What most need::

    from validation import compare, load_scene, plot, read_answer, write

    problem = load_scene("tsb1-pipe", {"assembly.layers": 2}).problem()
    write(answer, "out/")
    plot(answer, "mises")

| | |
|---|---|
| `load_scene`, `Scene` | a scene by its name or from TOML; its ``problem()`` |
| `write`, `read_answer` | an answer as files, and back |
| `plot` | a field of an answer as a matplotlib figure |
| `section` | normal force, shear forces and moments through planes |
| `compare` | answers of several solvers beside each other |
| `report` | one page about a scene that can be sent |
| `sweep` | a scene with every combination of some values |
| `sensitivity` | derivatives of the measures with respect to the parameters |
| `optimise` | the best design under limits |
| `cost` | error against CPU time of every method and mesh |
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.calls import (
        Scene,
        compare,
        cost,
        load_scene,
        optimise,
        plot,
        read_answer,
        report,
        section,
        sensitivity,
        sweep,
        write,
    )

__all__ = [
    "Scene",
    "compare",
    "cost",
    "load_scene",
    "optimise",
    "plot",
    "read_answer",
    "report",
    "section",
    "sensitivity",
    "sweep",
    "write",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'validation' has no attribute {name!r}")
    return getattr(import_module("validation.calls"), name)


def __dir__() -> list[str]:
    return __all__
