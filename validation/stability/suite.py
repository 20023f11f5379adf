"""All robustness cases, in order."""

from __future__ import annotations

from collections.abc import Sequence

from validation.stability import (
    contact_law,
    explicit,
    geometry,
    orders,
    process,
    rigid,
    static,
)
from validation.stability.degenerate import deformable as degenerate_deformable
from validation.stability.degenerate import rigid as degenerate_rigid
from validation.statement import Statement, chosen_by_name


def cases() -> tuple[Statement, ...]:
    """Every case of every subject."""
    subjects = (
        rigid,
        degenerate_rigid,
        degenerate_deformable,
        contact_law,
        static,
        explicit,
        geometry,
        orders,
        process,
    )
    return tuple(case for subject in subjects for case in subject.CASES)


def chosen(names: Sequence[str]) -> list[Statement]:
    """Cases whose name or subject is in ``names``; all where it is empty."""
    return chosen_by_name(cases(), names, "--only", " (`tubelock stability --list` shows all)")
