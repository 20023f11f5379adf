"""Frictionless blocks slide along the curved faces of a CAD model, whose triangles are no teeth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.files.block_files import gmsh_session, read_blocks
from geometry.loads import LoadCase
from geometry.polyhedra.assembly import polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from mbd import analyse

pytestmark = pytest.mark.quick


def _plug(occ: Any, make: Callable[[], int]) -> None:
    """A box of 200 x 100 x 100 mm with a hole, and the plug that fills it."""
    occ.cut([(3, occ.addBox(-100, -50, 0, 200, 100, 100))], [(3, make())])
    make()


def _half_cylinder(occ: Any) -> None:
    def make() -> int:
        rod = [(3, occ.addCylinder(0, -50, 100, 0, 100, 0, 40))]
        ((_, tag),), _ = occ.intersect(rod, [(3, occ.addBox(-40, -50, 0, 80, 100, 100))])
        return int(tag)

    _plug(occ, make)


def _cone(occ: Any) -> None:
    _plug(occ, lambda: int(occ.addCone(0, 0, 40, 0, 0, 60, 20, 35)))


def _dovetail(occ: Any) -> None:
    """Wider below than above, and ever faster narrower towards +y."""

    def make() -> int:
        wires = []
        for y, narrower in ((-50, 0.0), (0, 4.0), (50, 12.0)):
            low, high = 40.0 - narrower, 30.0 - narrower
            corners = [(-low, 50), (low, 50), (high, 100), (-high, 100)]
            points = [occ.addPoint(x, y, z) for x, z in corners]
            sides = [occ.addLine(points[k - 1], points[k]) for k in range(4)]
            wires.append(occ.addWire(sides))
        return int(occ.addThruSections(wires, makeSolid=True)[0][1])

    _plug(occ, make)


def _carried(path: Path, wrench: list[float]) -> bool:
    """Whether a force at a point of the z axis, and a moment, are carried."""
    hole, plug = sorted(read_blocks(path, element_size=15.0), key=lambda block: -block.volume)
    placed = [(block, np.eye(3), np.zeros(3)) for block in (hole, plug)]
    detection = DetectionOptions(tolerance=0.5)
    assembly = polyhedral_assembly("plug", placed, np.array([True, False]), detection)
    # Forces act on the axis of the cylinder, which resists no moment about it.
    moment = wrench[3:] + np.cross([0.0, 0.0, 100.0] - plug.centroid, wrench[:3])
    wrenches = np.array([np.zeros(6), [*wrench[:3], *moment]])
    load = LoadCase(assembly, "push", (), assembly.fixed, body_wrenches=wrenches)
    return bool(analyse(assembly, load=load).details.equilibrium.holds)


@pytest.mark.parametrize(
    ("draw", "wrench", "carried"),
    [
        (_half_cylinder, [0, 0, -1, 0, 0, 0], True),
        (_half_cylinder, [0, 0.05, -1, 0, 0, 0], False),  # along the groove
        (_half_cylinder, [0.05, 0, -1, 0, 0, 0], True),  # up its side
        (_cone, [0, 0, -1, 0, 0, 0], True),
        (_cone, [0, 0, 1, 0, 0, 0], False),
        (_cone, [0, 0, -1, 0, 0, 1], False),  # round its axis
        (_dovetail, [0, 1, 0, 0, 0, 0], True),
        (_dovetail, [0, -1, 0, 0, 0, 0], False),  # towards its wide end
        (_dovetail, [0, 1, 0.2, 0, 0, 0], True),
        (_dovetail, [0, 0, 1, 0, 0, 0], False),  # its sides turn the lift into a push out
    ],
)
def test_plugs_of_step_files_hold_what_their_surfaces_hold(
    draw: Callable[[Any], None], wrench: list[float], carried: bool, tmp_path: Path
) -> None:
    pytest.importorskip("gmsh", exc_type=ImportError)
    with gmsh_session("test") as gmsh:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "plug.step"))
    assert _carried(tmp_path / "plug.step", wrench) is carried


def test_a_half_cylinder_of_a_step_file_weighs_what_it_is(tmp_path: Path) -> None:
    pytest.importorskip("gmsh", exc_type=ImportError)
    with gmsh_session("test") as gmsh:
        _half_cylinder(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "plug.step"))
    plug = min(read_blocks(tmp_path / "plug.step", element_size=30.0), key=lambda b: b.volume)
    # OCC integrates to 1e-10; the triangles of 30 mm lack four per cent.
    assert plug.volume == pytest.approx(np.pi * 40.0**2 / 2 * 100.0, rel=1e-8)
    np.testing.assert_allclose(plug.centroid, [0.0, 0.0, 100 - 160 / (3 * np.pi)], atol=1e-6)
