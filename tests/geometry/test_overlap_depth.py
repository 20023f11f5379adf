"""How deep blocks are in each other does not depend on the triangles that draw them."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.assembly import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.overlap import Overlap, check_overlaps, find_overlaps
from geometry.polyhedra.polyhedron import polyhedron
from tests.support.drawn_blocks import Drawn, arch, cuboid, triangles_of

pytestmark = pytest.mark.quick


def _assembly(blocks: list[Drawn], seed: int = 0) -> PolyhedralAssembly:
    rng = np.random.default_rng(seed)
    solids = [polyhedron(str(k), one[0], triangles_of(one, rng)) for k, one in enumerate(blocks)]
    placed = [(solid, np.eye(3), np.zeros(3)) for solid in solids]
    return polyhedral_assembly("own blocks", placed, np.arange(len(blocks)) == 0)


def _only(assembly: PolyhedralAssembly) -> Overlap:
    (overlap,) = find_overlaps(assembly, assembly.tolerance)
    return overlap


@pytest.mark.parametrize("corner", [0, 4], ids=["front", "back"])
@pytest.mark.parametrize("seed", range(3))
def test_a_corner_pushed_into_the_next_voussoir_is_as_deep_as_it_was_pushed(corner, seed) -> None:
    blocks = arch(11)
    points, faces = blocks["V06"]
    corner += int(np.argmin(points[:4, 0] + points[:4, 2]))  # intrados, on the side of V05
    # The joint of V05 lies in the plane through the axis of the arch and its intrados edge.
    away = points[corner] * [1.0, 0.0, 1.0]
    normal = np.cross([0.0, 1.0, 0.0], away / np.linalg.norm(away))
    normal *= -np.sign(normal[0])
    points = points.copy()
    points[corner] += 5.0 * normal
    overlap = _only(_assembly([blocks["V05"], (points, faces)], seed))
    assert overlap.depth == pytest.approx(5.0, rel=1e-6)
    assert overlap.words == ""


@pytest.mark.parametrize(
    ("low", "depth"),
    [((0, 0, 48), 2.0), ((97, 40, 10), 3.0), ((30, 76, 20), 4.0)],
)
def test_boxes_are_as_deep_in_each_other_as_one_must_be_moved(low, depth) -> None:
    other = cuboid(low, np.add(low, [100, 80, 50]))
    for seed in range(3):
        overlap = _only(_assembly([cuboid((0, 0, 0), (100, 80, 50)), other], seed))
        assert overlap.depth == pytest.approx(depth, rel=1e-6)


def test_one_block_twice_and_a_cavity_drawn_as_a_block_are_named() -> None:
    outer = cuboid((0, 0, 0), (100, 80, 50))
    with pytest.raises(AssemblyError, match="one block that is there twice"):
        check_overlaps(_assembly([outer, cuboid((0, 0, 0), (100, 80, 50))]))
    with pytest.raises(AssemblyError, match="hollow block is one object of both surfaces"):
        check_overlaps(_assembly([outer, cuboid((20, 20, 20), (60, 50, 30))]))
