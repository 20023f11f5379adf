"""Answers under each combination of loads, and the envelope over them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from geometry.answer import Answer, Measure, least_factor, title_of
from geometry.parts.rows import RowTable
from mbd.options import Rigid
from validation.case import Case
from validation.errors import InputError
from validation.output.answer_files import answer_of_data
from validation.output.console import listing
from validation.output.files import write_csv
from validation.study.run import answered
from validation.study.study import CaseStudy, Quantity


def combination_cases(file: Case) -> dict[str, Case]:
    """Return a scene under each of its combinations, by their names."""
    if not file.combinations:
        raise InputError(
            f"{file.name}: combinations: got none; expected sections such as [combinations.NAME] "
            "with factors: weight = 1.35, load = 1.5"
        )
    return {name: file.combined(name) for name in file.combinations}


def combination_answers(
    file: Case,
    cases: Mapping[str, Case],
    store: Path,
    tell: Callable[[str], None] | None = None,
    failed: dict[str, str] | None = None,
) -> dict[str, Answer]:
    """Answers to cases of a scene, such as its combinations, by its method, without their fields.

    The store, a file of rows, keeps them; ``tell`` is called with a line after each that is new.
    ``failed`` takes why a case has no answer; None: every case needs one.
    """
    kind: Quantity = "rigid" if isinstance(file.method, Rigid) else "fem"
    named = (("combination", tuple(cases)),)
    study = CaseStudy(file.name, kind, named, cases=tuple(cases.values()))
    rows = answered(study, store, tell, every=failed is None)
    if failed is not None:
        failed |= {row["combination"]: row["message"] for row in rows if row["status"] == "failed"}
    ok = (row for row in rows if row["status"] == "ok")
    return {row["combination"]: answer_of_data(row["answer"]) for row in ok}


def envelope(answers: Mapping[str, Answer]) -> dict[str, tuple[str, Measure]]:
    """Combination that governs each measure, and its value.

    That is the largest size, of load factors and of the least force of a joint the least.
    """
    names = dict.fromkeys(name for answer in answers.values() for name in answer.measures)
    result = {}
    for measure in names:
        having = {name: a.measures[measure] for name, a in answers.items() if measure in a.measures}
        if title_of(measure).least:
            governing = min(having, key=lambda name: least_factor(having[name]))
        else:
            governing = max(having, key=lambda name: abs(having[name].value))
        result[measure] = governing, having[governing]
    return result


def combinations_json(answers: Mapping[str, Answer]) -> dict[str, Any]:
    """Answers and envelope as plain data."""
    return {
        "combinations": {name: answer.as_dict() for name, answer in answers.items()},
        "envelope": {
            measure: {"combination": name, **result.as_json()}
            for measure, (name, result) in envelope(answers).items()
        },
    }


def print_combinations(file: Case, answers: Mapping[str, Answer], console: Console) -> None:
    """Print verdict and measures under each combination, which governs, and what is built."""
    table = listing(f"{file.name}: load combinations", "", numbers=(*answers, "governing"))
    for row in combination_rows(answers):
        table.add_row(*row)
    console.print(table)
    first = next(iter(answers.values()))
    console.print(RowTable("what is built", first.rows["model"]))


def combination_rows(answers: Mapping[str, Answer]) -> Iterator[list[str]]:
    """Title and words of each verdict and measure by combination, and which one governs these."""
    verdicts = [answer.rows["verdict"] for answer in answers.values()]
    for title in dict.fromkeys(row.title for rows in verdicts for row in rows):
        said = ["; ".join(row.words for row in rows if row.title == title) for rows in verdicts]
        yield [title, *(words or "–" for words in said), ""]
    for measure, (governing, _) in envelope(answers).items():
        values = [
            a.measures[measure].value_words if measure in a.measures else "–"
            for a in answers.values()
        ]
        yield [title_of(measure).words, *values, governing]


def write_combinations(answers: Mapping[str, Answer], path: Path) -> None:
    """Write value and error bar of each measure under each combination as CSV; dimensions too."""
    rows: list[tuple[Any, ...]] = [
        (name, measure, result.value, result.error, result.unit)
        for name, answer in answers.items()
        for measure, result in answer.measures.items()
    ]
    for name, answer in answers.items():
        dimensions = answer.report["dimensions"]
        rows += [
            (name, key, dimensions[key], None, unit)
            for key, unit in dimensions["units"].items()
            if not isinstance(dimensions[key], dict)
        ]
    write_csv(path, ("combination", "measure", "value", "error", "unit"), rows)
