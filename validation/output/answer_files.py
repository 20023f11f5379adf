"""Answers as files: numbers as JSON, arrays as numpy's archive, meshes for ParaView."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from geometry.answer import Answer, Measure, known
from geometry.errors import unreadable
from validation.errors import InputError
from validation.output.files import prepare_folder, write_whole

#: Files of an answer.
FILES = ("answer.json", "answer.npz", "mesh.vtu", "contacts.vtp")
_ARRAYS = ("points", "cells", "block_of_point", "layer_of_point")


def write_answer(answer: Answer, folder: Path) -> tuple[Path, ...]:
    """Write an answer into a folder, which is made: `FILES`, each whole or not at all.

    Returns
    -------
    tuple[Path, ...]
        The files; without contacts there is no file of them.
    """
    folder = prepare_folder(folder)
    text = json.dumps(answer.as_dict(), indent=2, ensure_ascii=False) + "\n"
    arrays: dict[str, Any] = {name: getattr(answer, name) for name in _ARRAYS}
    arrays |= {f"field {name}": values for name, values in answer.fields.items()}
    arrays |= {f"contact {name}": values for name, values in answer.contacts.items()}

    def archive(path: Path) -> None:
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)

    write_whole(folder / FILES[0], lambda path: path.write_text(text, "utf-8"))
    write_whole(folder / FILES[1], archive)
    write_whole(folder / FILES[2], lambda path: answer.mesh().save(path))
    if not len(answer.contacts):
        return tuple(folder / name for name in FILES[:3])
    contacts = answer.contact_mesh()
    for name in [n for n in contacts.array_names if contacts[n].dtype.kind == "U"]:
        contacts.cell_data.pop(name, None)  # names of faces, which the format has no columns of
    write_whole(folder / FILES[3], contacts.save)
    return tuple(folder / name for name in FILES)


def read_answer(folder: Path) -> Answer:
    """Read an answer that was written; `details`, the solver's own result, is not kept.

    Raises
    ------
    InputError
        A folder without an answer, or a damaged one.
    """
    for name in FILES[:2]:
        why = unreadable(folder / name)
        if why is not None:
            raise InputError(f"{folder / name}: {why}; expected a folder that `write` wrote")
    try:
        data = json.loads((folder / FILES[0]).read_text("utf-8"))
        measures = {name: Measure(**found) for name, found in data.pop("measures").items()}
        title, method = data.pop("title"), data.pop("method")
        with np.load(folder / FILES[1], allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
        own = {name: arrays[name] for name in _ARRAYS}
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise InputError(f"{folder}: holds a damaged answer ({error}); write it again") from None
    return Answer(
        title=title,
        method=method,
        measures=known(measures),
        fields=known(_named(arrays, "field ")),
        contacts=known(_named(arrays, "contact ")),
        reported=lambda: data,
        **own,
    )


def _named(arrays: dict[str, Any], kind: str) -> dict[str, Any]:
    return {name.removeprefix(kind): v for name, v in arrays.items() if name.startswith(kind)}
