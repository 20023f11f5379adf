"""What the command prints about a case."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from tests.support.commands import command
from validation import Case


def written(case: Case, path: Path) -> Path:
    """The scene of a case as a file."""
    given = {key: value for key, value in case.keys.items() if value is not None}
    path.write_text("\n".join(f"{key} = {_toml(value)}" for key, value in given.items()), "utf-8")
    return path


def printed(case: Case, folder: Path, *words: str) -> str:
    """What ``tubelock fem`` prints about a case on its mesh, its table without lines and breaks."""
    if case.scene.fem.method == "static":
        case = case.changed({"fem.error_estimate": False, "fem.mesh": "scene"})
    path = written(case, folder / "scene.toml")
    told = words if "-o" in words else (*words, "--json", str(folder / "answer.json"))
    status, out, said = command("fem", str(path), *told)
    assert status == 0, said
    return re.sub(r"[│\s]+", " ", out)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        given = {json.dumps(key): _toml(inner) for key, inner in value.items() if inner is not None}
        return "{" + ", ".join(f"{key} = {inner}" for key, inner in given.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value) if isinstance(value, str | bool) else repr(value)
