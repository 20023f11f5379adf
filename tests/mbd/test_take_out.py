"""Ways out by hand: grooves, stops, thin plates, a puzzle, frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry import PolyhedralAssembly, convex_polyhedron
from geometry.families.masonry import box
from geometry.polyhedra.assembly import polyhedral_assembly
from mbd.building.sweeps import Sweeps
from mbd.building.take_out import TakeOut, direction_words, free_directions, take_out
from tests.support.assemblies import boxes, dovetail
from validation import load_case


def turned(blocks: PolyhedralAssembly, turn: np.ndarray) -> PolyhedralAssembly:
    """The same blocks, turned as a whole."""
    placed = [
        (blocks.shape(k), turn @ blocks.rotations[k], turn @ blocks.translations[k])
        for k in range(blocks.n_blocks)
    ]
    return polyhedral_assembly("turned", placed, blocks.fixed, names=blocks.names)


def outcome(found: TakeOut) -> list[tuple[tuple[int, ...], bool]]:
    return [(way.blocks, way.free) for way in found.each]


@pytest.mark.quick
def test_a_tail_slides_along_its_groove_only_and_for_its_length() -> None:
    assembly = dovetail()
    way = take_out(assembly).each[0]
    assert way.free
    assert way.direction is not None
    assert np.abs(way.direction) == pytest.approx([0.0, 1.0, 0.0])
    assert way.clear_after == pytest.approx(80.0)
    into_tail = assembly.interfaces.normals
    assert np.abs(free_directions(into_tail) @ [0.0, 1.0, 0.0]) == pytest.approx(1.0)


@pytest.mark.quick
def test_a_block_stops_at_what_is_in_its_way() -> None:
    """On a floor, below a ceiling, 30 mm from one wall and 50 from another, side walls touch."""
    floor = ((-100.0, 0.0, -20.0), (300.0, 100.0, 0.0))
    roof = ((-100.0, 0.0, 100.0), (300.0, 100.0, 120.0))
    walls = (((-50.0, 0.0, 0.0), (-30.0, 100.0, 100.0)), ((150.0, 0.0, 0.0), (170.0, 100.0, 100.0)))
    sides = (((-100, -20, -20), (300, 0, 120)), ((-100, 100, -20), (300, 120, 120)))
    assembly = boxes(floor, roof, *walls, *sides, ((0, 0, 0), (100, 100, 100)), fixed=6)
    found = take_out(assembly)
    (way,) = found.each
    assert not way.free
    assert way.direction == pytest.approx([1.0, 0.0, 0.0])
    # The block that moves is thinned by the clearance.
    assert way.distance == pytest.approx(50.0 + found.clearance, rel=1e-9)
    assert way.met == (3,)
    assert found.left == (6,)


@pytest.mark.quick
@pytest.mark.parametrize("where", [0.1, 17.3, 49.9])
def test_nothing_thin_is_passed_through(where: float) -> None:
    """A plate of a hundredth of a millimetre, and the edge and the tip of a wedge, far away."""
    block = ((0.0, 0.0, 0.0), (100.0, 100.0, 100.0))
    plate = ((where, where, 5000.0), (where + 0.01, where + 60.0, 5100.0))
    assembly = boxes(((0, 0, -20), (100, 100, 0)), plate, block, fixed=2)
    sweeps = Sweeps(assembly)
    up = np.array([0.0, 0.0, 1.0])
    met = sweeps.along(up, np.array([2]), np.array([1]))[0, 1]
    assert met == pytest.approx(4900.0 + sweeps.clearance, abs=1e-9)
    tip = np.array([(where + 20.0, where + 20.0, 700.0), (0, 0, 900), (90, 0, 900), (0, 90, 900)])
    spike = convex_polyhedron("spike", tip.astype(np.float64))
    placed = [(box((100.0, 100.0, 100.0)), np.eye(3), np.zeros(3)), (spike, np.eye(3), np.zeros(3))]
    pair = polyhedral_assembly("pair", placed, np.array([False, True]))
    sweeps = Sweeps(pair)
    met = sweeps.along(up, np.array([0]), np.array([1]))[0, 1]
    assert met == pytest.approx(600.0 + sweeps.clearance, abs=1e-9)


@pytest.mark.quick
def test_crossed_edges_meet_where_their_common_normal_says() -> None:
    """Two ridges at right angles, one above the other: neither has a corner near the other."""
    low = np.array([(x, y, z) for x, z in ((-50, 0), (50, 0), (0, 40)) for y in (-300, 300)])
    high = np.array([(x, y, z) for y, z in ((-50, 200), (50, 200), (0, 130)) for x in (-300, 300)])
    placed = [
        (convex_polyhedron(name, points.astype(np.float64)), np.eye(3), np.zeros(3))
        for name, points in (("low", low), ("high", high))
    ]
    sweeps = Sweeps(polyhedral_assembly("ridges", placed, np.array([False, True])))
    met = sweeps.along(np.array([0.0, 0.0, 1.0]), np.array([0]), np.array([1]))[0, 1]
    # The ridge sinks by the clearance over the cosine of its flanks, of slope 40 / 50.
    assert met == pytest.approx(90.0 + sweeps.clearance * np.hypot(1.0, 0.8), rel=1e-9)


@pytest.mark.quick
@pytest.mark.parametrize(
    ("fixed", "order"), [("A", [(3,), (2,), (1,)]), ("K", [(0, 1, 2), (2,), (1,)]), ("KA", [])]
)
def test_the_puzzle_comes_apart_in_its_order(fixed: str, order: list[tuple[int, ...]]) -> None:
    """K is the key. With K fixed the others leave it as one; with K and another none moves."""
    blocks = load_case("voxel-puzzle", {"assembly.fixed": fixed}, method="rigid").problem.blocks
    found = take_out(blocks)
    assert [way.blocks for way in found.order] == order
    assert (found.left == ()) == bool(order)
    assert (", 1 times several as one" in found.words) is ((0, 1, 2) in order)
    if (0, 1, 2) in order:
        pair = replace(found, order=(replace(found.order[0], blocks=(0, 1)),))
        assert ", 1 times several as one" in pair.words
    if order:
        assert found.assembly_order == tuple(reversed(order))


@pytest.mark.quick
def test_of_blocks_that_can_come_out_the_highest_is_next() -> None:
    """A block stops at a wall, nearer at another one: once that is out, it precedes a low one.

    What leaves neither touched it nor ended its longest way.
    """
    floor, roof = ((-100, 0, -20), (300, 100, 0)), ((-100, 0, 100), (300, 100, 120))
    sides = (((-100, -20, -20), (300, 0, 120)), ((-100, 100, -20), (300, 120, 120)))
    wall, base = ((150, 0, 0), (170, 100, 100)), ((-100, 0, -520), (300, 100, -500))
    free = (
        ((0, 0, 0), (100, 100, 100)),
        ((-80, 0, 0), (-30, 100, 100)),
        ((0, 0, -500), (50, 50, -450)),
    )
    found = take_out(boxes(floor, roof, *sides, wall, base, *free, fixed=6))
    assert [way.free for way in found.each] == [False, True, True]
    assert found.each[0].met == (4,)
    assert [way.blocks for way in found.order] == [(7,), (6,), (8,)]


def test_a_panel_comes_out_of_a_frame_without_one_rail_only() -> None:
    """And what comes out does not depend on how the panel is turned in space or numbered."""
    blocks = load_case("versatile-panel", method="rigid").problem.blocks
    whole = take_out(blocks)
    assert not whole.order
    assert len(whole.left) == len(blocks.free_blocks)
    side = blocks.fixed & (blocks.centroids[:, 0] > blocks.centroids[~blocks.fixed, 0].max())
    kept = np.flatnonzero(~side)
    placed = [(blocks.shape(k), blocks.rotations[k], blocks.translations[k]) for k in kept]
    open_ = polyhedral_assembly("open", placed, blocks.fixed[kept])
    found = take_out(open_)
    assert found.order
    rng = np.random.default_rng(64)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    again = take_out(turned(open_, turn))
    assert outcome(again) == outcome(found)
    assert len(again.left) == len(found.left)


@pytest.mark.quick
def test_directions_along_axes_have_words() -> None:
    words = {(0, 0, 1): "up", (0, 0, -1): "down", (1, 0, 0): "+x", (0, -1, 0): "-y"}
    assert [direction_words(np.array(way, dtype=float)) for way in words] == list(words.values())
    assert direction_words(np.array([0.6, 0.0, -0.8])) == "(0.600, 0.000, -0.800)"
