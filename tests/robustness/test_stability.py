"""The hard cases: none is red; the suite itself tells a broken law from one that holds."""

from __future__ import annotations

import pytest

from tests.support.commands import answered
from validation.stability.case import CaseVerdict, case_verdict, rejected
from validation.stability.report import run_case
from validation.stability.suite import cases, chosen
from validation.statement import Statement

#: Of every subject one or two that take less than half a CPU second.
QUICK = [
    "amplitude-too-large",
    "checkpoint-truncated",
    "cone-inside-1e-9",
    "corner-on-face",
    "dice-on-a-facet",
    "edge-on-face",
    "inverted-element",
    "mechanism-driven",
    "parallel-normals",
    "rank-deficient",
    "thickness-2",
    "time-step-1.01",
    "zero-load-explicit",
    "zero-load-rigid",
    "zero-load-static",
]
#: Those of which `make test` has one of the kind: a kill in `tests/study`, and energy over 100 000
#: steps in `tests/fem/test_central_difference.py`.
THOROUGH = ("killed", "steps-1e6")
#: Cases whose honest answer is a refusal; all others are green.
REFUSED = {
    "amplitude-too-large",
    "checkpoint-truncated",
    "cone-outside-1e-5",
    "contacts-lost",
    "frame-incomplete",
    "inverted-element",
    "load-1e9-static",
    "mechanism-driven",
    "mechanism-driven-explicit",
    "mechanism-driven-static",
    "overclosure-1-mm",
    "strain-1e4-static",
    "time-step-1.01",
    "time-step-1.01-forced",
    "turning-normals",
    "units-metre-scene",
}


def marks(case: Statement) -> list[pytest.MarkDecorator]:
    """How the tests of a case are chosen."""
    if case.name in THOROUGH:
        return [pytest.mark.thorough]
    return [pytest.mark.quick] if case.name in QUICK else [pytest.mark.slow] if case.slow else []


def test_named_cases_exist() -> None:
    assert {*QUICK, *REFUSED, *THOROUGH} <= {case.name for case in cases()}


@pytest.mark.parametrize("case", [pytest.param(c, id=c.name, marks=marks(c)) for c in cases()])
def test_hard_case_holds_or_is_refused(case: Statement) -> None:
    # Each law and the derivation of its bounds stand beside the case.
    outcome = run_case(case)
    expected = "refused" if case.name in REFUSED else "green"
    assert outcome["verdict"] == expected, outcome["proof"]
    assert outcome["proof"]


def test_at_least_thirty_distinct_cases() -> None:
    names = [case.name for case in cases()]
    assert len(set(names)) == len(names) >= 30


@pytest.mark.parametrize(
    ("numbers", "message", "kind"),
    [
        ([("a", 1.0, 2.0)], None, "green"),
        ([("a", 3.0, 2.0)], None, "red"),
        ([("a", 3.0, ">=", 2.0), ("b", 1, "==", 1)], None, "green"),
        ([("a", 3.0, ">=", 2.0), ("b", 1, "==", 0)], None, "red"),
        ([("a", float("nan"), 2.0)], None, "red"),
        ([], None, "red"),
        ([("a", 3.0, 2.0)], "no", "red"),
        ([], "no", "refused"),
    ],
)
def test_verdicts_follow_from_the_numbers(numbers, message, kind) -> None:
    assert case_verdict(*numbers, message=message).kind == kind


def test_a_failure_or_a_missing_refusal_is_red() -> None:
    def broken() -> CaseVerdict:
        raise KeyError("lost")

    outcome = run_case(Statement("x", {"subject": "y", "law": "z"}, broken))
    assert outcome["verdict"] == "red"
    assert "lost" in outcome["proof"]
    assert rejected(lambda: None, ValueError).kind == "red"
    assert rejected(lambda: int("x"), ValueError, "absent words").kind == "red"
    assert rejected(lambda: int("x"), ValueError, "invalid literal").kind == "refused"


def test_command_writes_what_it_prints() -> None:
    data, out = answered("stability", "--only", "layers-1")
    assert data["counts"] == {"green": 1, "refused": 0, "red": 0}
    assert data["cases"][0]["name"] == "layers-1"
    assert "layers-1" in out


def test_the_list_is_written_where_json_is_asked() -> None:
    listed = answered("stability", "--list", "--only", "contact-law")[0]["cases"]
    assert [case["name"] for case in listed] == [case.name for case in chosen(["contact-law"])]
    assert all(case["law"] for case in listed)
