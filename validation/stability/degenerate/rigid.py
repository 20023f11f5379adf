"""Degenerate contact: edges, points, spikes, facets of any size, each with an answer by hand."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.families.masonry import box
from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.overlap import check_assembly
from geometry.polyhedra.polyhedron import Polyhedron, convex_polyhedron
from mbd import RigidSystem, analyse
from validation.stability.case import CaseVerdict, case, case_verdict
from validation.stability.problems import relative_difference

_EYE = np.eye(3)
#: Forces of a few contacts: round-off, times the condition of the groove at hand.
_ROUND_OFF = 1e-9

Placed = tuple[Polyhedron, FloatArray, FloatArray]


def _at(shape: Polyhedron, x: float, y: float, z: float, turn: FloatArray = _EYE) -> Placed:
    return shape, turn, np.array([x, y, z])


def _prism(corners: list[tuple[float, float]], length: float) -> Polyhedron:
    """Solid of corners (x, z) along y."""
    ends = (-length / 2, length / 2)
    return convex_polyhedron("prism", [(x, y, z) for y in ends for x, z in corners])


#: Its edge lies along y at the origin, and it opens upward.
_WEDGE = _prism([(0.0, 0.0), (30.0, 60.0), (-30.0, 60.0)], 100.0)


def _pressed(
    placed: list[Placed], force: FloatArray, point: FloatArray | None = None, held: int = 1
) -> tuple[PolyhedralAssembly, RigidSystem]:
    """Analyse bodies of which the first are held, the last pushed by a force at a point."""
    fixed = np.arange(len(placed)) < held
    assembly = polyhedral_assembly("degenerate", placed, fixed)
    check_assembly(assembly)
    wrenches = np.zeros((len(placed), 6))
    wrenches[-1, :3] = force
    if point is not None:
        wrenches[-1, 3:] = np.cross(point - assembly.centroids[-1], force)
    load = LoadCase(assembly, "push", (), fixed, body_wrenches=wrenches)
    return assembly, analyse(assembly, load=load).details


_DOWN = np.array([0.0, 0.0, -1.0])


def _stands_and_falls(
    placed: list[Placed], inside: FloatArray, outside: FloatArray, *, contacts: int | None = None
) -> CaseVerdict:
    """A push at the first point is carried by forces that sum to it; at the second it is not."""
    _, stands = _pressed(placed, _DOWN, inside)
    _, falls = _pressed(placed, _DOWN, outside)
    total = float(stands.contact_forces.sum())
    return case_verdict(
        ("carried", stands.equilibrium.holds, ">=", 1),
        ("forces against the push", relative_difference(total, 1.0), _ROUND_OFF),
        ("carried beside it", falls.equilibrium.holds, 0),
        ("contacts", stands.n_contacts, "==" if contacts else ">=", contacts or 1),
    )


_FLOOR = box((400.0, 400.0, 50.0), "floor")


@case()
def edge_on_face() -> CaseVerdict:
    """A wedge stands on its edge: carried over the edge, tips 1e-3 beside it."""
    placed = [_at(_FLOOR, -200.0, -200.0, -50.0), _at(_WEDGE, 0.0, 0.0, 0.0)]
    return _stands_and_falls(placed, np.array([0.0, 49.0, 60.0]), np.array([1e-3, 0.0, 60.0]))


@case()
def edge_beyond_face() -> CaseVerdict:
    """An edge longer than its table: carried up to the table's rim."""
    table = box((100.0, 60.0, 50.0), "table")
    placed = [_at(table, -50.0, -30.0, -50.0), _at(_WEDGE, 0.0, 0.0, 0.0)]
    return _stands_and_falls(placed, np.array([0.0, 29.999, 60.0]), np.array([0.0, 30.001, 60.0]))


@case()
def edge_across_an_edge() -> CaseVerdict:
    """Two edges cross in a point: faces carry nothing, edges do there, and tip 1e-3 beside it."""
    turn = Rotation.from_euler("zy", [90.0, 180.0], degrees=True).as_matrix()
    placed = [_at(_WEDGE, 0.0, 0.0, 0.0, turn), _at(_WEDGE, 0.0, 0.0, 0.0)]
    _, there = _pressed(placed, _DOWN, np.array([0.0, 0.0, 60.0]))
    _, beside = _pressed(placed, _DOWN, np.array([0.0, 1e-3, 60.0]))
    edges, none = there.with_edges, beside.with_edges
    assert edges is not None
    assert none is not None
    return case_verdict(
        ("carried by faces", there.holds, 0),
        ("carried with edges", edges.holds, ">=", 1),
        ("carried beside it", none.holds, 0),
        ("contacts", edges.n_contacts - there.n_contacts, "==", 1),
    )


