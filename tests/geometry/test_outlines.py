"""Blocks of a family fill a body that is known in closed form, and touch over a known area."""

from __future__ import annotations

import numpy as np
import pytest

from geometry import (
    Assembly,
    BrickStack,
    CircularArch,
    OsteomorphicWall,
    PlanarSineWall,
    RunningBondWall,
)
from geometry.assembly import interface_surface
from geometry.polyhedra.assembly import PolyhedralAssembly

pytestmark = pytest.mark.quick

#: Width, thickness, height and amplitude of the blocks of walls [mm].
WALL = (80.0, 40.0, 60.0, 5.0)
#: Walls with two columns and three layers, and by how much odd rows are moved over the width.
WALLS = {
    "one wave": (PlanarSineWall(*WALL, 0.5, columns=2, layers=3, divisions=(4, 2, 2)), 0.0),
    "two waves": (PlanarSineWall(*WALL, 1.0, 0.5, columns=2, layers=3, divisions=(8, 2, 3)), 0.5),
    "saddles": (OsteomorphicWall(*WALL, columns=2, layers=3, divisions=(4, 3, 2)), 0.5),
}


def bounds(blocks: Assembly | PolyhedralAssembly) -> list[float]:
    """Lowest and highest coordinates."""
    of = blocks.nodes if isinstance(blocks, Assembly) else blocks.points
    points = np.concatenate([of(block) for block in range(blocks.n_blocks)])
    return [*points.min(axis=0), *points.max(axis=0)]


@pytest.mark.parametrize("kind", WALLS)
def test_a_wall_fills_its_box_and_is_fixed_all_round(kind: str) -> None:
    """Waves cancel: a joint projects to its plane, a block has the volume of its brick."""
    stated, moved = WALLS[kind]
    width, thickness, height = WALL[:3]
    wall = stated.build()
    left, right = -2.0 * width, (2.0 + moved) * width
    box = [left, 0.0, -0.5 * height, right, thickness, 3.5 * height]
    assert bounds(wall) == pytest.approx(box, abs=1e-9)
    brick = width * thickness * height
    assert wall.volumes[~wall.fixed] == pytest.approx(6 * [brick], rel=1e-12)
    assert wall.volumes.sum() == pytest.approx(16.0 * brick, rel=1e-12)
    assert wall.fixed.sum() == 14
    for row in (wall.centroids[:, 2] // height == r for r in range(3)):
        order = np.argsort(wall.centroids[row, 0])
        assert wall.fixed[row][order].tolist() == [True, False, False, True]
    upward = np.abs(wall.interfaces.areas * wall.interfaces.normals[:, 2]).sum()
    assert upward == pytest.approx(4 * (4.0 - moved) * width * thickness, rel=1e-12)


def test_stacked_bricks_touch_over_their_beds_and_heads() -> None:
    stack = BrickStack((40.0, 30.0, 20.0), (4, 3, 2), columns=2, layers=1).build()
    assert bounds(stack) == pytest.approx([0.0, 0.0, -20.0, 80.0, 30.0, 40.0])
    assert stack.volumes == pytest.approx(6 * [24000.0])
    assert stack.interfaces.areas.sum() == pytest.approx(2 * 80.0 * 30.0 + 3 * 30.0 * 20.0)


def test_a_running_bond_wall_rests_on_all_its_beds() -> None:
    wall = RunningBondWall((200.0, 100.0, 80.0), 2, 3).build()
    assert bounds(wall) == pytest.approx([0.0, 0.0, -80.0, 400.0, 100.0, 240.0])
    assert wall.volumes.sum() == pytest.approx(4 * 400.0 * 100.0 * 80.0)
    # One head joint in a row of two bricks, two in the row between, which has halves at its ends.
    heads = (1 + 2 + 1) * 100.0 * 80.0
    assert wall.interfaces.areas.sum() == pytest.approx(3 * 400.0 * 100.0 + heads)


def test_voussoirs_fill_a_ring_of_flat_pieces() -> None:
    """Each is four pieces between chords: their area is that of triangles at the centre."""
    arch = CircularArch(1000.0, 200.0, 300.0, 5, 120.0).build()
    piece = np.radians(120.0 / 5 / 4)
    volume = 4 * 0.5 * (1100.0**2 - 900.0**2) * np.sin(piece) * 300.0
    assert arch.volumes == pytest.approx(7 * [volume], rel=1e-12)
    assert arch.interfaces.areas.sum() == pytest.approx(6 * 200.0 * 300.0, rel=1e-9)
    # The crown, and the outer corners of the fixed voussoirs, which reach 24 degrees lower.
    side = 1100.0 * np.sin(np.radians(84.0))
    low = 900.0 * np.cos(np.radians(84.0))
    assert bounds(arch) == pytest.approx([-side, 0.0, low, side, 300.0, 1100.0], rel=1e-9)


def test_contact_facets_lie_where_their_contacts_are(small_tube: Assembly) -> None:
    """Blocks of a tube are turned; also of facets that are asked for in another order."""
    interfaces = small_tube.interfaces
    for asked in (None, np.arange(interfaces.n_contacts)[::-7]):
        surface = interface_surface(small_tube, asked)
        corners = surface.nodes[surface.quads]
        vectors = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        expected = interfaces.areas[:, None] * interfaces.normals
        assert vectors == pytest.approx(expected[slice(None) if asked is None else asked], abs=1e-9)
