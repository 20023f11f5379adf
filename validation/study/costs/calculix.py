"""CalculiX as a setting of `tubelock cost`: our deck, its displacements and its pressures.

Its price is the CPU time of the program alone; our writing and reading of files are not in it. It
gives pressures at nodes of one of two surfaces: the largest of them, and of each facet the mean of
its corners. The averaged stress is ours, of its displacements.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fem.decks.deck import Deck, Flavour
from fem.decks.write import write_deck
from fem.stresses.peaks import stress_peaks
from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray
from geometry.parts.measures import block_measures
from validation.build.deck import build_deck
from validation.case import scene_case
from validation.errors import InputError
from validation.scene.family import AssemblyScene
from validation.study.comparison.calculix import CalculixError, CalculixResult, run_calculix

#: Wall time after which a run is given up [s].
_TIMEOUT = 1800.0


@dataclass(frozen=True)
class MethodAnswer:
    """What a method says of a scene, as `tubelock cost` measures it."""

    assembly: Assembly
    scalars: dict[str, float]
    contacts: IntArray
    """Facets in the interfaces of the assembly, (n,)."""
    pressures: FloatArray
    """Mean pressure of each, (n,) [MPa]."""
    cpu_seconds: float
    details: dict[str, Any] = field(default_factory=dict)
    """Numbers of the solver."""


def solve_by_calculix(where: str, scene: AssemblyScene) -> MethodAnswer:
    """Write the deck of a scene, run CalculiX on it and measure what it answers."""
    deck = build_deck(scene_case(scene, where), Flavour.CALCULIX)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "deck.inp"
        write_deck(path, deck)
        try:
            result = run_calculix(path, timeout=_TIMEOUT)
        except CalculixError as error:
            raise InputError(f"{where}: {error}") from None
    return measured_answer(deck, result)


def measured_answer(deck: Deck, printed: CalculixResult) -> MethodAnswer:
    """Measure what CalculiX printed of the deck of a scene."""
    contacts, pressures = _facet_pressures(deck, printed)
    assembly, interfaces = deck.assembly, deck.assembly.interfaces
    per_block = block_measures(
        assembly.free_blocks,
        interfaces.block_m[contacts],
        interfaces.block_s[contacts],
        pressures,
        interfaces.areas[contacts],
    )
    scalars = {
        "p_max_point": float(printed.pressures.max(initial=0.0)),
        "p_eff": float(per_block.p_eff.mean()),
        "sigma_1_averaged": _averaged_tension(deck, printed),
        "max_displacement": float(np.linalg.norm(printed.displacements, axis=1).max()),
    }
    return MethodAnswer(assembly, scalars, contacts, pressures, printed.cpu_seconds)


def _facet_pressures(deck: Deck, printed: CalculixResult) -> tuple[IntArray, FloatArray]:
    """Facets of which one block at least is free, and the mean of each over its slave nodes.

    A node on the rim of two faces has a pressure on each; which is which is not printed, and the
    mean of both is taken.
    """
    first = np.array(deck.first_node)
    total, count = np.zeros(first[-1]), np.zeros(first[-1])
    np.add.at(total, printed.slave_nodes, printed.pressures)
    np.add.at(count, printed.slave_nodes, 1.0)
    nodal = total / np.maximum(count, 1.0)
    assembly, interfaces = deck.assembly, deck.assembly.interfaces
    held = assembly.fixed[interfaces.block_m] & assembly.fixed[interfaces.block_s]
    contacts = np.flatnonzero(~held)
    nodes = interfaces.quads_s[contacts] + first[interfaces.block_s[contacts], None]
    return contacts, nodal[nodes].mean(axis=1)


def _averaged_tension(deck: Deck, printed: CalculixResult) -> float:
    deformable, first = deck.problem.deformable, deck.first_node
    groups = [np.zeros((group.n_copies, group.mesh.n_nodes, 3)) for group in deformable.bodies]
    for block in deformable.deformable_blocks.tolist():
        own = printed.displacements[first[block] : first[block + 1]]
        groups[deformable.group_of[block]][deformable.copy_of[block]] = own
    peaks = stress_peaks(deformable, tuple(groups))
    return peaks.sigma_1_averaged.value
