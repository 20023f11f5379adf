"""Masonry with known answers: a wall in running bond, a circular arch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from geometry.mesh import HexMesh, boundary_quads, structured_hexahedra
from geometry.parts.options import Count, Length, Options, Size
from geometry.parts.placed import AssemblyError, require_size
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.polyhedron import Polyhedron, polyhedron_from_quads

#: Names of bricks by their widths.
_NAMES = {1.0: "brick", 0.5: "half-brick"}
#: Straight pieces that approximate the curved faces of a voussoir.
_PIECES = 4


def box(size: tuple[float, float, float], name: str = "box") -> Polyhedron:
    """Box [0, size] [mm]."""
    nodes = np.array(
        [[x, y, z] for x in (0.0, size[0]) for y in (0.0, size[1]) for z in (0.0, size[2])]
    )
    return polyhedron_from_quads(
        name, nodes, boundary_quads(HexMesh(nodes, structured_hexahedra(1, 1, 1)))
    )


@dataclass(frozen=True)
class RunningBondWall(Options):
    """Wall of bricks in running bond on a fixed foundation.

    Every other row has a half brick at both ends, so the wall's ends are plumb.
    """

    size: Size
    """Length, depth and height of a brick [mm]."""
    columns: Count
    """Whole bricks in a row without half bricks."""
    rows: Count
    """Rows above the foundation."""

    def build(self, detection: DetectionOptions | None = None) -> PolyhedralAssembly:
        """Stack the rows."""
        even, odd = [1.0] * self.columns, [0.5, *[1.0] * (self.columns - 1), 0.5]
        rows = [odd if row % 2 else even for row in range(self.rows)]
        return wall_of_rows(self.size, rows, detection)


def wall_of_rows(
    size: tuple[float, float, float],
    rows: Sequence[Sequence[float]],
    detection: DetectionOptions | None = None,
) -> PolyhedralAssembly:
    """Stack rows of bricks of given widths on a fixed foundation; openings may be left.

    Parameters
    ----------
    size
        Length (x), depth (y) and height (z) of a whole brick [mm].
    rows
        From the bottom: widths in bricks from left to right, an opening as a negative width.
    detection
        What counts as contact.
    """
    require_size(size)
    lengths = [sum(abs(width) for width in row) for row in rows]
    if not lengths or not np.allclose(lengths, lengths[0]) or any(0 in row for row in rows):
        raise AssemblyError(
            f"rows: got {lengths} bricks in a row, expected rows of one length, no width of zero"
        )
    length, depth, height = size
    shapes = {
        width: box((width * length, depth, height), _NAMES.get(width, f"brick of {width:g}"))
        for width in sorted({width for row in rows for width in row if width > 0})
    }
    base = box((lengths[0] * length, depth, height), "foundation")
    blocks = [(base, np.eye(3), np.array([0.0, 0.0, -height]))]
    for layer, row in enumerate(rows):
        starts = length * np.cumsum([0.0, *np.abs(row)])
        blocks += [
            (shapes[width], np.eye(3), np.array([x, 0.0, layer * height]))
            for width, x in zip(row, starts, strict=False)
            if width > 0
        ]
    fixed = np.zeros(len(blocks), dtype=bool)
    fixed[0] = True
    return polyhedral_assembly("wall", blocks, fixed, detection)


def voussoir(
    radius: float, thickness: float, depth: float, angle: float, *, pieces: int = _PIECES
) -> Polyhedron:
    """Sector of a ring, from θ = 0 (the +x axis) to ``angle`` [rad] in the xz plane.

    Its curved faces are approximated by ``pieces`` flat ones.
    """
    theta = np.linspace(0.0, angle, pieces + 1)
    r = radius + thickness * np.array([-0.5, 0.5])
    y = np.array([0.0, depth])
    r, theta, y = (g.ravel() for g in np.meshgrid(r, theta, y, indexing="ij"))
    nodes = np.column_stack([r * np.cos(theta), y, r * np.sin(theta)])
    # (r, θ, y) is left-handed here: turn the facets outward.
    quads = boundary_quads(HexMesh(nodes, structured_hexahedra(1, pieces, 1)))[:, ::-1]
    return polyhedron_from_quads("voussoir", nodes, quads)


@dataclass(frozen=True)
class CircularArch(Options):
    """Circular arch between two fixed voussoirs beyond its springings.

    Each curved face of a voussoir is four flat pieces; a row prints what its volume lacks.
    """

    radius: Length
    """Of the centre line [mm]."""
    thickness: Length
    """Radial [mm]."""
    depth: Length
    """Out of the plane, y [mm]."""
    voussoirs: Annotated[int, Ge(2)]
    """Free blocks, numbered from 1 at the right springing (+x) on."""
    embrace: Annotated[float, Gt(0), Le(180)] = 180.0
    """Angle between the springings [°]; 180 is the semicircle."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thickness >= 2 * self.radius:
            raise AssemblyError(
                f"thickness: got {self.thickness:g} mm, more than twice the radius "
                f"{self.radius:g} mm"
            )

    @property
    def flat_pieces(self) -> tuple[int, float]:
        """Flat pieces of each curved face, and what they take of the volume (a part of it, < 0)."""
        angle = np.radians(self.embrace) / self.voussoirs / _PIECES
        return _PIECES, float(np.sin(angle) / angle - 1.0)

    def build(
        self, detection: DetectionOptions | None = None, *, pieces: int = _PIECES
    ) -> PolyhedralAssembly:
        """Place the voussoirs, whose curved faces are approximated by flat pieces."""
        step = np.radians(self.embrace) / self.voussoirs
        shape = voussoir(self.radius, self.thickness, self.depth, step, pieces=pieces)
        first = 0.5 * np.pi - np.radians(self.embrace) / 2
        blocks = []
        for k in range(-1, self.voussoirs + 1):
            c, s = np.cos(first + k * step), np.sin(first + k * step)
            turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
            blocks.append((shape, turn, np.zeros(3)))
        fixed = np.zeros(len(blocks), dtype=bool)
        fixed[[0, -1]] = True
        return polyhedral_assembly("arch", blocks, fixed, detection)
