"""The paper's parameter study with deformable blocks, and its geometric conclusions judged by it.

The rows are those of `tubelock sweep paper-480` and `tubelock sweep paper-480-fem`, as CSV beside
the studies. The claims are judged by the judges of `validation.paper.claims`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from validation import InputError
from validation import read_rows as csv_rows
from validation.paper.claims.rigid import RIGID_CLAIMS
from validation.paper.evidence import PATHS, Design, PaperEvidence, StudyTable
from validation.paper.verdict import ClaimVerdict, Truth, claim_verdict

RIGID, DEFORMABLE = "paper-480", "paper-480-fem"
#: Folder of the built-in studies and their rows.
_STUDIES = Path(str(resources.files("validation"))) / "studies"
#: Claims that the rows of a study decide.
GEOMETRIC = (
    "falls-with-amplitude",
    "flattens",
    "falls-with-thickness",
    "thick-depends-less",
    "fine-is-worse",
    "wave-threshold",
    "fewer-larger",
    "fewer-larger-example",
    "cosine-lower",
)
#: What each claim is judged by: title, and whether the rows are those of deformable blocks.
JUDGED = {
    "p_max": ("rigid p_max", False),
    "p_max_fem": ("deformable p_max", True),
    "p_eff": ("rigid p_eff", False),
    "p_eff_fem": ("deformable p_eff", True),
    "sigma_1_averaged_fem": ("deformable averaged tension", True),
    "max_displacement_fem": ("deformable displacement", True),
}
_AXES = ("shift s", "frequency f", "blocks n", "thickness t", "amplitude a")
_BEST: Design = (0.5, 2.0, 2, 60.0, 25.0)

Rows = dict[Design, dict[str, Any]]


def rows_by_design(path: Path) -> Rows:
    """Rows of a study from the CSV that `tubelock sweep --csv` writes, by design."""
    rows: Rows = {}
    for row in csv_rows(path):
        try:
            s, f, n, t, a = (float(row[p]) for p in PATHS)
            rows[s, f, int(n), t, a] = row
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{path}: no rows of {DEFORMABLE}: {error}; expected what "
                f"`tubelock sweep {DEFORMABLE} --csv FILE` writes"
            ) from None
    return rows


class Compared:
    """Rows of rigid and of deformable blocks for the same designs."""

    def __init__(self, path: Path | None = None) -> None:
        """Read the rows: those in the program, deformable ones from another file if named."""
        rigid = rows_by_design(_STUDIES / f"{RIGID}.csv")
        self.source = _STUDIES / f"{DEFORMABLE}.csv" if path is None else path
        deformable = rows_by_design(self.source)
        self.unresolved = {
            key: str(row["message"] or "p_max is not resolved")
            for key, row in deformable.items()
            if row["status"] != "ok" or row["p_max"] is None or row["sigma_1_averaged"] is None
        }
        """Designs without the measures, and why."""
        self.n_computed = len(deformable)
        self.rows: Rows = {
            key: {**rigid[key], **{f"{name}_fem": value for name, value in row.items()}}
            for key, row in deformable.items()
            if key in rigid and key not in self.unresolved
        }
        """Complete rows; columns of deformable blocks end in ``_fem``."""
        if not self.rows:
            raise InputError(f"{self.source}: no design has all measures; expected more rows")
        self.axes = complete_axes(self.rows)
        self.rows = {
            key: row
            for key, row in self.rows.items()
            if all(value in axis for value, axis in zip(key, self.axes, strict=True))
        }

    def table(self, measure: str) -> StudyTable:
        """Parameter study whose p_max is another measure."""
        rows = {key: row | {"p_max": row[measure]} for key, row in self.rows.items()}
        return StudyTable(rows, self.axes, "84 × 10 × 20")

    def values(self, measure: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """A measure of all designs, in their order."""
        return np.array([row[measure] for row in self.rows.values()], dtype=float)

    @property
    def scope(self) -> str:
        """How many designs there are, of which values."""
        values = ", ".join(
            f"{name} ∈ {{{', '.join(f'{v:g}' for v in axis)}}}"
            for name, axis in zip(_AXES, self.axes, strict=True)
        )
        return f"{len(self.rows)} of the paper's 480 designs ({values})"


def complete_axes(keys: Iterable[Design]) -> tuple[tuple[float, ...], ...]:
    """Values of each parameter of which every combination is there: the emptiest ones are left out.

    A study that is still running, or was ended early, is judged by the part that is complete.
    """
    keys = set(keys)
    axes = [sorted({key[axis] for key in keys}) for axis in range(5)]
    while len(keys) < math.prod(map(len, axes)):
        share = {
            (axis, value): sum(key[axis] == value for key in keys) * len(axes[axis])
            for axis in range(5)
            for value in axes[axis]
            if len(axes[axis]) > 1
        }
        axis, value = min(share, key=lambda place: share[place])
        axes[axis].remove(value)
        keys = {key for key in keys if key[axis] != value}
    return tuple(map(tuple, axes))


def judge_geometry(compared: Compared) -> list[dict[str, Any]]:
    """Judge each geometric claim by each measure: verdict and number."""
    claims = {claim.name: claim for claim in RIGID_CLAIMS}
    rows = []
    for name in GEOMETRIC:
        for measure, (title, _) in JUDGED.items():
            verdict = _verdict(claims[name].judge, compared, measure)
            rows.append(_row(name, claims[name].text["statement"], title, verdict))
    for measure, (title, _) in JUDGED.items():
        verdict = _best(compared, measure)
        rows.append(_row("best", claims["best"].text["statement"], title, verdict))
    return rows


def _row(name: str, statement: str, title: str, verdict: ClaimVerdict) -> dict[str, Any]:
    return {
        "claim": name,
        "statement": statement,
        "measure": title,
        "verdict": str(verdict.truth),
        "number": verdict.number.replace("p_max", "the measure"),
    }


def _verdict(
    judge: Callable[[PaperEvidence], ClaimVerdict], compared: Compared, measure: str
) -> ClaimVerdict:
    """Judge a claim by another measure; rows that it needs and that are missing leave it open."""
    evidence = PaperEvidence(Path())
    evidence.__dict__["study"] = compared.table(measure)
    try:
        return judge(evidence)
    except KeyError as missing:
        return ClaimVerdict(Truth.NOT_COMPUTED, f"needs the design {missing}", {})


def _best(compared: Compared, measure: str) -> ClaimVerdict:
    """Ask whether the design that the paper names has the least value of the rows."""
    values = compared.table(measure).p_max
    if _BEST not in values:
        return ClaimVerdict(Truth.NOT_COMPUTED, f"needs the design {_BEST}", {})
    best = min(values, key=lambda key: values[key])
    s, f, n, t, a = best
    rank = 1 + sum(value < values[_BEST] for value in values.values())
    words = f"least at s = {s:g}, f = {f:g}, n = {n}, t = {t:g}, a = {a:g}: {values[best]:.4g}; "
    words += f"the paper's design is number {rank} of {len(values)}: {values[_BEST]:.4g}"
    return claim_verdict(best == _BEST, words)


def effects(compared: Compared) -> list[dict[str, Any]]:
    """Steps of each parameter over which each measure falls or rises, beyond the error bars."""
    rows = []
    for axis, parameter in enumerate(_AXES):
        for measure, (title, deformable) in JUDGED.items():
            table = compared.table(measure)
            pairs = [(a, b) for a, b in table.pairs(axis) if a in table.rows and b in table.rows]
            if not pairs:
                continue
            change = np.array([table.p_max[b] - table.p_max[a] for a, b in pairs])
            ratio = np.array([table.p_max[b] / table.p_max[a] for a, b in pairs])
            bars = np.zeros(len(pairs))
            if deformable:
                of = f"{measure.removesuffix('_fem')}_error_fem"
                bars = np.array([sum(table.rows[k][of] or 0.0 for k in pair) for pair in pairs])
            rows.append(
                {
                    "parameter": parameter,
                    "measure": title,
                    "steps": len(pairs),
                    "falls": int((change < -bars).sum()),
                    "rises": int((change > bars).sum()),
                    "within error bars": int((np.abs(change) <= bars).sum()),
                    "mean ratio": float(np.exp(np.log(ratio).mean())),
                }
            )
    return rows


def rank_correlations(compared: Compared) -> list[dict[str, Any]]:
    """Spearman's rank correlation of each two measures."""
    from scipy.stats import spearmanr

    names = list(JUDGED)
    of = np.column_stack([compared.values(name) for name in names])
    ranks = np.asarray(spearmanr(of).statistic)
    return [
        {"measure": JUDGED[name][0]}
        | {JUDGED[other][0]: float(ranks[i, j]) for j, other in enumerate(names)}
        for i, name in enumerate(names)
    ]


def as_json(compared: Compared) -> dict[str, Any]:
    """Everything as plain data."""
    return {
        "designs": len(compared.rows),
        "computed": compared.n_computed,
        "scope": compared.scope,
        "unresolved": [[*key, why] for key, why in compared.unresolved.items()],
        "claims": judge_geometry(compared),
        "effects": effects(compared),
        "rank_correlations": rank_correlations(compared),
    }
