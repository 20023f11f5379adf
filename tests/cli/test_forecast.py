"""Work that takes long says how long, once, from its own pace."""

import pytest

from validation.output import console
from validation.output.console import WINDOW, WINDOWS, Forecast, duration_words

pytestmark = pytest.mark.quick


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test turns."""
    now = [0.0]
    monkeypatch.setattr(console.time, "perf_counter", lambda: now[0])
    return now


def test_the_rest_takes_what_the_best_pace_says(clock) -> None:
    """One part a second, a minute of compilation in between: 3 h for the rest."""
    told, said = Forecast(), []
    for done in range(1, 101):
        clock[0] += 61.0 if done == 4 else 1.0
        said.append(told.left(done, 10808))
    assert [words for words in said if words is not None] == ["3 h"], "said once"
    assert said.index("3 h") < 4 * WINDOWS * WINDOW


def test_short_work_says_nothing(clock) -> None:
    told = Forecast()
    for done in range(500):
        clock[0] += 1.0
        assert told.left(done, 500) is None


@pytest.mark.parametrize(
    ("seconds", "words"), [(90, "90 s"), (150, "2.5 min"), (2e4, "5.6 h"), (1e9, "32 years")]
)
def test_durations_have_the_unit_that_one_would_choose(seconds: float, words: str) -> None:
    assert duration_words(seconds) == words
