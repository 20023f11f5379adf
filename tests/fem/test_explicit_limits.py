"""Limits of an explicit run: of work, at the same step on every machine, and of memory."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fem import Explicit, solve_explicit
from geometry.machine.work import SECONDS, LimitError, Operation
from tests.support.commands import command, set_words
from validation import load_case

pytestmark = pytest.mark.quick

METHOD = Explicit(damping="none", ramp_time=1e-4, end_time=1e-3, sample_interval=10)


@pytest.fixture(name="problem", scope="module")
def _problem():
    return load_case("column").problem


def test_a_run_ends_at_the_first_sample_whose_work_reaches_the_limit(tmp_path, problem):
    """The work of a step is elements and points times what each costs; cut at half of it the run
    goes on to the bits of the whole."""
    whole = solve_explicit(problem, METHOD)
    steps, work = whole.report["n_steps"], whole.report["work"]["done"]
    elements = whole.details.run.stated.n_elements
    assert work > SECONDS[Operation.STEP] * elements * steps
    kept = tmp_path / "run.npz"
    half = solve_explicit(problem, replace(METHOD, max_work=0.5 * work), checkpoint=kept)
    assert half.report["status"] == "stopped"
    assert half.report["work"]["stopped_by"] == "work"
    # Steps cost alike; every tenth one is a sample.
    assert 0.0 <= half.report["work"]["done"] - 0.5 * work < 11.0 * work / steps
    resumed = solve_explicit(problem, METHOD, resume=kept)
    assert resumed.report["n_steps"] == steps
    for a, b in zip(resumed.details.displacements, whole.details.displacements, strict=True):
        assert np.array_equal(a, b)


def test_what_needs_more_memory_is_not_started(problem):
    told = []
    with pytest.raises(LimitError, match=r"GB of memory, and the limit is .* GB") as refused:
        solve_explicit(problem, replace(METHOD, max_memory=1e-6), progress=told.append)
    assert refused.value.by == "memory"
    assert not any(hasattr(each, "step") for each in told)


def test_the_command_ends_at_its_limit_of_work_with_a_checkpoint(tmp_path):
    settings = {"fem": "{method = 'explicit', end_time = 1e-3, ramp_time = 1e-4}"}
    sets = set_words(settings)
    written = tmp_path / "answer.json"
    status, out, printed = command(
        *("fem", "column", *sets, "--max-work", "1e-9", "--json", str(written)),
        *("--output", str(tmp_path / "out")),
    )
    assert status == 3, out + printed
    assert json.loads(written.read_text("utf-8"))["work"]["stopped_by"] == "work"
    assert list((tmp_path / "out").glob("*.npz"))
