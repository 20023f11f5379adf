"""All robustness cases, in order."""

from __future__ import annotations

from collections.abc import Sequence

from validation.errors import InputError
from validation.stability import (
    contact_law,
    explicit,
    geometry,
    orders,
    process,
    rigid,
    static,
)
from validation.stability.case import Case
from validation.stability.degenerate import deformable as degenerate_deformable
from validation.stability.degenerate import rigid as degenerate_rigid


def cases() -> tuple[Case, ...]:
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
    return tuple(case for subject in subjects for case in subject.CASES.found)


def chosen(names: Sequence[str]) -> tuple[Case, ...]:
    """Cases whose name or subject is in ``names``; all where it is empty."""
    every = cases()
    known = {case.name for case in every} | {case.subject for case in every}
    for name in names:
        if name not in known:
            raise InputError(
                f"--only: got {name!r}; expected a case or one of the subjects "
                f"{', '.join(sorted({case.subject for case in every}))} "
                "(`tubelock stability --list` shows all)"
            )
    return tuple(c for c in every if not names or c.name in names or c.subject in names)
