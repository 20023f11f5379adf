"""Claims that rigid blocks decide: parameter study, tables, load transfer, hexagon-based block."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from geometry import Answer
from mbd import contact_jacobian
from validation.paper.evidence import (
    Design,
    FloatArray,
    IntArray,
    PaperEvidence,
    p_max,
    paper_measures_of,
)
from validation.paper.reference import reference
from validation.paper.verdict import ClaimVerdict, Statements, Truth, claim_verdict, listed

RIGID_CLAIMS = Statements("claim")


#: What "approximately", "comparable", "minor" and "marginal" may mean here.
_TENTH = 0.10


def _count_falling(evidence: PaperEvidence, axis: int) -> tuple[int, int]:
    """Steps of one parameter over which p_max falls, and all steps."""
    p = evidence.study.p_max
    pairs = evidence.study.pairs(axis)
    return sum(p[after] < p[before] for before, after in pairs), len(pairs)


# ---------------------------------------------------------------------------------------------
# Parameter study


@RIGID_CLAIMS.add
def _locked(evidence: PaperEvidence) -> ClaimVerdict:
    rows = evidence.study.rows.values()
    locked = sum(row["mechanism"] == "locked" for row in rows)
    flat, low = (
        [
            str(evidence.rigid(f"tsb{k}-pipe", f"block.amplitude={a}").details.mechanism)
            for k in (1, 2)
        ]
        for a in ("0", "0.1")
    )
    return claim_verdict(
        locked == len(rows) and set(low) == {"locked"} and "locked" not in flat,
        f"{locked} of {len(rows)} designs locked; a = 0.1 mm: {low[0]}; a = 0: {flat[0]}",
        locked=locked,
        designs=len(rows),
        amplitude_0_1=low,
        amplitude_0=flat,
    )


@RIGID_CLAIMS.add
def _falls_with_amplitude(evidence: PaperEvidence) -> ClaimVerdict:
    falling, total = _count_falling(evidence, 4)
    return claim_verdict(
        falling == total, f"{falling} of {total} steps", falling=falling, steps=total
    )


@RIGID_CLAIMS.add
def _flattens(evidence: PaperEvidence) -> ClaimVerdict:
    p, amplitudes = evidence.study.p_max, evidence.study.axes[4]
    flatter = total = 0
    for key in p:
        if key[4] == amplitudes[0]:
            curve = np.array([p[(*key[:4], a)] for a in amplitudes])
            drop = -np.diff(curve)
            flatter += int((np.diff(drop) < 0).sum())
            total += len(drop) - 1
    if not total:
        return ClaimVerdict(Truth.NOT_COMPUTED, "needs three amplitudes", {})
    return claim_verdict(
        flatter == total,
        f"the next drop is smaller in {flatter} of {total} pairs of steps",
        flatter=flatter,
        pairs=total,
    )


@RIGID_CLAIMS.add
def _saturates(evidence: PaperEvidence) -> ClaimVerdict:
    curves = {}
    for shift in (0.0, 0.5):
        curve = [p_max(evidence.tsb((shift, 1.5, 4, 40.0, a))) for a in (25.0, 30.0, 40.0)]
        curves[f"s={shift:g}"] = curve
    percent = {name: 100 * (1 - c[2] / c[1]) for name, c in curves.items()}
    return claim_verdict(
        all(drop < 100 * _TENTH for drop in percent.values()),
        f"from a = 30 to 40 mm p_max still falls by {listed(percent, '{:.0f} %', ' and ')}, for "
        f"example to {curves['s=0'][2]:.3f} from {curves['s=0'][1]:.3f} MPa (s = 0); f = 1.5, "
        "n = 4, t = 40; marginal: below 10 %; the printed range ends at 25 mm",
        p_max_at_25_30_40=curves,
    )


@RIGID_CLAIMS.add
def _falls_with_thickness(evidence: PaperEvidence) -> ClaimVerdict:
    falling, total = _count_falling(evidence, 3)
    p = evidence.study.p_max
    rising = [(b, p[a] / p[b] - 1) for b, a in evidence.study.pairs(3) if p[a] >= p[b]]
    words = ""
    if rising:
        frequencies = sorted({b[1] for b, _ in rising})
        largest = max(change for _, change in rising)
        words = (
            f"; the others rise by at most {100 * largest:.1f} % "
            f"(f = {', '.join(f'{f:g}' for f in frequencies)})"
        )
    return claim_verdict(
        falling == total,
        f"{falling} of {total} steps{words}",
        falling=falling,
        steps=total,
        rising=[list(b) for b, _ in rising],
    )


@RIGID_CLAIMS.add
def _thick_depends_less(evidence: PaperEvidence) -> ClaimVerdict:
    p, thicknesses = evidence.study.p_max, evidence.study.axes[3]
    of = {t: [v for key, v in p.items() if key[3] == t] for t in thicknesses}
    spread = {t: max(values) - min(values) for t, values in of.items()}
    words = listed({f"t = {t:g}": v for t, v in spread.items()}, "{:.2f} MPa")
    return claim_verdict(
        bool((np.diff(list(spread.values())) < 0).all()),
        f"max - min of p_max over a, f, n, s: {words}",
        range_of_p_max=spread,
    )


@RIGID_CLAIMS.add
def _fine_is_worse(evidence: PaperEvidence) -> ClaimVerdict:
    """Ask how p_max of the largest f compares with that of the smallest, and what that grows with.

    All three together: at the largest n and a the ratio is above 1, and it grows with n and a.
    """
    p = evidence.study.p_max
    shifts, frequencies, numbers, thicknesses, amplitudes = evidence.study.axes
    low, high = frequencies[0], frequencies[-1]

    def ratio(s: float, n: float, t: float, a: float) -> float:
        return p[s, high, int(n), t, a] / p[s, low, int(n), t, a]

    a, n = amplitudes[-1], numbers[-1]
    tubes = [(s, t) for s in shifts for t in thicknesses]
    ratios = [ratio(s, n, t, a) for s, t in tubes]
    with_n = sum(r > ratio(s, numbers[0], t, a) for (s, t), r in zip(tubes, ratios, strict=True))
    with_a = sum(r > ratio(s, n, t, amplitudes[0]) for (s, t), r in zip(tubes, ratios, strict=True))
    worse = sum(r > 1 for r in ratios)
    return claim_verdict(
        min(worse, with_n, with_a) > len(tubes) / 2,
        f"at a = {a:g} mm, n = {n:g}, f = {high:g} is worse than f = {low:g} in {worse} of "
        f"{len(tubes)} tubes (× {np.mean(ratios):.2f} on average); that ratio is larger than at "
        f"n = {numbers[0]:g} in {with_n}, than at a = {amplitudes[0]:g} in {with_a}",
        ratios=ratios,
        grows_with_n=with_n,
        grows_with_amplitude=with_a,
    )


@RIGID_CLAIMS.add
def _wave_threshold(evidence: PaperEvidence) -> ClaimVerdict:
    """Ask of every (s, f, t, a) whether p_max rises again as n, hence n_w = 2 f n, grows."""
    p = evidence.study.p_max
    shifts, frequencies, numbers, thicknesses, amplitudes = evidence.study.axes
    share: dict[float, str] = {}
    turning: dict[float, list[float]] = {}
    holds = True
    for a in amplitudes:
        rising = total = 0
        turning[a] = []
        for s, f, t in product(shifts, frequencies, thicknesses):
            curve = [p[s, f, int(n), t, a] for n in numbers]
            lowest = int(np.argmin(curve))
            total += 1
            if lowest < len(curve) - 1 and curve[-1] > 1.01 * curve[lowest]:
                rising += 1
                turning[a].append(2 * f * numbers[lowest])
        share[a] = f"{rising} of {total}"
        holds &= rising > total / 2
    spread = sorted({w for places in turning.values() for w in places})
    return claim_verdict(
        holds and len(spread) <= 3,
        "p_max rises again with n_w in "
        + ", ".join(f"{words} curves (a = {a:g})" for a, words in share.items())
        + f"; the turning points lie anywhere from n_w = {spread[0]:g} to {spread[-1]:g}: "
        "f matters on its own",
        rising_curves=share,
        turning_points=spread,
    )


@RIGID_CLAIMS.add
def _fewer_larger(evidence: PaperEvidence) -> ClaimVerdict:
    p = evidence.study.p_max
    lower = total = 0
    for (s, f, n, t, a), value in p.items():
        for (s2, f2, n2, t2, a2), other in p.items():
            if (s2, t2, a2) == (s, t, a) and n2 > n and abs(f2 * n2 - f * n) < 1e-9:
                lower += value < other
                total += 1
    return claim_verdict(
        lower == total,
        f"fewer blocks are lower in {lower} of {total} pairs of equal n_w",
        lower=lower,
        pairs=total,
    )


@RIGID_CLAIMS.add
def _fewer_larger_example(evidence: PaperEvidence) -> ClaimVerdict:
    p, (*_, thicknesses, amplitudes) = evidence.study.p_max, evidence.study.axes
    t, a = (
        (40.0 if 40.0 in thicknesses else thicknesses[0]),
        (20.0 if 20.0 in amplitudes else amplitudes[-1]),
    )
    few: Design = (0.0, 2.0, 2, t, a)
    many: Design = (0.0, 1.0, 4, t, a)
    lower = [
        p[0.0, 2.0, 2, thick, high] < p[0.0, 1.0, 4, thick, high]
        for thick in thicknesses
        for high in amplitudes
    ]
    others = "and so for every a and t"
    if not all(lower):
        others = f"but not for every a and t: lower in {sum(lower)} of {len(lower)}"
    return claim_verdict(
        all(lower),
        f"{p[few]:.3f} against {p[many]:.3f} MPa (a = {a:g}, t = {t:g}), {others}",
        few=p[few],
        many=p[many],
    )


@RIGID_CLAIMS.add
def _best(evidence: PaperEvidence) -> ClaimVerdict:
    order = sorted(evidence.study.p_max, key=lambda key: evidence.study.p_max[key])
    fine = {key: p_max(evidence.tsb(key)) for key in order[:4]}
    best = min(fine, key=lambda key: fine[key])
    words = "; ".join(
        f"s = {s:g}, f = {f:g}, n = {n}, t = {t:g}, a = {a:g}: {fine[s, f, n, t, a]:.4f} MPa"
        for s, f, n, t, a in sorted(fine, key=lambda key: fine[key])[:2]
    )
    return claim_verdict(
        best == (0.5, 2.0, 2, 60.0, 25.0),
        f"lowest at 84 × 24 × 20: {words}",
        lowest=[[*key, value] for key, value in fine.items()],
    )


@RIGID_CLAIMS.add
def _cosine_lower(evidence: PaperEvidence) -> ClaimVerdict:
    p = evidence.study.p_max
    ratio = np.array([p[(0.5, *key[1:])] / value for key, value in p.items() if key[0] == 0.0])
    lower = int((ratio < 1).sum())
    return claim_verdict(
        lower > len(ratio) / 2 and float(ratio.mean()) < 1.0,
        f"lower in {lower} of {len(ratio)} designs, mean ratio {ratio.mean():.3f} (said without "
        "“all”: in most, and on average)",
        lower=lower,
        designs=len(ratio),
        mean_ratio=float(ratio.mean()),
    )


@RIGID_CLAIMS.add
def _thickness_minor(evidence: PaperEvidence) -> ClaimVerdict:
    by_thickness = {t: p_max(evidence.tsb((0.5, 1.5, 4, t, 20.0))) for t in (40.0, 50.0, 60.0)}
    spread = max(by_thickness.values()) / min(by_thickness.values()) - 1
    return claim_verdict(
        spread < _TENTH,
        f"{listed({f't = {t:g}': p for t, p in by_thickness.items()}, '{:.3f} MPa')}: "
        f"{100 * spread:.0f} % apart (minor: below 10 %)",
        p_max=by_thickness,
    )


@RIGID_CLAIMS.add
def _480_in_hours(evidence: PaperEvidence) -> ClaimVerdict:
    seconds = evidence.study.cpu_seconds
    return claim_verdict(
        seconds < 3 * 3600,
        f"{len(evidence.study.rows)} designs at {evidence.study.mesh} in {seconds:.0f} CPU seconds "
        f"(printed: {reference()['cost']['mbd_cpu_hours']:g} CPU hours)",
        cpu_seconds=seconds,
    )


@RIGID_CLAIMS.add
def _speed_up_printed(_: PaperEvidence) -> ClaimVerdict:
    cost = reference()["cost"]
    per_design = cost["mbd_cpu_hours"] / cost["mbd_configurations"]
    ratio = cost["fem_cpu_hours"] / per_design
    return claim_verdict(
        4.5 < np.log10(ratio) < 5.5,
        f"{cost['fem_cpu_hours']:g} h / {per_design:.4f} h = {ratio:.3g}: the paper's own numbers, "
        "on two machines and of two codes",
        ratio=ratio,
    )


@RIGID_CLAIMS.add
def _length(_: PaperEvidence) -> ClaimVerdict:
    block = reference()["blocks"]["TSB1"]
    length = block["layers"] * block["height"] + 2 * block["height"] / 2
    return claim_verdict(length == 2600.0, f"12 · 200 + 2 · 100 = {length:g} mm", length=length)


# ---------------------------------------------------------------------------------------------
# Tables


def _rows(evidence: PaperEvidence, case: str) -> tuple[Answer, Answer]:
    return evidence.case("TSB1", case), evidence.case("TSB2", case)


@RIGID_CLAIMS.add
def _tsb2_wider(evidence: PaperEvidence) -> ClaimVerdict:
    one, two = (paper_measures_of(run) for run in _rows(evidence, "pipe"))
    return claim_verdict(
        two.effective_count_percent > one.effective_count_percent
        and two.effective_area_percent > one.effective_area_percent,
        f"{two.effective_count_percent:.1f} against {one.effective_count_percent:.1f} % of the "
        f"elements, {two.effective_area_percent:.1f} against {one.effective_area_percent:.1f} % "
        "of the area",
        count=[one.effective_count_percent, two.effective_count_percent],
        area=[one.effective_area_percent, two.effective_area_percent],
    )


@RIGID_CLAIMS.add
def _tsb2_preferable(evidence: PaperEvidence) -> ClaimVerdict:
    one, two = (paper_measures_of(run) for run in _rows(evidence, "pipe"))
    apart = abs(two.p_eff_pooled / one.p_eff_pooled - 1)
    return claim_verdict(
        apart < _TENTH and two.p_max < one.p_max,
        f"p_eff {one.p_eff_pooled:.4f} and {two.p_eff_pooled:.4f} MPa ({100 * apart:.1f} % apart), "
        f"p_max {one.p_max:.3f} and {two.p_max:.3f} MPa",
        p_eff=[one.p_eff_pooled, two.p_eff_pooled],
        p_eff_per_block=[one.p_eff, two.p_eff],
        p_max=[one.p_max, two.p_max],
    )


def _near(target: float, case: str, *, count: bool) -> Callable[[PaperEvidence], ClaimVerdict]:
    def judge(evidence: PaperEvidence) -> ClaimVerdict:
        both = [paper_measures_of(run) for run in _rows(evidence, case)]
        shares = [(m.effective_count_percent, m.effective_area_percent) for m in both]
        chosen = [pair[0 if count else 1] for pair in shares]
        return claim_verdict(
            all(abs(value - target) <= 5.0 for value in chosen),
            f"TSB1 {shares[0][0]:.1f} %, TSB2 {shares[1][0]:.1f} % of the elements; "
            f"{shares[0][1]:.1f} %, {shares[1][1]:.1f} % of the area (approximately: ± 5 points)",
            count_percent=[pair[0] for pair in shares],
            area_percent=[pair[1] for pair in shares],
        )

    return judge


for _count, _name in ((True, "area-{}"), (False, "area-{}-true")):
    for _case, _target in (("pipe", 30.0), ("tunnel", 50.0)):
        RIGID_CLAIMS.add(_near(_target, _case, count=_count), _name.format(_case))


# ---------------------------------------------------------------------------------------------
# Load transfer


def _by_layer(run: Answer, measure: str = "p_max") -> tuple[IntArray, FloatArray]:
    """Free layers and the mean over the blocks of each of a measure of theirs."""
    blocks, values = run.details.blocks, getattr(run.details.per_block, measure)
    layer = blocks.layer[blocks.free_blocks]
    layers = np.unique(layer)
    return layers, np.array([values[layer == k].mean() for k in layers])


@RIGID_CLAIMS.add
def _blocks_alike(evidence: PaperEvidence) -> ClaimVerdict:
    worst = 0.0
    for case in ("pipe", "tunnel", "pillar", "shaft"):
        for run in _rows(evidence, case):
            blocks, maxima = run.details.blocks, run.details.per_block.p_max
            layer = blocks.layer[blocks.free_blocks]
            for k in np.unique(layer):
                values = maxima[layer == k]
                worst = max(worst, float(np.ptp(values) / values.max()))
    return claim_verdict(
        worst < 1e-6,
        f"block maxima within a layer differ by at most {worst:.1e} (pipe, tunnel, pillar, shaft)",
        largest_relative_difference=worst,
    )


@RIGID_CLAIMS.add
def _layers_alike(evidence: PaperEvidence) -> ClaimVerdict:
    values = {
        f"{name} {case}": _by_layer(evidence.case(name, case))[1]
        for case in ("pipe", "tunnel")
        for name in ("TSB1", "TSB2")
    }
    apart = {name: float(np.ptp(p[2:-2]) / p[2:-2].mean()) for name, p in values.items()}
    words = ", ".join(f"{name} {100 * share:.0f} %" for name, share in apart.items())
    return claim_verdict(
        max(apart.values()) < _TENTH / 2,
        f"block maxima of layers 3 to 10 differ by {words} (identical: below 5 %)",
        p_max_by_layer={name: p.tolist() for name, p in values.items()},
    )


@RIGID_CLAIMS.add
def _shaft_layer(evidence: PaperEvidence) -> ClaimVerdict:
    """Compute by the paper's two measures in which layer the contact is hardest, for both loads."""
    hardest_layers: dict[str, dict[str, list[int]]] = {}
    for name, run in zip(("TSB1", "TSB2"), _rows(evidence, "shaft"), strict=True):
        physical = evidence.rigid(f"{name.lower()}-shaft")
        for words, one in (("as printed", run), ("full traction", physical)):
            for measure in ("p_eff", "p_max"):
                layers, p = _by_layer(one, measure)
                hardest = [int(k) for k in layers[p > 0.999 * p.max()]]
                hardest_layers.setdefault(f"{measure} {words}", {})[name] = hardest
    return claim_verdict(
        all(layers == [7] for layers in hardest_layers["p_eff as printed"].values()),
        "layers of the largest mean of the blocks' effective pressures: "
        f"{_layer_words(hardest_layers['p_eff as printed'])} in the convention of the tables, "
        f"{_layer_words(hardest_layers['p_eff full traction'])} with the full traction; of the "
        f"largest block maxima: {_layer_words(hardest_layers['p_max as printed'])}",
        **hardest_layers,
    )


