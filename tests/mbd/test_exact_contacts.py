"""Curved faces of CAD models touch by their exact shape, however coarse their facets are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem import Problem, concrete
from geometry.files.block_files import gmsh_session, read_blocks
from geometry.files.hexahedral_solids import with_hexahedra
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polyhedron import Polyhedron
from mbd import analyse

pytest.importorskip("gmsh", exc_type=ImportError)
pytestmark = pytest.mark.quick


def _read(path: Path, draw: Callable[[Any], Any], size: float | None = None) -> list[Polyhedron]:
    """Solids of a drawing, the largest one first."""
    with gmsh_session("test") as gmsh:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return sorted(read_blocks(path, element_size=size), key=lambda block: -block.volume)


def _drawn(
    path: Path,
    draw: Callable[[Any], Any],
    size: float | None = None,
    tolerance: float | None = None,
) -> PolyhedralAssembly:
    """Solids of a drawing; the largest one is fixed."""
    blocks = _read(path, draw, size)
    placed = [(block, np.eye(3), np.zeros(3)) for block in blocks]
    fixed, detection = np.arange(len(blocks)) == 0, DetectionOptions(tolerance=tolerance)
    return polyhedral_assembly("drawn", placed, fixed, detection)


def _plug(diameter: float, *, ball: bool = False) -> Callable[[Any], Any]:
    """A bore or a hollow of 50 mm, and what is put into it."""

    def solid(occ: Any, d: float) -> int:
        if ball:
            return int(occ.addSphere(0, 0, 0, d / 2))
        return int(occ.addCylinder(0, 0, -80, 0, 0, 80, d / 2))

    def draw(occ: Any) -> None:
        occ.cut([(3, occ.addBox(-60, -60, -80, 120, 120, 80))], [(3, solid(occ, 50.0))])
        solid(occ, diameter)

    return draw


def test_solids_keep_their_order_and_faces_when_their_file_is_gone(tmp_path) -> None:
    """Cylinders on each other, whose facets lie below the round face by their chords at most."""
    path, radii = tmp_path / "a.step", [30.0, 10.0, 20.0, 5.0]
    with gmsh_session("test") as gmsh:
        for k, radius in enumerate(radii):
            gmsh.model.occ.addCylinder(0, 0, 10.0 * k, 0, 0, 10.0, radius)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    blocks = read_blocks(path)
    path.unlink()
    assert [b.volume for b in blocks] == pytest.approx([10.0 * np.pi * r**2 for r in radii])
    for block, radius in zip(blocks, radii, strict=True):
        sides = block.corners[np.abs(block.normals[:, 2]) < 0.5][..., :2]
        middles = 0.5 * (sides + np.roll(sides, 1, axis=1))
        chord = radius - np.linalg.norm(middles, axis=2).min()
        assert 0.5 * chord < block.facet_errors[0].max() <= chord + 1e-9 * radius


@pytest.mark.parametrize("size", [None, 10.0])
@pytest.mark.parametrize("ball", [False, True])
def test_a_plug_that_fits_its_bore_touches_all_over(
    ball: bool, size: float | None, tmp_path
) -> None:
    """The area of its facets, but for those at the rim that lie beside the other face."""
    assembly = _drawn(tmp_path / "a.step", _plug(50.0, ball=ball), size)
    check_assembly(assembly)
    bore, patches = assembly.shape(0), assembly.interfaces.patches
    facets = bore.areas[bore.facet_errors[0] > 0.0].sum()
    exact = 2.0 * np.pi * 25.0**2 if ball else np.pi * 50.0 * 80.0
    assert 0.93 * facets <= patches.areas.sum() <= exact
    assert np.abs(patches.gaps).max() <= 1e-9
    points, normals = assembly.interfaces.centroids, assembly.interfaces.normals
    arms = points - [0.0, 0.0, 0.0] if ball else points * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(np.linalg.norm(arms, axis=1), 25.0, atol=1e-6)
    np.testing.assert_allclose(normals, -arms / 25.0, atol=1e-6)


@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize("wider", [0.04, 0.4, 2.0])
def test_a_plug_that_is_too_wide_overlaps_by_what_it_is_wider(
    wider: float, ball: bool, tmp_path: Path
) -> None:
    assembly = _drawn(tmp_path / "a.step", _plug(50.0 + wider, ball=ball))
    with pytest.raises(AssemblyError, match=f"overlap by {wider / 2:.3g} mm"):
        check_assembly(assembly)


@pytest.mark.parametrize("lower", [-0.1, 0.0, 0.1])
def test_a_ball_touches_a_plane_at_one_point(lower: float, tmp_path: Path) -> None:
    def draw(occ: Any) -> None:
        occ.addBox(-60, -60, -60, 120, 120, 60)
        occ.addSphere(3.0, 4.0, 25.0 - lower, 25.0)

    assembly = _drawn(tmp_path / "a.step", draw)
    if lower:
        with pytest.raises(
            AssemblyError, match="overlap by 0.1 mm" if lower > 0.0 else "touches no"
        ):
            check_assembly(assembly)
        return
    check_assembly(assembly)
    contacts = assembly.interfaces
    n = contacts.n_contacts
    np.testing.assert_allclose(contacts.centroids, [[3.0, 4.0, 0.0]] * n, atol=1e-6)
    np.testing.assert_allclose(contacts.normals, [[0.0, 0.0, 1.0]] * n, atol=1e-6)
    # Gaps of a sphere are within the tolerance up to √(2 R t) from the point.
    largest = np.pi * 2.0 * 25.0 * assembly.tolerance
    assert contacts.patches.areas.sum() <= largest


def _cone(occ: Any) -> int:
    return int(occ.addCone(0, 0, -50, 0, 0, 80, 10, 42))


def _cone_in_its_hole(occ: Any) -> None:
    occ.cut([(3, occ.addBox(-50, -50, -50, 100, 100, 50))], [(3, _cone(occ))])
    _cone(occ)


def _unmatched(solids: PolyhedralAssembly) -> tuple[Any, ...] | None:
    return with_hexahedra(solids, 2, None, lambda _: np.zeros(0, dtype=np.int64)).unmatched


@pytest.mark.parametrize("draw", [_plug(50.0, ball=True), _cone_in_its_hole])
def test_curved_faces_that_fit_get_one_mesh(draw: Callable[[Any], Any], tmp_path: Path) -> None:
    """The ball and the cone rise above the hollow: what coincides is a part of their faces."""
    assert _unmatched(_drawn(tmp_path / "a.step", draw)) == ()


def test_facets_of_two_files_that_overlap_are_told_from_solids_that_do(tmp_path: Path) -> None:
    """Facets of a file each do not match; solids that overlap indeed are said to."""
    hollow = _read(tmp_path / "a.step", _plug(50.0, ball=True))[0]
    for radius, words in ((25.0, "draw both solids in place in one"), (25.4, "by 0.4 mm .* move")):
        ball = _read(tmp_path / "b.step", lambda occ, r=radius: occ.addSphere(0, 0, 0, r))
        placed = [(block, np.eye(3), np.zeros(3)) for block in (hollow, *ball)]
        solids = polyhedral_assembly("drawn", placed, np.array([True, False]), DetectionOptions())
        with pytest.raises(AssemblyError, match=words):
            _unmatched(solids)


@pytest.mark.parametrize("size", [None, 40.0])
@pytest.mark.parametrize("tolerance", [None, 0.2])
def test_three_cylinders_need_the_friction_of_their_lines(
    size: float | None, tolerance: float | None, tmp_path: Path
) -> None:
    """Two on a floor that carry a third: μ = tan 15°, whatever the facets and the tolerance.

    Moments about the axis of a lower cylinder make the tangential forces at the floor and at the
    upper one equal, T; horizontally T = N sin 30° - T cos 30°. The floor presses more than N.
    """

    def draw(occ: Any) -> None:
        occ.addBox(-400, 0, -50, 800, 200, 50)
        for x, z in ((-100.0, 100.0), (100.0, 100.0), (0.0, 100.0 + 100.0 * 3.0**0.5)):
            occ.addCylinder(x, 0, z, 0, 200, 0, 100)

    assembly = _drawn(tmp_path / "a.step", draw, size, tolerance)
    check_assembly(assembly)
    needed = np.tan(np.radians(15.0))
    for factor, carried in ((0.995, False), (1.005, True)):
        problem = Problem(
            assembly, None, concrete, gravity=(0, 0, -9810), friction=float(factor * needed)
        )
        assert analyse(problem).details.holds is carried
