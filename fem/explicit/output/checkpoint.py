"""Checkpoints and stop requests: a killed run goes on bitwise identically.

A checkpoint is one ``.npz`` with every array and number of the state, the history so far and
a fingerprint of the problem; it replaces the last one in a single step, so a run killed while
writing leaves the last one whole.
"""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from scipy.sparse import bsr_array

from fem.explicit.output.energy import COLUMNS, History
from fem.explicit.step import Loop
from geometry.errors import RefusedError, unreadable
from geometry.machine.system import stop_signals

FORMAT = 5

Contents = dict[str, np.ndarray[Any, Any]]


class CheckpointError(RefusedError):
    """A checkpoint that cannot be used: missing, damaged, or of another problem."""


class OtherProblemError(CheckpointError):
    """A whole checkpoint, but of another model or time step."""


def write_checkpoint(path: Path, loop: Loop, history: History) -> None:
    """Write state and history; atomically replaces an older file."""
    path = Path(path)
    initial = np.nan if history.initial_total is None else history.initial_total
    contents: Contents = {
        **{f"array/{name}": array for name, array in state_arrays(loop).items()},
        **{f"number/{name}": np.array(v) for name, v in state_numbers(loop).items()},
        "format": np.array(FORMAT),
        "fingerprint": np.array(fingerprint(loop)),
        "history": history.table(),
        "pushes": np.array(history.pushes),
        "initial_total": np.array(initial),
        "put_in": np.array(history.put_in),
        "turnover": np.array(history.turnover),
    }
    temporary = path.with_name(path.name + ".part")
    with temporary.open("wb") as file:
        arrays: dict[str, Any] = {**contents, "digest": np.array(content_digest(contents))}
        np.savez(file, **arrays)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def read_checkpoint(path: Path, loop: Loop) -> History:
    """Fill the state of ``loop`` from a checkpoint and return the history up to it.

    Nothing of it changes unless the whole checkpoint fits.
    """
    path = Path(path)
    contents = _contents(path)
    if "fingerprint" not in contents or str(contents.get("format")) != str(FORMAT):
        raise CheckpointError(f"checkpoint {path}: not a checkpoint of this version")
    if str(contents.pop("digest", "")) != content_digest(contents):
        raise CheckpointError(
            f"checkpoint {path}: is damaged: its content is not what was written; start the run "
            "from the beginning"
        )
    if str(contents["fingerprint"]) != fingerprint(loop):
        raise OtherProblemError(
            f"checkpoint {path}: belongs to another model or time step; "
            "run the same scene with the same options or remove the file"
        )
    arrays, numbers = state_arrays(loop), state_numbers(loop)
    for name, array in arrays.items():
        kept = contents.get(f"array/{name}")
        if kept is None or (kept.shape, kept.dtype) != (array.shape, array.dtype):
            result = "nothing" if kept is None else f"{kept.shape} of {kept.dtype}"
            raise CheckpointError(
                f"checkpoint {path}: {name} is {result}, expected {array.shape} of {array.dtype}; "
                "it was written by another version: start the run from the beginning"
            )
    for name, array in arrays.items():
        array[...] = contents[f"array/{name}"]
    for name in numbers:
        set_state_number(loop, name, contents[f"number/{name}"].item())
    return _history(contents)


def _contents(path: Path) -> Contents:
    """Everything in a file, read whole."""
    why = unreadable(path)
    if why is not None:
        raise CheckpointError(f"checkpoint {path}: {why}; start the run from the beginning")
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    # Bytes that are no such file raise what they like: of zip, of zlib, of numpy's headers.
    except Exception:
        raise CheckpointError(
            f"checkpoint {path}: not a readable checkpoint; start the run from the beginning"
        ) from None


def _history(contents: Contents) -> History:
    initial = float(contents["initial_total"])
    rows = contents["history"].reshape(-1, len(COLUMNS))
    return History(
        rows=[tuple(float(v) for v in row) for row in rows],
        initial_total=None if np.isnan(initial) else initial,
        put_in=float(contents["put_in"]),
        turnover=float(contents["turnover"]),
        pushes=[tuple(row) for row in contents["pushes"].tolist()],
    )


