"""Where an answer with friction lies among those that the laws admit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class FrictionSet:
    """Where an answer with friction lies among those that the laws admit."""

    member: str
    """How the load was applied."""
    change: dict[str, float]
    """Of each measure when half as many load steps are taken, in its unit; empty where only one
    number of them was solved."""
    width: dict[str, float]
    """Of each measure after the way past the load and back, relative to that straight up, less
    one [-]; empty where that way has no end."""
    remark: str
    """Why there is no width, or where it was found."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "member": self.member,
            "change_by_load_steps": self.change,
            "past_and_back": self.width,
            "remark": self.remark,
        }
