"""Tiny named problems, shared by the tests, and what a quick test may cost."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Iterator
from typing import Any

import pytest
from hypothesis import settings

from geometry import Assembly
from geometry.families.boxes import BrickStack
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.machine.work import compiling
from tests.fixtures.commands import small_meshes, undrawn
from tests.support.blocks import tsb
from tests.support.commands import command

#: CPU seconds that a test marked ``quick`` may take, not counting what is compiled; one that takes
#: longer is marked ``slow`` beside it.
QUICK = 2.0

# The same examples in every run, so that a red run is the change's fault; other examples:
# `pytest --hypothesis-profile=default`.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# Jobs in the background inherit that interruptions are ignored, as `nohup` and CI start them, and
# would pass it on to the commands that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def _no_progress() -> Iterator[None]:
    """No progress on standard error, however slow the machine: tests of it set their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("validation.output.console.SHORT", 1e9)  # waits have an end
        yield


def _cpu_seconds() -> float:
    """Of this process and of those that it waited for."""
    return sum(os.times()[:4])


_STARTED = pytest.StashKey[float]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--dearest", type=int, default=0, help="list so many tests by CPU time")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    item.stash[_STARTED] = _cpu_seconds()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """The last report of a test tells its CPU time, and the first line of its docstring."""
    report = yield
    if call.when == "teardown":
        words = getattr(getattr(item, "function", None), "__doc__", None) or ""
        law = (words.strip().splitlines() or [""])[0]
        spent = _cpu_seconds() - item.stash[_STARTED]
        report.user_properties = [*report.user_properties, ("cpu", spent), ("law", law)]
    return report


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """The dearest tests and what they protect; fixtures count for the test that asks first."""
    count = config.getoption("dearest")
    if not count:
        return
    rows = [
        (told["cpu"], report.nodeid, told["law"])
        for report in terminalreporter.stats.get("", ())
        if "cpu" in (told := dict(getattr(report, "user_properties", ())))
    ]
    terminalreporter.section(f"dearest tests, of {sum(row[0] for row in rows):.0f} CPU s in all")
    for spent, name, law in sorted(rows, reverse=True)[:count]:
        terminalreporter.write_line(f"{spent:5.1f}  {name}{law and ': '}{law}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Fail a quick test that is not, in `make check` (not in `make lowest`).

    No law depends on the speed of a machine: `make test` does not measure.
    """
    chosen = "quick" in str(item.config.option.markexpr) and "UNTIMED" not in os.environ
    marked = item.get_closest_marker("quick") is not None
    if not chosen or not marked or item.get_closest_marker("slow") is not None:
        return (yield)
    with compiling() as compiled:
        start = _cpu_seconds()
        result = yield
    spent = _cpu_seconds() - start - compiled.cpu_seconds
    if spent > QUICK:
        pytest.fail(f"took {spent:.1f} CPU s; a quick test takes {QUICK:g}: mark it slow")
    return result


@pytest.fixture(scope="session")
def small_tube() -> Assembly:
    """TSB1 with three layers, a coarse mesh."""
    return SineTube(tsb(), SineBlockDivisions(24, 3, 6), 3).build()


@pytest.fixture(scope="session")
def plain_ring() -> Assembly:
    """One free layer of four plain cylindrical bricks (amplitude 0)."""
    return SineTube(tsb(amplitude=0.0), SineBlockDivisions(12, 4, 4), 1).build()


@pytest.fixture(scope="session")
def two_bricks() -> Assembly:
    """Two bricks, one on the other, between fixed bricks."""
    return BrickStack((100.0, 60.0, 50.0), (4, 3, 2), columns=1, layers=2).build()


@pytest.fixture(name="undrawn")
def _undrawn() -> Iterator[None]:
    """Pictures of a command are empty files."""
    with undrawn():
        yield


@pytest.fixture(name="small_meshes")
def _small_meshes() -> Iterator[None]:
    """Refined answers take meshes of a few elements."""
    with small_meshes():
        yield


@pytest.fixture
def tubelock(monkeypatch, tmp_path) -> Callable[..., tuple[int, str, str]]:
    """Run the command in an empty folder: exit status, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    return command
