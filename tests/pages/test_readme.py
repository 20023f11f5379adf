"""The README and CONTRIBUTING: what they point to is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text("utf-8")


def test_every_picture_is_in_the_repository() -> None:
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", TEXT) + re.findall(r'<img src="([^"]+)"', TEXT)
    assert len(pictures) > 1
    assert [p for p in pictures if not (ROOT / p).is_file()] == []


def test_contributing_points_at_what_is_there() -> None:
    """Every file and folder that it names exists, but for those that one is to add."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    named = re.findall(r"`((?:geometry|mbd|fem|validation|tests|docs)/[\w./]+)`", text)
    placeholders = ("NAME", "GROUP")
    there = [path for path in named if not any(word in path for word in placeholders)]
    assert len(there) > 12
    assert [path for path in there if not (ROOT / path).exists()] == []
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert [link for link in links if not (ROOT / link).exists()] == []
