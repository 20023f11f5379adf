"""Faces that face each other without contact are reported, and the default finds curved ones."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.support.drawn_blocks import Drawn, arch, write_obj
from validation import load_case, solve

pytestmark = pytest.mark.quick

_ROW = "facing area not in contact"


def _notes(folder: Path, blocks: dict[str, Drawn], fixed: list[str], extra: str = ""):
    write_obj(folder / "a.obj", blocks)
    (folder / "a.toml").write_text(
        f'[block]\ntype = "mesh"\n[[parts]]\nfile = "a.obj"\n[assembly]\nfixed = {fixed}\n'
        f"[effects]\ngravity = [0, 0, -9810]\n[detection]\ntolerance = 0.4\n{extra}",
        "utf-8",
    )
    file = load_case(str(folder / "a.toml"))
    run = solve(file.with_method("rigid"))
    return run.as_dict().get("notes", {}), run.details.blocks


def _wavy(k: int, n: int, bottom: int) -> Drawn:
    """Brick of 100 x 50 x 60 between two waves of n x n facets, the lower cut the other way."""
    x, y = np.meshgrid(np.linspace(0, 100, n + 1), np.linspace(0, 50, n + 1), indexing="ij")
    wave = 6.0 * np.cos(2 * np.pi * x / 100) * np.cos(2 * np.pi * y / 50)
    points = [np.stack([x, y, 60.0 * (k + up) + wave], axis=-1).reshape(-1, 3) for up in (1, 0)]
    last, at = (n + 1) ** 2, np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    faces: list[tuple[int, ...]] = []
    for i, j in np.ndindex(n, n):
        a, b, c, d = (int(q) for q in (at[i, j], at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]))
        faces += [(a, b, c), (a, c, d)]
        a, b, c, d = (q + last for q in (a, b, c, d))
        faces += [(a, d, b), (b, d, c)] if bottom else [(a, c, b), (a, d, c)]
    rim = [*at[:-1, 0], *at[-1, :-1], *at[:0:-1, -1], *at[0, :0:-1]]
    for a, b in zip(rim, [*rim[1:], rim[0]], strict=True):
        faces.append((int(a), int(a) + last, int(b) + last, int(b)))
    return np.concatenate(points), faces


def test_curved_joints_cut_into_other_triangles_are_found_by_default(tmp_path: Path) -> None:
    blocks = {f"b{k}": _wavy(k, 20, 1) for k in range(2)}
    doubts, assembly = _notes(tmp_path, blocks, ["b0"])
    alike = {f"b{k}": _wavy(k, 20, 0) for k in range(2)}
    whole = _notes(tmp_path, alike, ["b0"])[1].interfaces.patches.areas.sum()
    # Facets of 5 x 2.5 mm; both surfaces are within the tolerance all over.
    assert assembly.interfaces.patches.areas.sum() == pytest.approx(whole, rel=0.02)
    assert _ROW not in doubts
    lost, assembly = _notes(tmp_path, blocks, ["b0"], "angle = 2.0\n")
    share = 1.0 - assembly.interfaces.patches.areas.sum() / whole
    assert share > 0.1
    assert int(lost[_ROW].partition("%")[0]) == pytest.approx(100 * share, abs=3.0)


def test_gaps_are_reported_where_the_blocks_are_analysed(tmp_path: Path) -> None:
    blocks = arch(5, thickness=300.0)
    doubts, _ = _notes(tmp_path, blocks, ["S_left", "S_right"])
    assert _ROW not in doubts
    points, faces = blocks["S_right"]
    blocks["S_right"] = np.subtract(points, [0.0, 0.0, 0.99]), faces
    doubts, _ = _notes(tmp_path, blocks, ["S_left", "S_right"])
    # One joint of six alike.
    assert doubts[_ROW].startswith("17%")
    assert "gaps up to 0.99 mm" in doubts[_ROW]
    # What the row proposes is accepted, and is enough.
    proposed = re.search(r"detection\.tolerance = ([\d.]+)", doubts[_ROW])
    assert proposed is not None
    file = load_case(str(tmp_path / "a.toml"), [f"detection.tolerance={proposed[1]}"])
    assert _ROW not in solve(file.with_method("rigid")).as_dict().get("notes", {})
