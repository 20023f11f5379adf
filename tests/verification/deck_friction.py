"""A cube of 0.5 mm with friction on one of 1 mm, on finer and finer facets: which answer is right?

The problem is that of CalculiX' friction1: 210 000 MPa, ν = 0.3, 100 MPa on the small cube, whose
top and the foot of the other do not move sideways; 1e7 MPa/mm, μ = 0.2, stick slope 47 000 MPa/mm.
Pressures are means over a sixteenth of the face: its corner, and the four at its centre.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fem import Static, solve_static
from fem.decks.read.deck import deck_of_lines
from tests.support.ccx import run_calculix
from tests.verification.deck_oracle import deck_nodes, difference, gradual, ours

#: Edge of the small cube [mm] and its facets on a sixteenth of the face.
_EDGE = 0.5


def cube_lines(n: int, kind: str = "NODE TO SURFACE") -> list[str]:
    """Deck of n³ elements in each cube; nodes of the small one come first, layer by layer."""
    lines = ["*Node, nset=ALL"]
    for first, edge, corner in ((1, _EDGE, (0.25, 0.25, 1.0)), (1 + (n + 1) ** 3, 1.0, (0, 0, 0))):
        places = np.stack(np.meshgrid(*[np.arange(n + 1) * edge / n] * 3, indexing="ij"), axis=-1)
        places = places.transpose(2, 1, 0, 3).reshape(-1, 3) + corner
        lines += [
            f"{first + k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(places.tolist())
        ]
    number, step = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1), (n + 1) ** 3
    low = [number[:-1, :-1, :-1], number[:-1, :-1, 1:], number[:-1, 1:, 1:], number[:-1, 1:, :-1]]
    corners = np.stack([*low, *(part + (n + 1) ** 2 for part in low)], axis=-1).reshape(-1, 8) + 1
    for name, first in (("SMALL", 0), ("BIG", 1)):
        lines.append(f"*Element, type=C3D8, elset={name}")
        for k, row in enumerate((corners + first * step).tolist()):
            lines.append(", ".join(map(str, [first * n**3 + k + 1, *row])))
    top, foot = n**3 - n**2 + 1, step + 1
    return [
        *lines,
        *("*Elset, elset=UNDER, generate", f"1, {n**2}", "*Elset, elset=LID, generate"),
        *(f"{top}, {n**3}", "*Elset, elset=SEAT, generate", f"{n**3 + top}, {2 * n**3}"),
        *("*Nset, nset=HEAD, generate", f"{step - (n + 1) ** 2 + 1}, {step}"),
        *("*Nset, nset=FOOT, generate", f"{foot}, {foot + (n + 1) ** 2 - 1}"),
        *("*Nset, nset=SLAVE, generate", f"1, {(n + 1) ** 2}"),
        *("*Surface, name=SLAVES", "UNDER, S1", "*Surface, name=MASTERS", "SEAT, S2"),
        *("*Material, name=EL", "*Elastic", "210000., .3", "*Density", "7.8E-9"),
        *("*Solid Section, elset=SMALL, material=EL", "*Solid Section, elset=BIG, material=EL"),
        *("*Boundary", "FOOT, 1, 3", "HEAD, 1, 2"),
        *(f"*Contact Pair, interaction=I, type={kind}", "SLAVES, MASTERS"),
        *("*Surface Interaction, name=I", "*Surface Behavior, pressure-overclosure=LINEAR"),
        *("1.e7, 3.", "*Friction", "0.2, 47000.", "*Step", "*Static", "*Dload", "LID, P2, 100."),
        *("*Node Print, nset=ALL", "U", "*Contact Print, nset=SLAVE", "CSTR", "*End Step", ""),
    ]


def rows(finest: int = 16) -> Iterator[dict[str, Any]]:
    """Pressures and the largest displacement of both programs, and their difference."""
    n = 4
    while n <= finest:
        deck = deck_of_lines(cube_lines(n))
        answer = solve_static(deck.problem(), Static(mesh="scene", error_estimate=False))
        moved = ours(deck_nodes(deck), answer)
        place, area = answer.contacts["centroid"], answer.contacts["area"]
        pressure = answer.contacts["pressure"]
        yield _row(n, "tubelock", moved) | _means(place, pressure * area, area)
        with TemporaryDirectory() as folder:
            path = Path(folder, "cubes.inp")
            path.write_text("\n".join(gradual(cube_lines(n))), "ascii")
            theirs = run_calculix(path)
        nodes = deck_nodes(deck)
        edge = np.minimum(*_ends(nodes.place[theirs.slave_nodes]))
        share = (_EDGE / n) ** 2 * np.where(edge < 1e-9, 0.5, 1.0).prod(axis=1)
        at = nodes.place[theirs.slave_nodes]
        row = _row(n, "CalculiX", theirs.displacements)
        row |= _means(at, theirs.pressures * share, share)
        yield row | {"u off [%]": difference(moved, theirs.displacements)}
        n *= 2


def _ends(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances of places from both ends of the small cube along x and y, (n, 2) [mm] each."""
    local = place[:, :2] - 0.25
    return local, _EDGE - local


def _row(n: int, program: str, moved: np.ndarray) -> dict[str, Any]:
    largest = float(np.linalg.norm(moved, axis=1).max())
    return {"facets": f"{n} × {n}", "program": program, "u [mm]": largest}


def _means(place: np.ndarray, force: np.ndarray, area: np.ndarray) -> dict[str, Any]:
    """Means of the pressure: points on the rim of a part count with half of their area."""
    low, high = _ends(place)
    quarter = 0.25 * _EDGE
    result: dict[str, Any] = {}
    corner = np.minimum(low, high)
    centre = 2.0 * quarter - corner
    for title, inside in (("corner", corner), ("centre", centre)):
        # 1 inside, half on the inner rim.
        weight = np.where(inside < quarter - 1e-9, 1.0, 0.0) + 0.5 * (
            np.abs(inside - quarter) < 1e-9
        )
        share = weight.prod(axis=1)
        result[f"p {title} [MPa]"] = float((share * force).sum() / (share * area).sum())
    return result
