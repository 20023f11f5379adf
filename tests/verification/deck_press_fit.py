"""Decks of a press fit and of a push through: closed form, tubelock, CalculiX.

Quarters of two rings, Ø 20 / 40.005 in Ø 40 / 60 mm, whose meshes overlap by 0.0025 mm, and a block
of 5.001 mm beside a wall at 5 mm, as a person builds them in a preprocessor. The first step
resolves the interference, the second presses the inner part out along z, against friction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fem import solve_static
from fem.decks.read.deck import deck_of_lines
from tests.support.ccx import calculix_available, run_calculix

MODULUS = 210000.0
#: Penalty and stick slope [MPa/mm], and friction.
JOINT, STICK, MU = 1e5, 1e4, 0.1
#: Radii of the rings, their interference and that of the block, height of both, way of the push.
INNER, MIDDLE, OUTER, RINGS, BLOCK, HEIGHT, WAY = 10.0, 20.0, 30.0, 0.0025, 0.001, 4.0, 0.01


def ring_pressure() -> float:
    """Two thick rings under plane stress (Lamé), and the joint [MPa]."""
    inner = (MIDDLE**2 + INNER**2) / (MIDDLE**2 - INNER**2)
    outer = (OUTER**2 + MIDDLE**2) / (OUTER**2 - MIDDLE**2)
    return RINGS / (MIDDLE * (inner + outer) / MODULUS + 1.0 / JOINT)


def block_pressure() -> float:
    """Block of 5 mm without lateral strain, and the joint in series [MPa]."""
    return BLOCK / ((5.0 + BLOCK) / MODULUS + 1.0 / JOINT)


@dataclass(frozen=True)
class Grid:
    """Hexahedra between lines of nodes, mapped to their places."""

    name: str
    first: int
    """Nodes and elements of the parts before."""
    lines: tuple[np.ndarray, np.ndarray, np.ndarray]
    place: Callable[[np.ndarray], np.ndarray]

    @property
    def numbers(self) -> np.ndarray:
        """Of the nodes, by their place along the lines."""
        shape = tuple(map(len, self.lines))
        return self.first + 1 + np.arange(np.prod(shape)).reshape(shape)

    def mesh(self) -> list[str]:
        """Nodes and elements."""
        at = np.stack(np.meshgrid(*self.lines, indexing="ij"), axis=-1).reshape(-1, 3)
        nodes = [f"{self.first + k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in self._placed(at)]
        n, a, b = self.numbers, slice(None, -1), slice(1, None)
        around = ((a, a), (b, a), (b, b), (a, b))
        corners = [n[i, j, k].ravel() for k in (a, b) for i, j in around]
        rows = np.stack(corners, axis=1).tolist()
        elements = [", ".join(map(str, [self.first + k, *row])) for k, row in enumerate(rows, 1)]
        return ["*Node, nset=ALL", *nodes, f"*Element, type=C3D8, elset={self.name}", *elements]

    def _placed(self, at: np.ndarray) -> Iterator[tuple[int, list[float]]]:
        return enumerate((self.place(at).round(12) + 0.0).tolist(), 1)

    def side(self, name: str, nodes: np.ndarray) -> list[str]:
        """Set of nodes."""
        return [f"*Nset, nset={name}", *map(str, nodes.ravel().tolist())]

    def surface(self, name: str, side: str, *, last: bool) -> list[str]:
        """Facets at the beginning or end of the first lines: those of C3D8 are S6 and S4."""
        shape = tuple(len(line) - 1 for line in self.lines)
        elements = self.first + 1 + np.arange(np.prod(shape)).reshape(shape)[-1 if last else 0]
        rows = [f"*Elset, elset={name}-E", *map(str, elements.ravel().tolist())]
        return [*rows, f"*Surface, name={name}", f"{name}-E, {side}"]


def deck(one: Grid, two: Grid, held: list[str], ratio: float) -> list[str]:
    """Deck of two parts, the first of which is pressed out of its fit with the second."""
    return [
        *(*one.mesh(), *two.mesh(), *one.side("PUSHED", one.numbers[:, :, -1])),
        *one.side("CUT", one.numbers[0]),
        *(line for g in (one, two) for line in g.side(f"{g.name}-START", g.numbers[:, 0])),
        *(line for g in (one, two) for line in g.side(f"{g.name}-END", g.numbers[:, -1])),
        *(*two.side("FOOT", two.numbers[:, :, 0]), *two.side("FAR", two.numbers)),
        *(*one.surface("SLAVE", "S4", last=True), *two.surface("MASTER", "S6", last=False)),
        *("*Material, name=STEEL", "*Elastic", f"{MODULUS}, {ratio}"),
        *(f"*Solid Section, elset={g.name}, material=STEEL" for g in (one, two)),
        *("*Surface Interaction, name=I", "*Surface Behavior, pressure-overclosure=LINEAR"),
        *(f"{JOINT}", "*Friction", f"{MU}, {STICK}"),
        *("*Contact Pair, interaction=I, type=SURFACE TO SURFACE", "SLAVE, MASTER"),
        *("*Boundary", *held, "PUSHED, 3"),
        *("*Step, inc=1000", "*Static", "0.1, 1.", "*End Step", "*Step, inc=1000", "*Static"),
        *("0.05, 1., 1e-6, 0.05", "*Boundary", f"PUSHED, 3, 3, {-WAY}"),
        *("*Node Print, nset=ALL", "U", "*Node Print, nset=PUSHED, totals=ONLY", "RF"),
        *("*Contact Print", "CSTR", "*End Step", ""),
    ]


def rings(around: int) -> list[str]:
    """Quarters of two rings."""

    def place(at: np.ndarray) -> np.ndarray:
        radius, angle, height = at.T
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])

    angles, heights = np.linspace(0.0, 0.5 * np.pi, around + 1), np.linspace(0.0, HEIGHT, 3)
    radii = np.linspace(INNER, MIDDLE + RINGS, around // 3 + 2)
    one = Grid("INNER", 0, (radii, angles, heights), place)
    radii = np.linspace(MIDDLE, OUTER, around // 3 + 2)
    two = Grid("OUTER", one.numbers.size, (radii, angles, heights), place)
    held = [
        f"{name}-{side}, {k}"
        for name in ("INNER", "OUTER")
        for side, k in (("START", 2), ("END", 1))
    ]
    return deck(one, two, [*held, "FOOT, 3"], 0.3)


def block(around: int) -> list[str]:
    """Half of a block, held at its middle, beside a wall that does not move and is larger."""
    line = np.linspace(0.0, 4.0, around // 3 + 1)
    one = Grid("BLOCK", 0, (np.linspace(0.0, 5.0 + BLOCK, 4), line, line), lambda at: at)
    line = np.linspace(-1.0, 5.0, around // 3)
    two = Grid("WALL", one.numbers.size, (np.array([5.0, 6.0]), line, line), lambda at: at)
    return deck(one, two, ["CUT, 1", "BLOCK-START, 2", "BLOCK-END, 2", "FAR, 1, 3"], 0.0)


#: Deck on a mesh, pressure and area of the joint.
CASES = {
    "rings": (rings, ring_pressure, 0.5 * np.pi * MIDDLE * HEIGHT),
    "block": (block, block_pressure, 4.0 * HEIGHT),
}


def rows(meshes: tuple[int, ...] = (6, 12, 24)) -> Iterator[dict[str, Any]]:
    """Mean pressure of each joint and force of the push, beside closed form and CalculiX."""
    for name, (make, pressure, area) in CASES.items():
        yield _row(name, "closed form", pressure(), MU * pressure() * area)
        for around in meshes:
            lines = make(around)
            stated = deck_of_lines(lines)
            answer = solve_static(stated.problem(), stated.method)
            mean = float(answer.contacts["pressure"] @ answer.contacts["area"]) / area
            (curve,) = answer.report["motions"]
            yield _row(f"{name}, {around}", "tubelock", mean, abs(curve["force"][-1]))
            if calculix_available():
                with TemporaryDirectory() as folder:
                    path = Path(folder, "fit.inp")
                    path.write_text("\n".join(lines), "ascii")
                    found = run_calculix(path)
                force = abs(float(found.reactions["PUSHED"][2]))
                yield _row(f"{name}, {around}", "CalculiX", None, force)


def _row(case: str, program: str, pressure: float | None, force: float) -> dict[str, Any]:
    return {"case": case, "program": program, "p [MPa]": pressure, "push [N]": force}
