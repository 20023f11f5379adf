"""API pages from docstrings: one page for each room, its modules one after the other."""

from __future__ import annotations

import ast
import importlib
import os
from collections.abc import Iterator
from pathlib import Path

from ext.runs import ROOT, emptied

#: What is shown; and what stands in no program of a reader: compiled loops.
_SHOWN = ("geometry", "mbd", "fem", "validation/scene", "validation/build")
_INNER = ("fem/explicit/kernels",)


def write_api(folder: Path) -> None:
    """Write the public names, and one page for each folder; `API=off` leaves those pages out."""
    emptied(folder)
    write_public(folder / "index.md")
    rooms: list[Path] = []
    if os.environ.get("API") != "off":
        rooms = [room for package in _SHOWN for room in _rooms(ROOT / package)]
    for room in rooms:
        (folder / f"{_name(room)}.md").write_text(_page(room), "utf-8")
    rows = [f"| [`{_name(room)}`]({_name(room)}.md) | {_first(_name(room))} |" for room in rooms]
    listed = "\n".join(_name(room) for room in rooms)
    modules = _MODULES.format(rows="\n".join(rows), names=listed) if rooms else _NO_MODULES
    (folder / "modules.md").write_text(modules, "utf-8")


def write_public(path: Path) -> None:
    """Write the page of the public names."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(_INDEX.format(public="\n".join(_public_rows())), "utf-8")


#: The packages whose `__all__` is the public interface.
_PUBLIC = ("geometry", "fem", "mbd")

_INDEX = """# Public API

These names are the public interface. Arrays are `(n, 3)`, units mm, N, MPa, s, tonne. Docstrings
give shapes, units, errors and sources.

| import | definition | purpose |
|---|---|---|
{public}

```{{toctree}}
:hidden:

modules
```
"""

_MODULES = """# All modules

The modules behind the public names, for development.

| package | content |
|---|---|
{rows}

```{{toctree}}
:hidden:

{names}
```
"""

_NO_MODULES = "# All modules\n\nThe pages of all modules are not part of this build (`API=off`).\n"


def _public_rows() -> Iterator[str]:
    """One row for each public name: import, definition, first line of the docstring."""
    for package in _PUBLIC:
        module = importlib.import_module(package)
        for name in module.__all__:
            value = getattr(module, name)
            if isinstance(value, type) or callable(value):
                full, words = f"{value.__module__}.{value.__qualname__}", _summary(value)
            else:
                full, words = f"{package}.{name}", f"`{value!r}`"
            yield f"| `from {package} import {name}` | `{full}` | {words} |"


def _summary(value: object) -> str:
    """First paragraph of a docstring, for a cell of a table."""
    words = (value.__doc__ or "").strip().split("\n\n")[0]
    return " ".join(words.split()).replace("``", "`").replace("|", "\\|")


def _rooms(package: Path) -> Iterator[Path]:
    """Folders with modules, a package and those inside it."""
    for init in sorted(package.rglob("__init__.py")):
        room = init.parent
        if not str(room.relative_to(ROOT)).startswith(_INNER):
            yield room


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def _first(module: str) -> str:
    return _summary(importlib.import_module(module))


def _page(room: Path) -> str:
    title = _name(room)
    modules = [p for p in sorted(room.glob("*.py")) if not p.stem.startswith("__")]
    lines = [f"# {title}", "", "```{eval-rst}", f".. automodule:: {title}", "```", ""]
    for module in modules:
        name = _name(module)
        lines += [f"## {name}", "", "```{eval-rst}", f".. automodule:: {name}"]
        shown = ", ".join(_public(module))
        lines += [f"   :members: {shown}", "   :member-order: bysource"] if shown else []
        lines += ["```", ""]
    return "\n".join(lines)


def _public(module: Path) -> list[str]:
    """Classes and functions that a module defines for others."""
    body = ast.parse(module.read_text("utf-8")).body
    kinds = (ast.ClassDef, ast.FunctionDef)
    return [n.name for n in body if isinstance(n, kinds) and not n.name.startswith("_")]
