"""Laws of the hexagon-based block: conforming tubes, closed surfaces, known volume."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry import HexagonBlock
from geometry.families.hexagon_block import HexagonBlockDivisions, hexagon_block
from geometry.families.tube import HexagonTube

pytestmark = pytest.mark.quick

THB0 = HexagonBlock(blocks_per_layer=4, inner_radius=120.0, thickness=40.0)


@given(
    n=st.integers(4, 9),
    radius=st.floats(20.0, 500.0),
    slenderness=st.floats(0.3, 1.0),
    halves=st.integers(2, 4),
    layers=st.integers(1, 4),
)
@settings(max_examples=25, deadline=None)
def test_every_edge_facet_of_every_free_block_meets_its_twin(
    n: int, radius: float, slenderness: float, halves: int, layers: int
) -> None:
    block = HexagonBlock(n, radius, slenderness * radius)
    tube = HexagonTube(block, HexagonBlockDivisions(2 * halves, 2), layers).build()
    found = tube.interfaces  # raises AssemblyError where a facet of a free block is alone
    # Two sloping joints per block between layers, one upright joint per free block and half
    # a one per frame block.
    facets = 2 * halves * 2
    assert found.n_contacts == facets * n * (2 * (layers + 1) + layers + 1)


def test_surface_is_closed_and_congruent_sides_oppose() -> None:
    tube = HexagonTube(THB0, HexagonBlockDivisions(6, 4), 2).build()
    for shape in tube.shapes:
        total = sum(shape.surface(name).area_vectors.sum(axis=0) for name in shape.faces)
        area = sum(shape.surface(name).areas.sum() for name in shape.faces)
        # Sums of some hundred facets of up to 1e3 mm² each: round-off of 1e-16 each.
        assert np.abs(total).max() < 1e-13 * area
    found = tube.interfaces
    arm = tube.centroids[found.block_s] - tube.centroids[found.block_m]
    mean = np.add.reduceat(found.normals * found.areas[:, None], found.pair_start[:-1])
    assert (np.einsum("ci,ci->c", mean, arm[found.pair_start[:-1]]) > 0).all()


def test_volume_of_the_block_is_that_of_the_straight_hexagon() -> None:
    # What one edge bulges out its neighbour bulges in, so at radius r the block's area is the
    # hexagon's times r/r_i: V = A t (r_i + t/2)/r_i. Chords instead of circles between nodes lose
    # (Δθ)²/6 of it: two meshes extrapolate (order 2) to the closed form.
    exact = 1.5 * np.sqrt(3) * THB0.circumradius**2 * 40.0 * (140.0 / 120.0)
    volumes = [hexagon_block(THB0, HexagonBlockDivisions(m, 4)).volume for m in (8, 16)]
    errors = [1 - v / exact for v in volumes]
    assert errors[0] < (2 * np.pi / 4 / 8) ** 2 / 6 * 1.5
    assert 3.5 < errors[0] / errors[1] < 4.5
    # The remainder after extrapolation is of fourth order, (Δθ)⁴ ~ 1.5e-3 at the coarse mesh.
    assert abs((4 * volumes[1] - volumes[0]) / 3 / exact - 1) < 1e-4


def test_frames_are_flat_and_fixed() -> None:
    tube = HexagonTube(THB0, HexagonBlockDivisions(4, 2), 3).build()
    bottom, top = tube.shapes[1].surface("bottom"), tube.shapes[2].surface("top")
    np.testing.assert_allclose(
        bottom.normals, np.tile([0, 0, -1.0], (bottom.n_facets, 1)), atol=1e-12
    )
    np.testing.assert_allclose(top.normals, np.tile([0, 0, 1.0], (top.n_facets, 1)), atol=1e-12)
    assert tube.fixed.sum() == 8
    height = np.ptp(np.concatenate([tube.nodes(b)[:, 2] for b in range(tube.n_blocks)]))
    assert height == pytest.approx(4 * THB0.layer_pitch, rel=1e-14)
