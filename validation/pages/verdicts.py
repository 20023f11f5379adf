"""What a reader asks first of an assembly, answered from its rigid and deformable answers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from fem.accuracy.errors import Accuracy
from fem.answer.measures import large_motion
from fem.element.material import Material
from geometry.answer import (
    FACTORS,
    Answer,
    Measure,
    least_factor,
    measure_rows,
)
from geometry.parts.rows import Row
from mbd import MechanismClass
from mbd.results.rows import OF_RIGID_BLOCKS

#: Whether an answer is good news, bad news, neither, or good on a condition, as pages colour it.
GOOD, BAD, OPEN, CAUTION = "true", "false", "open", "caution"
#: Answers to whether blocks are locked; other classes have a motion.
_LOCKED = {
    MechanismClass.LOCKED: "yes: no motion exists",
    MechanismClass.UNDECIDED: "not decided",
}
#: Measures of the summary, of deformable and of rigid blocks.
_SHOWN = ("p_max_point", "sigma_1_averaged", "max_displacement")
_SHOWN_RIGID = ("p_max_facet", "largest_joint_force")
#: Key of a scene that each load factor needs, and a value to begin with [MPa].
_STRENGTHS = {
    "cracking_factor": ("tensile_strength", 3),
    "crushing_factor": ("compressive_strength", 30),
}


@dataclass(frozen=True)
class PageVerdict:
    """A question and its answer."""

    question: str
    words: str
    """The answer in short."""
    tone: str = OPEN
    """`GOOD`, `BAD`, `OPEN` or `CAUTION`."""
    lines: tuple[str, ...] = ()
    """What stands below it."""


def verdicts(
    rigid: Answer | None, fem: Answer | None, failed: Mapping[str, str]
) -> list[PageVerdict]:
    """Answer the questions of a reader; ``failed`` says why an answer is missing, by its kind."""
    result = [] if rigid is None else [_locked(rigid), _carried(rigid)]
    answer = fem if fem is not None else rigid
    assert answer is not None
    if answer.problem.blocks.detection is not None:
        result.reverse()  # of masonry the first question is whether it stands
    if "rigid" in failed:
        result.append(PageVerdict("Rigid blocks?", "no answer", OPEN, (failed["rigid"],)))
    if "fem" in failed:
        result.append(PageVerdict("Deformable blocks?", "no answer", BAD, (failed["fem"],)))
    result.append(_how_much(rigid, fem))
    result.append(_how_sure(fem))
    materials = answer.problem.materials
    result += [
        strength_verdict(materials, answer.measures, computed=fem is not None),
        castable(answer),
    ]
    return result


def _locked(rigid: Answer) -> PageVerdict:
    """Say whether a mechanism exists."""
    found = rigid.details.classification
    words, lines = _LOCKED.get(found.mechanism, "no: a motion exists"), list[str]()
    supported = rigid.details.supported_classification
    if supported is not found:
        words = _LOCKED.get(supported.mechanism, "no: a motion exists")
        lines.append(f"With the supports of this load: {words}.")
    tone = GOOD if found.mechanism is MechanismClass.LOCKED else OPEN
    return PageVerdict("Is it locked?", words, tone, tuple(lines))


def _carried(rigid: Answer) -> PageVerdict:
    """Say whether rigid blocks carry the load, and up to which limit."""
    result, lines = rigid.details, [f"load: {rigid.case.load_words}"]
    lines += _lines(rigid.rows["verdict"])
    words, tone = ("yes", GOOD) if result.holds else ("no", BAD)
    verdict = result.verdict
    if verdict.holds is None:
        words, tone = "not decided", OPEN
    elif verdict.condition:
        words, tone = f"yes,{verdict.condition}", CAUTION if verdict.squeezed else OPEN
    if rigid.case.combinations:
        lines.append(
            "That is the load without factors. Combinations have their own verdicts below."
        )
    return PageVerdict("Does it carry the load?", words, tone, tuple(lines))


def _lines(rows: Iterable[Row]) -> list[str]:
    """Rows of an answer, a line each."""
    return [f"{row.title}: {row.words}" for row in rows]


def _measures(answer: Answer, names: tuple[str, ...]) -> list[str]:
    """Some measures in words, a line each."""
    return _lines(measure_rows({n: answer.measures[n] for n in names if n in answer.measures}))


def _how_much(rigid: Answer | None, fem: Answer | None) -> PageVerdict:
    """State the largest pressure, tension and displacement, and where they are."""
    lines = [] if fem is None else _measures(fem, _SHOWN)
    of_rigid = [] if rigid is None else _measures(rigid, _SHOWN_RIGID)
    lines += [f"Rigid blocks, {line}" for line in of_rigid]
    nothing_acts = rigid is not None and rigid.details.holds
    why_none = "nothing acts" if nothing_acts else "the load is not carried"
    words = lines.pop(0) if lines else f"no forces: {why_none}"
    return PageVerdict("Where and how much?", words, OPEN, tuple(lines))


def _how_sure(fem: Answer | None) -> PageVerdict:
    """State error bars, or what the rigid answer rests on."""
    if fem is None:
        plain = (
            "Forces between rigid blocks are not unique: those of least norm are shown.",
            "Pressures are means over facets: they depend on the facet size.",
        )
        return PageVerdict("How sure is it?", "rigid blocks have no error bars", OPEN, plain)
    measures, accuracy, lines = fem.measures, fem.parts.get("accuracy"), list[str]()
    if isinstance(accuracy, Accuracy):
        lines = _lines(accuracy.rows)
    lines += _lines(measure_rows({n: m for n, m in measures.items() if not m.is_number}))
    if large_motion(fem.details) is not None:
        lines.append("Motions are large, but counted as small: see the table.")
    if not any(measure.error is not None for measure in measures.values()):
        why = "the scene sets one mesh without an estimate"
        if isinstance(accuracy, Accuracy):
            why = f"the refinement was ended by {accuracy.ended_by}"
        words, tone = f"no error bars: {why}", BAD
    else:
        named = [measures[name] for name in _SHOWN if name in measures]
        sure = sum(measure.is_number for measure in named)
        words = f"{sure} of the {len(named)} numbers above are resolved"
        if sure == len(named):
            worst = max((m.error or 0.0) / abs(m.value) for m in named if m.value)
            words = f"all numbers above are uncertain by at most {100 * worst:.2g} %"
        tone = GOOD if sure == len(named) else OPEN
    return PageVerdict("How sure is it?", words, tone, tuple(lines))


def strength_verdict(
    materials: Sequence[Material], measures: Mapping[str, Measure], *, computed: bool
) -> PageVerdict:
    """State the load factors at cracking and crushing, or the keys that they need."""
    lines, factors = [], [name for name in FACTORS if name in measures]
    rigid = "" if computed else f" ({OF_RIGID_BLOCKS})"
    for line in _lines(measure_rows({name: measures[name] for name in factors})):
        lines.append(f"{line}{rigid}")
    sure = all(measures[name].is_number for name in factors)
    least = min((least_factor(measures[name]) for name in factors), default=0.0)
    known = [measures[name].value for name in factors if measures[name].is_number]
    tone = GOOD if sure and least >= 1.0 else OPEN
    tone = BAD if any(value < 1.0 for value in known) else tone
    for name, (key, value) in _STRENGTHS.items():
        if name in factors:
            continue
        if any(getattr(material, key) is not None for material in materials):
            why = "only static deformable blocks have it" if not computed else "not computed"
            lines.append(f"{FACTORS[name].words}: {why}")
            continue
        lines.append(
            f"{FACTORS[name].words}: needs material.{key} [MPa]; add it to the scene, or "
            f"--set material.{key}={value}"
        )
    if not factors:
        return PageVerdict("When does it fail first?", "not computed", OPEN, tuple(lines))
    words = lines.pop(0)
    return PageVerdict("When does it fail first?", words, tone, tuple(lines))


def castable(answer: Answer) -> PageVerdict:
    """Say whether walls and joints keep the limits of the scene, with what is built."""
    lines = _lines(answer.parts["dimensions"].rows)
    limits = answer.case.limits
    exceeded = [line for line in lines if "TOO " in line]
    if limits.least_wall is None and limits.steepest_joint is None:
        words = "not checked: set limits.least_wall [mm] and limits.steepest_joint [degrees]"
        return PageVerdict("Can it be cast?", words, OPEN, tuple(lines))
    if exceeded:
        others = tuple(line for line in lines if line not in exceeded)
        return PageVerdict("Can it be cast?", f"no: {'; '.join(exceeded)}", BAD, others)
    return PageVerdict("Can it be cast?", "yes, within the limits of the scene", GOOD, tuple(lines))
