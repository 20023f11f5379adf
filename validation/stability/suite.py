"""All robustness cases, in order."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

from validation.stability.case import CASES
from validation.statement import Statement, chosen_by_name

_SUBJECTS = (
    *("rigid", "degenerate.rigid", "degenerate.deformable", "contact_law", "static", "explicit"),
    *("geometry", "orders", "process"),
)


def cases() -> tuple[Statement, ...]:
    """Every case of every subject."""
    for subject in _SUBJECTS:
        import_module(f"validation.stability.{subject}")
    return tuple(CASES)


def chosen(names: Sequence[str]) -> list[Statement]:
    """Cases whose name or subject is in ``names``; all where it is empty."""
    return chosen_by_name(cases(), names, "--only", " (`tubelock stability --list` shows all)")
