"""How deep blocks are in each other does not depend on the triangles that draw them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.families.masonry import voussoir
from geometry.files.named_surfaces import by_corners
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.overlap import (
    Overlap,
    SignedDistance,
    check_overlaps,
    find_overlaps,
    penetration,
)
from geometry.polyhedra.polygons import surface_of_polygons
from geometry.polyhedra.polyhedron import Polyhedron, polyhedron
from tests.support.blocks import random_rotation
from tests.support.drawn_blocks import Drawn, arch, cuboid, triangles_of

pytestmark = pytest.mark.quick


def _assembly(blocks: list[Drawn], seed: int | None = 0) -> PolyhedralAssembly:
    """Faces cut into triangles at random; without a seed as files are, concave ones too."""
    if seed is None:
        solids = [
            polyhedron("", *surface_of_polygons("", points, by_corners(map(list, faces))))
            for points, faces in blocks
        ]
    else:
        rng = np.random.default_rng(seed)
        solids = [polyhedron("", one[0], triangles_of(one, rng)) for one in blocks]
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
    assembly = _assembly([blocks["V05"], (points, faces)], seed)
    overlap = _only(assembly)
    # The push turned round separates them; no less does, but by what the tilted faces give way.
    assert 5.0 - assembly.tolerance <= overlap.depth <= 5.0 * (1.0 + 1e-9)
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


def _prism(outline: list[tuple[float, float]], depth: float = 300.0) -> Drawn:
    """Prism along y over an outline in x and z, clockwise seen against y."""
    n = len(outline)
    points = np.array([(x, y, z) for y in (0.0, depth) for x, z in outline])
    sides = [[k, k + n, (k + 1) % n + n, (k + 1) % n] for k in range(n)]
    return points, [[*range(n)], [*range(2 * n - 1, n - 1, -1)], *sides]


_STONES = (
    [
        *((357.623, 949.709), (364.047, 896.419), (530.335, 824.134), (644.656, 927.399)),
        *((645.972, 971.562), (500.329, 1090.214)),
    ],
    [
        *((489.116, 1199.959), (500.313, 1090.128), (645.956, 971.475), (760.827, 1091.906)),
        (764.267, 1199.959),
    ],
)
#: Pairs that a translation separates, with one that does [mm].
_PAIRS = {
    "slivers": ([_prism(list(one)) for one in _STONES], 0.078),
    "rims": (
        [cuboid((0, 0, 0), (100, 300, 100)), cuboid((-0.03, 0, 99.95), (99.97, 300, 200))],
        0.05,
    ),
    "wedges": (
        [
            _prism([(0, 0), (0, 50), (50, 60), (100, 50), (100, 0)]),
            _prism([(10, 120), (90, 120), (50, 57)], 250.0),
        ],
        3.0,
    ),
}


@pytest.mark.parametrize("pair", _PAIRS)
def test_no_translation_shorter_than_the_depth_separates_blocks(pair: str) -> None:
    """Along 200 ways a translation shorter by four tolerances leaves them deeper than one."""
    blocks, enough = _PAIRS[pair]
    assembly = _assembly(blocks, None)
    overlap, tolerance = _only(assembly), assembly.tolerance
    assert 0.0 < overlap.depth <= enough * (1.0 + 1e-9)
    less = overlap.depth - 4.0 * tolerance
    a, b = assembly.shapes
    distances = SignedDistance(a), SignedDistance(b)
    for way in np.random.default_rng(7).normal(size=(200, 3)):
        motion = np.eye(3), max(less, 0.0) * way / np.linalg.norm(way)
        assert penetration(a, b, motion, tolerance, distances)[0] > tolerance


def test_wavy_beds_are_as_deep_as_one_was_lowered() -> None:
    """Both flanks of a wave bar the way along any facet's normal: only the way up is free."""
    x = np.linspace(0.0, 200.0, 81)
    wave = (20.0 * np.cos(2.0 * np.pi * x / 50.0)).tolist()
    bed = list(zip(x.tolist(), wave, strict=True))
    low = [(0.0, -100.0), *bed, (200.0, -100.0)]
    high = [*((a, b - 0.57) for a, b in bed[::-1]), (0.0, 100.0), (200.0, 100.0)]
    assembly = _assembly([_prism(low, 80.0), _prism(high, 80.0)], None)
    overlap = _only(assembly)
    assert overlap.depth == pytest.approx(0.57, abs=assembly.tolerance)


def test_a_dovetail_that_is_too_wide_is_not_as_deep_as_it_is_long() -> None:
    """No short translation separates what is held all round: the deepest point counts."""
    socket = [(-60, 0), (60, 0), (60, 60), (15, 60), (25, 35), (-25, 35), (-15, 60), (-60, 60)]
    tail = [(-15.2, 60), (-25.2, 35.1), (25.2, 35.1), (15.2, 60), (15.2, 110), (-15.2, 110)]
    blocks = [_prism([(float(x), float(z)) for x, z in one[::-1]], 80.0) for one in (socket, tail)]
    # A flank is 0.2 mm too far out, and leans by arctan 0.4.
    overlap = _only(_assembly(blocks, None))
    assert overlap.depth == pytest.approx(0.2, rel=0.2)


class _Round:
    """Exact faces of a voussoir: those of its triangles whose corners lie on one circle."""

    def __init__(self, drawn: Polyhedron, middle: float) -> None:
        radii = np.linalg.norm(drawn.points[drawn.triangles][..., [0, 2]], axis=-1)
        self.extent = drawn.volume, drawn.centroid
        self._curved = np.ptp(radii, axis=1) < 1e-9
        self._radius, self._outward = radii[:, 0], np.sign(radii[:, 0] - middle)

    def on(self, points: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
        away = points * [1.0, 0.0, 1.0]
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        foot = self._radius[triangles, None] * away + points * [0.0, 1.0, 0.0]
        return foot, self._outward[triangles, None] * away

    def together(self, triangles: IntArray) -> BoolArray:
        same = np.ptp(self._radius[triangles], axis=1) < 1e-9
        return np.asarray(self._curved[triangles].all(axis=1) & same)

    def curved(self, triangles: IntArray) -> BoolArray:
        return np.asarray(self._curved[triangles])


@pytest.mark.parametrize("step", [1, -1], ids=["outer first", "inner first"])
@pytest.mark.parametrize("depth", [0.0, 2.0])
def test_round_blocks_are_as_deep_as_they_are_pushed_whatever_facets_draw_them(depth, step) -> None:
    """One ring in another: facets are up to 14 mm in each other where they only touch."""
    outer = voussoir(1050.0, 100.0, 300.0, 1.0, pieces=3)
    inner = voussoir(950.0, 100.0, 280.0, 1.0, pieces=4)  # narrower: its corners are inside
    shapes = [replace(b, exact=_Round(b, r)) for b, r in ((outer, 1050.0), (inner, 950.0))]
    # Away from the origin, turned; the inner one is pushed outward at half of its angle.
    turn, where = random_rotation(3), np.array([3000.0, -200.0, 700.0])
    push = turn @ [depth * np.cos(0.5), 0.0, depth * np.sin(0.5)]
    placed = [(shapes[0], turn, where), (shapes[1], turn, where + push)]
    rings = polyhedral_assembly("rings", placed[::step], np.arange(2) == 0)
    found = find_overlaps(rings, 0.1)
    # At that angle corners of the inner one are: no point is deeper.
    assert [overlap.depth for overlap in found] == pytest.approx([depth] if depth else [], abs=1e-6)
