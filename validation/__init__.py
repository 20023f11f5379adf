"""Scenes, files of answers, pictures, comparisons, studies, the paper and the command line.

What most need::

    from validation import compare, load_case, plot, read_answer, solve, write

    answer = solve(load_case("tsb1-pipe", {"assembly.layers": 2}))
    write(answer, "out/")
    plot(answer, "mises")

| | |
|---|---|
| `load_case`, `Case` | a problem and a method: a scene by its name or from TOML |
| `builtin_names`, `builtin_text` | scenes that come with the program, and their TOML |
| `solve` | the answer to a case |
| `write`, `read_answer` | an answer as files, and back |
| `plot` | a field of an answer as a matplotlib figure |
| `section` | normal force, shear forces and moments through planes |
| `compare` | answers of several solvers beside each other |
| `report` | one page about a scene that can be sent |
| `sweep` | a scene with every combination of some values, or a study by its name |
| `read_rows` | rows of a study from its CSV |
| `sensitivity` | derivatives of the measures with respect to the parameters |
| `optimise` | the best design under limits |
| `cost` | error against CPU time of every method and mesh |
| `InputError` | what is wrong with a scene, an option or a file, in one line |
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.case import Case, load_case, solve
    from validation.errors import InputError
    from validation.notebook import (
        compare,
        cost,
        optimise,
        plot,
        read_answer,
        read_rows,
        report,
        section,
        sensitivity,
        sweep,
        write,
    )
    from validation.scene.builtin import builtin_names, builtin_text

__all__ = [
    "Case",
    "InputError",
    "builtin_names",
    "builtin_text",
    "compare",
    "cost",
    "load_case",
    "optimise",
    "plot",
    "read_answer",
    "read_rows",
    "report",
    "section",
    "sensitivity",
    "solve",
    "sweep",
    "write",
]


#: Where names come from that are not in `validation.notebook`.
_PLACES = {
    "Case": "validation.case",
    "InputError": "validation.errors",
    "builtin_names": "validation.scene.builtin",
    "builtin_text": "validation.scene.builtin",
    "load_case": "validation.case",
    "solve": "validation.case",
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'validation' has no attribute {name!r}")
    return getattr(import_module(_PLACES.get(name, "validation.notebook")), name)


def __dir__() -> list[str]:
    return __all__
