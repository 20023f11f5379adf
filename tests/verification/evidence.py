"""The paper's evidence on coarse meshes."""

from __future__ import annotations

import itertools
from pathlib import Path

from geometry import Answer
from validation.paper.evidence import PaperEvidence, StudyTable

AXES = ((0.0, 0.5), (1.0, 1.5, 2.0), (2, 3, 4, 5, 6), (30.0, 40.0, 50.0, 60.0))


AMPLITUDES = (10.0, 15.0, 20.0, 25.0)


def synthetic_study(**changes: float) -> StudyTable:
    """480 designs in which p_max = (1 + s/100) n / (f a t) exactly, some values replaced."""
    rows = {}
    for s, f, n, t, a in itertools.product(*AXES, AMPLITUDES):
        p = (1 - s / 100) * n / (f * a * t)
        rows[s, f, n, t, a] = {
            "p_max": p * changes.get(f"f{f:g}n{n}t{t:g}a{a:g}", 1.0),
            "mechanism": "locked",
            "n_contacts": 1000 * n,
            "cpu_seconds": 0.05,
            "status": "ok",
        }
    return StudyTable(rows, (*AXES, AMPLITUDES), "24 × 4 × 6")


class CoarseEvidence(PaperEvidence):
    """Evidence on meshes small enough for tests, with the parameter study given."""

    def rigid(self, scene: str, *settings: str) -> Answer:
        coarse = {"mesh.around": 24, "mesh.radial": 3, "mesh.axial": 6}
        if scene.startswith("thb"):
            coarse = {"mesh.edge": 8, "mesh.radial": 3}
        given = {k: v for k, _, v in (setting.partition("=") for setting in settings)}
        mesh = [f"{key}={min(value, int(given.get(key, value)))}" for key, value in coarse.items()]
        rest = [setting for setting in settings if not setting.startswith("mesh.")]
        return super().rigid(scene, *rest, *mesh)

    def fem_mesh(self, _: str, /) -> tuple[int, int, int]:
        return 12, 2, 4


def coarse_evidence(
    folder: Path, study: StudyTable | None = None, *, deformable: bool = False
) -> CoarseEvidence:
    """Evidence whose parameter study is the synthetic one."""
    evidence = CoarseEvidence(folder, deformable=deformable)
    evidence.__dict__["study"] = synthetic_study() if study is None else study
    evidence.__dict__["half_block"] = evidence.study
    return evidence


def picture_is_drawn(path: Path) -> bool:
    """Whether a PNG has more than a blank background."""
    import matplotlib.image

    pixels = matplotlib.image.imread(path)[..., :3]
    return bool(pixels.shape[0] > 400 and (pixels < 0.9).any(axis=2).mean() > 0.01)
