"""Decks and meshes written, read back and described."""

from __future__ import annotations

import re
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from fem.decks.keywords import DeckError
from fem.decks.read.cards import read_cards
from fem.decks.read.deck import read_deck
from fem.decks.statement import Deck, Flavour, element_name
from fem.decks.write import write_deck
from fem.element.material import Material
from geometry.errors import RefusedError, unreadable
from geometry.files.mesh_io import assembly_mesh, read_hex_mesh, write_hex_mesh
from geometry.files.whole import write_whole
from geometry.mesh import HexMesh, corner_jacobians
from validation.build.deck import build_deck
from validation.errors import InputError, named
from validation.output.console import two_columns
from validation.output.files import prepare_file
from validation.scene.read import SceneFile

#: Keywords of a file with a mesh and nothing else.
_MESH_KEYWORDS = {"HEADING", "NODE", "ELEMENT", "NSET", "ELSET"}


@dataclass(frozen=True)
class WrittenDeck:
    """A deck on disk."""

    deck: Deck
    """What it says."""
    path: Path
    """Where it is."""
    n_bytes: int
    """Its size."""
    keywords: dict[str, int]
    """How often each keyword occurs."""
    cpu_seconds: float
    """CPU time of building and writing it."""


def export_deck(file: SceneFile, flavour: Flavour | None, path: Path) -> WrittenDeck:
    """Write the deck of a scene, whole or not at all.

    Raises
    ------
    InputError
        For a scene that the program has no words for, or a path that cannot be written.
    """
    start = time.process_time()
    if path.suffix.lower() != ".inp":
        raise InputError(f"-o {path}: expected a file name that ends in .inp")
    deck = build_deck(file, flavour)
    return _write(deck, path, start)


def _elements(deck: Deck) -> str:
    """Names of the elements of all shapes."""
    names = {deck.element: str(deck.element.value)}
    return ", ".join(dict.fromkeys(element_name(deck, names, s) for s in deck.assembly.shapes))


def _write(deck: Deck, path: Path, start: float) -> WrittenDeck:
    prepare_file(path)
    keywords: dict[str, int] = {}
    with named(deck.name):
        write_whole(path, lambda partial: keywords.update(write_deck(partial, deck)))
    return WrittenDeck(deck, path, path.stat().st_size, keywords, time.process_time() - start)


def print_export(written: WrittenDeck, console: Console) -> None:
    """Print the contents of a deck that was written."""
    deck = written.deck
    table = _description(deck, f"{deck.name}: deck, flavour {deck.flavour}")
    table.add_row("file", f"{written.path}, {written.n_bytes / 1e6:.3g} MB")
    words = (f"{word} ({count})" for word, count in written.keywords.items())
    table.add_row("keywords", ", ".join(words))
    table.add_row("CPU seconds", f"{written.cpu_seconds:.3f}")
    console.print(table)


# ---------------------------------------------------------------------------------------------
# Import


def import_deck(path: Path) -> Deck:
    """Read a deck that `export` wrote.

    Raises
    ------
    InputError
        With the line that cannot be read.
    """
    try:
        with named(str(path)), path.open(encoding="ascii") as file:
            return read_deck(file)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected a deck") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text (byte {error.start}); expected a deck") from None


def import_mesh(path: Path) -> HexMesh:
    """Read the hexahedra of a mesh file of any format that meshio knows.

    Raises
    ------
    InputError
        For no hexahedra, bad ones, or a flat deck that says more than a mesh (naming the line).
    """
    try:
        if path.suffix.lower() == ".inp":
            _check_mesh_alone(path)
        return read_hex_mesh(path)
    except RefusedError as error:
        text = str(error)
        raise InputError(text if str(path) in text else f"{path}: {text}") from None


def _check_mesh_alone(path: Path) -> None:
    """Reject a flat deck that says more than a mesh: a mesh reader would drop it silently."""
    with path.open(encoding="utf-8", errors="replace") as file:
        for card in read_cards(file):
            if card.keyword not in _MESH_KEYWORDS:
                raise DeckError(
                    f"line {card.line}: *{card.keyword.title()} is not supported; import reads "
                    "decks that `export` wrote (general, pairs), and files with a mesh alone"
                )


def import_file(path: Path, output: Path | None) -> tuple[Table, dict[str, Any]]:
    """Read a deck or a mesh, write it again where asked; what it says, as text and as data.

    Raises
    ------
    InputError
        For no file, or one that cannot be read or written.
    """
    why = unreadable(path)
    if why is not None:
        raise InputError(f"{path}: {why}; expected a deck or a mesh")
    start = time.process_time()
    if _is_deck(path):
        deck = import_deck(path)
        seconds = time.process_time() - start
        table, data = _description(deck, f"{path}: deck of {deck.name}"), deck_json(deck)
        if output is not None and output.suffix.lower() == ".inp":
            _write(deck, output, start)
        elif output is not None:
            _write_mesh(output, *assembly_mesh(deck.assembly))
    else:
        mesh = import_mesh(path)
        seconds = time.process_time() - start
        table, data = _mesh_description(mesh, f"{path}: mesh"), mesh_json(mesh)
        if output is not None:
            _write_mesh(output, mesh, np.zeros(mesh.n_elements, dtype=np.int64))
    table.add_row("CPU seconds", f"{seconds:.3f}")
    if output is not None:
        table.add_row("written", str(output))
    return table, data


