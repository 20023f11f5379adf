"""API pages from docstrings: one page for each room, its modules one after the other."""

from __future__ import annotations

import ast
import importlib
import os
from collections.abc import Iterator
from pathlib import Path

from ext.runs import ROOT, emptied

#: What is shown; and what stands in no program of a reader: compiled loops.
_SHOWN = ("geometry", "mbd", "fem", "validation/scene", "validation/build", "validation/run")
_INNER = ("fem/explicit/kernels",)


def write_api(folder: Path) -> None:
    """Write the overview and one page for each folder; `API=off` leaves the pages out."""
    emptied(folder)
    if os.environ.get("API") == "off":
        (folder / "index.md").write_text("# API\n\nLeft out of this build (`API=off`).\n", "utf-8")
        return
    rooms = [room for package in _SHOWN for room in _rooms(ROOT / package)]
    for room in rooms:
        (folder / f"{_name(room)}.md").write_text(_page(room), "utf-8")
    rows = [f"| [`{_name(room)}`]({_name(room)}.md) | {_first(_name(room))} |" for room in rooms]
    listed = "\n".join(_name(room) for room in rooms)
    text = _INDEX.format(rows="\n".join(rows), names=listed)
    (folder / "index.md").write_text(text, "utf-8")


_INDEX = """# API

Three packages answer questions, a fourth asks them. Arrays are `(n, 3)`, units mm, N, MPa, s,
tonne; shapes, units, errors and sources stand in the docstrings. `validation` is shown as far as
programs need it.

| package | what is in it |
|---|---|
{rows}

```{{toctree}}
:hidden:

{names}
```
"""


def _rooms(package: Path) -> Iterator[Path]:
    """Folders with modules, a package and those inside it."""
    for init in sorted(package.rglob("__init__.py")):
        room = init.parent
        if not str(room.relative_to(ROOT)).startswith(_INNER):
            yield room


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def _first(module: str) -> str:
    words = (importlib.import_module(module).__doc__ or "").strip().split("\n\n")[0]
    return " ".join(words.split()).replace("``", "`").replace("|", "\\|")


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
