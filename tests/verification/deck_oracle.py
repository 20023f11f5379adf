"""CalculiX as the judge of how a deck is read: displacements of its nodes by number.

The deck as it is and the one that this package writes of it are solved by CalculiX; our answer and
the reference files of its test suite (``NAME.dat.ref``) stand beside.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import KDTree

from fem import read_deck
from fem.decks.deck import Flavour
from fem.decks.read.deck import InputDeck
from geometry import Answer
from tests.support.ccx import CalculixResult, run_calculix
from tests.support.decks import written_again as lines_of

#: Set of all nodes that the judge prints.
_EVERY = "TUBELOCK-EVERY-NODE"
_STRESS = re.compile(
    r"contact stress .* time +\S+\s*\n\s*\n((?: *\d+(?: +\d+)?(?: +\S+\.\S+){3} *\n)+)"
)
_TABLE = re.compile(r"displacements .* time +(\S+)\s*\n\s*\n((?: *\d+(?: +\S+){3} *\n)+)")


@dataclass(frozen=True)
class Nodes:
    """Nodes of the blocks of a flat deck."""

    label: np.ndarray
    """Numbers in the deck, (n,)."""
    block: np.ndarray
    """(n,)"""
    place: np.ndarray
    """(n, 3) [mm]"""


def deck_nodes(deck: InputDeck) -> Nodes:
    """Nodes of the elements of a flat deck, by block."""
    blocks = deck.built.blocks
    rows = []
    for block in range(len(blocks.owners)):
        part, solid = blocks.instance(block).part, blocks.solid(block)
        own = np.union1d(solid.nodes, solid.others)
        rows.append(own[own < len(part.places)])
    label = np.array(list(part.index))
    return Nodes(
        np.concatenate([label[own] for own in rows]),
        np.repeat(np.arange(len(rows)), [len(own) for own in rows]),
        np.concatenate([blocks.coordinates(b, own) for b, own in enumerate(rows)]),
    )


def at_nodes(nodes: Nodes, block: np.ndarray, place: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values of points at the nodes of the same blocks and places; zero in other blocks."""
    result = np.zeros((len(nodes.label), values.shape[1]))
    for number in np.unique(block).tolist():
        here, there = nodes.block == number, block == number
        _, nearest = KDTree(place[there]).query(nodes.place[here])
        result[here] = values[there][nearest]
    return result


def ours(nodes: Nodes, answer: Answer) -> np.ndarray:
    """Our displacements of nodes, (n, 3) [mm]."""
    return at_nodes(nodes, answer.block_of_point, answer.points, answer.fields["displacement"])


