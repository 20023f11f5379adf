"""Work of a run, counted in operations: the same on every machine; and its CPU time.

Parts that cost count their operations, by formulas in sizes and in iterations done. `SECONDS` says
what each takes on the reference machine; limits are sums of them, in reference seconds. A limit of
CPU time is read from the clock of this process instead. Stages are timed without compilation.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Literal, NamedTuple, NoReturn, TypeAlias

from geometry.errors import RefusedError
from geometry.machine.system import machine_memory
from geometry.parts.rows import Row


class Operation(StrEnum):
    """What is counted."""

    DENSE = "dense"
    """Multiplications of dense factorisations and products of matrices."""
    SPARSE = "sparse"
    """Multiplications of sparse factorisations."""
    ENTRY = "entry"
    """Entries of matrices that meet a vector."""
    ELEMENT = "element"
    """Entries of element matrices and stresses that are integrated, times points."""
    POINT = "point"
    """Contact points at which gaps are found, times nodes of both facets."""
    SEARCH = "search"
    """Contact points whose facet is searched."""
    CALL = "call"
    """Linear problems of a block, whatever its size."""
    STEP = "step"
    """Elements in a time step of an explicit run."""
    TOUCH = "touch"
    """Contact points in such a step, counted by what they cost: one each on paired facets."""
    SIMPLEX = "simplex"
    """Iterations of the simplex method times entries of the matrix."""
    CONIC = "conic"
    """Iterations of the interior-point method times entries of the matrix."""


#: Seconds of an operation on the reference machine, one thread: by `python -m
#: tests.benchmarks.work --fit`, once and on purpose.
SECONDS = {
    Operation.DENSE: 2.9e-11,
    Operation.SPARSE: 2.8e-10,
    Operation.ENTRY: 7.3e-10,
    Operation.ELEMENT: 5.2e-10,
    Operation.POINT: 1.6e-7,
    Operation.SEARCH: 1.0e-6,
    Operation.CALL: 1.7e-3,
    Operation.STEP: 6.1e-8,
    Operation.TOUCH: 1.3e-8,
    Operation.SIMPLEX: 3.1e-9,
    Operation.CONIC: 6.1e-8,
}
#: Power of the unknowns of a block with which operations grow on finer meshes of solids. From mesh
#: to mesh that of dense ones is 0.9 to 2: they are of volumes, of faces and of iterations.
GROWTH = {
    Operation.DENSE: 5.0 / 3.0,
    Operation.SPARSE: 2.0,
    Operation.ENTRY: 4.0 / 3.0,
    Operation.ELEMENT: 1.0,
    Operation.POINT: 2.0 / 3.0,
    Operation.SEARCH: 2.0 / 3.0,
    Operation.CALL: 0.0,
    Operation.STEP: 4.0 / 3.0,
    Operation.TOUCH: 1.0,
    Operation.SIMPLEX: 2.0,
    Operation.CONIC: 2.0,
}


#: Part of the machine's memory that one computation may need.
_SHARE = 0.8


#: What may stop a run within.
Stop: TypeAlias = Literal["work", "clock", "memory"]
#: Limits in words.
LIMITS: Mapping[str, str] = {
    "work": "the limit of work",
    "clock": "the limit of CPU time",
    "memory": "the limit of memory",
    "interrupt": "an interrupt",
}


class LimitError(RefusedError):
    """A limit is reached: what was begun has no answer."""

    of_input = False

    def __init__(self, by: Stop, words: str = "") -> None:
        remedy = "expected a coarser mesh, fewer blocks or a higher limit"
        super().__init__(words or f"no state within {LIMITS[by]}; {remedy}")
        self.by = by
        """Which limit."""

    def __reduce__(self) -> tuple[type[LimitError], tuple[Stop, str]]:
        """Make the same again, in another process."""
        return LimitError, (self.by, str(self))


class Allowance(NamedTuple):
    """What is left."""

    work: float
    """Reference seconds."""
    seconds: float
    """CPU time [s]."""


@dataclass
class Budget:
    """What may be spent, and what was."""

    work: float | None = None
    """Reference seconds at most; None: no limit."""
    ends: float = math.inf
    """CPU time of this process at which it is stopped [s]."""
    memory: float | None = None
    """Memory of one computation at most [GB]."""
    outer: Budget | None = None
    """Which this one is part of."""
    done: dict[Operation, float] = field(default_factory=dict)
    """Operations by kind."""
    seconds: float = 0.0
    """All of them in reference seconds."""
    bytes: float = 0.0
    """Largest matrices that were held at once."""
    stopped_by: str | None = None
    """Which limit, or an interrupt, left something undone; None: none."""

    @property
    def left(self) -> Allowance:
        """What is left of it."""
        work = math.inf if self.work is None else self.work - self.seconds
        seconds = self.ends - time.process_time() if self.ends < math.inf else math.inf
        return Allowance(work, seconds)

    @property
    def rows(self) -> list[Row]:
        """Which limit left something undone, where one did."""
        if self.stopped_by != "work" or self.work is None:
            return []
        words = f"{self.seconds:.3g} of {self.work:g} s on the reference machine"
        return [Row("work", words, self.seconds, "s", "evidence")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "done": self.seconds,
            "limit": self.work,
            "max_memory": self.memory,
            "stopped_by": self.stopped_by,
        }

    def grown(self, ratio: float) -> float:
        """Reference seconds of the same on a mesh with ``ratio`` times the unknowns."""
        return sum(n * SECONDS[kind] * ratio ** GROWTH[kind] for kind, n in self.done.items())

    def bytes_grown(self, ratio: float) -> float:
        """Matrices of the same on a mesh with ``ratio`` times the unknowns [bytes]."""
        return self.bytes * ratio ** GROWTH[Operation.ENTRY]

    def add(self, kind: Operation, amount: float) -> None:
        """Count operations.

        Raises
        ------
        LimitError
            A limit is reached.
        """
        self.done[kind] = self.done.get(kind, 0.0) + amount
        self.seconds += amount * SECONDS[kind]
        if self.outer is not None:
            self.outer.add(kind, amount)
        if self.work is not None and self.seconds > self.work:
            self._stop("work")
        if self.ends < math.inf and self.left.seconds < 0.0:
            self._stop("clock")

    def _stop(self, by: Stop) -> NoReturn:
        self.mark(by)
        raise LimitError(by)

    def mark(self, by: str) -> None:
        """Say that a limit left something undone, here and in what this one is part of."""
        self.stopped_by = by
        if self.outer is not None:
            self.outer.mark(by)


_BUDGET: ContextVar[Budget | None] = ContextVar("budget", default=None)


def _chain() -> Iterator[Budget]:
    """The present budget and those that it is part of."""
    current = _BUDGET.get()
    while current is not None:
        yield current
        current = current.outer


@contextmanager
def budget(
    work: float | None = None, ends: float = math.inf, memory: float | None = None
) -> Iterator[Budget]:
    """Count what is done within, and limit it: see `Budget`."""
    result = Budget(work, ends, memory, _BUDGET.get())
    token = _BUDGET.set(result)
    try:
        yield result
    finally:
        _BUDGET.reset(token)


@contextmanager
def unlimited() -> Iterator[None]:
    """Count what is done within, whatever the limits of time: what a finished answer still needs.

    Limits of memory stay: what goes beyond them is not started.
    """
    memories = [own.memory for own in _chain() if own.memory is not None]
    free = Budget(memory=min(memories, default=None))
    token = _BUDGET.set(free)
    try:
        yield
    finally:
        _BUDGET.reset(token)
        for own in _chain():
            own.seconds += free.seconds
            for kind, amount in free.done.items():
                own.done[kind] = own.done.get(kind, 0.0) + amount


def count(kind: Operation, amount: float) -> None:
    """Count operations of a kind where someone asks for them; raises `LimitError` at a limit."""
    current = _BUDGET.get()
    if current is not None:
        current.add(kind, amount)


def count_elimination(inner: int, around: int, *, symmetric: bool = True) -> None:
    """Count the elimination of so many unknowns of a dense matrix from those around them."""
    n, m = float(inner), float(around)
    half = n * (n**2 / 3.0 + n * m + m**2) / 2.0
    count(Operation.DENSE, half if symmetric else 2.0 * half)


def clock(seconds: float | None) -> float:
    """CPU time of this process in so many seconds; without end for None."""
    return math.inf if seconds is None else time.process_time() + seconds


def allowance() -> Allowance:
    """What is left of all budgets; without end where there is none."""
    left = [own.left for own in _chain()]
    work = min((one.work for one in left), default=math.inf)
    return Allowance(work, min((one.seconds for one in left), default=math.inf))


def stop(by: str) -> str:
    """Say that a limit left something undone; returns it in words."""
    limit, current = None, _BUDGET.get()
    if current is not None:
        current.mark(by)
    for own in _chain():
        limit = own.work or limit
    return f"{LIMITS[by]}, {limit:g} s on the reference machine" if by == "work" else LIMITS[by]


def hold_memory(size: float) -> None:
    """Say how many bytes the matrices of one computation take."""
    for own in _chain():
        own.bytes = max(own.bytes, size)


def memory_limit() -> float:
    """Bytes that one computation may take: as limited, and at most a part of the machine's."""
    limits = [2.0**30 * own.memory for own in _chain() if own.memory is not None]
    return min([_SHARE * machine_memory(), *limits])