def _is_deck(path: Path) -> bool:
    """Whether a file claims to come from `export`."""
    if path.suffix.lower() != ".inp":
        return False
    with path.open(encoding="ascii", errors="replace") as file:
        head = [file.readline() for _ in range(2)]
    return head[0].strip().lower() == "*heading" and head[1].startswith("tubelock ")


def _write_mesh(path: Path, mesh: HexMesh, owner: np.ndarray[Any, Any]) -> None:
    try:
        write_hex_mesh(path, mesh, cell_data={"block": owner.astype(np.int32)})
    except OSError:
        raise
    # Each of meshio's writers has its own way to say what it cannot hold.
    except Exception as error:
        reason = " ".join(re.sub(r"\.partial-\w+", path.stem, str(error)).split())
        raise InputError(
            f"-o {path}: cannot be written as a mesh ({reason}); expected .inp, .vtu, …"
        ) from None


# ---------------------------------------------------------------------------------------------
# Words and data


def deck_json(deck: Deck) -> dict[str, Any]:
    """Return what a deck says as plain data."""
    assembly, names = deck.assembly, deck.material_names
    shapes = Counter(assembly.shape(b).name for b in range(assembly.n_blocks))
    return {
        "scene": deck.name,
        "flavour": str(deck.flavour),
        "procedure": str(deck.step.procedure),
        "blocks": dict(shapes),
        "n_nodes": sum(assembly.shape(b).mesh.n_nodes for b in range(assembly.n_blocks)),
        "n_elements": sum(assembly.shape(b).mesh.n_elements for b in range(assembly.n_blocks)),
        "volume": float(assembly.volumes.sum()),
        "element": _elements(deck),
        "material": _constants(next(iter(names)))
        if len(names) == 1
        else {name: _constants(material) for material, name in names.items()},
        "contact": None if deck.joint is None else type(deck.joint.law.members[0]).__name__,
        "held_blocks": len({hold.block for hold in deck.holds}),
        "loads": [{"kind": type(load).__name__, "blocks": len(load.blocks)} for load in deck.loads],
        "end_time": deck.step.end_time,
        "ramp_time": deck.step.ramp_time,
        "clearance": deck.clearance,
        "spacing": deck.spacing,
        "notes": list(deck.notes),
    }


def _constants(material: Material) -> dict[str, float]:
    """Constants that a deck has of a material."""
    return {
        "density": material.density,
        "young_modulus": material.young_modulus,
        "poisson_ratio": material.poisson_ratio,
    }


def mesh_json(mesh: HexMesh) -> dict[str, Any]:
    """Return what a mesh is as plain data."""
    return {
        "n_nodes": mesh.n_nodes,
        "n_elements": mesh.n_elements,
        "volume": mesh.extent()[0],
        "smallest_corner_jacobian": float(corner_jacobians(mesh).min()),
    }


def _description(deck: Deck, title: str) -> Table:
    data = deck_json(deck)
    table = two_columns(title)
    table.add_row("blocks", ", ".join(f"{n} {name}" for name, n in data["blocks"].items()))
    table.add_row(
        "mesh",
        f"{data['n_nodes']} nodes, {data['n_elements']} elements ({data['element']}), "
        f"{data['volume']:.6g} mm³",
    )
    for material, name in (names := deck.material_names).items():
        constants = f"{material.density:g} t/mm³, {material.young_modulus:g} MPa, ν = "
        row = "material" if len(names) == 1 else name.lower()
        table.add_row(row, f"{constants}{material.poisson_ratio:g}")
    table.add_row("contact", data["contact"] or "none")
    loads = [f"{load['kind']} on {load['blocks']} blocks" for load in data["loads"]]
    table.add_row("loads", ", ".join(loads) or "none")
    table.add_row("supports", f"{data['held_blocks']} fixed blocks")
    table.add_row(
        "step",
        f"{data['procedure']}, {deck.step.end_time:g} s, smooth step of {deck.step.ramp_time:g} s",
    )
    if deck.notes:
        table.add_row("notes", "\n".join(deck.notes))
    return table


def _mesh_description(mesh: HexMesh, title: str) -> Table:
    data = mesh_json(mesh)
    table = two_columns(title)
    table.add_row("mesh", f"{mesh.n_nodes} nodes, {mesh.n_elements} hexahedra")
    table.add_row("volume", f"{data['volume']:.6g} mm³")
    table.add_row("smallest corner Jacobian", f"{data['smallest_corner_jacobian']:.3g} mm³")
    return table
