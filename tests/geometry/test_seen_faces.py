"""Faces that see each other without contact, and the tolerances that messages propose."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from geometry import Assembly, DetectionOptions, PolyhedralAssembly, RefusedError
from geometry.polyhedra.near_joints import facing_surfaces
from tests.support.drawn_blocks import cuboid

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("between", [0.0, 40.0, 100.0])
def test_a_brick_in_between_hides_what_is_behind_it(between: float) -> None:
    """Three courses of bricks 100 mm wide; the middle one is as wide as stated."""
    low, high = cuboid((0, 0, 0), (100, 50, 30)), cuboid((0, 0, 60), (100, 50, 90))
    blocks = {"low": low, "high": high}
    if between:
        blocks["middle"] = cuboid((0, 0, 30), (between, 50, 60))
    fixed = list(blocks) if between else ["low", "high"]
    blocks["free"] = cuboid((0, 0, 90), (100, 50, 120))
    assembly = Assembly.from_blocks(
        blocks.values(), names=list(blocks), fixed=fixed, detection=DetectionOptions(tolerance=0.4)
    )
    facing = facing_surfaces(assembly)
    touching = assembly.interfaces.patches.areas.sum()
    assert facing.area == pytest.approx(100.0 * 50.0)
    assert facing.missing == 0.0
    assert touching == pytest.approx(50.0 * (100.0 + 2.0 * between))
    free = replace(assembly, fixed=np.arange(len(blocks)) == 0)
    # Of 100 mm the middle brick hides its width; lines of sight sample the rest.
    facing = facing_surfaces(free)
    assert facing.missing == pytest.approx(50.0 * (100.0 - between), abs=0.12 * 5000.0)
    assert (facing.missing == 0.0) == (between == 100.0)


@pytest.mark.parametrize("gap", [0.001, 0.02, 0.3, 3.0, 6.0, 9.0, 20.0])
def test_tolerances_are_proposed_where_they_are_accepted(gap: float) -> None:
    """A brick above its support: what the message proposes is taken, and is enough."""
    bricks = cuboid((0, 0, 0), (100, 50, 30)), cuboid((0, 0, 30 + gap), (100, 50, 60 + gap))

    def placed(tolerance: float | None) -> PolyhedralAssembly:
        detection = DetectionOptions(tolerance=tolerance)
        return Assembly.from_blocks(bricks, fixed=0, detection=detection)

    length, message = (100.0 * 50.0 * 30.0) ** (1.0 / 3.0), ""
    try:
        placed(None)
    except RefusedError as error:
        message = str(error)
    assert bool(message) == (gap > 1e-4 * length)
    proposed = re.search(r"tolerance` = ([\d.]+)", message)
    if proposed is not None:
        wider = placed(float(proposed[1]))
        assert wider.interfaces.patches.areas.sum() == pytest.approx(5000.0)
    elif message:
        assert 10.0 * gap > 0.1 * length
