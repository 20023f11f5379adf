"""Claims that deformable blocks decide: contact against rigid blocks, stresses, displacements.

All from the static state without initial gaps; the paper's own gap is not printed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry import Answer, effective_facets
from validation.paper.evidence import BoolArray, FloatArray, PaperEvidence, block_of_tube
from validation.paper.verdict import ClaimVerdict, Statements, Truth, claim_verdict

FEM_CLAIMS = Statements("claim")


BLOCKS = ("TSB1", "TSB2")
CASES = ("pipe", "tunnel", "pillar", "beam", "shaft")
#: Layer that the paper looks at.
_LAYER = 7


# ---------------------------------------------------------------------------------------------
# Fields on the grid of a block


def block_grid(answer: Answer, values: FloatArray, block: int) -> FloatArray:
    """Values of a block, of nodal ones (n_points, …), by position: radial, around, axial."""
    mesh = answer.case.keys["mesh"]
    shape = (mesh["radial"] + 1, mesh["around"] + 1, mesh["axial"] + 1)
    return values[answer.block_of_point == block].reshape(*shape, *values.shape[1:])


def _sigma(answer: Answer, layer: int, component: int = 0, place: int = 0) -> FloatArray:
    """Principal stress (0: σ₁, 2: σ₃) of one block on its grid."""
    block = int(np.flatnonzero(answer.problem.blocks.layer == layer)[place])
    return block_grid(answer, answer.fields["principal_stress"][:, component], block)


def _volumes(answer: Answer) -> FloatArray:
    """Volume that belongs to each node of the free block, on its grid [mm³]."""
    block = int(answer.problem.blocks.free_blocks[0])
    corners = answer.points[answer.cells[answer.block_of_point[answer.cells[:, 0]] == block]]
    edges = corners[:, [1, 3, 4]] - corners[:, [0]]
    share = np.repeat(np.abs(np.linalg.det(edges)) / 8, 8)
    cells = answer.cells[answer.block_of_point[answer.cells[:, 0]] == block]
    total = np.bincount(cells.ravel(), share, minlength=len(answer.points))
    return block_grid(answer, total.astype(np.float64), block)


def _apart(one: FloatArray, other: FloatArray) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(one))


# ---------------------------------------------------------------------------------------------
# Contact against rigid blocks


@dataclass(frozen=True)
class PressurePair:
    """Contact pressures of one interface from both models, facet by facet."""

    name: str
    corners: FloatArray
    """Of the facets, (n, 4, 3) [mm]."""
    rigid: FloatArray
    """(n,) [MPa]"""
    deformable: FloatArray
    """(n,) [MPa]"""

    @property
    def effective(self) -> BoolArray:
        """Facets of the effective contact area of rigid blocks, (n,)."""
        return effective_facets(self.rigid)

    @property
    def peak_share(self) -> float:
        """Share of the deformable blocks' peaks that lie in the rigid blocks' effective area.

        Peaks are the facets above half of the largest pressure.
        """
        peaks = self.deformable > 0.5 * self.deformable.max()
        return float(self.effective[peaks].mean())

    @property
    def correlation(self) -> float:
        """Correlation coefficient of the two pressure fields."""
        return float(np.corrcoef(self.rigid, self.deformable)[0, 1])


def pressure_pairs(evidence: PaperEvidence) -> list[PressurePair]:
    """The twelve comparisons of figure pc_MBD_FEM: three cases, two blocks, top and bottom."""
    pairs = []
    for case in ("pipe", "tunnel", "shaft"):
        for block in BLOCKS:
            answer = evidence.fem(block, case)
            rigid = same_mesh(evidence, answer)
            for lower, side in ((_LAYER, "top"), (_LAYER - 1, "bottom")):
                pairs.append(_pair(f"{block} {case} {side}", answer, rigid, lower))
    return pairs


def _pair(name: str, answer: Answer, rigid: Answer, lower: int) -> PressurePair:
    """Pressures between a layer and the next one; both answers have the same facets."""
    chosen = (np.sort(answer.contacts["layer"], axis=1) == (lower, lower + 1)).all(axis=1)
    return PressurePair(
        name,
        answer.contacts["corners"][chosen],
        rigid.contacts["pressure"][chosen],
        answer.contacts["pressure"][chosen],
    )


def same_mesh(evidence: PaperEvidence, answer: Answer) -> Answer:
    """Rigid-block result on the mesh of a deformable one, with the full load."""
    mesh = answer.case.keys["mesh"]
    return evidence.rigid(answer.case.name, *(f"mesh.{key}={value}" for key, value in mesh.items()))


@FEM_CLAIMS.add
def _peaks_found(evidence: PaperEvidence) -> ClaimVerdict:
    pairs = pressure_pairs(evidence)
    shares = np.array([p.peak_share for p in pairs])
    chance = np.array([p.effective.mean() for p in pairs])
    worst = pairs[int(np.argmin(shares))]
    return claim_verdict(
        bool((shares > 0.5).all() and shares.mean() > 0.8),
        f"{100 * shares.mean():.0f} % of the peak facets (above half of the largest pressure) lie "
        f"in the rigid blocks' effective area, which covers {100 * chance.mean():.0f} % of the "
        f"faces; least: {worst.name} {100 * shares.min():.0f} %; correlation "
        f"{min(p.correlation for p in pairs):.2f} to {max(p.correlation for p in pairs):.2f}",
        share={p.name: p.peak_share for p in pairs},
        correlation={p.name: p.correlation for p in pairs},
    )


@FEM_CLAIMS.add
def _areas_fem(evidence: PaperEvidence) -> ClaimVerdict:
    values, words = {}, []
    for case, target in (("pipe", 30.0), ("tunnel", 50.0)):
        contacts = [evidence.fem(b, case).report["contact"] for b in BLOCKS]
        counts = [c["effective_count_percent"] for c in contacts]
        values[case] = counts
        words.append(
            f"{case}: {counts[0]:.0f} % (TSB1), {counts[1]:.0f} % (TSB2), said: {target:g} %"
        )
    holds = all(abs(v - t) <= 5 for k, t in (("pipe", 30), ("tunnel", 50)) for v in values[k])
    return claim_verdict(
        holds,
        "of the elements of deformable blocks; "
        + "; ".join(words)
        + ". Their pressures are more concentrated than those of rigid blocks",
        effective_count_percent=values,
    )


# ---------------------------------------------------------------------------------------------
# Stresses


@FEM_CLAIMS.add
def _layers_repeat(evidence: PaperEvidence) -> ClaimVerdict:
    differences = {}
    for block in BLOCKS:
        for case in ("pipe", "tunnel", "pillar", "shaft"):
            answer = evidence.fem(block, case)
            differences[f"{block} {case}"] = max(
                _apart(_sigma(answer, k), _sigma(answer, k + 2)) for k in range(4, 8)
            )
    worst = max(v for k, v in differences.items() if "shaft" not in k)
    shaft = min(v for k, v in differences.items() if "shaft" in k)
    return claim_verdict(
        worst < 0.05 < shaft,
        f"σ₁ of layers 4 to 7 differs from two layers above by at most {100 * worst:.1f} % in "
        f"pipe, tunnel and pillar, by {100 * shaft:.0f} % or more in shaft",
        difference=differences,
    )


@FEM_CLAIMS.add
def _under_the_waves(evidence: PaperEvidence) -> ClaimVerdict:
    shares = {}
    for block in BLOCKS:
        for case in CASES:
            answer = evidence.fem(block, case)
            tension = answer.fields["principal_stress"][:, 0]
            free = answer.problem.blocks.free_blocks
            values = np.array([block_grid(answer, tension, int(b)) for b in free])
            height = np.linspace(0.0, 1.0, values.shape[3])
            high = height[np.nonzero(values > np.quantile(values, 0.99))[3]]
            shares[f"{block} {case}"] = float(((high <= 0.2) | (high >= 0.8)).mean())
    least = min(shares, key=lambda key: shares[key])
    return claim_verdict(
        min(shares.values()) > 0.8,
        "of the nodes with the highest 1 % of σ₁, within a fifth of the height from a sinusoidal "
        f"face: {100 * np.mean(list(shares.values())):.0f} % (mean of ten runs), least "
        f"{100 * shares[least]:.0f} % ({least})",
        share=shares,
    )


@FEM_CLAIMS.add
def _favourable(_: PaperEvidence) -> ClaimVerdict:
    return ClaimVerdict(
        Truth.UNDECIDABLE,
        "the paper names no measure of a favourable stress state; mean σ₁, localisation and "
        "compressed volume are judged one by one",
        {},
    )


def _monolith(answer: Answer) -> tuple[float, float]:
    """Length [mm] and second moment of area [mm⁴] of a solid tube, clamped at both ends."""
    block = block_of_tube(answer.case)
    bending = np.pi / 4 * (block.outer_radius**4 - block.inner_radius**4)
    return answer.case.keys["assembly"]["layers"] * block.height, float(bending)


@FEM_CLAIMS.add
def _far_side(evidence: PaperEvidence) -> ClaimVerdict:
    stresses, words = {}, []
    for name in BLOCKS:
        answer = evidence.fem(name, "beam")
        (length, bending), force = _monolith(answer), _load(answer)
        moment = np.linalg.norm(force) * length / 8
        expected = moment * block_of_tube(answer.case).outer_radius / bending
        stress = _far_axial_stress(answer, force)
        stresses[name] = (stress, float(expected))
        words.append(f"{name}: {stress:+.4f} MPa")
    return claim_verdict(
        all(stress < 0.05 * expected for stress, expected in stresses.values()),
        "mean axial stress on the side away from the load, layers 5 to 9: "
        + ", ".join(words)
        + f"; a solid tube clamped at both ends: +{stresses['TSB1'][1]:.4f} MPa at mid-length",
        far_side_and_solid=stresses,
    )


def _next_layer(answer: Answer) -> tuple[float, float]:
    """How far σ₁ of the layer above the middle one is from it, turned by 180° and mirrored [-]."""
    here, above = _sigma(answer, _LAYER), _sigma(answer, _LAYER + 1)
    return _apart(here, above[:, ::-1, ::-1]), _apart(here, above[:, ::-1])


@FEM_CLAIMS.add
def _half_turn(evidence: PaperEvidence) -> ClaimVerdict:
    turned, mirrored = _next_layer(evidence.fem("TSB1", "pipe"))
    return claim_verdict(
        turned < 0.05,
        f"σ₁ of layer 8 turned by 180° differs from layer 7 by {100 * turned:.1f} % "
        f"(mirrored: {100 * mirrored:.0f} %)",
        turned=turned,
        mirrored=mirrored,
    )


@FEM_CLAIMS.add
def _mirror(evidence: PaperEvidence) -> ClaimVerdict:
    turned, mirrored = _next_layer(evidence.fem("TSB2", "pipe"))
    return claim_verdict(
        mirrored < 0.05,
        f"σ₁ of layer 8 mirrored differs from layer 7 by {100 * mirrored:.1f} % "
        f"(turned by 180°: {100 * turned:.0f} %)",
        turned=turned,
        mirrored=mirrored,
    )


@FEM_CLAIMS.add
def _four_alike(evidence: PaperEvidence) -> ClaimVerdict:
    """Solve a tube without using its symmetry: four layers are enough to see it."""
    answer = evidence.whole_tube("TSB1", "pipe", 4)
    first = _sigma(answer, 2)
    worst = max(_apart(first, _sigma(answer, 2, 0, place)) for place in range(1, 4))
    return claim_verdict(
        worst < 1e-3,
        f"σ₁ of the four blocks of a layer differs by at most {worst:.0e} (solved without using "
        "the symmetry, four layers)",
        difference=worst,
    )


def _peaks(answer: Answer, side: str) -> tuple[FloatArray, FloatArray]:
    """Largest σ₁ near each notch of one wavy face of a block of layer 7, and how far from it.

    A notch (the paper's valley) is where the wave cuts deepest into the block. Notches on the
    block's edge are left out: half of them belongs to the neighbour.

    Returns
    -------
    tuple
        Peaks [MPa] and distances in wave lengths, from left to right.
    """
    block = block_of_tube(answer.case)
    field, waves = _sigma(answer, _LAYER), block.waves_per_block
    near = field[:, :, -3:] if side == "top" else field[:, :, :3]
    along = near.max(axis=(0, 2))
    u = np.linspace(0.0, 1.0, len(along))
    # z = sin(2π w u + π s): notches of the top face at phase 3/4, of the bottom face at 1/4.
    phase = 0.75 if side == "top" else 0.25
    notches = (np.arange(-2, waves + 3) + phase - block.shift / 2) / waves
    peaks, distances = [], []
    for notch in notches[(notches > 0.02) & (notches < 0.98)]:
        near_notch = np.flatnonzero(np.abs(u - notch) <= 0.5 / waves + 1e-12)
        top = near_notch[int(np.argmax(along[near_notch]))]
        peaks.append(along[top])
        distances.append(abs(u[top] - notch) * waves)
    return np.array(peaks), np.array(distances)


@FEM_CLAIMS.add
def _valleys_tsb1(evidence: PaperEvidence) -> ClaimVerdict:
    answer = evidence.fem("TSB1", "pipe")
    (top, far_top), (bottom, far_bottom) = _peaks(answer, "top"), _peaks(answer, "bottom")
    apart = max(float(far_top.max()), float(far_bottom.max()))
    ratio = float(top.max() / bottom.max())
    return claim_verdict(
        apart < 0.25 and 0.5 < ratio < 2.0,
        f"peaks of σ₁ {_list(top)} MPa at the top, {_list(bottom)} MPa at the bottom, at most "
        f"{apart:.2f} of a wave from the notches",
        top=top.tolist(),
        bottom=bottom.tolist(),
        distance=apart,
    )


@FEM_CLAIMS.add
def _valleys_tsb2(evidence: PaperEvidence) -> ClaimVerdict:
    answer = evidence.fem("TSB2", "pipe")
    (top, _), (bottom, _) = _peaks(answer, "top"), _peaks(answer, "bottom")
    ratio = float(bottom.max() / top.max())
    return claim_verdict(
        ratio > 1.5,
        f"peaks of σ₁ {_list(top)} MPa at the top, {_list(bottom)} MPa at the bottom: the "
        f"{'top' if ratio < 1 else 'bottom'} ones are higher, {max(ratio, 1 / ratio):.1f} times. "
        "With the wave of the tables (valley at the left edge) alone: the other way is the same "
        "tube upside down",
        top=top.tolist(),
        bottom=bottom.tolist(),
    )


def _list(values: FloatArray) -> str:
    return ", ".join(f"{v:.2f}" for v in values)


@FEM_CLAIMS.add
def _one_of_three(evidence: PaperEvidence) -> ClaimVerdict:
    ratios = {}
    for block, side in (("TSB1", "top"), ("TSB1", "bottom"), ("TSB2", "top"), ("TSB2", "bottom")):
        peaks = np.sort(_peaks(evidence.fem(block, "pipe"), side)[0])
        ratios[f"{block} {side}"] = float(peaks[-1] / peaks[-2])
    return claim_verdict(
        all(ratio > 1.1 for ratio in ratios.values()),
        "highest over second: "
        + ", ".join(f"{v:.2f} ({k})" for k, v in ratios.items())
        + " (higher: by more than 10 %)",
        ratio=ratios,
    )


@FEM_CLAIMS.add
def _lower_tension(evidence: PaperEvidence) -> ClaimVerdict:
    runs = {block: evidence.fem(block, "pipe") for block in BLOCKS}
    means = {b: float(np.average(_sigma(r, _LAYER), weights=_volumes(r))) for b, r in runs.items()}
    return claim_verdict(
        means["TSB2"] < means["TSB1"],
        f"mean σ₁ in layer 7: {means['TSB1']:.4f} MPa (TSB1), {means['TSB2']:.4f} MPa (TSB2), "
        f"{100 * (means['TSB2'] / means['TSB1'] - 1):+.1f} %",
        mean_sigma_1=means,
    )


def _share(answer: Answer, where: BoolArray) -> float:
    """Share of a block's volume."""
    volumes = _volumes(answer)
    return float(volumes[where].sum() / volumes.sum())


@FEM_CLAIMS.add
def _localized(evidence: PaperEvidence) -> ClaimVerdict:
    shares = {}
    for block in BLOCKS:
        answer = evidence.fem(block, "pipe")
        values = np.abs(_sigma(answer, _LAYER))
        shares[block] = _share(answer, values > np.quantile(values, 0.999) / 3)
    return claim_verdict(
        shares["TSB2"] < shares["TSB1"],
        "volume with σ₁ above a third of its peak: "
        + ", ".join(f"{100 * v:.1f} % ({k})" for k, v in shares.items()),
        share=shares,
    )


@FEM_CLAIMS.add
def _compressed(evidence: PaperEvidence) -> ClaimVerdict:
    limit = 0.1
    shares = {}
    for block in BLOCKS:
        answer = evidence.fem(block, "pipe")
        shares[block] = _share(answer, _sigma(answer, _LAYER, 2) < -limit)
    return claim_verdict(
        shares["TSB2"] > shares["TSB1"],
        f"volume with σ₃ below -{limit:g} MPa: "
        + ", ".join(f"{100 * v:.1f} % ({k})" for k, v in shares.items()),
        share=shares,
    )


# ---------------------------------------------------------------------------------------------
# Displacements


def _mean_displacement(answer: Answer) -> float:
    volumes, size = _volumes(answer), np.linalg.norm(answer.fields["displacement"], axis=1)
    grids = (block_grid(answer, size, int(b)) for b in answer.problem.blocks.free_blocks)
    return float(np.mean([np.average(grid, weights=volumes) for grid in grids]))


def _smaller_displacement(case: str) -> Callable[[PaperEvidence], ClaimVerdict]:
    def judge(evidence: PaperEvidence) -> ClaimVerdict:
        one, two = (_mean_displacement(evidence.fem(b, case)) for b in BLOCKS)
        return claim_verdict(
            one < two,
            f"mean displacement {1e3 * one:.2f} µm (TSB1), {1e3 * two:.2f} µm (TSB2), no initial "
            "gap",
            mean_displacement=[one, two],
        )

    return judge


for _case in ("pipe", "tunnel"):
    FEM_CLAIMS.add(_smaller_displacement(_case), f"displacement-{_case}")


def _load(answer: Answer) -> FloatArray:
    """Resultant of the load [N]."""
    forces: FloatArray = answer.problem.load_case.facet_forces
    return forces.sum(axis=0)


def _far_axial_stress(answer: Answer, force: FloatArray) -> float:
    """Mean σ_zz over the outer surface within 30° of the direction of the load, layers 5 to 9."""
    blocks, away = answer.problem.blocks, force[:2] / np.linalg.norm(force[:2])
    values = []
    for block in np.flatnonzero((blocks.layer >= 5) & (blocks.layer <= 9)).tolist():
        outer = np.unique(blocks.shape(block).faces["outer"])
        nodes = blocks.nodes(block)[outer]
        direction = nodes[:, :2] / np.linalg.norm(nodes[:, :2], axis=1, keepdims=True)
        chosen = direction @ away > np.cos(np.pi / 6)
        stress = answer.fields["stress"][answer.block_of_point == block]
        values.append(stress[outer[chosen], 2])
    return float(np.concatenate(values).mean())


@FEM_CLAIMS.add
def _monolithic(evidence: PaperEvidence) -> ClaimVerdict:
    ratios = {}
    for name in BLOCKS:
        answer = evidence.fem(name, "beam")
        (length, bending), material = _monolith(answer), answer.problem.material
        force = float(np.linalg.norm(_load(answer)))
        sag = force * length**3 / (192 * material.young_modulus * bending)
        ratios[f"{name} beam"] = answer["max_displacement"].value / sag
        answer = evidence.fem(name, "shaft")
        block = block_of_tube(answer.case)
        pressure = answer.case.keys["load"]["pressure"]
        torque = pressure * 2 * np.pi * block.outer_radius**2 * block.height
        shear = material.young_modulus / (2 * (1 + material.poisson_ratio))
        turn = torque / 2 * (length / 2) / (shear * 2 * bending)
        ratios[f"{name} shaft"] = answer["max_displacement"].value / float(
            turn * block.outer_radius
        )
    return claim_verdict(
        all(ratio < 2 for ratio in ratios.values()),
        "largest displacement over that of a solid tube (beam and torsion theory): "
        + ", ".join(f"{v:.0f} ({k})" for k, v in ratios.items())
        + ": the shape may follow, the size does not",
        ratio=ratios,
    )


@FEM_CLAIMS.add
def _speed_up(evidence: PaperEvidence) -> ClaimVerdict:
    answer = evidence.fem("TSB1", "pipe")
    rigid = same_mesh(evidence, answer)
    seconds, of_rigid = (run.report["cpu_seconds"]["total"] for run in (answer, rigid))
    ratio = seconds / of_rigid
    return claim_verdict(
        4.5 < np.log10(ratio) < 5.5,
        f"same tube, same mesh, one core: static deformable {seconds:.1f} s, "
        f"rigid {of_rigid:.3f} s: × {ratio:.0f}; five orders lie between two codes, not between "
        "the two models",
        ratio=ratio,
    )
