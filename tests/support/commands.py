"""The command line as tests run it, and the line by which a case is rejected."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any
from unittest import mock

from geometry import RefusedError
from validation import load_case, solve

#: Files of every answer: its numbers, its arrays, its blocks, and its contact facets.
ANSWER_FILES = ("answer.json", "answer.npz", "fields.vtu", "contact_pressures.vtu")


@cache
def _tubelock() -> EntryPoint:
    """Looked for once: it takes as long as a short command."""
    (found,) = entry_points(group="console_scripts", name="tubelock")
    return found


def command(*words: str) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of ``tubelock WORDS``, in this process."""
    out, err = _stream(), _stream()
    with (
        mock.patch.object(sys, "argv", ["tubelock", *words]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            _tubelock().load()()
            status = 0
        except SystemExit as stop:
            status = int(stop.code or 0)
    return status, _text(out), _text(err)


def set_words(settings: Iterable[str] | Mapping[str, Any]) -> list[str]:
    """Words of a command that state settings."""
    if isinstance(settings, Mapping):
        settings = [f"{key}={value}" for key, value in settings.items()]
    return [word for setting in settings for word in ("--set", setting)]


def answered(*words: str) -> tuple[dict[str, Any], str]:
    """Data that ``tubelock WORDS`` writes as JSON, and the text that it prints beside them."""
    status, out, said = command(*words, "--json", "-")
    assert status == 0, said
    data: dict[str, Any] = json.loads(out)
    return data, said


def rejected(
    stated: str | Path | Mapping[str, Any],
    settings: Mapping[str, Any] | Sequence[str] = (),
    *,
    method: str | None = None,
) -> str:
    """The one line that rejects a case, when it is read or when it is solved."""
    try:
        solve(load_case(stated, settings, method=method))
    except RefusedError as error:
        line = str(error)
        assert line.count("\n") == 0 < len(line), f"expected one line, got {line!r}"
        return line
    raise AssertionError(f"{stated}, {settings}: expected to be rejected, got an answer")


def _stream() -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="", write_through=True)


def _text(stream: io.TextIOWrapper) -> str:
    stream.flush()
    return stream.buffer.getvalue().decode("utf-8")  # type: ignore[attr-defined]
