"""Errors that commands turn into one clear line and an exit status."""

from __future__ import annotations

import difflib
import io
import json
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, get_args, get_origin

from geometry.errors import RefusedError
from geometry.parts.rows import first_of

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


class InputError(RefusedError):
    """Bad input, in whole words for people: who wraps refusals lets it pass."""

    def __init__(self, words: str, *, of_input: bool = True) -> None:
        super().__init__(words)
        self.of_input = of_input


#: Keys of scenes for the names that fields of a problem and of its methods have in the libraries.
_KEYS = {
    "clearance": "contact.clearance",
    "coefficient": "effects.friction.coefficient",
    "end_time": "fem.end_time",
    "finite_rotation": "effects.finite_rotation",
    "friction": "effects.friction",
    "gravity": "effects.gravity",
    "max_work": "fem.max_work",
    "maximum_stiffness": "contact.maximum_stiffness",
    "pressure": "load.pressure",
    "ramp_time": "fem.ramp_time",
    "safety_factor": "fem.safety_factor",
    "sample_interval": "fem.sample_interval",
    "size": "mesh.size",
    "spacing": "contact.spacing",
    "stick_stiffness": "effects.friction.stick_stiffness",
    "threads": "fem.threads",
    "time_step": "fem.time_step",
    "tolerance": "detection.tolerance",
    "young_modulus": "material.young_modulus",
}


@contextmanager
def named(name: str, *, keys: bool = True) -> Iterator[None]:
    """Put the name of a scene or file before refusals of the libraries inside.

    ``keys``: whether fields are named by the keys of scenes; those of problems made in Python stay.
    """
    try:
        yield
    except InputError:
        raise
    except RefusedError as error:
        words = with_keys(str(error), _KEYS if keys else {})
        raise InputError(f"{name}: {words}", of_input=error.of_input) from None


def with_keys(words: str, keys: Mapping[str, str]) -> str:
    """Words of a library, with keys of a scene for the names of its fields.

    A field is named at the beginning, before a colon, and elsewhere in back quotes.
    """
    head, colon, rest = words.partition(":")
    return re.sub(
        r"`(\w+)`",
        lambda found: keys.get(found[1], found[0]),
        f"{keys.get(head, head)}{colon}{rest}",
    )


@contextmanager
def keyed(keys: Mapping[str, str]) -> Iterator[None]:
    """Name the keys of a scene in refusals of the libraries inside; see `with_keys`."""
    try:
        yield
    except RefusedError as error:
        error.args = (with_keys(str(error), keys),)
        raise


def _stop(words: str, status: int = 2) -> NoReturn:
    print(" ".join(words.split("\n")), file=sys.stderr)
    raise SystemExit(status)


#: Exit status where a requested accuracy or state was not reached, or a run was unstable.
NOT_REACHED = 3
#: Exit status after Ctrl-C, and after a reader of standard output went away (128 + SIGPIPE).
INTERRUPTED, READER_GONE = 130, 141


def run_command(command: Callable[[], object]) -> None:
    """Run a command; the only place that turns errors into exit statuses.

    What cannot be printed ends no command (`LastingOutput`): its files are written, and
    the exit status tells.
    """
    start = time.monotonic()
    try:
        with lasting_output() as output:
            status = _status(command)
    except KeyboardInterrupt as stop:
        kept = stop.args[0] if stop.args else "nothing was saved"
        _stop(f"stopped after {time.monotonic() - start:.0f} s: {kept}", INTERRUPTED)
    failure = None if output is None else output.failure
    if isinstance(failure, BrokenPipeError):
        status = status or READER_GONE
    elif failure is not None and not status:
        _stop(
            f"error: standard output: {failure.strerror or failure}; what was printed is lost, "
            "files, if any, are written: make room, or print to another place"
        )
    if status is not None:
        raise SystemExit(status)


def _status(command: Callable[[], object]) -> int | str | None:
    """Exit status of a command, after its error is printed."""
    try:
        command()
    except RefusedError as error:
        _stop(f"error: {error}", 2 if error.of_input else NOT_REACHED)
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
    except SystemExit as end:
        if end.code == INTERRUPTED:  # typer has caught it
            raise _behind(end) from None
        return end.code
    return None


def _behind(end: SystemExit) -> KeyboardInterrupt:
    """Interruption that ended a command; its words are what was saved."""
    error: BaseException | None = end
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error or KeyboardInterrupt()


# ---------------------------------------------------------------------------------------------
# What is wrong with a scene

#: A number as much of the world writes it.
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")

#: A kind of values among the keys of one that may have several.
_KIND = re.compile(r"(constrained-)?(int|str|float|bool)|(tuple|list|literal|function-\w+)[\[(].*")

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