def require_memory(what: str, need: float, remedy: str) -> None:
    """Reject what needs so many bytes, where that is beyond the limit.

    Raises
    ------
    LimitError
        As `beyond_memory`.
    """
    words = beyond_memory(what, need, remedy)
    if words is not None:
        stop("memory")
        raise LimitError("memory", words)


def beyond_memory(what: str, need: float, remedy: str) -> str | None:
    """One line on what needs so many bytes, where that is beyond the limit; else None."""
    limit = memory_limit()
    if need <= limit:
        return None
    size, there = need / 2**30, machine_memory()
    has = f"the limit is {limit / 2**30:.3g} GB (max_memory)"
    if limit >= _SHARE * there:
        has = f"this machine has {there / 2**30:.0f} GB"
    least = f"{size:.0f}" if 100.0 <= size < 1e6 else f"{size:.3g}"
    return f"{what} need about {least} GB of memory, and {has}; take {remedy}"


# ---------------------------------------------------------------------------------------------
# CPU time of what runs, without what is compiled, once a machine


class Compiling:
    """Counts the CPU time that functions are compiled in, and tells when the first one is."""

    def __init__(self, tell: Callable[[], None] | None) -> None:
        self.cpu_seconds = 0.0
        self._tell = tell
        self._depth = 0  # a function is compiled with those it calls
        self._start = 0.0

    def start(self) -> None:
        """Start the clock at the outermost function."""
        if self._tell is not None:
            self._tell()
            self._tell = None
        if self._depth == 0:
            self._start = time.process_time()
        self._depth += 1

    def stop(self) -> None:
        """Stop it there."""
        self._depth -= 1
        if self._depth == 0:
            self.cpu_seconds += time.process_time() - self._start


