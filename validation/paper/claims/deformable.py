"""Claims that deformable blocks decide: contact against rigid blocks, stresses, displacements.

All from the static state without initial gaps; the paper's own gap is not printed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from geometry import Answer, effective_facets
from validation.paper.evidence import BoolArray, FloatArray, PaperEvidence, block_of_tube
from validation.paper.verdict import ClaimVerdict, Statements, Truth, claim_verdict, listed

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


def _by_run(
    evidence: PaperEvidence, measure: Callable[[Answer], float], cases: Iterable[str] = CASES
) -> dict[str, float]:
    """Measure of both blocks in some load cases; of one case, by the block alone."""
    names = {(b, c): f"{b} {c}" for b in BLOCKS for c in cases}
    if len(names) == len(BLOCKS):
        names = {(b, c): b for b, c in names}
    return {name: measure(evidence.fem(*run)) for run, name in names.items()}


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
    said = {"pipe": 30.0, "tunnel": 50.0}
    shares = {
        case: _by_run(
            evidence, lambda run: run.report["contact"]["effective_count_percent"], [case]
        )
        for case in said
    }
    words = (f"{c}: {listed(of, '{:.0f} %')}, said: {said[c]:g} %" for c, of in shares.items())
    return claim_verdict(
        all(abs(share - said[case]) <= 5 for case, of in shares.items() for share in of.values()),
        f"of the elements of deformable blocks; {'; '.join(words)}. Their pressures are more "
        "concentrated than those of rigid blocks",
        effective_count_percent={case: list(of.values()) for case, of in shares.items()},
    )


# ---------------------------------------------------------------------------------------------
# Stresses


@FEM_CLAIMS.add
def _layers_repeat(evidence: PaperEvidence) -> ClaimVerdict:
    def apart(answer: Answer) -> float:
        return max(_apart(_sigma(answer, k), _sigma(answer, k + 2)) for k in range(4, 8))

    differences = _by_run(evidence, apart, ("pipe", "tunnel", "pillar", "shaft"))
    worst = max(v for k, v in differences.items() if "shaft" not in k)
    shaft = min(v for k, v in differences.items() if "shaft" in k)
    return claim_verdict(
        worst < 0.05 < shaft,
        f"σ₁ of layers 4 to 7 differs from two layers above by at most {100 * worst:.1f} % in "
        f"pipe, tunnel and pillar, by {100 * shaft:.0f} % or more in shaft",
        difference=differences,
    )


def _share_under_waves(answer: Answer) -> float:
    """Of the nodes with the highest 1 % of σ₁, the share within a fifth of the height of a wave."""
    tension = answer.fields["principal_stress"][:, 0]
    free = answer.problem.blocks.free_blocks
    values = np.array([block_grid(answer, tension, int(b)) for b in free])
    height = np.linspace(0.0, 1.0, values.shape[3])
    high = height[np.nonzero(values > np.quantile(values, 0.99))[3]]
    return float(((high <= 0.2) | (high >= 0.8)).mean())


@FEM_CLAIMS.add
def _under_the_waves(evidence: PaperEvidence) -> ClaimVerdict:
    shares = _by_run(evidence, _share_under_waves)
    least = min(shares, key=lambda key: shares[key])
    return claim_verdict(
        shares[least] > 0.8,
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


def _next_layer(block: str, other: str) -> Callable[[PaperEvidence], ClaimVerdict]:
    """Whether σ₁ of the layer above the middle one is that of it, turned by 180° or mirrored."""

    def judge(evidence: PaperEvidence) -> ClaimVerdict:
        answer = evidence.fem(block, "pipe")
        here, above = _sigma(answer, _LAYER), _sigma(answer, _LAYER + 1)
        changed = {"turned by 180°": above[:, ::-1, ::-1], "mirrored": above[:, ::-1]}
        apart = {name: _apart(here, field) for name, field in changed.items()}
        (said,) = set(changed) - {other}
        return claim_verdict(
            apart[said] < 0.05,
            f"σ₁ of layer 8 {said} differs from layer 7 by {100 * apart[said]:.1f} % "
            f"({other}: {100 * apart[other]:.0f} %)",
            **{name.split()[0]: value for name, value in apart.items()},
        )

    return judge


FEM_CLAIMS.add(_next_layer("TSB1", other="mirrored"), "half-turn")
FEM_CLAIMS.add(_next_layer("TSB2", other="turned by 180°"), "mirror")


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


def _both_peaks(answer: Answer) -> tuple[dict[str, FloatArray], float, str]:
    """Peaks of both faces, the largest distance of one from its notch, and the peaks in words."""
    both = {side: _peaks(answer, side) for side in ("top", "bottom")}
    peaks = {side: values for side, (values, _) in both.items()}
    apart = max(float(distances.max()) for _, distances in both.values())
    places = (f"{_list(values)} MPa at the {side}" for side, values in peaks.items())
    return peaks, apart, f"peaks of σ₁ {', '.join(places)}"


@FEM_CLAIMS.add
def _valleys_tsb1(evidence: PaperEvidence) -> ClaimVerdict:
    peaks, apart, words = _both_peaks(evidence.fem("TSB1", "pipe"))
    ratio = float(peaks["top"].max() / peaks["bottom"].max())
    return claim_verdict(
        apart < 0.25 and 0.5 < ratio < 2.0,
        f"{words}, at most {apart:.2f} of a wave from the notches",
        **{side: values.tolist() for side, values in peaks.items()},
        distance=apart,
    )


@FEM_CLAIMS.add
def _valleys_tsb2(evidence: PaperEvidence) -> ClaimVerdict:
    peaks, _, words = _both_peaks(evidence.fem("TSB2", "pipe"))
    ratio = float(peaks["bottom"].max() / peaks["top"].max())
    return claim_verdict(
        ratio > 1.5,
        f"{words}: the {'top' if ratio < 1 else 'bottom'} ones are higher, "
        f"{max(ratio, 1 / ratio):.1f} times. With the wave of the tables (valley at the left edge) "
        "alone: the other way is the same tube upside down",
        **{side: values.tolist() for side, values in peaks.items()},
    )


def _list(values: FloatArray) -> str:
    return ", ".join(f"{v:.2f}" for v in values)


@FEM_CLAIMS.add
def _one_of_three(evidence: PaperEvidence) -> ClaimVerdict:
    ratios = {}
    for block, side in product(BLOCKS, ("top", "bottom")):
        peaks = np.sort(_peaks(evidence.fem(block, "pipe"), side)[0])
        ratios[f"{block} {side}"] = float(peaks[-1] / peaks[-2])
    return claim_verdict(
        all(ratio > 1.1 for ratio in ratios.values()),
        f"highest over second: {listed(ratios)} (higher: by more than 10 %)",
        ratio=ratios,
    )


@FEM_CLAIMS.add
def _lower_tension(evidence: PaperEvidence) -> ClaimVerdict:
    means = _by_run(evidence, lambda run: _mean(_sigma(run, _LAYER), _volumes(run)), cases=["pipe"])
    return claim_verdict(
        means["TSB2"] < means["TSB1"],
        f"mean σ₁ in layer 7: {listed(means, '{:.4f} MPa')}, "
        f"{100 * (means['TSB2'] / means['TSB1'] - 1):+.1f} %",
        mean_sigma_1=means,
    )


def _mean(values: FloatArray, weights: FloatArray) -> float:
    return float(np.average(values, weights=weights))


def _where_peaked(answer: Answer) -> BoolArray:
    values = np.abs(_sigma(answer, _LAYER))
    return values > np.quantile(values, 0.999) / 3


def _volume_share(
    words: str, where: Callable[[Answer], BoolArray], *, larger: bool
) -> Callable[[PaperEvidence], ClaimVerdict]:
    """Whether a share of the volume of a block of layer 7 is larger, or smaller, in TSB2."""

    def judge(evidence: PaperEvidence) -> ClaimVerdict:
        shares = _by_run(
            evidence,
            lambda run: _mean(where(run).astype(np.float64), _volumes(run)),
            cases=["pipe"],
        )
        more = shares["TSB2"] > shares["TSB1"]
        less = shares["TSB2"] < shares["TSB1"]
        percent = {block: 100 * share for block, share in shares.items()}
        number = f"volume with {words}: {listed(percent, '{:.1f} %')}"
        return claim_verdict(more if larger else less, number, share=shares)

    return judge


FEM_CLAIMS.add(
    _volume_share("σ₁ above a third of its peak", _where_peaked, larger=False), "localized"
)
FEM_CLAIMS.add(
    _volume_share("σ₃ below -0.1 MPa", lambda run: _sigma(run, _LAYER, 2) < -0.1, larger=True),
    "compressed",
)


# ---------------------------------------------------------------------------------------------
# Displacements


def _mean_displacement(answer: Answer) -> float:
    volumes, size = _volumes(answer), np.linalg.norm(answer.fields["displacement"], axis=1)
    grids = (block_grid(answer, size, int(b)) for b in answer.problem.blocks.free_blocks)
    return float(np.mean([_mean(grid, volumes) for grid in grids]))


def _smaller_displacement(case: str) -> Callable[[PaperEvidence], ClaimVerdict]:
    def judge(evidence: PaperEvidence) -> ClaimVerdict:
        means = _by_run(evidence, _mean_displacement, [case])
        micrometres = {block: 1e3 * mean for block, mean in means.items()}
        return claim_verdict(
            means["TSB1"] < means["TSB2"],
            f"mean displacement {listed(micrometres, '{:.2f} µm')}, no initial gap",
            mean_displacement=list(means.values()),
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


def _over_solid(answer: Answer) -> float:
    """Largest displacement over that of a solid tube by beam theory, of a shaft by torsion."""
    (length, bending), material = _monolith(answer), answer.problem.material
    largest, load = answer["max_displacement"].value, answer.case.keys["load"]
    if load["case"] == "beam":
        force = float(np.linalg.norm(_load(answer)))
        return largest / (force * length**3 / (192 * material.young_modulus * bending))
    block = block_of_tube(answer.case)
    torque = load["pressure"] * 2 * np.pi * block.outer_radius**2 * block.height
    shear = material.young_modulus / (2 * (1 + material.poisson_ratio))
    turn = torque / 2 * (length / 2) / (shear * 2 * bending)
    return largest / float(turn * block.outer_radius)


@FEM_CLAIMS.add
def _monolithic(evidence: PaperEvidence) -> ClaimVerdict:
    ratios = _by_run(evidence, _over_solid, ("beam", "shaft"))
    return claim_verdict(
        all(ratio < 2 for ratio in ratios.values()),
        "largest displacement over that of a solid tube (beam and torsion theory): "
        f"{listed(ratios, '{:.0f}')}: the shape may follow, the size does not",
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
