"""Running a study: on the cores of this machine or on a Dask cluster, a few designs ahead.

Runners take design numbers one after another and hand back rows as they come; they hold a
bounded number of designs at a time, so memory does not grow with the study. The parent writes.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from itertools import chain, islice
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any, Protocol

from geometry.machine.system import (
    available_cores,
    interrupt,
    interrupts_blocked,
    stop_signals,
)
from validation.errors import InputError
from validation.study.rowfile import StudyRows
from validation.study.study import DesignRow, Study

#: Most processes for each core.
_MOST_WORKERS = 16
#: Designs handed out ahead of the workers, for each worker.
_AHEAD = 3
_WORKER_DIED = (
    "the worker process died twice on this design (killed, or out of memory); "
    "try a coarser mesh or fewer workers, then --retry-failed"
)


def run_design(study: Study, number: int) -> DesignRow:
    """Compute one design, counted from 0; whatever goes wrong with it becomes its message."""
    rigid = study.quantity == "rigid"
    # Other threads of the process may be at work on other designs; fem may use several itself.
    clock = time.thread_time if rigid else time.process_time
    start = clock()
    failure, results, remarks = "", dict[str, Any](), list[str]()
    try:
        results, remarks = study.results(number)
    except Exception as error:
        words = " ".join(str(error).split()).removeprefix(f"{study.name}[{number}]: ")
        words = words.removeprefix(f"{study.name}: ")
        words = words or "no message"
        failure = words if isinstance(error, ValueError) else f"{type(error).__name__}: {words}"
    return DesignRow(
        number=number,
        status="failed" if failure else "ok",
        message=failure or "; ".join(remarks),
        parameters=study.design(number),
        results=results,
        cpu_seconds=clock() - start,
        worker=(os.getpid(), time.process_time()),
    )


def failed_row(study: Study, number: int, message: str) -> DesignRow:
    """Row of a design whose process did not live to report it."""
    return DesignRow(number, "failed", message, study.design(number), {}, 0.0)


class Runner(Protocol):
    """Computes designs somewhere."""

    def rows(self, numbers: Iterable[int]) -> Generator[DesignRow, None, None]:
        """Rows of the designs, in the order in which they are ready."""


@dataclass
class Tally:
    """What a sweep has done so far in this session."""

    computed: int = 0
    design_cpu_seconds: float = 0.0
    """CPU time inside the designs [s]."""
    _workers: dict[int, float] = field(default_factory=dict)

    def count(self, row: DesignRow) -> None:
        """Take in one row."""
        self.computed += 1
        self.design_cpu_seconds += row.cpu_seconds
        process, seconds = row.worker
        self._workers[process] = max(seconds, self._workers.get(process, 0.0))

    @property
    def worker_cpu_seconds(self) -> float:
        """CPU time of the worker processes, their start included [s]."""
        return sum(self._workers.values())

    @property
    def workers(self) -> int:
        """Processes that computed something."""
        return len(self._workers)


def sweep(
    results: StudyRows,
    runner: Runner,
    *,
    retry_failed: bool = False,
    on_row: Callable[[DesignRow], None] | None = None,
    numbers: Iterator[int] | None = None,
) -> Tally:
    """Compute the designs that the result file lacks, and write each row when it is there.

    ``numbers`` are the designs to compute, asked for one by one; None: all.
    """
    settled = {"ok"} if retry_failed else {"ok", "failed"}

    def missing(asked: Iterable[int]) -> Iterator[int]:
        return (number for number in asked if results.status.get(number) not in settled)

    tally, all_designs = Tally(), range(results.study.n_designs)
    if numbers is None and next(missing(all_designs), None) is None:
        return tally
    with results.alone():
        # Another process may have added rows before this one was alone.
        asked = missing(all_designs if numbers is None else numbers)
        with closing(runner.rows(asked)) as rows:
            for row in rows:
                results.add(row)
                tally.count(row)
                if on_row is not None:
                    on_row(row)
    return tally


def computed(
    results: StudyRows,
    runner: Runner,
    numbers: Iterable[int],
    on_row: Callable[[DesignRow], None] | None = None,
) -> list[dict[str, Any]]:
    """Rows of some designs, in their order; those that the result file lacks are computed."""
    numbers = list(numbers)
    sweep(results, runner, numbers=iter(numbers), on_row=on_row)
    by_number = {row["number"]: row for row in results.rows()}
    return [by_number[number] for number in numbers]


def answered(
    study: Study, store: Path, tell: Callable[[str], None] | None = None, *, every: bool = True
) -> list[dict[str, Any]]:
    """Rows of all designs of one parameter; ``every``: the first that fails ends the study.

    ``tell`` is called with words after each new row. A row that failed before is tried again.

    Raises
    ------
    InputError
        Why a design has no answer, where every one needs it.
    """
    results = StudyRows(store, study)

    def follow(row: DesignRow) -> None:
        if every and row.status == "failed":
            raise InputError(row.message)
        if tell is not None:
            (value,) = row.parameters.values()
            tell(f"{value}, {row.number + 1} of {study.n_designs}")

    sweep(results, runner_for(study), retry_failed=True, on_row=follow)
    return list(results.rows())


# ---------------------------------------------------------------------------------------------
# This machine


@contextmanager
def _main_left_out() -> Iterator[None]:
    """Let processes started here not import the calling script, of which designs need nothing.

    A script without a main guard would start its study again in every one of them.
    """
    main = vars(sys.modules["__main__"])
    before: dict[str, Any] = {n: main[n] for n in ("__spec__", "__file__") if n in main}
    main["__spec__"] = None
    main.pop("__file__", None)
    try:
        yield
    finally:
        main.update(before)


def _start_worker(stop: Event) -> None:
    """Leave Ctrl-C to the parent, and end when it asks to or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch() -> None:
        while parent is not None and parent.is_alive() and not stop.wait(0.5):
            pass
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class SerialRunner:
    """Computes designs in this process, one after another."""

    def __init__(self, study: Study) -> None:
        self.study = study

    def rows(self, numbers: Iterable[int]) -> Generator[DesignRow, None, None]:
        """Rows in the order of the numbers."""
        for number in numbers:
            yield run_design(self.study, number)


