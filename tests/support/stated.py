"""The problem of a scene as it is refined."""

from __future__ import annotations

from fem import Problem
from validation import load_case


def stated(name: str, *settings: str) -> Problem:
    return load_case(name, settings or ("assembly.layers=1",)).problem
