"""What the program answered when the fixtures were stored, against what it answers now.

A difference is intended, and then the commit that makes it stores the new answer
(``python tests/fixtures/record.py --only GROUP/NAME``) and says why, or it is a defect. What takes
minutes is compared where ``TUBELOCK_FIXTURES=all`` is in the environment.
"""

from __future__ import annotations

import os
from dataclasses import replace

import pytest

from tests.fixtures.stock import TOLERANCE, Fixture, fixtures

_ALL = os.environ.get("TUBELOCK_FIXTURES") == "all"
_DEAR = pytest.mark.skipif(not _ALL, reason="takes minutes: TUBELOCK_FIXTURES=all compares it")


@pytest.mark.parametrize(
    "fixture",
    [
        pytest.param(f, id=f.title, marks=[pytest.mark.slow, *([_DEAR] if f.dear else [])])
        for f in fixtures()
    ],
)
def test_answer_is_the_stored_one(fixture: Fixture) -> None:
    """Floats to 1e-9 on the processor that stored them, to 1e-6 elsewhere (solvers stop at 1e-8);
    digests on that processor alone; measures of explicit states to 1e-9 everywhere."""
    assert fixture.stored is not None, f"{fixture.title} is not stored: see record.py"
    found = fixture.compare()
    assert not found, "\n".join(f"{path}: {old} -> {new}" for path, old, new in found[:20])


def test_a_changed_answer_is_noticed() -> None:
    """Other numbers, words, lengths and keys are differences; round-off is none."""
    (fixture,) = (f for f in fixtures() if f.title == "rigid/tsb1-pipe")
    measures = fixture.stored["answer"]["measures"]

    def paths(**changed: object) -> list[str]:
        answer = {**fixture.stored["answer"], **changed}
        other = replace(fixture, ask=lambda: {**fixture.stored, "answer": answer})
        return [path for path, _, _ in other.compare(TOLERANCE)]

    largest = measures["p_max"]["value"]
    assert paths() == []

    def changed(by: float) -> list[str]:
        other = measures["p_max"] | {"value": largest * (1 + by)}
        return paths(measures=measures | {"p_max": other})

    assert changed(1e-11) == []
    assert changed(1e-8) == ["answer.measures.p_max.value"]
    assert paths(mechanism="activated") == ["answer.mechanism"]
    assert paths(unused_keys=[]) == ["answer.unused_keys.length"]
    assert paths(more=1) == ["answer.more"]
