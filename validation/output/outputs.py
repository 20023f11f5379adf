"""What one call writes and where: stated at once, checked together, before any work is done."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from validation.errors import InputError
from validation.output.console import following, process_words, text_console
from validation.output.files import (
    PAGES,
    Provenance,
    output_folder,
    prepare_file,
    remove_others,
    stamp_vtu,
    stamped,
    write_json,
)

if TYPE_CHECKING:
    from rich.console import Console

    from geometry.parts.rows import RowTable
    from validation.case import Case

#: Endings of files that are written only if asked for: arrays, and fields for ParaView.
LARGE = (".npz", ".vtu")


@dataclass
class Outputs:
    """Outputs of one call; as a context manager, it rejects and prepares before the work.

    No output may be a file that the call reads, nor another output of the same call: either would
    be replaced without a word. If the work fails, folders that are still empty are taken away.
    """

    json: str | None = None
    """Target of the data: a file, ``-`` for standard output, None for nowhere."""
    folder: Path | None = None
    """Folder of fields and pictures; None: none are written."""
    names: tuple[str, ...] = ()
    """Names of all files that may be written into `folder`; ``*`` stands for anything."""
    files: Mapping[str, Path | None] = field(default_factory=dict)
    """Single files by the option that names them."""
    stores: Mapping[str, Path] = field(default_factory=dict)
    """Files of results, which are read and added to, by the option that names them."""
    reads: tuple[Path, ...] = ()
    """Files that the call reads, beside those of its scene."""
    case: Case | None = None
    """What the call is about; what is written names it."""
    fields: bool = False
    """Whether fields for ParaView and arrays, which are large, are written too."""
    exit_line: bool = True
    """Whether CPU time and memory are printed at the end; not where the text is a file by itself.
    """
    _of_this_call: set[str] = field(default_factory=set, repr=False)
    _unused: tuple[str, ...] | None = field(default=None, repr=False)
    _defaults: dict[str, str] = field(default_factory=dict, repr=False)
    _open: ExitStack = field(default_factory=ExitStack, repr=False)

    @cached_property
    def origin(self) -> Provenance:
        """Origin that every file states."""
        return Provenance(self.case)

    @cached_property
    def console(self) -> Console:
        """Text for people."""
        return text_console(self.json)

    def __enter__(self) -> Self:
        """Reject outputs that would replace something this call needs, and make folders."""
        named = list(self._named())
        self._refuse_inputs(named)
        self._refuse_twice(named)
        with ExitStack() as made:
            for option, path in named:
                if option in self.stores and path.exists():
                    continue  # who opens it says more than whether it can be written
                made.enter_context(output_folder(path.parent))
                prepare_file(path)
            made.enter_context(output_folder(self.folder))
            if self._draws:
                from validation.output.pictures.gallery import showing

                made.enter_context(showing(None if self.case is None else self.case.pictures))
            self._open = made.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.__exit__(kind, error, trace)
        keeps_rows = self.stores or any(name.endswith(".jsonl") for name in self.names)
        if isinstance(error, KeyboardInterrupt) and not error.args and keeps_rows:
            error.args = ("finished rows are kept; run the same command to go on",)
        if self.exit_line and kind is None:
            self.console.print(f"{'process':9} {process_words()}")

    def _named(self) -> Iterator[tuple[str, Path]]:
        if self.json is not None and self.json != "-":
            yield "--json", Path(self.json)
        yield from self.stores.items()
        for option, path in self.files.items():
            if path is not None:
                yield option, path

    def _refuse_inputs(self, named: list[tuple[str, Path]]) -> None:
        for source in (*self.reads, *(() if self.case is None else self.case.reads)):
            for option, path in named:
                if _same(path, source):
                    raise InputError(
                        f"{option} {path}: is a file that this call reads, and it would be "
                        "replaced; choose another name"
                    )
            if self._in_folder(source):
                raise InputError(
                    f"-o {self.folder}: {source.name} in it is a file that this call reads, and it "
                    "would be replaced; choose another folder"
                )

    def _refuse_twice(self, named: list[tuple[str, Path]]) -> None:
        for number, (option, path) in enumerate(named):
            for other, second in named[number + 1 :]:
                if _same(path, second):
                    raise InputError(
                        f"{option} and {other} both name {path}; the second would replace the "
                        "first: choose two names"
                    )
            if self._in_folder(path):
                raise InputError(
                    f"{option} {path}: a file of that name is written into -o {self.folder} as "
                    "well; choose another name"
                )

    def _in_folder(self, path: Path) -> bool:
        """Whether a path is one of the files that go into the folder."""
        if self.folder is None or not _same(path.parent, self.folder):
            return False
        return any(fnmatchcase(path.name, name) for name in self.names)

    @property
    def _draws(self) -> bool:
        """Whether pictures are among what is written."""
        single = [path.name for path in self.files.values() if path is not None]
        names = single if self.folder is None else [*single, *self.names]
        return any(Path(name).suffix.lower() in (".png", *PAGES) for name in names)

    def path(self, name: str) -> Path:
        """Path of a file that this call writes into the folder; the name is one of `names`."""
        assert self.folder is not None
        assert name in self.names or any(fnmatchcase(name, k) for k in self.names), name
        self._of_this_call.add(name)
        return self.folder / name

    def say(self, words: str, path: Path) -> None:
        """Print what was written where."""
        self.console.print(f"{words:9} {path}")

    def show(self, table: RowTable) -> None:
        """Print a table."""
        self.console.print(str(table), soft_wrap=True)

    def write(self, words: str, name: str, write: Callable[[Path], object]) -> None:
        """Let ``write`` make a file of the folder and say so; nothing without a folder.

        Nor of fields and arrays that are not asked for.
        """
        if self.folder is not None and (self.fields or Path(name).suffix not in LARGE):
            path = self.path(name)
            with following(f"{words} {name}"):
                write(path)
            if path.suffix == ".vtu":
                stamp_vtu(path, self.origin)
            self.say(words, path)

    def remove_others(self) -> None:
        """Remove what an earlier call left under a name that this one may write, and did not."""
        if self.folder is not None:
            remove_others(self.folder, self.names, self._of_this_call)

    def tell_keys(self, method: str = "", *, answered: bool = False) -> None:
        """Print the defaults that an answer depends on, and what its method does not have.

        ``method`` is that of the case, or "static deck", "explicit deck" and "blocks"; ``answered``
        is whether the table of an answer has them already, but for pictures that are not drawn.
        """
        if self.case is None:
            return
        use = self.case.key_use(method, drawn=self._draws)
        self._unused, self._defaults = tuple(use.idle), use.defaults
        known = self.case.key_use(method).words.items() if answered else ()
        for head, words in use.words.items():
            if (head, words) not in known:
                self.console.print(f"{head:9} {words}")

    def write_json(self, data: Any) -> None:
        """Write the data where ``--json`` says, with the version of its keys and its origin."""
        if self.json is not None:
            write_json(self.json, self._stamped(data))

    def write_data(self, words: str, name: str, data: Any) -> None:
        """Write the data into the folder, too."""
        self.write(words, name, lambda path: write_json(str(path), self._stamped(data)))

    def _stamped(self, data: Any) -> dict[str, Any]:
        """Data with the version of its keys, unused keys, defaults and origin."""
        defaults = {"defaults": self._defaults} if self._defaults else {}
        return stamped(data, self.origin, self._unused) | defaults


def _same(a: Path, b: Path) -> bool:
    """Whether two paths name one file, whether or not it is there yet."""
    try:
        return os.path.samefile(a, b)
    except (OSError, ValueError):
        # Links to themselves have no end to be followed to, and some names no file in this locale.
        with contextlib.suppress(UnicodeEncodeError):
            return os.path.realpath(a) == os.path.realpath(b)
        return False
