"""CalculiX as the judge of how a deck is read: displacements of its nodes by number."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import KDTree

from fem.decks.read.deck import InputDeck
from geometry import Answer
from tests.support.ccx import CalculixResult, run_calculix

#: Set of all nodes that the judge prints.
_EVERY = "TUBELOCK-EVERY-NODE"


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
    parts = [one.part for one in deck.blocks.instances]
    labels = [np.array(list(part.index)) for part in parts]
    return Nodes(
        np.concatenate(labels),
        np.repeat(np.arange(len(parts)), list(map(len, labels))),
        np.concatenate([part.nodes for part in parts]),
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


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of displacements over the largest of them [%]."""
    size = max(float(np.linalg.norm(values, axis=1).max(initial=0.0)) for values in (one, other))
    return 100.0 * float(np.linalg.norm(one - other, axis=1).max(initial=0.0)) / (size or 1.0)
