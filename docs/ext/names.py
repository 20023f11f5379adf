"""Names of our code in backticks become links to the API pages."""

from __future__ import annotations

import re
from typing import Any

#: `mbd.equilibrium.newton_equilibrium` and the like, not yet part of a role.
_NAME = re.compile(r"(?<![}`\w])`((?:geometry|mbd|fem|validation)(?:\.[A-Za-z_]\w*)+)`(?!`)")


def linked(text: str) -> str:
    """Return Markdown whose dotted names are references, code blocks left alone."""
    lines, inside = [], False
    for line in text.split("\n"):
        if re.match(r"^\s*(```|~~~)", line):
            inside = not inside
        lines.append(line if inside else _NAME.sub(r"{py:obj}`\1 <\1>`", line))
    return "\n".join(lines)


def _link(_app: Any, _name: str, source: list[str]) -> None:
    source[0] = linked(source[0])


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
