"""Compiled functions whose cache several processes may fill at once.

numba writes the index of its cache before the machine code and holds no lock: of two processes
that compile different forms of one function at the same moment, one can load the other's machine
code under its own name, and compute with it. Here the code is written first, and both steps are
one under a lock, for reading too.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numba
from filelock import FileLock
from numba.core.caching import IndexDataCacheFile


class LockedCacheFile(IndexDataCacheFile):  # type: ignore[misc]
    """Index and machine code of one function, one process at a time."""

    def _lock(self) -> FileLock:
        return FileLock(f"{self._index_path}.lock")

    def save(self, key: Any, data: Any) -> None:
        """Add a compiled form."""
        with self._lock():
            overloads = self._load_index()
            if key not in overloads:
                known = set(overloads.values())
                names = (self._data_name(number) for number in itertools.count(1))
                overloads[key] = next(name for name in names if name not in known)
            # Code before index: a process killed in between leaves no name without its code.
            self._save_data(overloads[key], data)
            self._save_index(overloads)

    def load(self, key: Any) -> Any:
        """Return a compiled form; None where there is none."""
        with self._lock():
            return super().load(key)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit`; with ``cache=True`` safe against other processes."""

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        cache = getattr(dispatcher, "_cache", None)
        # Absent where compilation is disabled; without effect where nothing is cached.
        file = getattr(cache, "_cache_file", None)
        if isinstance(file, IndexDataCacheFile):
            file.__class__ = LockedCacheFile
        return dispatcher

    return compiled