#: What other programs call keys of scenes, and what stands here instead.
_ELSEWHERE = {
    "alpha": "effects.rayleigh.mass_proportional",
    "beta": "effects.rayleigh.stiffness_proportional",
    "mu": "effects.friction.coefficient",
    "hard": 'contact.law = "linear" with a stiff contact.stiffness',
}


def key_places(model: type[BaseModel], above: str = "") -> Iterator[str]:
    """``section.key`` of all keys of a scene, tables in lists left out."""
    for name, field in model.model_fields.items():
        place, inner = f"{above}{name}", field.annotation
        sections = [kind for kind in (inner, *get_args(inner)) if hasattr(kind, "model_fields")]
        if above:
            yield place
        if sections and get_origin(inner) not in (tuple, list, dict):
            yield from key_places(sections[0], f"{place}.")


def place_of(key: str, model: type[BaseModel]) -> str | None:
    """First place of a scene at which a key of that name stands; None where there is none."""
    return next((place for place in key_places(model) if place.endswith(f".{key}")), None)


def _unknown_key(path: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """Name a key that is not known, and the nearest one that is."""
    place, key = ".".join(str(k) for k in path), str(path[-1])
    if len(path) > 1 and key in model.model_fields:
        return f"unknown key {place}: {key} stands above the first [section] of a scene"
    there = _ELSEWHERE.get(key) or place_of(key, model)
    if there is not None and there != place:
        return f"unknown key {place}: did you mean {there}?"
    known = _known_keys(model, path[:-1])
    begun = [name for name in known if name.startswith(key)]
    near = begun or difflib.get_close_matches(key, known, n=1)
    if near:
        return f"unknown key {place}: did you mean {near[0]!r}?"
    hint = f": expected one of {', '.join(known)}" if known else "; remove it"
    return f"unknown key {place}{hint}"


def _misspelt(problem: Any, problems: list[Any]) -> tuple[int | str, ...] | None:
    """Place of the missing key that an unknown one is a misspelling of."""
    if problem["type"] != "extra_forbidden":
        return None
    missing = {str(p["loc"][-1]): p["loc"] for p in problems if p["type"] == "missing"}
    near = difflib.get_close_matches(str(problem["loc"][-1]), missing, n=1, cutoff=0.5)
    return missing[near[0]] if near else None


def _first(problems: list[Any]) -> Any:
    """The problem to tell: unknown keys before missing ones, most of all those that explain one."""
    if problems[0]["type"] != "missing":
        return problems[0]
    unknown = [problem for problem in problems if problem["type"] == "extra_forbidden"]
    unknown.sort(key=lambda problem: _misspelt(problem, problems) is None)
    return (unknown or problems)[0]


def one_line(
    error: ValidationError, model: type[BaseModel], example: Mapping[str, Any] | None = None
) -> str:
    """First wrong value of a model's data in one line, and where there are more.

    An example of the same kind has the lines that are missing.
    """
    problems = [
        problem if problem["type"] == "extra_forbidden" else problem | {"loc": _keys_of(problem)}
        for problem in error.errors(include_url=False)
        if problem["type"] != "default_factory_not_called"
    ]
    missing = [p["loc"] for p in problems if p["type"] == "missing"]
    # A list with wrong values is called too short as well.
    wrong = {p["loc"][:k] for p in problems for k in range(1, len(p["loc"]))}
    problems = [p for p in problems if p["type"] != "too_short" or p["loc"] not in wrong]
    lines = _lines_to_add(missing, model, example or {})
    if lines and len(missing) == len(problems):
        return f"{_and([_place(path) for path in missing])} missing; add, with your values: {lines}"
    first = _first(problems)
    place = ".".join(str(key) for key in first["loc"])
    if first["type"] == "extra_forbidden":
        line = _unknown_key(first["loc"], model)
    else:
        line = _wrong_value(first, place, model)
    reported = (first["loc"], _misspelt(first, problems))
    for kind in ("invalid", "missing"):
        others = dict.fromkeys(
            ".".join(str(key) for key in p["loc"])
            for p in problems
            if p["loc"] not in reported and (p["type"] == "missing") is (kind == "missing")
        )
        line += f"; also {kind}: {first_of(others, _MOST_NAMED)}" if others else ""
    # Names of keys may hold anything, line breaks too.
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)


def _keys_of(problem: Any) -> tuple[int | str, ...]:
    """Keys of a wrong value, without the kinds that it may have: pydantic adds the one it tried."""
    return tuple(key for key in problem["loc"] if not _KIND.fullmatch(str(key)))


