"""numba: its clock, and the files in which it keeps compiled functions.

numba's files are keyed by types, processor and options, not by what a function calls in other
modules. So the folder of a module is named by the sources of the module and of all that it imports.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import pickle
import re
import secrets
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core import bytecode, config, event
from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile, NullCache
from numba.core.runtime import rtsys
from numba.misc.appdirs import AppDirs

from geometry.machine.work import CLOCKS

_LOG = logging.getLogger(__name__)

#: Imports at the top of a file; functions that are compiled have no others.
_IMPORT = re.compile(r"^(?:from (\S+) )?import (\([^)]*\)|.+)", re.MULTILINE)
#: Switches of the compiler that change the code it makes.
_SWITCHES = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT")
#: Folders of other sources that nothing used for so long are removed [s].
_UNUSED = 30 * 86400.0


class _Watch(event.Listener):  # type: ignore[misc]
    """Passes on when compilation starts and ends."""

    def on_start(self, _: Any) -> None:
        """Start the clocks."""
        for clock in CLOCKS:
            clock.start()

    def on_end(self, _: Any) -> None:
        """Stop them."""
        for clock in CLOCKS:
            clock.stop()


event.register("numba:compile", _Watch())

# Numba counts the functions of a process, and the count is what tells the names of two closures of
# one factory apart. Code of two processes, loaded together, had one name for two functions: the
# linker took the first for both, without a word (https://github.com/numba/numba/issues/10486).
bytecode.FunctionIdentity._unique_ids = iter(lambda: secrets.randbits(64), None)


class KernelCache(NullCache):  # type: ignore[misc]
    """numba's files of one function, without a closure, in a folder of this program."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], folder: Path) -> None:
        line = function.__code__.co_firstlineno
        name = f"{function.__qualname__}-{line}".replace("<", "").replace(">", "")
        self._options = repr(sorted(options.items()))
        self._files = IndexDataCacheFile(str(folder), name, source_stamp=None)
        # Two processes that add to an index at once would number two forms alike.
        self._files._data_name_pattern = f"{name}.{secrets.token_hex(8)}.{{number:d}}.nbc"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled form for a signature, None where there is none that can be read."""
        # Numba would load all it compiles with, a quarter of a second; whoever compiles does so.
        rtsys.initialize(target_context)
        with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError):
            data = self._files.load(self._key(sig, target_context.codegen()))
            return data and CompileResultCacheImpl.rebuild(None, target_context, data)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled form; without a word where the disk is full."""
        if not data.library.has_dynamic_globals and not data.lifted:
            with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError):
                key = self._key(sig, data.codegen)
                self._files.save(key, CompileResultCacheImpl.reduce(None, data))

    def _key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return sig, codegen.magic_tuple(), self._options


@functools.cache
def sources(module: str) -> dict[str, Path]:
    """Files of an imported module and of all that it imports from its package and `geometry`."""
    packages = {module.partition(".")[0], "geometry"}
    result: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        file = getattr(sys.modules.get(name), "__file__", None)
        if name in result or file is None or name.partition(".")[0] not in packages:
            continue
        result[name] = Path(file)
        for package, names in _IMPORT.findall(result[name].read_text("utf-8")):
            imported = re.findall(r"[\w.]+", names)
            waiting += [package, *(f"{package}.{n}" for n in imported)] if package else imported
    return result


@functools.cache
def folder_of(module: str, started: float) -> Path | None:
    """Folder for the compiled functions of a module; None where nothing can be kept.

    Sources that were edited after the program started [s since the epoch] are not what runs:
    nothing is kept then.
    """
    files = sorted(sources(module).values())
    if not files or max(file.stat().st_mtime for file in files) > started:
        return None
    switches = [getattr(config, switch, None) for switch in _SWITCHES]
    asked = [llvmlite.__version__, sys.version, switches]
    digest = sha256(repr([asked, *(file.read_bytes() for file in files)]).encode()).hexdigest()
    top = Path(config.CACHE_DIR or AppDirs("tubelock", appauthor=False).user_cache_dir)
    folder = top / f"tubelock-numba-{numba.__version__}-{module}-{digest[:16]}"
    try:
        if not (config.CACHE_DIR or top.is_absolute()):  # an empty variable of the environment
            raise OSError
        if not folder.is_dir():
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _remove_unused(top, module)
        tempfile.TemporaryFile(dir=folder).close()
        os.utime(folder)
    except OSError:
        _say_nothing_is_kept(top)
        return None
    return folder


def _remove_unused(top: Path, module: str) -> None:
    """Remove code of other sources; a process that still runs it compiles anew what it misses."""
    for folder in top.glob(f"tubelock-numba-*-{module}-*"):
        if folder.stat().st_mtime < time.time() - _UNUSED:
            shutil.rmtree(folder, ignore_errors=True)


@functools.cache
def _say_nothing_is_kept(top: Path) -> None:
    _LOG.warning(
        "%s cannot be written: every run compiles anew (NUMBA_CACHE_DIR names another folder)", top
    )
