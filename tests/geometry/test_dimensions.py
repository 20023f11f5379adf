"""Dimensions of blocks against closed forms: boxes, tetrahedra, Sine Blocks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geometry import SineBlock, tube
from geometry.families.boxes import BrickStack
from geometry.parts.dimensions import dimensions, least_wall
from geometry.polyhedra.polyhedron import Polyhedron

AROUND = 48


@pytest.mark.quick
def test_a_sine_block_is_as_thick_and_as_steep_as_stated() -> None:
    """Facets are chords: of the wall by their sagitta, of the waves by sin(x)/x."""
    block = SineBlock(
        height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
    )
    blocks = tube(block, layers=2, mesh=(AROUND, 2, 2))
    found = dimensions(blocks, 2.4e-9)
    step = block.block_angle / AROUND
    sagitta = block.outer_radius * (1.0 - math.cos(step / 2.0))
    assert block.thickness - sagitta <= found.least_wall <= block.thickness
    wave = math.tau * block.waves_per_block / AROUND  # phase of an edge; nodes lie at zeros
    slope = math.tan(math.radians(found.steepest_joint))
    assert slope >= block.steepest_slope * math.sin(wave) / wave
    assert slope <= block.steepest_slope * (step / 2.0) / math.sin(step / 2.0) / math.cos(step)
    assert found.mass == pytest.approx(2.4e-9 * found.volume, rel=1e-12)
    assert found.volume == pytest.approx(8 * found.block_volume[0], rel=1e-12)


@pytest.mark.quick
def test_bricks_are_as_thick_as_their_shortest_side() -> None:
    blocks = BrickStack((60.0, 40.0, 20.0), (2, 2, 2), columns=2, layers=2).build()
    found = dimensions(blocks)
    assert found.least_wall == pytest.approx(20.0, rel=1e-12)
    assert found.mass is None
    assert found.contact_area == pytest.approx(blocks.interfaces.areas.sum(), rel=1e-12)


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
    small = ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2")
    words = [w for s in (*small, "limits.least_wall=50") for w in ("--set", s)]
    status, out, _ = tubelock("mbd", "tsb1-pipe", *words)
    assert status == 0
    assert "TOO THIN, limits.least_wall is 50 mm" in out
    assert "limits" not in out.partition("ignored")[2]
