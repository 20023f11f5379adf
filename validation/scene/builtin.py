"""Scenes and studies that come with the program; reading them imports nothing heavy."""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path

from geometry.errors import unreadable
from validation.errors import InputError

#: First words of the line that tells editors where the schema of scenes is.
SCHEMA_DIRECTIVE = "#:schema"


#: Folder of what comes with the program as TOML, by what it is.
_FOLDERS = {"scene": "scenes", "study": "studies"}
#: What lists them.
_LISTED = {"scene": "tubelock scenes", "study": "tubelock scenes --studies"}


def builtin_names(kind: str = "scene") -> list[str]:
    """Names of the built-in scenes, or of what else comes as TOML, sorted."""
    names = (path.name for path in (resources.files("validation") / _FOLDERS[kind]).iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def stands_for_builtin(path: Path, kind: str = "scene") -> bool:
    """Whether a path is to be looked up among them: no file, or a folder that has such a name."""
    if path.suffix == ".toml":
        return False
    why = unreadable(path)
    return why == "no such file" or (str(path) in builtin_names(kind) and path.is_dir())


def builtin_text(name: str, kind: str = "scene") -> str:
    """TOML text of a built-in scene."""
    known, folder = builtin_names(kind), _FOLDERS[kind]
    if name not in known:
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"see `{_LISTED[kind]}`"
        raise InputError(f"{kind} {name!r} not found: no such file or built-in {kind}; {hint}")
    return (resources.files("validation") / folder / f"{name}.toml").read_text("utf-8")


def builtin_about(name: str, kind: str = "scene") -> str:
    """Description of a built-in scene: its first comment that is no directive."""
    lines = builtin_text(name, kind).splitlines()
    return next(line.lstrip("# ") for line in lines if not line.startswith(SCHEMA_DIRECTIVE))
