"""Sets of mesh files as faces of blocks: node sets and surfaces of Abaqus, groups of gmsh.

A set of nodes is a face where it is made of whole facets of a block's surface: its nodes are the
corners of the facets all of whose corners it has. Other sets of nodes on the surface are edges.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geometry.mesh import IntArray

#: Corners of the sides S1 … S6 of C3D8 and C3D20, counted from 0.
_SIDES = {
    "S1": (0, 1, 2, 3),
    "S2": (4, 5, 6, 7),
    "S3": (0, 1, 5, 4),
    "S4": (1, 2, 6, 5),
    "S5": (2, 3, 7, 6),
    "S6": (3, 0, 4, 7),
}
_SURFACE = re.compile(r"^\*surface\s*,([^\n]*)\n((?:[^*\n][^\n]*\n?)*)", re.I | re.M)


def face_name(name: str) -> str:
    """Name of a face from that of a set, as decks take it: letters of one case, digits, - and _."""
    result = re.sub(r"[^a-z0-9_]", "-", name.lower())
    return result if result[:1].isalpha() else f"set{result}"


@dataclass(frozen=True)
class NamedSets:
    """Sets of a file by the numbers of its nodes."""

    nodes: dict[str, IntArray]
    """Sets of nodes, (n,) each."""
    facets: dict[str, IntArray]
    """Sets of facets, corners ascending, (n, 4) each."""

    def faces(self, outer: IntArray, number: IntArray) -> dict[str, IntArray]:
        """Faces of a block: sets that are made of whole facets of its surface.

        Parameters
        ----------
        outer
            Facets of the surface of the block, (n_facets, 4).
        number
            Its nodes in the file, (n_nodes,).
        """
        result: dict[str, IntArray] = {}
        for name, members in self.nodes.items():
            inside = np.isin(number, members)
            quads = outer[inside[outer].all(axis=1)]
            if len(quads) and len(np.unique(quads)) == int(inside.sum()):
                result[name] = quads
        corners = np.sort(number[outer], axis=1).tolist()
        for name, facets in self.facets.items():
            known = set(map(tuple, facets.tolist()))
            mine = np.array([tuple(row) in known for row in corners], dtype=np.bool_)
            if mine.any():
                result[name] = outer[mine]
        return result

    def edges(self, outer: IntArray, number: IntArray) -> dict[str, IntArray]:
        """Corners of a block, (n,), that are in each set of nodes of its surface alone.

        Parameters as those of `faces`.
        """
        on_surface = np.isin(np.arange(len(number)), outer)
        inside = {name: np.isin(number, members) for name, members in self.nodes.items()}
        return {
            name: np.flatnonzero(one)
            for name, one in inside.items()
            if one.any() and not (one & ~on_surface).any()
        }


def named_sets(path: Path, mesh: Any) -> NamedSets:
    """Sets of a file that meshio read: of nodes, surfaces of Abaqus, physical groups of gmsh."""
    nodes = {name: np.asarray(of, np.int64) for name, of in mesh.point_sets.items()}
    facets: dict[str, list[IntArray]] = {}
    for group, tags in zip(mesh.cells, mesh.cell_data.get("gmsh:physical", ()), strict=False):
        for name, (tag, dimension) in mesh.field_data.items():
            if group.type.startswith("quad") and dimension == 2 and (tags == tag).any():
                facets.setdefault(name, []).append(group.data[tags == tag, :4])
    if path.suffix.lower() == ".inp":
        for name, corners in _element_surfaces(path, mesh):
            facets.setdefault(name, []).append(corners)
    return NamedSets(
        {face_name(name): of for name, of in nodes.items()},
        {face_name(name): np.sort(np.concatenate(of), axis=1) for name, of in facets.items()},
    )


def _element_surfaces(path: Path, mesh: Any) -> Iterator[tuple[str, IntArray]]:
    """Name and corners of the sides of element sets that ``*Surface`` puts together."""
    sets = {name.upper(): of for name, of in mesh.cell_sets.items()}
    text = path.read_text("utf-8", errors="replace").replace("\r", "")
    for head, rows in _SURFACE.findall(text):
        given = dict(re.findall(r"(\w+)\s*=\s*([^,\s]+)", head))
        name = next((value for key, value in given.items() if key.upper() == "NAME"), None)
        for row in rows.splitlines():
            elements, _, side = (part.strip().upper() for part in row.partition(","))
            if name is None or side not in _SIDES or elements not in sets:
                continue
            for group, chosen in zip(mesh.cells, sets[elements], strict=False):
                if group.dim == 3 and len(chosen):
                    yield name, group.data[np.asarray(chosen, np.int64)][:, _SIDES[side]]
