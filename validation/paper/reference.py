"""The paper's printed numbers and statements, read from two data files."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from typing import Any


@cache
def reference() -> dict[str, Any]:
    """Return the content of ``reference.toml``: numbers."""
    return _content("reference.toml")


@cache
def statements() -> dict[str, Any]:
    """Return the content of ``statements.toml``: claims and errata by name."""
    return _content("statements.toml")


def _content(name: str) -> dict[str, Any]:
    return tomllib.loads((resources.files("validation") / "paper" / name).read_text("utf-8"))