def content_digest(contents: Mapping[str, np.ndarray[Any, Any]]) -> str:
    """Digest of names, shapes, types and bits."""
    digest = hashlib.sha256()
    for name in sorted(contents):
        digest.update(name.encode())
        _hash(digest, contents[name])
    return digest.hexdigest()


def state_arrays(loop: Loop) -> dict[str, np.ndarray[Any, Any]]:
    """Every array of the state and of the interactions, by a path of names."""
    arrays: dict[str, np.ndarray[Any, Any]] = _evolving(loop, np.ndarray)
    for k, interaction in enumerate(loop.interactions):
        for name, array in interaction.arrays().items():
            arrays[f"interaction.{k}.{name}"] = array
    return arrays


def bytes_of(loop: Loop) -> int:
    """Memory of what evolves and of the constants of the bodies."""
    evolves = sum(array.nbytes for array in state_arrays(loop).values())
    return evolves + sum(body.constant_bytes for body in loop.bodies)


def state_numbers(loop: Loop) -> dict[str, float | int]:
    """Every number of the state, by a path of names."""
    return _evolving(loop, (int, float))


def _evolving(loop: Loop, kind: Any) -> dict[str, Any]:
    """All of a kind that changes from step to step, by a path of names from the loop."""
    found: dict[str, Any] = {}
    for name in ("step", "mass_damping"):
        _collect(getattr(loop, name), name, found, kind)
    for k, body in enumerate(loop.bodies):
        _collect(body.now, f"bodies.{k}.now", found, kind)
    return found


def _collect(value: Any, path: str, found: dict[str, Any], kind: Any) -> None:
    if isinstance(value, kind):
        found[path] = value
    elif isinstance(value, tuple):
        for k, item in enumerate(value):
            _collect(item, f"{path}.{k}", found, kind)
    elif is_dataclass(value):
        for field in fields(value):
            _collect(getattr(value, field.name), f"{path}.{field.name}", found, kind)


def set_state_number(loop: Loop, path: str, number: float | int) -> None:
    """Inverse of `state_numbers` for one path."""
    *parents, name = path.split(".")
    owner: Any = loop
    for part in parents:
        owner = owner[int(part)] if part.isdigit() else getattr(owner, part)
    setattr(owner, name, number)


def fingerprint(loop: Loop) -> str:
    """Hash of everything that decides the bits of a run."""
    digest = hashlib.sha256()
    stated = loop.stated
    system = stated.system
    placed = [
        system.whole.assembly.rotations,
        system.whole.assembly.translations,
        system.whole.offsets,
    ]
    faces = [[shape.mesh.nodes, shape.contact_quads] for shape in system.whole.assembly.shapes]
    _hash(digest, [stated.bodies, stated.blocks, stated.effects, placed, faces])
    _hash(
        digest,
        [system.whole.contact, system.whole.surfaces.clearance, stated.stick, system.orbits.share],
    )
    _hash(digest, [system.whole.supports, system.whole.forces, stated.counted_pressure])
    _hash(digest, loop.time_step)
    return digest.hexdigest()


def _hash(digest: Any, value: Any) -> None:
    digest.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        digest.update(str((value.shape, value.dtype)).encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, list | tuple):
        for item in value:
            _hash(digest, item)
    elif isinstance(value, bsr_array):
        for part in (value.data, value.indices, value.indptr):
            _hash(digest, part)
    elif is_dataclass(value):
        for field in fields(value):
            digest.update(field.name.encode())
            _hash(digest, getattr(value, field.name))
    elif callable(value):
        digest.update(getattr(value, "__qualname__", repr(value)).encode())
    else:
        digest.update(repr(value).encode())


@dataclass
class StopRequest:
    """Whether Ctrl-C was pressed (or the process asked to terminate)."""

    requested: bool = False
    """Set by the signal."""


@contextmanager
def stop_requests() -> Iterator[StopRequest]:
    """Turn SIGINT and SIGTERM into a flag while the context lasts.

    A state must not be left half updated: the loop asks for the flag between two steps. A
    second Ctrl-C raises KeyboardInterrupt at once. Outside the main thread signals cannot be
    caught and the flag stays False.
    """
    request = StopRequest()

    def note(number: int, _: FrameType | None) -> None:
        if request.requested and number == signal.SIGINT:
            raise KeyboardInterrupt
        request.requested = True

    with stop_signals(note):
        yield request