class LocalRunner:
    """Worker processes on this machine; a design that kills its worker is recorded as failed."""

    def __init__(self, study: Study, workers: int | None = None) -> None:
        """Take a study and a number of processes, one per core unless told; refuse absurd ones."""
        if workers is not None and workers < 1:
            raise InputError(f"--workers {workers}: expected at least 1")
        most = _MOST_WORKERS * available_cores()
        if workers is not None and workers > most:
            raise InputError(
                f"--workers {workers}: expected at most {most}, {_MOST_WORKERS} for each core; "
                "more only take memory"
            )
        self.study = study
        self.workers = available_cores() if workers is None else workers

    def rows(self, numbers: Iterable[int]) -> Generator[DesignRow, None, None]:
        """Rows in the order in which they are ready."""
        # SIGTERM would leave behind what the processes share: it is a Ctrl-C meanwhile.
        with stop_signals(lambda *_: interrupt(), [signal.SIGTERM]):
            yield from self._rows(iter(numbers))

    def _rows(self, numbers: Iterator[int]) -> Generator[DesignRow, None, None]:
        while (first := next(numbers, None)) is not None:
            window = _AHEAD * self.workers
            lost = yield from self._pool(chain([first], numbers), self.workers, window)
            # One of these killed its worker, or someone else did. One at a time tells which.
            suspects = iter(lost)
            while (first := next(suspects, None)) is not None:
                for number in (yield from self._pool(chain([first], suspects), 1, 1)):
                    yield failed_row(self.study, number, _WORKER_DIED)

    def _pool(
        self, numbers: Iterator[int], workers: int, window: int
    ) -> Generator[DesignRow, None, list[int]]:
        """Rows of one pool of processes; returns the designs in its hands if it broke."""
        context = multiprocessing.get_context("spawn")
        with interrupts_blocked():  # a helper process of the library starts here
            stop = context.Event()
        pool = ProcessPoolExecutor(
            workers, mp_context=context, initializer=_start_worker, initargs=(stop,)
        )
        pending: dict[Future[DesignRow], int] = {}
        try:
            with interrupts_blocked():  # processes start here and inherit it: ending them is ours
                self._submit(pool, pending, numbers, window)
            while pending:
                finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    row = future.result()
                    del pending[future]
                    yield row
                self._submit(pool, pending, numbers, window - len(pending))
        except BrokenProcessPool:
            return sorted(pending.values())
        except BaseException:
            stop.set()  # do not wait for designs that may take hours
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return []

    def _submit(
        self,
        pool: ProcessPoolExecutor,
        pending: dict[Future[DesignRow], int],
        numbers: Iterator[int],
        count: int,
    ) -> None:
        for number in islice(numbers, count):
            # Noted before it is handed over: a pool that breaks here loses nothing.
            placeholder: Future[DesignRow] = Future()
            pending[placeholder] = number
            with _main_left_out():
                future = pool.submit(run_design, self.study, number)
            del pending[placeholder]
            pending[future] = number


