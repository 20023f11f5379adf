"""Options every compiled loop shares."""

from __future__ import annotations

from typing import Any

#: Division as NumPy does it, and the interpreter lock released.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}
