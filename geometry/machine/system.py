"""What differs between operating systems: memory, CPU time of other processes, signals, locks.

Windows has no `resource`, no timer of CPU time, no blocked signals and no SIGKILL; nothing here
is used before the system is asked for it.
"""

from __future__ import annotations

import math
import os
import secrets
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from filelock import BaseFileLock

#: Signal that ends a process at once: SIGKILL; on Windows SIGTERM, which does so there.
KILL: signal.Signals = getattr(signal, "SIGKILL", signal.SIGTERM)
#: Numbers of what `mallopt` sets: free memory that goes back, and arrays that do so one by one.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3


# ---------------------------------------------------------------------------------------------
# Threads, memory and CPU time


@contextmanager
def one_thread_of_blas() -> Iterator[None]:
    """Linear algebra inside on one thread, and afterwards on as many as before.

    Blocks are small dense problems, on which more threads wait: 12 layers of TSB1 take 13 CPU s
    with one thread, 97 with two.
    """
    import scipy.linalg  # noqa: F401 - its library of linear algebra is another than numpy's
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield


def keep_freed_memory() -> None:
    """Let the C library keep 64 MiB that were freed for what is asked for next, if it is glibc.

    Arrays of megabytes come and go: pages that the system takes back it has to clear anew, a tenth
    of the CPU time of a static run.
    """
    if sys.platform == "linux":
        import ctypes

        set_option = getattr(ctypes.CDLL(None), "mallopt", None)
        for option, size in ((_TRIM_THRESHOLD, 64), (_MMAP_THRESHOLD, 32)):
            if set_option is not None:
                set_option(option, size << 20)


def machine_memory() -> int:
    """Memory of the machine [bytes]."""
    if hasattr(os, "sysconf"):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    import psutil

    return int(psutil.virtual_memory().total)


def address_space_left() -> float:
    """Addresses that a limit of this process leaves [bytes]; without end where none is known."""
    try:
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        pages = Path("/proc/self/statm").read_text("ascii").split()[0]
    except (ImportError, OSError):
        return math.inf
    if limit == resource.RLIM_INFINITY:
        return math.inf
    return float(limit - int(pages) * os.sysconf("SC_PAGE_SIZE"))


def peak_memory_mb() -> float:
    """Peak resident memory of this process so far [MB].

    Where the system does not record the peak: the resident memory now.
    """
    try:
        import resource
    except ImportError:
        import psutil

        now = psutil.Process().memory_info()
        return float(getattr(now, "peak_wset", now.rss)) / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def children_cpu_seconds() -> float:
    """CPU time of the processes that this one has started and waited for [s].

    Not a number on Windows, which does not record it.
    """
    times = os.times()
    return math.nan if os.name == "nt" else times.children_user + times.children_system


# ---------------------------------------------------------------------------------------------
# Signals


@contextmanager
def cpu_limit(seconds: float, message: str) -> Iterator[None]:
    """Raise TimeoutError with the message in what takes more CPU time.

    Only the main thread is stopped, and only where the system has a timer of CPU time.
    """
    main = threading.current_thread() is threading.main_thread()
    if not main or not hasattr(signal, "setitimer") or not hasattr(signal, "SIGVTALRM"):
        yield
        return

    def stop(*_: object) -> None:
        raise TimeoutError(message)

    previous = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, previous)


@contextmanager
def stop_signals(
    handler: Callable[[int, FrameType | None], object],
    numbers: Sequence[signal.Signals] = (signal.SIGINT, signal.SIGTERM),
) -> Iterator[None]:
    """Call the handler on some signals; only the main thread can catch them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = [signal.signal(number, handler) for number in numbers]
    try:
        yield
    finally:
        for number, before in zip(numbers, previous, strict=True):
            signal.signal(number, before)


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Let processes started here inherit a blocked Ctrl-C.

    Where signals cannot be blocked they are ignored meanwhile, which processes inherit as well (not
    on Windows); only the main thread can do so.
    """
    if not hasattr(signal, "pthread_sigmask"):
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, handler)
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def interrupt() -> None:
    """Interrupt this process as Ctrl-C does."""
    if os.name == "nt":
        signal.raise_signal(signal.SIGINT)  # os.kill ends a process there
    else:
        os.kill(os.getpid(), signal.SIGINT)


def available_cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


# ---------------------------------------------------------------------------------------------
# Files


def release(lock: BaseFileLock) -> None:
    """Release a lock and delete its file.

    Windows deletes no open file; there filelock deletes it after the release.
    """
    with suppress(PermissionError):
        Path(lock.lock_file).unlink(missing_ok=True)
    lock.release()


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a temporary sibling with the same suffix, then rename it to ``path``.

    Its name is new and nobody can foresee it: calls that write the same file at once each publish a
    whole one, and no link that lies there leads elsewhere.
    """
    partial = path.with_name(f".partial-{secrets.token_hex(8)}{path.suffix}")
    os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        write(partial)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