# ---------------------------------------------------------------------------------------------
# A Dask cluster


class DaskRunner:
    """An existing Dask cluster; Dask itself moves the designs of a lost worker to another."""

    def __init__(self, study: Study, address: str, *, timeout: float = 10.0) -> None:
        """Connect to a scheduler, such as ``tcp://10.0.0.1:8786``, within a time [s]."""
        try:
            from distributed import Client
            from distributed.comm import get_address_host_port
        except ImportError:
            raise InputError(
                "--scheduler needs the library distributed: pip install 'tubelock[dask]'"
            ) from None
        self.study = study
        self.address = address
        self._session = f"tubelock-{uuid.uuid4().hex[:12]}"
        try:
            get_address_host_port(address, strict=True)
        except ValueError:
            raise InputError(
                f"--scheduler {address}: expected an address such as tcp://10.0.0.1:8786"
            ) from None
        try:
            self._client: Any = Client(address, timeout=timeout, set_as_default=False)
        except OSError as error:
            raise InputError(
                f"--scheduler {address}: no Dask scheduler answers there within {timeout:g} s "
                f"({' '.join(str(error).split())[:120]}); start one with `dask scheduler` and "
                f"workers with `dask worker {address}`"
            ) from None
        try:
            self._client.wait_for_workers(1, timeout=timeout)
        except TimeoutError:
            self._client.close(timeout=2)
            raise InputError(
                f"--scheduler {address}: it has no workers; start some with `dask worker {address}`"
            ) from None

    def rows(self, numbers: Iterable[int]) -> Generator[DesignRow, None, None]:
        """Rows in the order in which they are ready."""
        from distributed import CancelledError, as_completed
        from distributed.comm import CommClosedError

        numbers = iter(numbers)
        try:
            threads = sum(self._client.nthreads().values())
            handed = self._submit(islice(numbers, _AHEAD * max(threads, 1)))
            ready = as_completed(list(handed), loop=self._client.loop)
            for future in ready:
                number = handed.pop(future)
                yield self._row(future, number)
                following = self._submit(islice(numbers, 1))
                handed |= following
                ready.update(list(following))
        except (CancelledError, CommClosedError, OSError):
            raise InputError(
                f"--scheduler {self.address}: the scheduler stopped answering; the rows written "
                "so far are safe: run the same command to go on"
            ) from None
        finally:
            self._client.close(timeout=2)

    def _submit(self, numbers: Iterable[int]) -> dict[Any, int]:
        return {
            self._client.submit(
                run_design, self.study, number, key=f"{self._session}-{number}", pure=False
            ): number
            for number in numbers
        }

    def _row(self, future: Any, number: int) -> DesignRow:
        from distributed import CancelledError, KilledWorker

        # A result that was lost with its worker is computed again; `result` waits for it.
        if future.status == "cancelled":
            raise CancelledError(future.key)
        try:
            row: DesignRow = future.result()
        except KilledWorker:
            return failed_row(self.study, number, _WORKER_DIED)
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"--scheduler {self.address}: a worker cannot run designs "
                f"({type(error).__name__}: {error}); install the same tubelock there"
            ) from None
        return row


def runner_for(study: Study, workers: int | None = 1, scheduler: str | None = None) -> Runner:
    """Where designs are computed: this process, several of this machine, or a Dask cluster.

    None: one process for each core. Rows are the same wherever they are computed.
    """
    if scheduler is not None:
        return DaskRunner(study, scheduler)
    return SerialRunner(study) if workers == 1 else LocalRunner(study, workers)
