"""Files the command line writes: folders checked before the work, every file whole or absent."""

from __future__ import annotations

import csv
import json
import math
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geometry.machine.system import write_whole
from validation.errors import InputError

if TYPE_CHECKING:
    pass

#: Names of all frames for ParaView.
FRAMES = "frame_[0-9]*.vtu"
#: Endings of pages, which have pictures inside.
PAGES = (".html", ".htm")


def prepare_folder(folder: Path) -> Path:
    """Create a folder and make sure that it can be written, before any work is done."""
    taken = next((f for f in (folder, *folder.parents) if f.is_file()), None)
    if taken is not None:
        raise InputError(f"{taken}: is a file; expected a folder, or a name that is free")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror or error}); "
            "choose a folder you may write"
        ) from None
    return folder


@contextmanager
def output_folder(folder: Path | None) -> Iterator[None]:
    """Prepare a folder, and take it away again if the work fails before anything is in it."""
    if folder is None:
        yield
        return
    made = [f for f in (folder, *folder.parents) if not f.exists()]
    prepare_folder(folder)
    try:
        yield
    except BaseException:
        for empty in made:
            try:
                empty.rmdir()
            except OSError:
                break
        raise


def prepare_file(path: Path) -> Path:
    """Make sure that a file can be written later; nothing is created but its folder."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; expected the name of a file to write")
    if path.exists() and not path.is_file():
        # A whole file is renamed into place, which would put it in the place of a device.
        raise InputError(f"{path}: is no ordinary file; expected a file name, or --json - to pipe")
    prepare_folder(path.parent)
    if path.exists() and not os.access(path, os.W_OK):
        raise InputError(f"{path}: exists and cannot be overwritten; choose another name")
    return path


def require_picture(path: Path) -> None:
    """Reject a name of a picture of blocks that does not say PNG."""
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: expected a file name that ends in .png")


def write_csv(path: Path, heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write rows as CSV (RFC 4180, header line, numbers in full precision)."""

    def write(partial: Path) -> None:
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(heads)
            writer.writerows(rows)

    write_whole(path, write)


def _finite(data: Any) -> Any:
    """Return the same data with None in place of numbers that are not finite."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def write_json(target: str | None, data: Any) -> None:
    """Write data as JSON, numbers in full precision, to a file or to standard output (``-``).

    JSON has no infinity: a quantity that is none, or has no value, is null.
    """
    if target is None:
        return
    text = json.dumps(_finite(data), indent=2, allow_nan=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_whole(Path(target), lambda path: path.write_text(text, "utf-8"))
