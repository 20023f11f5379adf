"""Which keys of a scene an answer used: sections tell what is read of them while a method runs.

One mechanism in place of a list of cases: a key that is set and was not read cannot have changed
the answer. It is named, in words and in the data.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args, get_origin

from pydantic import BaseModel

#: A key by the class of its section and its name there.
_Key = tuple[type, str]
_READ: ContextVar[set[_Key] | None] = ContextVar("keys that are read", default=None)


class Recorded(BaseModel):
    """A section that tells, while `recording` is on, which of its values are read."""

    read_at_the_door: ClassVar[bool] = False
    """Whether reading the scene itself uses all its keys, before any method runs."""

    if not TYPE_CHECKING:  # a type checker would take every name for a value

        def __getattribute__(self, name: str) -> Any:
            read = _READ.get()
            if read is not None and not name.startswith("_"):
                kind = type(self)
                if name in kind.model_fields:
                    read.add((kind, name))
            return super().__getattribute__(name)

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """Return plain data; what is in it counts as read."""
        data = super().model_dump(**options)
        for name in data:
            getattr(self, name)
        return data


@dataclass
class KeyUse:
    """Keys of a scene that were read."""

    scene: BaseModel
    """The scene as it was given."""
    _read: set[_Key] = field(default_factory=set)

    @property
    def unused(self) -> tuple[str, ...]:
        """Keys that were set and not read, as ``section.key``, in the order of the scene."""
        return tuple(dict.fromkeys(self._unread(self.scene, "")))

    def _unread(self, section: BaseModel, place: str) -> Iterator[str]:
        kind = type(section)
        if isinstance(section, Recorded) and section.read_at_the_door:
            return
        values = section.__dict__
        for name in kind.model_fields:
            if name not in section.model_fields_set:
                continue
            inner = list(_sections(values[name]))
            for key, part in inner:
                yield from self._unread(part, f"{place}{name}{key}.")
            idle = not inner and (kind, name) not in self._read
            if idle and not _nothing(values[name]) and not _single(kind, name):
                yield f"{place}{name}"

    @property
    def defaults(self) -> dict[str, str]:
        """Defaults that the result depends on, in words, by section."""
        result = {}
        for name in type(self.scene).model_fields:
            section = self.scene.__dict__[name]
            if not isinstance(section, Recorded) or section.read_at_the_door:
                continue
            words = getattr(section, "words", "")
            if (
                name not in self.scene.model_fields_set
                and words
                and any((type(section), key) in self._read for key in type(section).model_fields)
            ):
                result[name] = words
        return result

    def count(self, section: BaseModel, besides: tuple[str, ...] = ()) -> None:
        """Count all keys of a section as read, besides some."""
        kind = type(section)
        self._read.update((kind, name) for name in kind.model_fields if name not in besides)

    @property
    def words(self) -> str:
        """Keys that were not read, whole sections as such; nothing where all were."""
        return unused_words(self.unused, self.scene)


def unused_words(unused: tuple[str, ...], scene: BaseModel) -> str:
    """Keys of a scene in words, sections of which all are meant as such."""
    given = KeyUse(scene).unused
    said = []
    for key in unused:
        section = key.partition(".")[0]
        mine = [k for k in unused if k.startswith(f"{section}.")]
        whole = len(mine) > 1 and len(mine) == sum(k.startswith(f"{section}.") for k in given)
        said.append(f"[{section}]" if whole else key)
    return ", ".join(dict.fromkeys(said))


def _sections(value: Any) -> Iterator[tuple[str, BaseModel]]:
    """Sections that a value is made of and how their keys go on; none for a plain value."""
    if isinstance(value, BaseModel):
        yield "", value
    elif isinstance(value, Mapping):
        for key, part in value.items():
            if isinstance(part, BaseModel):
                yield f".{key}", part
    elif isinstance(value, tuple | list):
        for part in value:
            if isinstance(part, BaseModel):
                yield "", part


def _nothing(value: Any) -> bool:
    """Whether a value states nothing: absent, off or empty."""
    return value is None or value is False or (isinstance(value, tuple | dict) and not value)


def _single(kind: type[BaseModel], name: str) -> bool:
    """Whether a key has one value that it can have: the name of what a section is."""
    annotation = kind.model_fields[name].annotation
    return get_origin(annotation) is Literal and len(get_args(annotation)) == 1


@contextmanager
def uncounted(*keys: _Key) -> Iterator[None]:
    """Do not count what is read of some keys inside: what is made there has them, the answer not.

    A key is the class of its section and its name there.
    """
    outer = _READ.get()
    if outer is None:
        yield
        return
    read: set[_Key] = set()
    token = _READ.set(read)
    try:
        yield
    finally:
        _READ.reset(token)
        outer |= read - set(keys)


@contextmanager
def unrecorded() -> Iterator[None]:
    """Record nothing of what is read inside: sections check and copy themselves."""
    token = _READ.set(None)
    try:
        yield
    finally:
        _READ.reset(token)


def count(section: BaseModel, *names: str) -> None:
    """Count keys as read: what was made of them before, uncounted, matters here."""
    read = _READ.get()
    if read is not None:
        read |= {(type(section), name) for name in names}


@contextmanager
def recording(scene: BaseModel) -> Iterator[KeyUse]:
    """Record what is read of a scene's sections, of its copies too, while a method runs."""
    use = KeyUse(scene)
    token = _READ.set(use._read)
    try:
        yield use
    finally:
        _READ.reset(token)
        outer = _READ.get()
        if outer is not None:
            outer |= use._read
