"""The paper's printed numbers, read from one data file."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from typing import Any


@cache
def reference() -> dict[str, Any]:
    """Return the content of ``reference.toml``."""
    text = (resources.files("validation") / "paper" / "reference.toml").read_text("utf-8")
    return tomllib.loads(text)
