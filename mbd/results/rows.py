"""Rows of the table of a rigid answer: verdict, measures, evidence, model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

import numpy as np

from geometry.answer import FACTORS, Answer, Measure
from geometry.assembly import Assembly
from geometry.parts.balance import balance_rows, reaction_rows
from geometry.parts.measures import JointResultants, Measures, first_largest
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, grouped, number
from geometry.polyhedra.options import CROSSING_EDGES, STANDING_CORNER
from mbd.system import RigidSystem

if TYPE_CHECKING:
    from geometry.polyhedra.assembly import PolyhedralAssembly

#: What a load factor of rigid blocks is.
OF_RIGID_BLOCKS = "by mean pressures of facets of rigid blocks, without peaks"
#: Why nothing of rigid blocks has an error bar.
_NO_BARS = "none of rigid blocks; where forces are not unique, those of least norm are shown"
#: Forces below this part of the largest are round-off.
_NOISE = 1e-9


def rigid_rows(answer: Answer) -> list[Row]:
    """Rows of a rigid answer but those of its parts."""
    result: RigidSystem = answer.details
    solids, shown = not isinstance(result.blocks, Assembly), list[Row]()
    if answer.measures:
        shown = _force_rows(answer.measures, result.blocks)
        shown += [_total_row(answer.measures, answer.report["reaction"])]
        shown += reaction_rows(answer.report.get("reactions", {}))
    if solids and result.holds and result.contact_forces.any():
        if not result.patch_pressures.size:
            shown.append(Row("largest contact pressure", "none: edges and points have no area"))
        largest = float(result.contact_forces.max())
        shown.append(Row("largest contact force", f"{number(largest)} N", largest, "N"))
        shown += _joint_rows(result.joints, result.blocks)
    return grouped(
        verdict=_verdict_rows(result),
        measures=[*shown, *_class_rows(result)],
        evidence=_evidence_rows(answer),
        model=_solid_rows(result) if solids else _mesh_rows(result),
    )


def _verdict_rows(result: RigidSystem) -> list[Row]:
    """Whether the load is carried, and by which forces."""
    locked = ": no motion is free, whatever the load" if result.words == "locked" else ""
    rows, balance = [Row("verdict", result.words + locked)], result.equilibrium
    if result.coulomb is None:
        rows.append(Row("in equilibrium", balance.status, balance.residual))
    if result.holds and not result.of_load:
        words = "of one state that balances; whether the load brings it about is not proved"
        rows.append(Row("forces", words))
    return rows


def _force_rows(measures: Mapping[str, Measure], blocks: AnyBlocks) -> list[Row]:
    """Largest pressure and load factor, least and largest force of a joint."""
    rows = []
    if peak := measures.get("p_max_facet"):
        words = peak.value_words
        if peak.place is not None:
            area = f"mean over a facet of {peak.place['facet_area']:.4g} mm²"
            words += f", {area}: {peak.place_words}"
        rows.append(Row("largest contact pressure", words, peak.value, "MPa"))
    if factor := measures.get("crushing_factor"):
        words = f"{factor.value_words}, {OF_RIGID_BLOCKS}"
        rows.append(Row(FACTORS["crushing_factor"].words, words, factor.value, factor.unit))
    if "least_joint_force" in measures:
        each = []
        for word in ("least", "largest"):
            force = measures[f"{word}_joint_force"]
            joint = "–".join(map(blocks.named, (force.place or {})["blocks"]))
            each.append(f"{word} {force.value_words} (joint {joint})")
        rows.append(Row("normal forces of joints", ", ".join(each), force.value, "N"))
    return rows


def _total_row(measures: Mapping[str, Measure], force: list[float]) -> Row:
    """Sum of the forces of fixed blocks and supports."""
    total = measures["total_reaction"]
    size = max(m.value for name, m in measures.items() if name.endswith(("reaction", "_force")))
    parts = [0.0 if abs(x) <= _NOISE * size else x for x in force]
    words = f"{total.value_words}: ({', '.join(map(number, parts))})"
    if not any(parts):
        words = "0 N: the loads are self-equilibrated"
    return Row("total reaction", words, total.value, total.unit)


def _joint_rows(joints: JointResultants, blocks: AnyBlocks) -> list[Row]:
    """The largest resultants of joints, and where they are."""
    rows = []
    for name, values, unit in (
        ("shear force T", joints.shear_force, "N"),
        ("bending moment M", joints.bending_moment, "N mm"),
        ("eccentricity M/N", np.linalg.norm(joints.eccentricity, axis=1), "mm"),
    ):
        k = first_largest(values)
        pair = "–".join(blocks.named(int(b)) for b in (joints.block_m[k], joints.block_s[k]))
        if values[k] > _NOISE * float(joints.normal_force.max()):
            words = f"{number(values[k])} {unit} (joint {pair})"
            rows.append(Row(f"largest {name}", words, float(values[k]), unit))
    return rows


def _class_rows(result: RigidSystem) -> list[Row]:
    """The paper's class, without friction, and its means over facets and blocks."""
    rows = [Row("class of the paper (no friction)", result.mechanism.words)]
    if result.supported_classification is not result.classification:
        rows[0] = rows[0]._replace(words=f"{rows[0].words} (end rings fixed)")
        words = f"{result.supported_classification.mechanism.words} (supports of this load)"
        rows.append(Row(rows[0].title, words))
    if isinstance(result.blocks, Assembly) and result.measures is not None:
        rows += _paper_rows(result.measures, result.method.norm)
    return rows