def printed(nodes: Nodes, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Displacements at the last time of a printed file: positions in `nodes`, values [mm]."""
    tables = _TABLE.findall(path.read_text("latin-1"))
    last = [rows for time, rows in tables if time == tables[-1][0]]
    values = np.array([row.split() for rows in last for row in rows.splitlines()], dtype=np.float64)
    values = values.reshape(-1, 4)
    position = {label: k for k, label in enumerate(nodes.label.tolist())}
    known = [row for row in values.tolist() if int(row[0]) in position]
    where = np.array([position[int(row[0])] for row in known], dtype=np.int64)
    return where, np.array(known).reshape(-1, 4)[:, 1:]


def printed_pressures(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Slaves, their sides and pressures [MPa] of the last table of a printed file; None: none."""
    tables = _STRESS.findall(path.read_text("latin-1"))
    if not tables:
        return None
    rows = np.array([row.split() for row in tables[-1].splitlines()], dtype=np.float64)
    slaves = rows[:, 0].astype(np.int64)
    sides = rows[:, 1].astype(np.int64) if rows.shape[1] > 4 else np.zeros_like(slaves)
    return slaves, sides, rows[:, -3]


def gradual(lines: list[str]) -> list[str]:
    """Deck whose static steps begin with a tenth of their time.

    CalculiX keeps the contact of faces that it finds at the beginning of an increment: with one
    increment displacements can be off by 6 %, although it prints no warning.
    """
    result = list[str]()
    for line in lines:
        before = result[-1].replace(" ", "").upper() if result else ""
        if before.startswith("*STATIC"):
            words = [*line.split(","), "", ""]
            own = not line.startswith("*")
            time = words[1].strip() if own and words[1].strip() else "1."
            result.append(f"{0.1 * float(time)}, {time}")
            if own:
                continue
        result.append(line)
    return result


def original(nodes: Nodes, path: Path) -> CalculixResult:
    """CalculiX on the deck as it is, with requests of all nodes and contacts.

    Displacements are those of `nodes`, (n, 3) [mm].
    """
    lines = [line for line in path.read_text("latin-1").splitlines() if line[:2] != "**"]
    meets = any("PAIR" in line.upper() for line in lines)
    lines = gradual(lines) if meets else lines
    end = max(k for k, line in enumerate(lines) if line.replace(" ", "").upper() == "*ENDSTEP")
    lines[end:end] = [f"*NODE PRINT, NSET={_EVERY}, GLOBAL=YES", "U"]
    lines[end:end] = ["*CONTACT PRINT", "CSTR"] * meets
    begin = next(k for k, line in enumerate(lines) if line.lstrip().upper().startswith("*STEP"))
    every = np.unique(nodes.label)
    lines[begin:begin] = [f"*NSET, NSET={_EVERY}", *map(str, every.tolist())]
    with TemporaryDirectory() as folder:
        copy = Path(folder, "original.inp")
        copy.write_text("\n".join([*lines, ""]), "latin-1")
        result = run_calculix(copy)
    moved = result.displacements[-len(every) :]
    return replace(result, displacements=moved[np.searchsorted(every, nodes.label)])


def pressures(
    deck: InputDeck, answer: Answer, slaves: np.ndarray, sides: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Contact pressures of tubelock and of another program at the slaves of this, (n,) [MPa].

    Slaves are numbers of nodes, or of elements, of which ``sides`` then has the side. Each of our
    facets counts at the nearest slave, by its area: sides have the mean of their points.
    """
    part, body = deck.places.instances[0].part, deck.built.blocks.bodies[0]
    places = body.hexahedra.nodes
    alike, group = np.unique(np.column_stack([slaves, sides]), axis=0, return_inverse=True)
    theirs = np.bincount(group.ravel(), values) / np.bincount(group.ravel())
    corners = [
        body.corners[part.element_index[slave], side - 1] if side else [part.index[slave]]
        for slave, side in alike.tolist()
    ]
    centre = np.array([places[rows].mean(axis=0) for rows in corners])
    at, pressure, area = (answer.contacts[key] for key in ("centroid", "pressure", "area"))
    share = np.zeros((len(at), len(centre)))
    # Facets between nodes count at all that are as near as the nearest.
    away = np.linalg.norm(at[:, None] - centre, axis=2)
    share[away <= 1.01 * away.min(axis=1, keepdims=True)] = 1.0
    share *= (area / share.sum(axis=1))[:, None]
    found = pressure @ share / np.maximum(share.sum(axis=0), 1e-300)
    touched = share.any(axis=0)
    return found[touched], theirs[touched]


def written_again(nodes: Nodes, deck: InputDeck) -> np.ndarray:
    """Displacements by CalculiX of the deck that this package writes, (n, 3) [mm]."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "again.inp")
        path.write_text("\n".join([*lines_of(deck, Flavour.CALCULIX), ""]), "ascii")
        again = deck_nodes(read_deck(path))
        moved = run_calculix(path).displacements[again.label - 1]
    return at_nodes(nodes, again.block, again.place, moved)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of displacements over the largest of them [%]."""
    size = max(float(np.linalg.norm(values, axis=1).max(initial=0.0)) for values in (one, other))
    return 100.0 * float(np.linalg.norm(one - other, axis=1).max(initial=0.0)) / (size or 1.0)
