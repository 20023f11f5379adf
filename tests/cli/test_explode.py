"""The paper's claim: the Sine Block's tube does not explode, the hexagon-based block's does."""

from __future__ import annotations

import numpy as np
import pytest

from geometry import BrickStack, HexagonBlock
from geometry.families.hexagon_block import HexagonBlockDivisions
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import HexagonTube, SineTube
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import as_polyhedral
from tests.support.blocks import tsb
from tests.support.commands import answered, set_words
from validation import load_case, solve
from validation.output.explosion import (
    FirstOrderExplosion,
    first_order_explosion,
    follow_explosion,
    outward_directions,
)

HEXAGONS = HexagonTube(HexagonBlock(4, 120.0, 40.0), HexagonBlockDivisions(6, 3), 1).build()
SINES = SineTube(tsb(), SineBlockDivisions(24, 3, 4), 1).build()


def test_hexagon_tube_explodes_and_sine_tube_does_not_to_first_order() -> None:
    opened = first_order_explosion(HEXAGONS, outward_directions(HEXAGONS))
    assert opened.admissible
    assert opened.closing_area_percent == 0.0
    closed = first_order_explosion(SINES, outward_directions(SINES))
    assert not closed.admissible
    assert closed.smallest_gap_rate < -0.5


def test_a_plain_ring_opens_its_radial_joints_and_slides_between_layers() -> None:
    # Blocks of a ring of four move apart: the joint between neighbours, at 45° to both motions,
    # opens by 2 sin 45°; horizontal joints slide.
    ring = SineTube(tsb(amplitude=0.0), SineBlockDivisions(12, 2, 2), 1).build()
    found = first_order_explosion(ring, outward_directions(ring))
    assert found.admissible
    areas, normals = ring.interfaces.areas, ring.interfaces.normals
    radial = np.abs(normals[:, 2]) < 0.5
    assert found.opening_area_percent == pytest.approx(100 * areas[radial].sum() / areas.sum())
    assert found.smallest_gap_rate == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_finite_motion_starts_as_first_order_says() -> None:
    surfaces, outward = as_polyhedral(SINES), outward_directions(SINES)
    rate = -first_order_explosion(SINES, outward).smallest_gap_rate
    found = follow_explosion(surfaces, outward, np.array([0.01, 20.0]), tolerance=0.005)
    # The deepest overlap grows with the fastest-closing contact; vertices are steeper or flatter
    # than the facet centroids of the first-order answer by the change over half a facet, 15 %.
    assert found.depths[0] == pytest.approx(0.01 * rate, rel=0.15)
    assert found.free_distance == pytest.approx(0.005 / rate, rel=0.2)
    assert found.depths[1] > 5.0
    hexagons = as_polyhedral(HEXAGONS)
    free = follow_explosion(
        hexagons, outward_directions(HEXAGONS), np.array([1.0, 40.0]), tolerance=0.005
    )
    assert free.first_overlap is None
    assert free.free_distance == 40.0


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_scenes_explode_or_not() -> None:
    for name, settings, explodes in (
        ("thb0-pipe", ["mesh.edge=6", "mesh.radial=3"], True),
        ("tsb2-pipe", ["mesh.around=24", "mesh.radial=3", "mesh.axial=4"], False),
    ):
        words = set_words((*settings, "assembly.layers=4"))
        run = answered("mbd", name, *words, "--disassemble")[0]["disassembly"]
        assert run["explodes"] == explodes
        assert run["first_order"]["admissible"] == explodes
        held = solve(load_case(name, [*settings, "assembly.layers=4"], method="rigid"))
        assert held.report["mechanism"] == ("activated" if explodes else "locked")


def test_what_is_no_tube_is_refused() -> None:
    with pytest.raises(AssemblyError, match="not a tube"):
        outward_directions(BrickStack((1.0, 1.0, 1.0), (1, 1, 1), columns=2, layers=1).build())


@pytest.mark.parametrize("rate", [-0.5, -1e-3, 0.0, 0.5])
def test_an_explosion_is_admissible_where_no_contact_closes(rate: float) -> None:
    explosion = FirstOrderExplosion(
        smallest_gap_rate=rate,
        closing_area_percent=0.0,
        opening_area_percent=0.0,
        push=None,  # type: ignore[arg-type]
    )
    assert explosion.admissible == (rate >= 0.0)
