"""A block shape: one hexahedral mesh with named faces.

Congruent blocks share one `Block`; an `Assembly` places copies of it by rigid motions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from geometry.mesh import (
    FloatArray,
    HexMesh,
    IntArray,
    QuadSurface,
    boundary_quads,
    check_mesh,
    grid_faces,
    grid_points,
    structured_hexahedra,
)


@dataclass(frozen=True)
class Curve:
    """The exact shape of a block, of which its mesh is a sample."""

    parameters: Callable[[], FloatArray]
    """Of the corners of each element, (n_elements, 8, n): one node may have several. Made when
    asked for: trilinear and rigid blocks have no use for them."""
    shape: Callable[[FloatArray], FloatArray]
    """Points of parameters, (m, n) to (m, 3) [mm]."""


@dataclass(frozen=True)
class Block:
    """One block shape in its own reference position."""

    name: str
    """What reports and decks call it, e.g. ``sine-block``."""
    mesh: HexMesh
    """Volume mesh in the reference position [mm]."""
    faces: dict[str, IntArray]
    """Named groups of boundary facets, each (n_facets, 4) node numbers, oriented outward."""
    contact_faces: tuple[str, ...] = field(default=())
    """Names of the groups that can meet another block."""
    curve: Curve | None = None
    """The exact shape; None: the mesh is the shape."""

    @cached_property
    def _extent(self) -> tuple[float, FloatArray]:
        return self.mesh.extent()

    @property
    def volume(self) -> float:
        """Volume of the mesh [mm³]."""
        return self._extent[0]

    @property
    def centroid(self) -> FloatArray:
        """Mass centroid of the mesh, (3,) [mm]."""
        return self._extent[1]

    @cached_property
    def contact_quads(self) -> IntArray:
        """All facets that can meet another block, groups in the order of `contact_faces`."""
        if not self.contact_faces:
            return np.empty((0, 4), dtype=np.int64)
        return np.concatenate([self.faces[name] for name in self.contact_faces])

    @cached_property
    def surface_nodes(self) -> IntArray:
        """Nodes on the boundary, each once, sorted; (n,)."""
        return np.unique(boundary_quads(self.mesh))

    def surface(self, name: str) -> QuadSurface:
        """Return the named face group as a surface with centroids, normals and areas."""
        return QuadSurface(self.mesh.nodes, self.faces[name])


def box_block(
    size: tuple[float, float, float],
    divisions: tuple[int, int, int],
    *,
    name: str = "box",
    contact_faces: tuple[str, ...] = (),
) -> Block:
    """Box [0, size] [mm] meshed by equal bricks, faces named ``x-``, ``x+``, … ``z+``.

    ``divisions`` are the elements along x, y, z; ``contact_faces`` can meet another block.
    """
    x, y, z = (np.linspace(0.0, s, n + 1) for s, n in zip(size, divisions, strict=True))
    mesh = HexMesh(grid_points(x, y, z), structured_hexahedra(*divisions))
    check_mesh(mesh, name)
    axis = {"u": "x", "v": "y", "w": "z"}
    faces = {axis[key[0]] + key[1]: quads for key, quads in grid_faces(*divisions).items()}
    return Block(name, mesh, faces, contact_faces)


def mapped_block(
    name: str,
    lines: tuple[FloatArray, FloatArray, FloatArray],
    shape: Callable[[FloatArray], FloatArray],
    faces: dict[str, str],
    contact_faces: tuple[str, ...],
) -> Block:
    """Block of an exact shape: the image of a grid of three parameters, right-handed.

    Parameters
    ----------
    name
        Name of the block shape.
    lines
        Values of each parameter at the nodes.
    shape
        Points of parameters, (m, 3) to (m, 3) [mm].
    faces
        Name of each side of the grid, ``u-`` to ``w+``.
    contact_faces
        Faces that can meet another block.
    """
    counts = [len(line) - 1 for line in lines]
    mesh = HexMesh(shape(grid_points(*lines)), structured_hexahedra(*counts))
    check_mesh(mesh, name)
    named = {faces[side]: quads for side, quads in grid_faces(*counts).items()}
    curve = Curve(lambda: grid_points(*lines)[mesh.elements], shape)
    return Block(name, mesh, named, contact_faces, curve)