#: Those that count now. The compiler, once it is loaded, starts and stops them.
CLOCKS: list[Compiling] = []


@contextmanager
def compiling(tell: Callable[[], None] | None = None) -> Iterator[Compiling]:
    """Watch over what is compiled inside: work is timed without it, and people are told once.

    Parameters
    ----------
    tell
        Called before the first function is compiled; never where all are loaded.
    """
    clock = Compiling(tell)
    CLOCKS.append(clock)
    try:
        yield clock
    finally:
        CLOCKS.remove(clock)


class Stopwatch:
    """A stopwatch that stands still while functions are compiled."""

    def __init__(self, compiled: Compiling) -> None:
        self._compiled = compiled
        self._start = time.process_time()
        self._last = self._work()
        self._seconds: dict[str, float] = {}

    def _work(self) -> float:
        return time.process_time() - self._compiled.cpu_seconds

    def lap(self, name: str) -> None:
        """End a stage: what was worked since the one before is its time."""
        now = self._work()
        self._seconds[name] = self._seconds.get(name, 0.0) + now - self._last
        self._last = now

    def seconds(self) -> dict[str, float]:
        """CPU time of each stage, of compilation if there was any, and of everything [s]."""
        compiled = self._compiled.cpu_seconds
        reported = {"compile": compiled} if compiled else {}
        return self._seconds | reported | {"total": time.process_time() - self._start}


@contextmanager
def timed_stages() -> Iterator[Stopwatch]:
    """Time the stages of what runs inside."""
    with compiling() as compiled:
        yield Stopwatch(compiled)


def summed(spent: dict[str, float], before: dict[str, float]) -> dict[str, float]:
    """Return the times of a run with those of work that was done for it before."""
    return spent | {name: spent.get(name, 0.0) + seconds for name, seconds in before.items()}
