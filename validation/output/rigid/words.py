"""Words that rigid answers share, whatever their blocks are made of."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from mbd import Mechanism, MechanismClass, RigidResult, SelfStress
from mbd.force_range import ForceRanges
from validation.run.rigid.further import Further

#: What each class means.
CLASS_WORDS = {
    MechanismClass.LOCKED: "locked: no block can move",
    MechanismClass.SUPPRESSED: "suppressed: blocks could move, but none of it goes with the load",
    MechanismClass.NEUTRAL: "neutral: blocks could move, the load neither drives nor holds them",
    MechanismClass.ACTIVATED: "activated: blocks can move, and the load drives them",
    MechanismClass.UNDECIDED: "undecided: no proof of either was found within tolerance",
}


def certificate_words(result: RigidResult) -> str:
    """Say what proves the mechanism class, with the numbers of the proof."""
    certificate = result.classification.certificate
    if isinstance(certificate, SelfStress):
        return (
            f"self-stress λ ≥ 1, ‖Gλ‖/‖λ‖ = {certificate.residual:.1e}, "
            f"σ_min/σ_max = {certificate.smallest_singular_value:.1e}"
        )
    if isinstance(certificate, Mechanism):
        return (
            f"mechanism δq, min Gᵀδq = {certificate.smallest_gap_rate:.1e}, "
            f"fᵀδq/‖f‖ = {certificate.work:.3g}"
        )
    return "none"


def held_words(held: dict[str, bool]) -> str:
    """Say along which axes a small push beside the load is held."""
    words = []
    for title, wanted in (("held against pushes along", True), ("free along", False)):
        axes = [axis for axis, found in held.items() if found is wanted]
        if axes:
            words.append(f"{title} {', '.join(axes)}")
    return "; ".join(words) + " (all blocks, without friction)"


def p_eff_words(per_block: float, pooled: float) -> str:
    """Say the effective mean pressure both ways [MPa]."""
    return (
        f"{per_block:.5g} MPa mean of the blocks' effective elements; {pooled:.5g} MPa pooled "
        "over all blocks"
    )


def range_words(ranges: ForceRanges) -> str:
    """Say how many joints have a range of forces and no value, and which is the widest."""
    wide, unbounded = int(ranges.undetermined.sum()), int(ranges.unbounded.sum())
    of = f"of {len(ranges.least)} joints"
    if wide == 0:
        return f"determined: every admissible state has the same force in each {of}"
    bound = f", {unbounded} of them without bound (self-stress)" if unbounded else ""
    k = int(np.argmax(np.where(ranges.unbounded, -1.0, ranges.width)))
    if unbounded == len(ranges.least):
        k = int(ranges.least.argmax())
    pair = f"blocks {ranges.block_m[k]} and {ranges.block_s[k]}"
    most = "any" if ranges.unbounded[k] else f"{ranges.largest[k]:.4g} N"
    return (
        f"undetermined in {wide} {of}{bound}; between {pair}: least {ranges.least[k]:.4g} N, "
        f"least-norm {ranges.shown[k]:.4g} N, largest {most}"
    )


def add_further_rows(table: Table, further: Further | None) -> None:
    """Add a row for each answer to a table of words and values."""
    if further is None:
        return
    if further.friction is not None:
        proof = ""
        if further.friction.mechanism is not None:
            proof = f"; fᵀd/‖f‖ = {further.friction.work:.3g}, least contact work "
            proof += f"{further.friction.smallest_contact_work:.1e}"
        table.add_row("with friction", further.friction.status + proof)
    if further.collapse is not None:
        c = further.collapse
        proof = ""
        if c.mechanism is not None:
            proof = f"; mechanism bounds it by {c.upper_bound:.6g}, residual {c.residual:.1e}"
        table.add_row("collapse", c.status + proof)
    if further.sliding is not None:
        table.add_row("sliding, no dilation", further.sliding.status)
    if further.ranges is not None:
        table.add_row("reaction", range_words(further.ranges))
    if further.margin is not None:
        m = further.margin
        block = int(further.free_blocks[m.block])
        table.add_row(
            "margin",
            f"smallest bearing area {m.bearing_area:.4g} mm² (load {m.load} on block {block})"
            if m.interlocked
            else f"none: load {m.load} on block {block} cannot be carried",
        )
