"""Compiled functions, kept by the content of everything they were compiled from.

numba keys its cache by the file of the function that is called: an edit of a helper in another
file leaves the old machine code running, and the index that leads from a form of a function to
its code can lead to the code of another form while two processes write it. Here the name of a
file *is* what is in it: a digest of the sources the function reads (its module and all it imports
from its own package and from `geometry`), of the types of its arguments, the processor, the options
and the versions of the compiler. There is no index to swap, a file is written whole or not at all,
and a damaged one is compiled anew. Where a source was edited after the program had started, what
runs is not what it says: such code is neither kept nor taken. Processes that need the same form at
the same time wait for the one that compiles it.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import logging
import os
import pickle
import secrets
import stat
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite
import numba
from filelock import FileLock, Timeout
from numba.core import bytecode, config, event
from numba.core.caching import CompileResultCacheImpl, NullCache
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

from geometry.compilation.clocks import CLOCKS
from geometry.compilation.started import STARTED
from geometry.machine.system import release

_LOG = logging.getLogger(__name__)

#: Switches of the compiler that change the code it makes.
_SWITCHES = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT")

_DIGEST_LENGTH = hashlib.sha256().digest_size

#: Longest wait for another process that compiles the same form [s]; then both compile it.
_LONGEST_WAIT = 120.0

#: Forms that this process compiles now, by file name.
_TURNS: dict[str, FileLock] = {}


class _Watch(event.Listener):  # type: ignore[misc]
    """Passes on when compilation starts and ends."""

    def on_start(self, _: Any) -> None:
        """Start the clocks."""
        for clock in CLOCKS:
            clock.start()

    def on_end(self, _: Any) -> None:
        """Stop them; where compilation fails, other processes wait no longer."""
        for clock in CLOCKS:
            clock.stop()
        if sys.exc_info()[0] is not None:
            for name in list(_TURNS):
                _end_turn(name)


event.register("numba:compile", _Watch())

# Numba counts the functions of a process, and the count is what tells the names of two closures of
# one factory apart. Code of two processes, loaded together, had one name for two functions: the
# linker took the first for both, without a word (https://github.com/numba/numba/issues/10486).
bytecode.FunctionIdentity._unique_ids = iter(lambda: secrets.randbits(64), None)


class KernelCache(NullCache):  # type: ignore[misc]
    """Machine code of one function: one file for each form, found by its content."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._source = source_digest(function.__module__)
        self._options = repr(sorted(options.items()))
        top = self._name.partition(".")[0]
        self._beside = Path(function.__code__.co_filename).parent / "__pycache__"
        self._program = Path(sys.modules[top].__file__ or "").parent.parent
        # Programs that share a folder do not share files.
        self._place = _hex(str(self._beside))[:12]

    @property
    def cache_path(self) -> str:
        """The first folder that code may be kept in."""
        return str(self._folders()[0])

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled form for a signature, None where there is none that can be read."""
        # Numba would load all it compiles with, a quarter of a second; whoever compiles does so.
        rtsys.initialize(target_context)
        name = self._file_name(sig, target_context.codegen())
        if name is None:
            return None
        content = self._content(name)
        if content is None:
            _take_turn(self._folders(), name)
            content = self._content(name)
        if content is None:
            return None
        _end_turn(name)
        return CompileResultCacheImpl.rebuild(None, target_context, content)

    def _content(self, name: str) -> Any:
        folders = [*self._folders(), *self._temporary(create=False)]
        found = (_read(folder / name) for folder in folders)
        return next((content for content in found if content is not None), None)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled form in the first folder that can be written."""
        name = self._file_name(sig, data.codegen)
        if name is None:
            return
        if not data.library.has_dynamic_globals and not data.lifted:
            self._keep(name, data)
        _end_turn(name)

    def _keep(self, name: str, data: Any) -> None:
        content = dumps(CompileResultCacheImpl.reduce(None, data))
        folders = self._folders()
        folder = next((f for f in folders if _write(f / name, content)), None)
        if folder is None:
            temporary = self._temporary(create=True)
            folder = next((f for f in temporary if _write(f / name, content)), None)
        if folder is not None:
            self._remove_older(folder)
        if folder != folders[0]:
            _say_elsewhere(Path(config.CACHE_DIR) if config.CACHE_DIR else self._program, folder)

    def _file_name(self, sig: Any, codegen: Any) -> str | None:
        """Name of the file of a form; None for a form that has no lasting name."""
        types = str(sig)
        # A function as argument is named by its place in memory.
        if " at 0x" in types or not self._source:
            return None
        switches = [getattr(config, switch, None) for switch in _SWITCHES]
        versions = (numba.__version__, llvmlite.__version__, sys.version)
        form = repr((types, codegen.magic_tuple(), self._options, switches, versions))
        return f"{self._stem()}{self._source[:12]}-{_hex(self._source + form)[:24]}.kernel"

    def _stem(self) -> str:
        return self._name.replace("<", "").replace(">", "") + "-"

    def _folders(self) -> list[Path]:
        """Where code may be: the user's choice, beside the source, the user's cache."""
        folders = [Path(config.CACHE_DIR) / self._place] if config.CACHE_DIR else []
        folders.append(self._beside)
        own = Path(AppDirs("tubelock", appauthor=False).user_cache_dir)
        # An empty variable of the environment would mean the folder at hand.
        return [*folders, own / self._place] if own.is_absolute() else folders

    def _temporary(self, *, create: bool) -> list[Path]:
        folder = _private_temporary(create=create)
        return [folder / self._place] if folder else []

    def _remove_older(self, folder: Path) -> None:
        """Remove code made from other sources: nothing will ask for it again."""
        for file in folder.glob(f"{self._stem()}*.kernel"):
            if not file.name.startswith(f"{self._stem()}{self._source[:12]}-"):
                with contextlib.suppress(OSError):
                    file.unlink()


