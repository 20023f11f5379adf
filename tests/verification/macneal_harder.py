"""Beams of MacNeal and Harder (1985) and NAFEMS' LE10, from decks, beside CalculiX.

``python -m tests.verification macneal-harder le10``. Beams have six elements; displacements of the
tip are relative to the theory that MacNeal and Harder print.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fem import solve_static
from fem.decks.read.deck import deck_of_lines
from geometry import Answer
from geometry.mesh import CORNERS, HEX_EDGES
from tests.support.answers import PLAIN
from tests.support.ccx import calculix_available
from tests.verification.deck_oracle import deck_nodes, original, ours

Place = Callable[[np.ndarray], np.ndarray]

#: Tip displacements by theory: straight beam along x, y, z, curved beam in and out of its plane.
_STRAIGHT = {"extension": (1, 3e-5), "in plane": (2, 0.1081), "out of plane": (3, 0.4321)}
_CURVED = {"in plane": (1, 0.08734), "out of plane": (3, 0.5022)}
#: Shift of the inner lines of nodes, at y = 0 and beyond, of every second one.
_LEAN = {
    "regular": np.zeros(7),
    "trapezoids": np.array([0.0, 0.1, -0.1, 0.1, -0.1, 0.1, 0.0]),
    "parallelograms": np.array([0.0, 0.1, 0.1, 0.1, 0.1, 0.1, 0.0]),
}


def _straight(shape: str) -> Place:
    def place(at: np.ndarray) -> np.ndarray:
        x, across = at[:, 0], 2.0 * at[:, 1] - 1.0
        lean = np.interp(x, np.arange(7.0), _LEAN[shape]) * across
        return np.column_stack([x + lean, 0.2 * at[:, 1], 0.1 * at[:, 2]])

    return place


def _curved(at: np.ndarray) -> np.ndarray:
    """A quarter of a circle, clamped at x = 0; the tip points along y."""
    angle, radius = np.radians(90.0 - 15.0 * at[:, 0]), 4.12 + 0.2 * at[:, 1]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 * at[:, 2]])


def _plate(at: np.ndarray) -> np.ndarray:
    """LE10: an elliptic plate of 600 mm with an elliptic hole, coordinates 0 to 1 each."""
    share, angle = at[:, 0], 0.5 * np.pi * at[:, 1]
    x = (2000.0 + 1250.0 * share) * np.cos(angle)
    y = (1000.0 + 1750.0 * share) * np.sin(angle)
    return np.column_stack([x, y, 600.0 * (at[:, 2] - 1.0)])


class Mesh:
    """Hexahedra of 8 or 20 nodes on a grid, by their places on it."""

    def __init__(self, n: tuple[int, int, int], place: Place, kind: str) -> None:
        low = np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), axis=-1).reshape(-1, 1, 3)
        natural = CORNERS
        if "20" in kind:
            natural = np.concatenate([CORNERS, CORNERS[HEX_EDGES].mean(axis=1)])
        every = (low + 0.5 * (natural + 1.0)).reshape(-1, 3)
        self.grid, members = np.unique(every, axis=0, return_inverse=True)
        self.members = members.reshape(-1, len(natural)) + 1
        self.n, self.place, self.kind = n, place, kind

    def lines(self) -> list[str]:
        """Nodes, elements and the material's section."""
        scaled = self.grid if self.place is not _plate else self.grid / self.n
        places = self.place(scaled).round(12) + 0.0
        text = [", ".join(map(str, [k, *row])) for k, row in enumerate(self.members.tolist(), 1)]
        rows = [line for row in text for line in _split(row)]
        return [
            "*Node, nset=ALL",
            *(f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(places.tolist(), 1)),
            *(f"*Element, type={self.kind}, elset=BODY", *rows),
            "*Solid Section, elset=BODY, material=M",
        ]

    def at(self, axis: int, value: float) -> list[int]:
        """Nodes on a plane of the grid."""
        return (np.flatnonzero(self.grid[:, axis] == value) + 1).tolist()

    def shares(self, nodes: list[int]) -> list[float]:
        """Shares of a force on the nodes of one face: quarters, or -1/12 and 1/3."""
        if len(nodes) == 4:
            return [0.25] * 4
        own = self.grid[np.array(nodes) - 1]
        return [1.0 / 3.0 if (row % 1.0).any() else -1.0 / 12.0 for row in own]


def _split(row: str) -> list[str]:
    words = row.split(", ")
    return [", ".join(words[:16]) + ",", ", ".join(words[16:])] if len(words) > 16 else [row]


def _set(name: str, nodes: list[int]) -> list[str]:
    return [f"*Nset, nset={name}", *map(str, nodes)]


