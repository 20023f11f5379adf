"""Rows that results of rigid blocks share, with hexahedral and triangulated blocks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.table import Table

from geometry.answer import FACTORS, Measure
from geometry.assembly import AnyBlocks
from mbd import Classification, Mechanism, MechanismClass, SelfStress
from mbd.force_range import ForceRanges
from validation.output.balance import add_reactions
from validation.output.section_forces import add_sections
from validation.run.rigid.answer import RigidAnswer
from validation.run.rigid.further import Further

#: Components below this part of the largest are round-off.
_NOISE = 1e-9
#: What a load factor of rigid blocks is.
OF_RIGID_BLOCKS = "by mean pressures of facets of rigid blocks, without peaks"
#: Each kinematic class in words.
CLASS_WORDS = {
    MechanismClass.LOCKED: "locked: no mechanism exists",
    MechanismClass.SUPPRESSED: "suppressed: a mechanism exists, the load acts against it",
    MechanismClass.NEUTRAL: "neutral: a mechanism exists, the load does no work on it",
    MechanismClass.ACTIVATED: "activated: a mechanism exists, and the load drives it",
    MechanismClass.UNDECIDED: "undecided: no proof of locking or of a mechanism within tolerance",
}


def certificate_words(classification: Classification) -> str:
    """Describe the proof of the kinematic class, with its numbers."""
    certificate = classification.certificate
    if isinstance(certificate, SelfStress):
        return (
            f"self-stress state λ ≥ 1, equilibrium error ‖Gλ‖/‖λ‖ = {certificate.residual:.1e}, "
            f"σ_min/σ_max = {certificate.smallest_singular_value:.1e}"
        )
    if isinstance(certificate, Mechanism):
        return (
            f"mechanism δq, smallest gap rate min Gᵀδq = {certificate.smallest_gap_rate:.1e}, "
            f"work fᵀδq/‖f‖ = {certificate.work:.3g}"
        )
    return "none"


def held_words(run: RigidAnswer) -> str:
    """Name the axes along which the assembly resists a small push beside the load, and how."""
    held, by_load = run.held or {}, run.held_by_load
    down = "held down by its weight" if run.weighs_alone else "held by its load"
    words = []
    for title, axes in (
        ("resists pushes along", [way for way in held if held[way] and way not in by_load]),
        (f"{down} against pushes along", list(by_load)),
        ("slides freely along", [way for way in held if not held[way]]),
    ):
        if axes:
            words.append(f"{title} {', '.join(axes)}")
    return "; ".join(words) + " (all blocks together, frictionless)"


def add_verdict(table: Table, run: RigidAnswer, titles: tuple[str, str], words: str) -> None:
    """Add what was asked first: the verdict with friction, else that of the class.

    Two titles of the class: where it is the verdict, and where it is not.
    """
    further = run.further
    if further is None or further.friction is None:
        table.add_row(titles[0], words)
        return
    table.add_row("verdict", run.carried.words)
    if further.bare is not None:
        table.add_row("edges and corners would add", edges_words(further))
    proof = ""
    if further.friction.mechanism is not None:
        proof = f"; fᵀd/‖f‖ = {further.friction.work:.3g}, least contact work "
        proof += f"{further.friction.smallest_contact_work:.1e}"
    table.add_row("with friction", further.friction.status + proof)
    table.add_row(titles[1], words)


def edges_words(further: Further) -> str:
    """What contacts would add that have no area and lie at the border of faces."""
    bare, friction = further.bare, further.friction
    assert bare is not None
    assert friction is not None
    words = "nothing to the verdict"
    if bare.holds is not friction.holds:
        words = "the load would be carried" if bare.holds else "not certain"
    if bare.factor is not None and further.collapse is not None:
        words += f"; limit load factor {bare.factor:.6g} for {further.collapse.factor:.6g}"
    return f"{words} ({bare.n_contacts} contacts without area, left out: a chamfer removes them)"


def add_first_rows(table: Table, run: RigidAnswer) -> None:
    """Add the main results: equilibrium, largest pressure, forces, reaction."""
    if run.further is None or run.further.friction is None:
        table.add_row("in equilibrium", run.result.equilibrium.status)
    _add_limits(table, run.further)
    result = run.answer.measures
    if "p_max_facet" in result:
        table.add_row("largest contact pressure", pressure_words(result["p_max_facet"]))
    if "crushing_factor" in result:
        words = f"{result['crushing_factor'].value_words}, {OF_RIGID_BLOCKS}"
        table.add_row(FACTORS["crushing_factor"].words, words)
    if "least_joint_force" in result:
        table.add_row("normal forces of joints", joint_force_words(result, run.assembly))
    if "total_reaction" in result:
        table.add_row("total reaction", reaction_words(result, run.answer.report["reaction"]))
        add_reactions(table, run.answer.report)
    add_sections(table, run.sections)
    if run.scene.sections and run.sections is None:
        table.add_row("sections", "none: no forces of the load")
    if run.carried.holds and not run.carried.by_load:
        table.add_row("forces", "none of the load alone: they follow from what presses before")


def reaction_words(found: Mapping[str, Measure], force: list[float]) -> str:
    """Sum of the forces of fixed blocks; nothing where the load balances itself to round-off."""
    size = max(found[n].value for n in ("total_reaction", "largest_joint_force") if n in found)
    parts = [0.0 if abs(x) <= _NOISE * size else x for x in force]
    if not any(parts):
        return "0 N: the loads are self-equilibrated"
    return f"{found['total_reaction'].value_words}: ({', '.join(f'{x:.5g}' for x in parts)})"


def pressure_words(peak: Measure) -> str:
    """Value of a mean over a facet, how large that is, and where."""
    if peak.place is None:
        return peak.value_words
    area = f"mean over a facet of {peak.place['facet_area']:.4g} mm²"
    return f"{peak.value_words}, {area}: {peak.place_words}"


def joint_force_words(found: Mapping[str, Measure], assembly: AnyBlocks) -> str:
    """Least and largest normal force between two blocks, and which blocks."""
    parts = []
    for word, name in (("least", "least_joint_force"), ("largest", "largest_joint_force")):
        where = found[name].place or {}
        joint = "–".join(map(assembly.named, where["blocks"]))
        parts.append(f"{word} {found[name].value_words} (joint {joint})")
    return ", ".join(parts)


def ring_words(ring: dict[str, Any]) -> str:
    """Mean hoop stress of a closed ring, with a remark on dry joints."""
    words = f"{ring['value']:.5g} MPa, mean hoop {ring['sense']} of a closed ring, "
    words += f"r = {ring['radius']:g} mm"
    if ring["sense"] == "tension":
        words += "; dry joints carry no tension: waves and end rings do"
    return words


def range_words(ranges: ForceRanges) -> str:
    """Count the joints whose forces are statically indeterminate, and name the widest range."""
    wide, unbounded = int(ranges.undetermined.sum()), int(ranges.unbounded.sum())
    of = f"of {len(ranges.least)} joints"
    if ranges.unanswered:
        return (
            f"not decided (limit of work) in {ranges.unanswered} {of}; of the others {wide} are "
            f"statically indeterminate, {unbounded} of them unbounded (self-stress)"
        )
    if wide == 0:
        return f"statically determinate {of}: every admissible state has the same forces"
    bound = f", {unbounded} of them unbounded (self-stress)" if unbounded else ""
    k = int(np.argmax(np.where(ranges.unbounded, -1.0, ranges.width)))
    if unbounded == len(ranges.least):
        k = int(ranges.least.argmax())
    pair = f"blocks {ranges.block_m[k]} and {ranges.block_s[k]}"
    most = "unbounded" if ranges.unbounded[k] else f"{ranges.largest[k]:.4g} N"
    return (
        f"statically indeterminate in {wide} {of}{bound}; between {pair}: minimum "
        f"{ranges.least[k]:.4g} N, minimum-norm {ranges.shown[k]:.4g} N, maximum {most}"
    )


def _add_limits(table: Table, further: Further | None) -> None:
    """Add the loads at which the assembly collapses."""
    if further is None:
        return
    if further.collapse is not None:
        c = further.collapse
        proof = ""
        if c.mechanism is not None:
            proof = f"; kinematic upper bound {c.upper_bound:.6g}, residual {c.residual:.1e}"
        table.add_row("limit load", c.status + proof)
    if further.sliding is not None:
        table.add_row("non-associated limit load", further.sliding.status)


def add_further_rows(table: Table, further: Further | None) -> None:
    """Add the ranges of joint forces and the margin, where the scene requests them."""
    if further is None:
        return
    if further.ranges is not None:
        table.add_row("joint forces", range_words(further.ranges))
    if further.margin is not None:
        m = further.margin
        block = int(further.free_blocks[m.block])
        of = m.areas.size
        if m.unasked:
            words = f"not decided (limit of work): {of - m.unasked} of {of} unit loads were asked; "
            words += f"the worst of them: {m.load} on block {block}, {m.bearing_area:.4g} mm²"
            table.add_row("margin", words)
            return
        table.add_row(
            "margin",
            f"smallest bearing area {m.bearing_area:.4g} mm² (unit load {m.load} on block {block})"
            if m.interlocked
            else f"none: unit load {m.load} on block {block} is not statically admissible",
        )
