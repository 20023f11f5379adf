"""Whether a file can be read to its end: folders, pipes and devices cannot."""

from __future__ import annotations

from pathlib import Path


def unreadable(path: Path) -> str | None:
    """Words for what stands in the place of a file that was to be read; None where one does.

    A pipe that nobody fills and a device without end would be read for ever.
    """
    try:
        if path.is_file():
            return None
        if path.is_dir():
            return "is a folder"
        there = path.exists()
    except (OSError, ValueError, RuntimeError) as error:  # names too long, links to themselves
        return f"cannot be looked up ({getattr(error, 'strerror', None) or error})"
    return "is a pipe or a device: save it as a file first" if there else "no such file"
