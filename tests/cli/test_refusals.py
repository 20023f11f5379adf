"""Bad input gets one line, exit status 2 and no file: every row of tests/refusals.toml."""

from __future__ import annotations

import shlex
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.quick

REFUSALS: dict[str, str] = {
    words: line
    for rows in tomllib.loads(
        (Path(__file__).parents[1] / "refusals.toml").read_text("utf-8")
    ).values()
    for words, line in rows.items()
}


def typed(words: str) -> Iterator[str]:
    """Words of a row as the command takes them: KEY=VALUE is a setting, unless of an option."""
    before = ""
    for word in shlex.split(words):
        if "=" in word and not word.startswith("-") and before != "--accuracy":
            yield "--set"
        yield word
        before = word


@pytest.mark.parametrize("words", REFUSALS)
def test_bad_input_gets_the_line_of_the_table(
    tubelock: Callable[..., tuple[int, str, str]], words: str
) -> None:
    assert tubelock(*typed(words)) == (2, "", f"error: {REFUSALS[words]}\n")
    assert not list(Path().iterdir())