@functools.cache
def source_digest(module: str) -> str:
    """Digest of the sources a module is made of: its own and those of what it imports.

    Imports are followed within the package of the module and `geometry`, inside functions too.
    Empty where a source was edited since the program started.
    """
    packages = {module.partition(".")[0], "geometry"}
    digests: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        file = _source_file(name) if name.partition(".")[0] in packages else None
        if file is not None and name not in digests:
            if file.stat().st_mtime > STARTED:
                return ""
            digests[name], imported = _read_source(file, name)
            waiting += imported
    return _hex(repr(sorted(digests.items())))


def _source_file(module: str) -> Path | None:
    top, *below = module.split(".")
    package = sys.modules.get(top)
    if package is None:
        return None
    if not hasattr(package, "__path__"):
        return Path(package.__file__) if package.__file__ and not below else None
    path = Path(next(iter(package.__path__))).joinpath(*below)
    for file in (path / "__init__.py", path.with_suffix(".py")):
        if file.is_file():
            return file
    return None


@functools.cache
def _read_source(file: Path, module: str) -> tuple[str, list[str]]:
    """Digest of a file and the names it imports: modules, and what may be modules of a package."""
    text = file.read_bytes()
    names: list[str] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = module.split(".")
            if node.level:  # a package counts itself as the first level
                up = node.level - (file.name == "__init__.py")
                above = above[: len(above) - up]
            start = ".".join([*above * bool(node.level), *filter(None, [node.module])])
            names += [start, *(f"{start}.{alias.name}" for alias in node.names)]
    return hashlib.sha256(text).hexdigest(), names


def _read(file: Path) -> Any:
    """Content of a file that this module wrote; None where there is none or it is damaged."""
    try:
        data = file.read_bytes()
    except OSError:
        return None
    digest, content = data[:_DIGEST_LENGTH], data[_DIGEST_LENGTH:]
    if hashlib.sha256(content).digest() != digest:
        return None
    return pickle.loads(content)


def _write(file: Path, content: bytes) -> bool:
    """Write a file all at once; whether that was possible."""
    unique = file.with_name(f"{file.name}.{os.getpid()}.{os.urandom(4).hex()}")
    try:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        unique.write_bytes(hashlib.sha256(content).digest() + content)
        unique.replace(file)
    except OSError:
        with contextlib.suppress(OSError):
            unique.unlink()
        return False
    return True


def _take_turn(folders: list[Path], name: str) -> None:
    """Wait until no other process compiles a form; nobody waits where no file can be written."""
    for folder in folders if name not in _TURNS else []:
        lock = FileLock(folder / f"{name}.lock")
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            lock.acquire(timeout=_LONGEST_WAIT)
        except Timeout:
            return
        except OSError:
            continue
        _TURNS[name] = lock
        return


def _end_turn(name: str) -> None:
    lock = _TURNS.pop(name, None)
    if lock is not None:
        release(lock)  # who waits for it finds the code


def _private_temporary(*, create: bool) -> Path | None:
    """A temporary folder that nobody else can put code into; None where there is none."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"tubelock-kernels-{user}"
    try:
        if create:
            folder.mkdir(mode=0o700, exist_ok=True)
        state = folder.lstat()
    except OSError:
        return None
    mine = not hasattr(os, "getuid") or (state.st_uid == user and not state.st_mode & 0o022)
    return folder if mine and stat.S_ISDIR(state.st_mode) else None


_said: list[str] = []


def _say_elsewhere(first: Path, folder: Path | None) -> None:
    """Print once in a run where the compiled code is stored."""
    if not _said:
        where = f"compiled code is kept in {folder.parent}" if folder else "every run compiles anew"
        _said.append(f"{first} cannot be written: {where} (NUMBA_CACHE_DIR names another folder)")
        _LOG.warning("%s", _said[0])


def _hex(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
