"""Errors that commands turn into one clear line and an exit status."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn, get_args, get_origin

from geometry.errors import RefusedError

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


class InputError(RefusedError):
    """Bad input, in whole words for people: who wraps refusals lets it pass."""


@contextmanager
def named(name: str) -> Iterator[None]:
    """Put the name of a scene or file before refusals of the libraries inside."""
    try:
        yield
    except InputError:
        raise
    except RefusedError as error:
        raise InputError(f"{name}: {error}") from None


def _stop(words: str, status: int = 2) -> NoReturn:
    print(" ".join(words.split("\n")), file=sys.stderr)
    raise SystemExit(status)


def run_command(command: Callable[[], object]) -> None:
    """Run a command; the only place that turns errors into exit statuses."""
    try:
        command()
    except RefusedError as error:
        _stop(f"error: {error}")
    except MemoryError as error:
        _stop(
            f"error: this needs more memory than there is ({error}); "
            "take fewer elements ([mesh]) or fewer layers (assembly.layers)"
        )
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _stop(
            f"error: {where}{error.strerror or error}; the output could not be written or a file "
            "not be read: make room, or choose another place"
        )
    except KeyboardInterrupt:
        _stop("interrupted", 130)


# ---------------------------------------------------------------------------------------------
# What is wrong with a scene

#: Places named beside the first mistake.
_MOST_NAMED = 3


def _known_keys(model: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """Keys allowed at a place of the scene."""
    inside = False  # a list or table of sections: its places and names are no keys of a section
    for key in path:
        if inside:
            inside = False
            continue
        field = model.model_fields.get(str(key))
        inner = None if field is None else field.annotation
        sections = [kind for kind in (inner, *get_args(inner)) if hasattr(kind, "model_fields")]
        if not sections:
            return []
        model, inside = sections[0], get_origin(inner) in (tuple, list, dict)
    return list(model.model_fields)


def _some(words: list[str]) -> str:
    """The first of some words, and how many more there are."""
    more = len(words) - _MOST_NAMED
    named = ", ".join(words[:_MOST_NAMED])
    return f"{named} and {more} more" if more > 0 else named


def one_line(error: ValidationError, model: type[BaseModel]) -> str:
    """First wrong value of a model's data in one line, and where there are more."""
    problems = error.errors(include_url=False)
    first = problems[0]
    place = ".".join(str(key) for key in first["loc"])
    if first["type"] == "extra_forbidden":
        known = _known_keys(model, first["loc"][:-1])
        near = difflib.get_close_matches(str(first["loc"][-1]), known, n=1, cutoff=0.5)
        hint = f": expected one of {', '.join(known)}" if known else "; remove it"
        line = f"unknown key {place}{f': did you mean {near[0]!r}?' if near else hint}"
    else:
        line = _wrong_value(first, place, model)
    others = dict.fromkeys(".".join(str(key) for key in p["loc"]) for p in problems[1:])
    others.pop(place, None)
    line += f"; wrong, too: {_some(list(others))}" if others else ""
    # Names of keys may hold anything, line breaks too.
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)


def _wrong_value(problem: Any, place: str, model: type[BaseModel]) -> str:
    """Say what is wrong with a value that has a known place, in the words of scenes."""
    kind, got, path = problem["type"], problem["input"], problem["loc"]
    if kind == "missing" and isinstance(path[-1], int):
        parent = ".".join(str(key) for key in path[:-1])
        return f"{parent}: got {got!r}; a value is missing at the end of the list"
    if kind == "missing":
        return f"{place} is missing: add it to the scene"
    if kind == "value_error":
        # Checks of a whole section name their keys; the section itself, in braces, helps nobody.
        words = str(problem["ctx"]["error"])
        return words if isinstance(got, dict) else f"{place}: got {got!r}; {words}"
    if kind in ("model_type", "dict_type"):
        keys = ", ".join(_known_keys(model, path))
        return f"{place}: got {got!r}; expected a section" + (f" with {keys}" if keys else "")
    if kind in ("tuple_type", "list_type"):
        return f"{place}: got {got!r}; expected a list of values in brackets, [ … ]"
    message = problem["msg"]
    return f"{place}: got {got!r}; {message[0].lower()}{message[1:]}"
