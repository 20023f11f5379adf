"""Contacts, verdict and forces depend on the blocks, not on the triangles that draw them."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.loads import LoadCase
from geometry.mesh import FloatArray, IntArray
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.polyhedron import polyhedron
from mbd import MechanismClass, analyse
from mbd.system import Verdict
from tests.support.drawn_blocks import Drawn, abeille, arch, cuboid, triangles_of

pytestmark = pytest.mark.quick

_Surface = tuple[FloatArray, IntArray]


def _redrawn(drawn: Drawn, seed: int) -> _Surface:
    """The same block: other diagonals, edges and triangles cut, other order, points repeated."""
    rng = np.random.default_rng(seed)
    points, triangles = list(drawn[0]), triangles_of(drawn, rng).tolist()

    def cut(a: int, b: int, at: float) -> None:
        """An edge, and the triangles on both sides of it, into two."""
        new = len(points)
        points.append((1.0 - at) * points[a] + at * points[b])
        for one in [t for t in triangles if {a, b} <= set(t)]:
            triangles.remove(one)
            triangles.extend([new if k == end else k for k in one] for end in (a, b))

    if rng.random() < 0.7:  # where edges of neighbours cross too
        for a, b in {tuple(sorted(e)) for p in drawn[1] for e in pairwise((*p, p[0]))}:
            cut(a, b, 0.5)
    for _ in range(int(rng.integers(0, 6))):
        a, b, c = triangles[int(rng.integers(len(triangles)))]
        if rng.random() < 0.5:
            cut(a, b, rng.uniform(0.3, 0.7))
            continue
        share = 0.2 + 0.4 * rng.dirichlet([1.0, 1.0, 1.0])
        points.append(share @ np.array([points[a], points[b], points[c]]))
        triangles.remove([a, b, c])
        triangles += [[a, b, len(points) - 1], [b, c, len(points) - 1], [c, a, len(points) - 1]]
    order = rng.permutation(len(triangles))
    corners = [np.roll(triangles[k], int(rng.integers(3))) for k in order]
    loose = np.array(points)[np.array(corners).ravel()]
    return loose, np.arange(len(loose)).reshape(-1, 3)


def _assembly(blocks: Mapping[str, _Surface], fixed: list[str]) -> PolyhedralAssembly:
    placed = [
        (polyhedron(name, *surface), np.eye(3), np.zeros(3)) for name, surface in blocks.items()
    ]
    return polyhedral_assembly("own blocks", placed, np.array([name in fixed for name in blocks]))


def _answers(assembly: PolyhedralAssembly) -> tuple[FloatArray, Verdict, Verdict, FloatArray]:
    """Contacts (n, 8), verdict without and with edges and corners, forces with their contacts."""
    weights = np.zeros((assembly.n_blocks, 6))
    weights[:, 2] = -1e-5 * np.array([shape.volume for shape in assembly.shapes])
    load = LoadCase(assembly, "weight", (), assembly.fixed, body_wrenches=weights)
    result, places = analyse(assembly, load=load).details, assembly.interfaces
    rows = np.column_stack([places.block_m, places.block_s, places.centroids, places.normals])
    # Equal to round-off is equal: contacts are sorted by rounded coordinates.
    index = result.contact_index
    return (
        rows[np.lexsort(np.round(rows + 1.234e-4, 3).T)],
        result.verdict,
        (result.with_edges or result).verdict,
        result.contact_forces[np.lexsort(np.round(rows[index] + 1.234e-4, 3).T)],
    )


def _vault() -> tuple[dict[str, Drawn], list[str]]:
    """Locked by edges that cross."""
    return abeille(2)


def _standing_arch() -> tuple[dict[str, Drawn], list[str]]:
    """Held by friction alone: faces, no verdict of locking."""
    return arch(5, thickness=250.0), ["S_left", "S_right"]


def _tripod() -> tuple[dict[str, Drawn], list[str]]:
    """A pyramid that stands on its tip, and a block in the form of an L."""
    tip = np.array([[0, 0, 10], [-8, -8, 30], [9, -7, 30], [7, 9, 30], [-9, 8, 30]], np.float64)
    sides = [(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 1, 4), (1, 2, 3, 4)]
    corner = [(-9, -9), (12, -9), (12, 0), (2, 0), (2, 11), (-9, 11)]
    ell = np.array([(20 + x, y, z) for z in (10.0, 25.0) for x, y in corner])
    around = [(k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k) for k in range(6)]
    return {
        "floor": cuboid((-50, -50, 0), (60, 50, 10)),
        "tip": (tip, [*sides]),
        "L": (ell, [(5, 4, 3, 0), (3, 2, 1, 0), (6, 9, 10, 11), (6, 7, 8, 9), *around]),
    }, ["floor"]


@pytest.mark.parametrize("blocks", [_vault, _standing_arch, _tripod])
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_subdivision_order_and_repeated_points_change_nothing(blocks, seed: int) -> None:
    drawn, fixed = blocks()
    plain = {name: (one[0], triangles_of(one)) for name, one in drawn.items()}
    contacts, verdict, every, forces = _answers(_assembly(plain, fixed))
    again = {name: _redrawn(one, seed + k) for k, (name, one) in enumerate(drawn.items())}
    contacts_again, verdict_again, every_again, forces_again = _answers(_assembly(again, fixed))
    assert verdict_again == verdict
    assert every_again == every
    # Points on faces are rounded to 1e-13 of coordinates of 1e3; normals to that over triangles
    # of a hundredth of a face.
    np.testing.assert_allclose(contacts_again, contacts, atol=1e-8)
    np.testing.assert_allclose(forces_again, forces, atol=1e-6 * max(1.0, forces.max(initial=0.0)))


def test_the_vault_is_locked_by_its_edges_alone() -> None:
    drawn, ring = _vault()
    plain = {name: (one[0], triangles_of(one)) for name, one in drawn.items()}
    _, verdict, every, _ = _answers(_assembly(plain, ring))
    assert verdict == (MechanismClass.ACTIVATED, False, False)
    assert every == (MechanismClass.LOCKED, True, False)
