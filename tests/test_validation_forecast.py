"""Work that takes long says how long, once, from its own pace."""

import pytest

from validation.output import forecast
from validation.output.forecast import LONG, MEASURED, Forecast, duration_words


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test turns."""
    now = [0.0]
    monkeypatch.setattr(forecast.time, "perf_counter", lambda: now[0])
    return now


def test_the_rest_takes_what_the_pace_says(clock) -> None:
    """One part a second after a first one that took a minute (compilation): 3 h for the rest."""
    told = Forecast()
    clock[0] = 60.0
    assert told.left(1, 10804) is None
    clock[0] += 0.5 * MEASURED
    assert told.left(1 + 0.5 * MEASURED, 10804) is None, "too early to know"
    clock[0] = 63.0
    assert told.left(4, 10804) == "3 h"
    clock[0] = 100.0
    assert told.left(41, 10804) is None, "said once"


def test_short_work_says_nothing(clock) -> None:
    told = Forecast()
    assert told.left(0, 10) is None
    clock[0] = 2.0 * MEASURED
    assert told.left(10 * clock[0] / (clock[0] + 0.9 * LONG), 10) is None


@pytest.mark.parametrize(
    ("seconds", "words"), [(90, "90 s"), (150, "2.5 min"), (2e4, "5.6 h"), (1e9, "32 years")]
)
def test_durations_have_the_unit_that_one_would_choose(seconds: float, words: str) -> None:
    assert duration_words(seconds) == words