def _layer_words(by_block: dict[str, list[int]]) -> str:
    return " and ".join(
        f"{', '.join(str(k) for k in layers)} ({name})" for name, layers in by_block.items()
    )


def _radial_gap_rate(run: Answer) -> float:
    """Smallest gap rate, relative to the largest, when every block moves outward by one unit."""
    assembly = run.details.blocks
    nothing_held = np.zeros(assembly.n_blocks, dtype=bool)
    contacts = contact_jacobian(assembly, nothing_held)
    arm = assembly.centroids - assembly.origin
    arm = arm - np.outer(arm @ assembly.axis, assembly.axis)
    motion = np.zeros((assembly.n_blocks, 6))
    motion[:, :3] = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    rates = contacts.jacobian.gap_rates(motion.ravel())
    return float(rates.min() / rates.max())


@RIGID_CLAIMS.add
def _no_explosion(evidence: PaperEvidence) -> ClaimVerdict:
    gap_rates = {
        name: _radial_gap_rate(evidence.case(name, "tunnel")) for name in ("TSB1", "TSB2", "THB0")
    }
    return claim_verdict(
        gap_rates["TSB1"] < -1e-3 and gap_rates["TSB2"] < -1e-3 and gap_rates["THB0"] > -1e-3,
        f"all blocks move outward by 1: smallest gap rate / largest = {listed(gap_rates, '{:.3f}')}"
        "; below 0: blocks collide",
        smallest_gap_rate=gap_rates,
    )


