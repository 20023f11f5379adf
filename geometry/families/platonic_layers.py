"""Planar layers of convex polyhedra between two planes, held by a fixed outer ring.

Regular tetrahedra, cubes and octahedra whose middle sections tile the plane (squares or regular
hexagons) and whose faces lean alternately to both sides. Sources: Glickman, "The G-block system of
vertically interlocking paving" (1984); Dyskin, Estrin, Kanel-Belov, Pasternak, "Topological
interlocking of platonic solids", Phil. Mag. Lett. 83 (2003).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge

from geometry.mesh import FloatArray
from geometry.parts.options import Count, Length, Options
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import CubeArrangement, DetectionOptions
from geometry.polyhedra.polyhedron import Polyhedron, convex_polyhedron


def tetrahedron(edge: float, thickness: float | None = None) -> Polyhedron:
    """Regular tetrahedron, upper edge along x, lower edge along y, middle section in z = 0.

    Planes cut its upper and lower edges off where it has a thickness [mm]: six sides.
    """
    height = edge / np.sqrt(8.0)
    top = height if thickness is None else thickness / 2
    wide, narrow = edge / 4 * (1.0 + top / height), edge / 4 * (1.0 - top / height)
    corners = [[s * wide, t * narrow, top] for s in (1, -1) for t in (1, -1)]
    corners += [[s * narrow, t * wide, -top] for s in (1, -1) for t in (1, -1)]
    return convex_polyhedron("tetrahedron", list(dict.fromkeys(map(tuple, corners))))


@dataclass(frozen=True)
class TetrahedraLayer(Options):
    """Planar layer of regular tetrahedra in a fixed ring, every other turned by 90°."""

    edge: Length
    """[mm]"""
    columns: Count
    """Free blocks along x."""
    rows: Count
    """Free blocks along y."""
    thickness: Length | None = None
    """Distance of two planes that cut off the upper and lower edge [mm]; by default none do."""
    freed: tuple[Annotated[int, Ge(0)], ...] = ()
    """Numbers of blocks of the ring that are not fixed: for stated supports and loads."""

    def __post_init__(self) -> None:
        super().__post_init__()
        height = self.edge / np.sqrt(2.0)
        if self.thickness is not None and self.thickness >= height:
            raise AssemblyError(
                f"thickness: got {self.thickness:g}; expected less than {height:.4g} mm, the "
                "height of the whole tetrahedron"
            )

    def build(self, detection: DetectionOptions | None = None) -> PolyhedralAssembly:
        """Lay the blocks, row by row.

        Raises
        ------
        AssemblyError
            For blocks that are freed and not of the ring.
        """
        shape = tetrahedron(self.edge, self.thickness)
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        blocks, fixed = [], []
        for j in range(self.rows + 2):
            for i in range(self.columns + 2):
                ends = i in (0, self.columns + 1), j in (0, self.rows + 1)
                if all(ends):
                    continue  # the corners of the ring touch no free block
                turn = quarter if (i + j) % 2 else np.eye(3)
                blocks.append((shape, turn, np.array([i, j, 0.0]) * self.edge / 2))
                fixed.append(any(ends))
        held = np.array(fixed)
        for block in self.freed:
            if block >= len(held) or not held[block]:
                raise AssemblyError(
                    f"freed: got {block}; expected numbers of blocks of the fixed ring: "
                    f"{', '.join(map(str, np.flatnonzero(fixed)))}"
                )
            held[block] = False
        return polyhedral_assembly("tetrahedra-layer", blocks, held, detection)


def octahedron(edge: float) -> Polyhedron:
    """Regular octahedron standing on a face, middle section in z = 0, an edge of it facing +x."""
    corners = np.array([[s if k == i else 0 for k in range(3)] for i in range(3) for s in (1, -1)])
    return convex_polyhedron("octahedron", _upright(corners * (edge / np.sqrt(2.0))))


def cube(edge: float) -> Polyhedron:
    """Cube standing on a corner, middle section in z = 0, an edge of it facing +x."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return convex_polyhedron("cube", _upright(corners * (edge / 2)))


def _upright(corners: FloatArray) -> FloatArray:
    """Turn the (1, 1, 1) direction into z and the direction (2, -1, -1) into x."""
    z = np.ones(3) / np.sqrt(3.0)
    x = np.array([2.0, -1.0, -1.0]) / np.sqrt(6.0)
    return corners @ np.column_stack([x, np.cross(z, x), z])


def _hexagonal(
    name: str, shape: Polyhedron, steps: FloatArray, rings: int, detection: DetectionOptions | None
) -> PolyhedralAssembly:
    """Copies on a triangular lattice, ``rings`` free rings round the middle one, one more fixed."""
    blocks, fixed = [], []
    last = rings + 1
    for i in range(-last, last + 1):
        for j in range(-last, last + 1):
            ring = max(abs(i), abs(j), abs(i + j))
            if ring <= last:
                blocks.append((shape, np.eye(3), i * steps[0] + j * steps[1]))
                fixed.append(ring == last)
    return polyhedral_assembly(name, blocks, np.array(fixed), detection)


def _lattice(distance: float, first: float) -> FloatArray:
    """Two lattice steps of a length, the first at an angle [rad] to x; (2, 3) [mm]."""
    angles = first + np.array([0.0, np.pi / 3])
    return distance * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(2)])


@dataclass(frozen=True)
class OctahedraLayer(Options):
    """Planar layer of octahedra lying on their faces, in a fixed ring."""

    edge: Length
    """[mm]"""
    rings: Annotated[int, Ge(0)]
    """Free rings round the middle block; one more is fixed."""

    def build(self, detection: DetectionOptions | None = None) -> PolyhedralAssembly:
        """Lay the blocks; with no free ring the middle one alone is free."""
        steps = _lattice(self.edge * np.sqrt(3.0) / 2, 0.0)
        return _hexagonal("octahedra-layer", octahedron(self.edge), steps, self.rings, detection)


@dataclass(frozen=True)
class CubesLayer(Options):
    """Planar layer of cubes in a fixed ring."""

    edge: Length
    """[mm]"""
    rings: Annotated[int, Ge(0)]
    """Free rings round the middle block; one more is fixed."""
    arrangement: CubeArrangement = CubeArrangement.HEXAGONAL
    """``hexagonal``: on their corners; ``square``: on their faces, like paving."""

    def build(self, detection: DetectionOptions | None = None) -> PolyhedralAssembly:
        """Lay the blocks."""
        edge, last = self.edge, self.rings + 1
        if self.arrangement is CubeArrangement.HEXAGONAL:
            steps = _lattice(edge * np.sqrt(1.5), 0.0)
            return _hexagonal("cubes-layer", cube(edge), steps, self.rings, detection)
        ends = (-edge / 2, edge / 2)
        shape = convex_polyhedron("cube", [[x, y, z] for x in ends for y in ends for z in ends])
        places = [(i, j) for i in range(-last, last + 1) for j in range(-last, last + 1)]
        blocks = [(shape, np.eye(3), np.array([i * edge, j * edge, 0.0])) for i, j in places]
        fixed = np.array([max(abs(i), abs(j)) == last for i, j in places])
        return polyhedral_assembly("cubes-layer", blocks, fixed, detection)
