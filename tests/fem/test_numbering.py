"""General contact with friction, one element a block, whatever numbers blocks and nodes have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geometry.files.mesh_io import write_hex_mesh
from geometry.mesh import CORNERS, FloatArray, HexMesh
from tests.support.answers import on_its_mesh
from tests.support.numberings import rotated_numberings
from tests.support.own_blocks import own_scene

#: Two boxes on a fixed base, and one across both of them: lowest and highest corners [mm].
BASE = (((-50.0, -20.0, -50.0), (250.0, 120.0, 0.0)),)
FREE = (
    ((0.0, 0.0, 0.0), (90.0, 100.0, 60.0)),
    ((100.0, 0.0, 0.0), (200.0, 100.0, 60.0)),
    ((40.0, 10.0, 60.0), (160.0, 90.0, 110.0)),
)
LOAD = """[load]
acceleration = [1500, 400, 0]
[effects]
gravity = [0, 0, -9810]
finite_sliding = true
[effects.friction]
coefficient = 0.5
"""


def write(path: Path, boxes: tuple[tuple[FloatArray, ...], ...], rng: np.random.Generator) -> None:
    """Boxes in any order, their corners from any of the 24 first ones, nodes in any order."""
    turns = rotated_numberings()
    nodes: list[FloatArray] = []
    elements = []
    for box in rng.permutation(len(boxes)):
        low, high = np.array(boxes[box])
        elements.append(8 * len(nodes) + turns[rng.integers(len(turns))])
        nodes.append(low + 0.5 * (CORNERS + 1.0) * (high - low))
    place = rng.permutation(8 * len(nodes))
    moved = np.empty((len(place), 3))
    moved[place] = np.concatenate(nodes)
    write_hex_mesh(path, HexMesh(moved, place[np.array(elements)]))


def test_an_answer_with_friction_does_not_depend_on_the_numbering(tmp_path: Path) -> None:
    """Which of two blocks has the points of a joint follows their order: their normals differ by
    how much blocks turn, here 1e-5, and pressures with them; the nodes' order changes round-off."""
    found = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        write(tmp_path / "base.vtu", BASE, rng)  # type: ignore[arg-type]
        write(tmp_path / "free.vtu", FREE, rng)  # type: ignore[arg-type]
        parts = '[[parts]]\nfile = "base.vtu"\nfixed = true\n[[parts]]\nfile = "free.vtu"\n'
        scene = own_scene(tmp_path, parts, load=LOAD).changed(
            {"fem.mesh": "scene", "fem.error_estimate": False}
        )
        run = on_its_mesh(scene, method="static")
        assert run.details.run is None
        assert run.details.evidence.converged
        found.append([run.measures[m].value for m in ("max_displacement", "p_max_point")])
    for other in found[1:]:
        assert other == pytest.approx(found[0], rel=1e-5)
    assert found[0][0] > 1e-3
