"""Facets and sections that pictures draw."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.answers import on_its_mesh
from tests.support.own_blocks import column
from validation.output.pictures.sections import section
from validation.output.pictures.tubes import STRESSES, extreme, run_facets, section_heights

PRESSURE = 0.5


@pytest.mark.parametrize("degree", [1, 2])
def test_joints_are_drawn_in_pieces_of_a_uniform_pressure(degree: int) -> None:
    """Joints of 100 × 80 mm²; of higher degree a facet is drawn in more than one piece."""
    run = on_its_mesh(column(PRESSURE).changed({"fem.degree": degree}), method="static")
    drawn = run_facets(run)
    np.testing.assert_allclose(drawn.pressures, PRESSURE, rtol=1e-7)
    corners = drawn.corners.reshape(-1, 4, 3)
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert 0.5 * np.linalg.norm(across, axis=1).sum() == pytest.approx(2 * 8000.0, rel=1e-4)
    assert not drawn.scale.note
    assert (len(run.details.contact_state.pressures) < len(drawn.pressures)) == (degree > 1)


def test_sections_lie_in_the_layer_that_they_name() -> None:
    """Hexagon tubes: layers reach into each other, so layer k is not between (k-1)h and kh."""
    small = ["mesh.edge=4", "mesh.radial=1", "assembly.layers=1"]
    run = on_its_mesh("thb0-tunnel", small, method="static")
    assembly = run.details.deformable.assembly
    along = np.concatenate([assembly.nodes(b) for b in assembly.free_blocks]) @ assembly.axis
    heights = section_heights(run.details)
    assert along.min() < heights[0]
    assert heights[-1] < along.max()
    # One height above and below the middle each, by the symmetry of the hexagon.
    assert heights[0] + heights[-1] == pytest.approx(along.min() + along.max(), abs=1e-3)
    assert all(len(section(run.details, z).triangles) for z in heights)


def test_rings_of_stresses_lie_in_the_block_and_the_section_that_the_table_names() -> None:
    small = ["mesh.around=12", "mesh.radial=1", "mesh.axial=4", "assembly.layers=1"]
    run = on_its_mesh("tsb1-pipe", small, method="static")
    blocks = run.details.deformable
    for stress in STRESSES:
        place = run[stress.measure].place
        assert place is not None
        mark = extreme(run, stress)
        (block,) = place["blocks"]
        assert f"block {block}" in mark.words
        node = np.linalg.norm(blocks.positions(block) - mark.point, axis=1).argmin()
        values = stress.sign * stress.of(run.details.principal(block))
        assert values[node] == values.max()
        cut = section(run.details, round(place["position"][2], 1))
        near = np.linalg.norm(cut.points - place["position"][:2], axis=1).min()
        assert near < 0.5 * blocks.drawn.characteristic_length
