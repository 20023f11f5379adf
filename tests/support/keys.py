"""Every key of a scene, and another value of it."""

from __future__ import annotations


def other(value: object) -> object:
    """Another value of the same kind that a scene takes."""
    words = {"newton": "clarabel", "force": "pressure", "static": "paper", "cone": "pyramid"}
    words |= {"incompatible": "full", "pyramid": "cone"}
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return 0.7 * value if value else 0.01
    return words.get(str(value), value)


def leaves(data: dict[str, object], place: str = "") -> list[tuple[str, object]]:
    """Keys of a scene with their values."""
    found: list[tuple[str, object]] = []
    for key, value in data.items():
        inner = isinstance(value, dict)
        found += leaves(value, f"{place}{key}.") if inner else [(f"{place}{key}", value)]  # type: ignore[arg-type]
    return found
