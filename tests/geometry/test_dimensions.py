"""Dimensions of blocks against closed forms: boxes, tetrahedra, Sine Blocks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.integrate

from geometry import SineBlock, tube
from geometry.families.boxes import BrickStack
from geometry.families.masonry import CircularArch
from geometry.files.hexahedral_solids import with_hexahedra
from geometry.parts.dimensions import dimensions, least_wall
from geometry.polyhedra.polyhedron import Polyhedron
from tests.support.coarse_tubes import coarse
from tests.support.commands import set_words


@pytest.mark.quick
@pytest.mark.parametrize("around", [12, 48])
@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_dimensions_of_a_sine_block_are_those_of_its_exact_shape(around: int, shift: float) -> None:
    """Whatever the mesh: a sector of a ring, waves above as below, joints that a free block has."""
    block = SineBlock(
        height=200,
        amplitude=20,
        frequency=1.5,
        shift=shift,
        blocks_per_layer=4,
        inner_radius=120,
        thickness=40,
    )
    found = dimensions(tube(block, layers=2, mesh=(around, 2, 2)), 2.4e-9)
    step = block.block_angle / around
    # Between facets, which are chords: what the mesh has of the wall, to round-off.
    wall = block.thickness * math.cos(step / 2.0)
    assert found.least_wall == pytest.approx(wall, rel=1e-12)
    assert math.tan(math.radians(found.steepest_joint)) == pytest.approx(
        block.steepest_slope, rel=1e-9
    )
    ring = math.pi * (block.outer_radius**2 - block.inner_radius**2) * block.height
    assert found.volume == pytest.approx(2.0 * ring, rel=1e-9)
    assert found.mass == pytest.approx(2.4e-9 * found.volume, rel=1e-12)
    assert found.volume == pytest.approx(8 * found.block_volume[0], rel=1e-12)
    sides = 2 * 4 * block.thickness * block.height
    beds = 3 * 4 * _wavy_bed(block)
    assert found.contact_area == pytest.approx(sides + beds, rel=1e-7)


def _wavy_bed(block: SineBlock) -> float:
    """Area of the bed of one block [mm²], by an adaptive rule."""
    waves = block.waves_per_block * block.blocks_per_layer

    def stretch(angle: float, r: float) -> float:
        phase = waves * angle + math.pi * block.shift
        height = block.amplitude * (r - block.inner_radius) / block.thickness
        along = height * waves * math.cos(phase) / r
        across = block.amplitude / block.thickness * math.sin(phase)
        return r * math.sqrt(1.0 + along**2 + across**2)

    area, _ = scipy.integrate.dblquad(
        stretch, block.inner_radius, block.outer_radius, 0.0, block.block_angle, epsrel=1e-9
    )
    return float(area)


@pytest.mark.quick
def test_bricks_are_as_thick_as_their_shortest_side() -> None:
    blocks = BrickStack((60.0, 40.0, 20.0), (2, 2, 2), columns=2, layers=2).build()
    found = dimensions(blocks)
    assert found.least_wall == pytest.approx(20.0, rel=1e-12)
    assert found.mass is None
    joints = blocks.interfaces
    held = blocks.fixed[joints.block_m] & blocks.fixed[joints.block_s]
    assert held.any()
    assert found.contact_area == pytest.approx(joints.areas[~held].sum(), rel=1e-12)


@pytest.mark.quick
@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_faces_that_meet_at_an_edge_are_no_wall(angle: float) -> None:
    """Of a slab with a sharp wedge, the thickness; of a tetrahedron, none."""
    wedge = np.array([[0, 0], [100, 0], [160, 30], [0, 30]], dtype=float)
    points = np.array([[x, y, z] for y in (0, 80) for x, z in wedge], dtype=float)
    sides = [[k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4] for k in range(4)]
    quads = [[3, 2, 1, 0], [4, 5, 6, 7], *sides]
    triangles = np.array([t for a, b, c, d in quads for t in ([a, c, b], [a, d, c])])
    turn = np.array(
        [[math.cos(angle), 0, -math.sin(angle)], [0, 1, 0], [math.sin(angle), 0, math.cos(angle)]]
    )
    assert least_wall(Polyhedron("slab", points @ turn.T, triangles)) == pytest.approx(30.0)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    solid = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    assert math.isinf(least_wall(Polyhedron("tetrahedron", corners, solid)))


def test_limits_are_compared_and_counted(tubelock) -> None:
    small = coarse(1, 2)
    words = set_words((*small, "limits.least_wall=50"))
    status, out, _ = tubelock("mbd", "tsb1-pipe", *words)
    assert status == 0
    assert "TOO THIN, limits.least_wall is 50 mm" in out
    assert "limits" not in out.partition("ignored")[2]


@pytest.mark.parametrize("angle", [4.5, 24.0])
def test_the_least_wall_of_a_voussoir_does_not_depend_on_the_method(angle: float) -> None:
    """From the inner edge of one joint along its normal to the other, or between the chords."""
    solids, phi = CircularArch(1000.0, 110.0, 300.0, 2, 2 * angle).build(), math.radians(angle)
    exact = min(945.0 * math.tan(phi), 110.0 * math.cos(phi / 8.0))
    assert dimensions(solids).least_wall == pytest.approx(exact, rel=1e-9)
    filled = with_hexahedra(solids, 4, 150.0, lambda _: np.zeros(0, dtype=np.int64))
    assert dimensions(filled).least_wall == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize(("embrace", "voussoirs"), [(180.0, 40), (24.0, 2), (120.0, 5)])
def test_the_row_on_flat_pieces_says_what_an_arch_weighs_less(
    embrace: float, voussoirs: int
) -> None:
    arch = CircularArch(1000.0, 110.0, 300.0, voussoirs, embrace)
    _, less = arch.flat_pieces
    exact = np.radians(embrace) / voussoirs * 1000.0 * 110.0 * 300.0
    assert arch.build().shape(1).volume == pytest.approx(exact * (1.0 + less), rel=1e-9)
