"""Puzzles of unit cubes: each letter of a drawing is one piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.mesh import CUBE, HexMesh, IntArray, boundary_quads
from geometry.parts.options import Length, Options
from geometry.parts.placed import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import DetectionOptions
from geometry.polyhedra.polyhedron import Polyhedron, polyhedron_from_quads


def voxel_piece(name: str, cells: IntArray, size: float) -> Polyhedron:
    """Union of cubes of an edge [mm] as one block; cells are their integer positions, (n, 3)."""
    corners = cells[:, None, :] + CUBE
    nodes, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    mesh = HexMesh(nodes * size, index.reshape(-1, 8).astype(np.int64))
    return polyhedron_from_quads(name, mesh.nodes, boundary_quads(mesh))


def read_drawing(layers: Sequence[Sequence[str]]) -> dict[str, IntArray]:
    """Cells of each letter of a drawing.

    Parameters
    ----------
    layers
        From bottom to top; each is a list of rows (y upward in the list), each row a string along
        x. A dot or a space is empty.
    """
    shapes = {(len(layer), *(len(row) for row in layer)) for layer in layers}
    if len(shapes) != 1 or len(set(next(iter(shapes))[1:])) != 1:
        raise AssemblyError("layers: expected layers of equally many rows of equal length")
    cells: dict[str, list[tuple[int, int, int]]] = {}
    for z, layer in enumerate(layers):
        for y, row in enumerate(layer):
            for x, letter in enumerate(row):
                if letter not in ". ":
                    cells.setdefault(letter, []).append((x, y, z))
    cubes = {letter: np.array(where, dtype=np.int64) for letter, where in sorted(cells.items())}
    for letter, where in cubes.items():
        if not _connected(where):
            raise AssemblyError(
                f"layers: piece {letter!r} falls apart; expected cubes joined face to face"
            )
    return cubes


def _connected(cells: IntArray) -> bool:
    """Whether cubes hang together face to face."""
    grid = np.zeros(cells.max(axis=0) + 1, dtype=np.bool_)
    grid[tuple(cells.T)] = True
    import scipy.ndimage

    return int(scipy.ndimage.label(grid)[1]) == 1


@dataclass(frozen=True)
class VoxelPuzzle(Options):
    """Puzzle of unit cubes: pieces drawn with letters, layer by layer from the bottom."""

    layers: tuple[tuple[str, ...], ...]
    """Each layer a list of rows; the same letter is the same piece, a dot is empty."""
    size: Length
    """Edge of a unit cube [mm]."""
    fixed: str
    """Letters of the fixed pieces."""

    def build(self, detection: DetectionOptions | None = None) -> PolyhedralAssembly:
        """Place the pieces, numbered in the order of their letters.

        Raises
        ------
        AssemblyError
            For a drawing that is none, and letters of no piece.
        """
        pieces = read_drawing(self.layers)
        unknown = sorted(set(self.fixed) - set(pieces))
        if unknown:
            raise AssemblyError(
                f"fixed: got {', '.join(unknown)}, expected letters among {''.join(pieces)}"
            )
        blocks = [
            (voxel_piece(letter, cells, self.size), np.eye(3), np.zeros(3))
            for letter, cells in pieces.items()
        ]
        held = np.array([letter in self.fixed for letter in pieces])
        return polyhedral_assembly("voxels", blocks, held, detection)
