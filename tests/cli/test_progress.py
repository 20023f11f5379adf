"""Runs that take long say what they are at and how long they take; short ones say nothing."""

from io import StringIO
from types import SimpleNamespace

import pytest

from tests.fixtures.commands import small_meshes
from tests.support.coarse_tubes import coarse
from tests.support.commands import set_words
from validation.output import console as progress
from validation.output.console import (
    WINDOW,
    WINDOWS,
    Following,
    Forecast,
    duration_words,
    explicit_progress,
    plain_console,
)

COARSE = coarse(2, 2)
TUBE = ("tsb1-pipe", *set_words(COARSE))


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test turns."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    return now


@pytest.fixture
def followed():
    """A run in a pipe, and what is printed of it."""
    return Following("arch", plain_console(printed := StringIO()), None), printed


@pytest.mark.quick
def test_the_rest_takes_what_the_best_pace_says(clock) -> None:
    """One part a second, a minute of compilation in between."""
    told = Forecast()
    for done in range(1, 101):
        clock[0] += 61.0 if done == 4 else max(1.0, WINDOW)
        left = told.left(done, 10808)
        assert (left is None) == (done <= WINDOWS)
        assert left is None or left == 10808 - done


@pytest.mark.quick
@pytest.mark.parametrize(
    ("seconds", "words"), [(90, "90 s"), (150, "2.5 min"), (2e4, "5.6 h"), (1e9, "32 years")]
)
def test_durations_have_the_unit_that_one_would_choose(seconds: float, words: str) -> None:
    assert duration_words(seconds) == words


@pytest.mark.quick
def test_lines_wait_until_the_run_is_long(followed) -> None:
    follow, printed = followed
    follow.line("mesh 1: u 0.1 mm")
    follow("mesh 2 of at most 6")
    assert not printed.getvalue()
    follow.tell()
    first, second = printed.getvalue().splitlines()
    assert first == "arch: mesh 1: u 0.1 mm"
    assert second.startswith("arch: mesh 2 of at most 6 … ")
    follow.line("mesh 2: u 0.11 mm")
    assert printed.getvalue().endswith("arch: mesh 2: u 0.11 mm\n")


@pytest.mark.quick
def test_explicit_runs_say_once_how_many_steps_they_take(followed, clock) -> None:
    follow, printed = followed
    show = explicit_progress(follow)
    for step in range(1, 2001, 50):
        clock[0] += WINDOW
        show(SimpleNamespace(time=1e-7 * (step - 1), step=step, n_steps=200_000, residual=None))
    follow.tell()
    line, _ = printed.getvalue().splitlines()
    assert line.startswith("arch: 200000 steps of 1e-07 s, about 33 min; Ctrl-C stops it")


@pytest.mark.usefixtures("undrawn")
def test_a_pipe_gets_plain_lines_of_long_runs_alone(tubelock, monkeypatch) -> None:
    # Nothing is timed: a run is long from its first moment, or never.
    for short, lines in ((1e9, 0), (0.0, 1)):
        monkeypatch.setattr(progress, "SHORT", short)
        with small_meshes(1, 2):
            status, _, err = tubelock("fem", *TUBE, "-o", "out")
        assert status == 0
        assert len([line for line in err.splitlines() if ": mesh 1: u " in line]) == lines
        assert all(text.isprintable() for text in err.splitlines())
    with small_meshes(1):
        assert tubelock("fem", *TUBE, "-o", "out", "--quiet")[2] == ""