@RIGID_CLAIMS.add
def _axially_open(evidence: PaperEvidence) -> ClaimVerdict:
    classes = [
        str(run.details.supported_classification.mechanism) for run in _rows(evidence, "pillar")
    ]
    return claim_verdict(
        set(classes) == {"suppressed"},
        f"with the top frame released: {classes[0]} (TSB1), {classes[1]} (TSB2): a lifting "
        "mechanism exists, axial load opposes it",
        classes=classes,
    )


# ---------------------------------------------------------------------------------------------
# Hexagon-based block


@RIGID_CLAIMS.add
def _hexagon_classes(evidence: PaperEvidence) -> ClaimVerdict:
    table = reference()["table"]["THB0"]
    classes = {case: str(evidence.case("THB0", case).details.mechanism) for case in table}
    right = sum(classes[case] == row["mechanism"] for case, row in table.items())
    return claim_verdict(
        right == len(table),
        ", ".join(f"{case} {name}" for case, name in classes.items()),
        classes=classes,
    )


@RIGID_CLAIMS.add
def _hexagon_pressures(evidence: PaperEvidence) -> ClaimVerdict:
    hexagon, cosine = (paper_measures_of(evidence.case(b, "tunnel")) for b in ("THB0", "TSB2"))
    more, twice = hexagon.p_eff_pooled / cosine.p_eff_pooled, hexagon.p_max / cosine.p_max
    return claim_verdict(
        hexagon.effective_count_percent > cosine.effective_count_percent
        and abs(more - 1.3) < _TENTH
        and 1.75 < twice < 2.25,
        f"{hexagon.effective_count_percent:.1f} against {cosine.effective_count_percent:.1f} % of "
        f"the elements; p_eff × {more:.2f}, p_max × {twice:.2f}",
        p_eff_ratio=more,
        p_max_ratio=twice,
    )
