"""The scenes that come with the program; reading their names and text imports nothing heavy."""

from __future__ import annotations

import difflib
from importlib import resources

from validation.errors import InputError

#: First words of the line that tells editors where the schema of scenes is.
SCHEMA_DIRECTIVE = "#:schema"


def toml_names(kind: str) -> list[str]:
    """Names of what comes with the program as TOML, ``scenes`` or ``studies``, sorted."""
    names = (path.name for path in (resources.files("validation") / kind).iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def toml_text(kind: str, name: str) -> str:
    """TOML text of one of them."""
    return (resources.files("validation") / kind / f"{name}.toml").read_text("utf-8")


def builtin_names() -> list[str]:
    """Names of the built-in scenes, sorted."""
    return toml_names("scenes")


def builtin_text(name: str) -> str:
    """TOML text of a built-in scene.

    Raises
    ------
    InputError
        For an unknown name, with the nearest ones.
    """
    if name not in builtin_names():
        near = difflib.get_close_matches(name, builtin_names(), n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else "see `tubelock scenes`"
        raise InputError(f"scene {name!r} is neither a file nor a built-in scene; {hint}")
    return toml_text("scenes", name)


def builtin_about(name: str) -> str:
    """What a built-in scene is, in the words of its first comment that is no directive."""
    lines = builtin_text(name).splitlines()
    return next(line.lstrip("# ") for line in lines if not line.startswith(SCHEMA_DIRECTIVE))
