"""Rows of the table of a rigid answer: verdict, measures, evidence, model; motion of blocks."""

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


from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from geometry.mesh import FloatArray
from mbd.system import placed_motion

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


#: Blocks that move less than this part of the largest displacement are not among those that move
#: most; and how many are named.
_MOST, _NAMED = 0.5, 3
#: Mechanisms are exact to 1e-6: sizes that differ by less than these decimals are one.
_DIGITS = 4
#: Displacements and components of directions that are none in words.
_NONE = 0.1
_AXES = "xyz"


@dataclass(frozen=True)
class BlockMotion:
    """First-order motion of a block; of all blocks the largest displacement of a point is 1."""

    block: int
    displacement: FloatArray
    """Of its mass centroid, (3,) [-]."""
    turn: FloatArray
    """Rotation times the largest arm of its points, (3,) [-]."""
    weighs_down: bool = True
    """Whether weight acts along -z, which is called down then."""

    @property
    def words(self) -> str:
        """Displacement along axes, and axis about which it turns."""
        parts = []
        for axis, value in zip(_AXES, self.displacement.tolist(), strict=True):
            down = axis == "z" and self.weighs_down
            names = ("up", "down") if down else (f"+{axis}", f"-{axis}")
            if abs(value) >= _NONE:
                parts.append(f"{names[value < 0]} {abs(value):.2g}")
        angle = float(np.linalg.norm(self.turn))
        if angle >= _NONE:
            parts.append(f"turns about {_axis(self.turn / angle)}")
        return ", ".join(parts)


def _axis(direction: FloatArray) -> str:
    most = int(np.abs(direction).argmax())
    if np.abs(np.delete(direction, most)).max() < _NONE:
        return f"{'-' if direction[most] < 0 else ''}{_AXES[most]}"
    return f"({', '.join(f'{x:.2f}' for x in direction)})"


@dataclass(frozen=True)
class DrivenMotion:
    """How blocks move that a load drives."""

    blocks: tuple[BlockMotion, ...]
    """All that move most, the first one most."""
    proved: bool
    """Whether it is a mechanism that no contact forces hold; else where blocks went that did not
    come to rest."""
    named: Sequence[str] = field(repr=False)
    """Names of these blocks."""

    @property
    def first(self) -> str:
        """The block that moves most, and how."""
        return f"block {self.named[0]} moves most: {self.blocks[0].words}"

    @property
    def words(self) -> str:
        """The blocks that move most, and how."""
        each = [f"{n}: {b.words}" for n, b in zip(self.named, self.blocks, strict=True)]
        more = len(each) - _NAMED
        return "; ".join([*each[:_NAMED], *([f"{more} more"] if more > 0 else [])])

    @property
    def rows(self) -> list[Row]:
        """One row."""
        words = self.words + ("" if self.proved else " (not proved)")
        return [Row("blocks that move most", words, group="verdict")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        blocks = [
            {"block": b.block, "displacement": b.displacement.tolist(), "turn": b.turn.tolist()}
            for b in self.blocks
        ]
        return {"proved": self.proved, "blocks": blocks}


def driven_motion(system: RigidSystem, rows: FloatArray, *, proved: bool) -> DrivenMotion:
    """Name the blocks that move most, of a motion (n_rows,) to any scale.

    Their weight says which way is down.
    """
    assembly, weight = system.blocks, system.stated.rigid_weight
    moving = placed_motion(assembly, rows, ~system.load.fixed)
    total = np.zeros(3) if weight is None else weight[:, :3].sum(axis=0)
    down = bool(total[2] < 0.0 and np.abs(total[:2]).max() <= 1e-6 * -total[2])
    sizes, arms = np.zeros(len(moving)), np.zeros(len(moving))
    for block in np.flatnonzero(moving.any(axis=1)).tolist():
        points = assembly.place(block, _points(assembly, block)) - assembly.centroids[block]
        moved = moving[block, :3] + np.cross(moving[block, 3:], points)
        sizes[block] = np.linalg.norm(moved, axis=1).max()
        arms[block] = np.linalg.norm(points, axis=1).max()
    largest = float(sizes.max(initial=0.0)) or 1.0
    sizes = np.round(sizes / largest, _DIGITS)  # symmetric blocks: the same first one always
    order = np.argsort(-sizes, kind="stable")
    most = order[sizes[order] >= _MOST].tolist()
    blocks = tuple(
        BlockMotion(
            block,
            moving[block, :3] / largest,
            moving[block, 3:] * arms[block] / largest,
            down,
        )
        for block in most
    )
    return DrivenMotion(blocks, proved, [assembly.named(block) for block in most])


def _points(assembly: AnyBlocks, block: int) -> FloatArray:
    if isinstance(assembly, Assembly):
        return assembly.shape(block).mesh.nodes
    return cast("FloatArray", assembly.shape(block).points)
