"""Docstrings are read in editors: what only reStructuredText misreads is escaped here."""

from __future__ import annotations

import re
from typing import Any

#: |t|, the size of a vector, and *DAMPING, an Abaqus keyword, mean themselves.
_MISREAD = re.compile(r"\||(?<![\w*])\*(?=[A-Z]{3,}\b|[A-Z][a-z]+ [A-Z])")


def _escape(_app: Any, _what: str, _name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    for number, line in enumerate(lines):
        if line.startswith((".. ", "   :", ":")):
            continue
        lines[number] = _MISREAD.sub(lambda found: "\\" + found[0], line)


#: Descriptions of single values, which napoleon would read as "type: description".
_SINGLE = frozenset({"attribute", "property", "data"})
_kept: dict[str, list[str]] = {}


def _keep(_app: Any, what: str, name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    if what in _SINGLE:
        _kept[name] = list(lines)


def _restore(_app: Any, what: str, name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    if what in _SINGLE and name in _kept:
        lines[:] = _kept.pop(name)


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx, before napoleon sees the lines."""
    app.connect("autodoc-process-docstring", _escape, priority=100)
    app.connect("autodoc-process-docstring", _keep, priority=200)
    app.connect("autodoc-process-docstring", _restore, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
