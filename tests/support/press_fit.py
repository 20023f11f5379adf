"""Deck of a block of 5.001 mm beside a wall at 5 mm, as a person builds it in a preprocessor.

The first step resolves the interference, the second presses the block out, against friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MODULUS = 210000.0
#: Penalty and stick slope [MPa/mm], and friction.
JOINT, STICK, MU = 1e5, 1e4, 0.1
#: Interference and way of the push [mm].
BLOCK, WAY = 0.001, 0.01


def block_pressure() -> float:
    """Block of 5 mm without lateral strain, and the joint in series [MPa]."""
    return BLOCK / ((5.0 + BLOCK) / MODULUS + 1.0 / JOINT)


@dataclass(frozen=True)
class Grid:
    """Hexahedra between lines of nodes."""

    name: str
    first: int
    """Nodes and elements of the parts before."""
    lines: tuple[np.ndarray, np.ndarray, np.ndarray]

    @property
    def numbers(self) -> np.ndarray:
        """Of the nodes, by their place along the lines."""
        shape = tuple(map(len, self.lines))
        return self.first + 1 + np.arange(np.prod(shape)).reshape(shape)

    def mesh(self) -> list[str]:
        """Nodes and elements."""
        at = np.stack(np.meshgrid(*self.lines, indexing="ij"), axis=-1).reshape(-1, 3)
        places = (at.round(12) + 0.0).tolist()
        nodes = [f"{self.first + k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(places, 1)]
        n, a, b = self.numbers, slice(None, -1), slice(1, None)
        around = ((a, a), (b, a), (b, b), (a, b))
        corners = [n[i, j, k].ravel() for k in (a, b) for i, j in around]
        rows = np.stack(corners, axis=1).tolist()
        elements = [", ".join(map(str, [self.first + k, *row])) for k, row in enumerate(rows, 1)]
        return ["*Node, nset=ALL", *nodes, f"*Element, type=C3D8, elset={self.name}", *elements]

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


def block(around: int) -> list[str]:
    """Half of a block, held at its middle, beside a wall that does not move and is larger."""
    line = np.linspace(0.0, 4.0, around // 3 + 1)
    one = Grid("BLOCK", 0, (np.linspace(0.0, 5.0 + BLOCK, 4), line, line))
    line = np.linspace(-1.0, 5.0, around // 3)
    two = Grid("WALL", one.numbers.size, (np.array([5.0, 6.0]), line, line))
    return deck(one, two, ["CUT, 1", "BLOCK-START, 2", "BLOCK-END, 2", "FAR, 1, 3"], 0.0)