def solved_lines(
    lines: list[str], *, judged: bool = True
) -> tuple[np.ndarray, np.ndarray | None, Answer]:
    """Displacements of all nodes here and in CalculiX, and our answer."""
    deck = deck_of_lines(lines)
    answer = solve_static(deck.problem(), PLAIN)
    nodes, theirs = deck_nodes(deck), None
    order = np.argsort(nodes.label)
    if judged and calculix_available():
        with TemporaryDirectory() as folder:
            path = Path(folder, "deck.inp")
            path.write_text("\n".join([*lines, ""]), "ascii")
            theirs = original(nodes, path).displacements[order]
    return ours(nodes, answer)[order], theirs, answer


def beam_lines(shape: str, kind: str, component: int = 2) -> list[str]:
    """Deck of a beam with a unit force at its tip along a component, 1 to 3."""
    place, ratio = (_curved, 0.25) if shape == "curved" else (_straight(shape), 0.3)
    mesh = Mesh((6, 1, 1), place, kind)
    tip = mesh.at(0, 6.0)
    return [
        *mesh.lines(),
        *(*_set("ROOT", mesh.at(0, 0.0)), *_set("TIP", tip)),
        *("*Material, name=M", "*Elastic", f"1e7, {ratio}", "*Boundary", "ROOT, 1, 3"),
        *("*Step", "*Static", "*Cload"),
        *(f"{node}, {component}, {of!r}" for node, of in zip(tip, mesh.shares(tip), strict=True)),
        *("*Node Print, nset=ALL", "U", "*End Step"),
    ]


def tip_moves(lines: list[str], moved: np.ndarray, component: int) -> float:
    """Mean displacement of the tip's nodes along a component [mm]."""
    first = lines.index("*Nset, nset=TIP") + 1
    tip = [int(line) for line in lines[first : lines.index("*Material, name=M")]]
    return float(moved[np.array(tip) - 1, component - 1].mean())


def beams() -> Iterator[dict[str, Any]]:
    """Tip displacement of each beam, load and element over the theory."""
    for shape in (*_LEAN, "curved"):
        for load, (component, theory) in (_CURVED if shape == "curved" else _STRAIGHT).items():
            for kind in ("C3D8I", "C3D8", "C3D20", "C3D20R"):
                lines = beam_lines(shape, kind, component)
                mine, theirs, _ = solved_lines(lines)
                row = {"beam": shape, "load": load, "element": kind, "theory": theory}
                row["tubelock"] = tip_moves(lines, mine, component) / theory
                if theirs is not None:
                    row["CalculiX"] = tip_moves(lines, theirs, component) / theory
                yield row


def plate() -> Iterator[dict[str, Any]]:
    """LE10: the stress σyy at the inner edge of the upper face [MPa], NAFEMS -5.38."""
    for n in ((4, 6, 2), (8, 12, 4)):
        mesh = Mesh(n, _plate, "C3D20")
        top = [k for k, row in enumerate(mesh.members.tolist(), 1) if _is_top(mesh, row)]
        middle = set(mesh.at(2, 0.5 * n[2])) & set(mesh.at(0, n[0]))
        lines = [
            *mesh.lines(),
            *_set("ALONG-X", mesh.at(1, 0.0)),
            *_set("ALONG-Y", mesh.at(1, n[1])),
            *_set("OUTER", mesh.at(0, n[0])),
            *_set("EDGE", sorted(middle)),
            *("*Elset, elset=UPPER", *map(str, top)),
            *("*Material, name=M", "*Elastic", "210000., 0.3", "*Boundary"),
            *("ALONG-X, 2", "ALONG-Y, 1", "OUTER, 1, 2", "EDGE, 3"),
            *("*Step", "*Static", "*Dload", "UPPER, P2, 1."),
            *("*Node Print, nset=ALL", "U", "*End Step"),
        ]
        mine, theirs, answer = solved_lines(lines)
        place = np.array([2000.0, 0.0, 0.0])
        there = int(np.linalg.norm(answer.points - place, axis=1).argmin())
        corner = int(np.linalg.norm(_plate(mesh.grid / n) - place, axis=1).argmin())
        # By symmetry y is a principal axis there, and the most compressed one.
        row = {"mesh": "{} × {} × {}".format(*n), "NAFEMS [MPa]": -5.38}
        row["σyy [MPa]"] = float(answer.fields["principal_stress"][there].min())
        row["u_z [mm]"] = float(mine[corner, 2])
        row["CalculiX u_z [mm]"] = None if theirs is None else float(theirs[corner, 2])
        yield row


def _is_top(mesh: Mesh, members: list[int]) -> bool:
    return bool(mesh.grid[np.array(members) - 1, 2].max() == mesh.n[2])