@case()
def corner_on_face() -> CaseVerdict:
    """A cube stands on its corner: carried there, tips 1e-3 beside it."""
    turn, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], np.ones((1, 3)))
    cube = box((50.0, 50.0, 50.0))
    placed = [_at(_FLOOR, -200.0, -200.0, -50.0), _at(cube, 0.0, 0.0, 0.0, turn.as_matrix())]
    aside = np.array([1e-3, 0.0, 80.0])
    # The corner stands on the diagonal of the floor: in both of its triangles, and once.
    return _stands_and_falls(placed, np.array([0.0, 0.0, 80.0]), aside, contacts=1)


@case()
def rotated_faces() -> CaseVerdict:
    """A cube turned by 45° on another: carried over their octagon, no more."""
    cube = box((100.0, 100.0, 100.0))
    turn = Rotation.from_euler("z", 45.0, degrees=True).as_matrix()
    corner = turn @ np.array([-50.0, -50.0, 0.0])
    placed = [_at(cube, -50.0, -50.0, -100.0), (cube, turn, corner)]
    # The octagon's corners lie at 22.5°, 50 mm over the cosine from the middle.
    angle = np.radians(22.5)
    way = np.array([np.cos(angle), np.sin(angle), 0.0]) * 50.0 / np.cos(angle)
    return _stands_and_falls(placed, 0.9999 * way, 1.0001 * way, contacts=8)


def _groove(degrees: float) -> CaseVerdict:
    """A wedge in a groove of two held wedges: N = W / (2 sin α) on each flank."""
    slope = np.tan(np.radians(degrees))
    height = 50.0 * min(1.0, 1.0 / slope)
    half = height * slope
    wide, base = half + 50.0, -30.0
    flank = [(0.0, 0.0), (half, height), (wide, height), (wide, base), (0.0, base)]
    sides = [_prism([(s * x, z) for x, z in flank], 60.0) for s in (-1.0, 1.0)]
    wedge = _prism([(0.0, 0.0), (half, height), (-half, height)], 40.0)
    placed = [_at(shape, 0.0, 0.0, 0.0) for shape in (*sides, wedge)]
    assembly, result = _pressed(placed, _DOWN, np.array([0.0, 0.0, height]), held=2)
    found = assembly.interfaces
    on = np.zeros(len(placed))
    np.add.at(on, found.block_m[result.contact_index], result.contact_forces)
    expected = 1.0 / (2.0 * np.sin(np.radians(degrees)))
    return case_verdict(
        ("carried", result.equilibrium.holds, ">=", 1),
        ("flank forces against W / (2 sin α)", relative_difference(on[:2], expected), _ROUND_OFF),
    )


@case()
def spike_in_a_crack() -> CaseVerdict:
    """A wedge of half angle 1° in its crack: 28.6 loads per flank."""
    return _groove(1.0)


@case()
def nearly_flat_groove() -> CaseVerdict:
    """A groove of 89.9°, normals 0.2° apart: half the load per flank."""
    return _groove(89.9)


@case()
def small_on_large() -> CaseVerdict:
    """A cube of 1 mm on a plate of 10 m: carried over its face, no more."""
    cube, plate = box((1.0, 1.0, 1.0)), box((1e4, 1e4, 10.0))
    placed = [_at(plate, -5e3, -5e3, -10.0), _at(cube, 1234.5, -321.0, 0.0)]
    inside, outside = np.array([1234.501, -320.5, 1.0]), np.array([1234.499, -320.5, 1.0])
    return _stands_and_falls(placed, inside, outside)


@case()
def one_edge_alone() -> CaseVerdict:
    """Cubes whose edges coincide: no contact is invented between them."""
    cube = box((50.0, 50.0, 50.0))
    cubes = (_at(cube, -50.0, -50.0, 0.0), _at(cube, 0.0, 0.0, 0.0))
    placed = [_at(_FLOOR, -200.0, -200.0, -50.0), *cubes]
    assembly, weighs = _pressed(placed, _DOWN)
    _, leans = _pressed(placed, _DOWN + np.array([-0.1, -0.1, 0.0]))
    result = assembly.interfaces
    between = int(((result.block_m == 1) & (result.block_s == 2)).sum())
    return case_verdict(
        ("contacts between them", between, 0),
        ("carried by the floor", weighs.equilibrium.holds, ">=", 1),
        ("held by the other's edge", leans.equilibrium.holds, 0),
    )