def _place(path: tuple[int | str, ...]) -> str:
    """Section or key, as scenes write it."""
    return f"[{path[0]}]" if len(path) == 1 else ".".join(str(key) for key in path)


def _and(words: list[str]) -> str:
    return f"{words[0]} is" if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]} are"


def _lines_to_add(
    missing: list[tuple[int | str, ...]], model: type[BaseModel], example: Mapping[str, Any]
) -> str:
    """Sections and keys that are missing, with the values of an example; empty without one."""
    lines: dict[str, dict[str, Any]] = {}
    for section, *key in missing:
        known = example.get(str(section))
        field: Any = model.model_fields.get(str(section))
        if len(key) == 3 and isinstance(key[1], int):  # tables of a list, each with its own key
            tables = known.get(key[0]) if isinstance(known, Mapping) else None
            if not isinstance(tables, list) or key[2] not in tables[0]:
                return ""
            lines.setdefault(f"{section}.{key[0]}", {})[str(key[2])] = tables[0][key[2]]
            continue
        if not isinstance(known, Mapping) or len(key) > 1:
            return ""
        inner = getattr(field.annotation, "model_fields", {})
        required = [name for name, value in inner.items() if value.is_required()]
        names = [str(part) for part in key] or required
        if not names or not all(name in known for name in names):
            return ""
        lines.setdefault(str(section), {}).update({name: known[name] for name in names})
    return "; ".join(
        f"[{section}] " + ", ".join(f"{k} = {_toml(v)}" for k, v in keys.items())
        for section, keys in lines.items()
    )


def _toml(value: Any) -> str:
    """Value as TOML writes it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value)


def _wrong_value(problem: Any, place: str, model: type[BaseModel]) -> str:
    """Describe an invalid value by its key in the scene."""
    kind, got, path = problem["type"], problem["input"], problem["loc"]
    if kind == "missing" and isinstance(path[-1], int):
        parent = ".".join(str(key) for key in path[:-1])
        return f"{parent}: got {got!r}; a value is missing at the end of the list"
    if kind == "missing":
        return f"{place} is missing: add it to the scene"
    if kind == "value_error":
        # Checks of a whole section name their keys; the section itself, in braces, helps nobody.
        words = str(problem["ctx"]["error"])
        return words if isinstance(got, dict) else f"{place}: got {got!r}; {words}{_meant(got)}"
    if kind in ("model_type", "dict_type"):
        keys = ", ".join(_known_keys(model, path))
        return f"{place}: got {got!r}; expected a section" + (f" with {keys}" if keys else "")
    if kind in ("tuple_type", "list_type"):
        return f"{place}: got {got!r}; expected a list of values in brackets, [ … ]"
    message = problem["msg"]
    if kind == "too_short":
        message = f"expected {problem['ctx']['min_length']} at least"
    return f"{place}: got {got!r}; {message[0].lower()}{message[1:]}{_meant(got)}"


def _meant(got: Any) -> str:
    """What a text in the place of a value was meant to be, where that is known."""
    if isinstance(got, str) and _DECIMAL_COMMA.fullmatch(got.strip()):
        return f"; did you mean {got.strip().replace(',', '.')}?"
    if isinstance(got, str) and got in _ELSEWHERE:
        return f"; did you mean {_ELSEWHERE[got]}?"
    return ""


class LastingOutput(io.FileIO):
    """A file descriptor that takes what cannot be written, and keeps the first error."""

    failure: OSError | None = None
    """Why text was lost; None as long as all of it could be written."""

    def write(self, data: object, /) -> int:
        """Write bytes; return how many there were, whether or not they could be written."""
        if self.failure is None:
            try:
                return super().write(data)  # type: ignore[arg-type]
            except OSError as error:
                self.failure = error
        return memoryview(data).nbytes  # type: ignore[arg-type]


@contextmanager
def lasting_output() -> Iterator[LastingOutput | None]:
    """Let standard output last; yields what keeps its error, or None where it is no file.

    Characters that the encoding of the terminal or pipe lacks are replaced.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace" if stream is sys.stdout else "backslashreplace")
    before = sys.stdout
    raw = _raw(before)
    if raw is None:
        yield None
        return
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=before.encoding,
        errors="replace",
        line_buffering=raw.isatty(),
    )
    try:
        yield raw
    finally:
        with suppress(ValueError):  # closed by the command
            sys.stdout.flush()
        sys.stdout = before


def _raw(stream: TextIO | None) -> LastingOutput | None:
    """The descriptor of a stream; None for a stream that has none."""
    try:
        if stream is None:
            return None
        stream.flush()
        return LastingOutput(stream.fileno(), "w", closefd=False)
    except (OSError, ValueError):
        return None