def _paper_rows(found: Measures, norm: str) -> list[Row]:
    """The paper's means over facets and blocks, which follow the facets."""
    number, area = found.effective_count_percent, found.effective_area_percent
    every, pooled = found.p_eff, found.p_eff_pooled
    over = "MPa, mean over the effective facets"
    return [
        Row("the paper's measures", f'means over facets and blocks, norm = "{norm}"'),
        Row("effective contact elements", f"{number:.2f} % (participation ratio)", number, "%"),
        Row("effective contact area", f"{area:.2f} % (the same by area)", area, "%"),
        Row("p_eff (formula)", f"{every:.5g} {over}, then over the blocks", every, "MPa"),
        Row("p_eff (tables)", f"{pooled:.5g} {over} of all blocks", pooled, "MPa"),
        Row("p_max", f"{found.p_max:.5g} MPa, mean of the block maxima", found.p_max, "MPa"),
    ]


def _evidence_rows(answer: Answer) -> list[Row]:
    """Proof of the class without friction, the balance of every block, how forces were chosen."""
    result: RigidSystem = answer.details
    rows = [Row("proof", result.classification.proof)]
    if result.coulomb is not None:
        found, proof = result.deciding, ""
        if found.mechanism is not None:
            proof = f"; fᵀd/‖f‖ = {found.work:.3g}, least contact work "
            proof += f"{found.smallest_contact_work:.1e}"
        rows[0] = rows[0]._replace(title="proof without friction")
        rows = [Row("proof", found.status + proof, found.residual), *rows]
    if not answer.measures:
        return rows
    words = f'minimum-norm contact forces (norm = "{result.method.norm}")'
    if result.equilibrium.iterations:
        words += f", {result.equilibrium.iterations} iterations"
    bars = Row("error bars", _NO_BARS)
    return [*rows, *balance_rows(answer.report), bars, Row("solution", words)]


def _mesh_rows(result: RigidSystem) -> list[Row]:
    """Blocks with hexahedra: their number, and that of their contacts."""
    words = f"{result.n_blocks} free blocks, {result.n_contacts} contact facet pairs"
    return [Row("model", words)]


def _solid_rows(result: RigidSystem) -> list[Row]:
    """Solids: their number, points and patches of contact."""
    solids = cast("PolyhedralAssembly", result.blocks)
    patches, kinds = solids.interfaces.patches, result.bare_contacts
    named = ((CROSSING_EDGES, "edge–edge"), (STANDING_CORNER, "vertex–face"))
    bare = " and ".join(f"{kinds[kind]} {name}" for kind, name in named if kinds[kind])
    points = f"{solids.interfaces.n_contacts} contact points"
    points += f", of which {bare} contacts" if bare else ""
    joints = (
        f"{len(patches.areas)}, {patches.areas.sum():.5g} mm² in all; contact tolerance "
        f"{solids.tolerance:.3g} mm"
    )
    rows = [
        Row("model", f"{solids.n_blocks} blocks, {result.n_blocks} of them free; {points}"),
        Row("contact patches", joints),
    ]
    curved = np.flatnonzero(patches.curved)
    if curved.size:  # its width grows with the tolerance
        widths = patches.widths[curved]
        k, least = int(curved[widths.argmin()]), float(widths.min())
        pair = f"blocks {solids.named(patches.block_m[k])} and {solids.named(patches.block_s[k])}"
        words = (
            f"{least:.3g} mm wide between {pair}, up to {widths.max():.3g} mm: where gaps are "
            "within the contact tolerance"
        )
        rows.append(Row("contact of curved faces", words, least, "mm"))
    return rows
