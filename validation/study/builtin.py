"""The parameter studies that come with the program."""

from __future__ import annotations

import difflib

from validation.errors import InputError
from validation.scene.builtin import toml_names, toml_text


def builtin_studies() -> list[str]:
    """Names of the built-in studies, sorted."""
    return toml_names("studies")


def builtin_study_text(name: str) -> str:
    """TOML text of a built-in study.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if name not in builtin_studies():
        known = ", ".join(builtin_studies())
        raise InputError(
            f"study {name!r} is neither a file nor a built-in study"
            f"{nearest(name, builtin_studies())}; built in: {known}"
        )
    return toml_text("studies", name)


def nearest(name: str, known: list[str]) -> str:
    """Words that name the nearest of some names, if one is near."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
    return f"; did you mean {near[0]!r}?" if near else ""
