"""Run CalculiX on a deck and read what it printed.

Its exit status says nothing: it can be 0 after an error. The log is read for ``*ERROR``.
"""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geometry.machine.system import children_cpu_seconds
from geometry.mesh import FloatArray, IntArray

PROGRAM = "ccx"


class CalculixError(RuntimeError):
    """A run of CalculiX without a result: what its log says."""


@dataclass(frozen=True)
class CalculixResult:
    """The last printed state of a run."""

    displacements: FloatArray
    """Nodes in the order of their numbers, (n_nodes, 3) [mm]; seven digits."""
    slave_nodes: IntArray
    """Slave node of each contact element, or slave element, from 0, (n_contacts,)."""
    slave_sides: IntArray
    """Side of the slave element, from 1; 0 where nodes press, (n_contacts,)."""
    pressures: FloatArray
    """Contact pressure there, (n_contacts,) [MPa]."""
    reactions: dict[str, FloatArray]
    """Sum of the forces on each held set of nodes, (3,) [N]."""
    cpu_seconds: float
    """CPU time of the program."""


def calculix_available() -> bool:
    """Whether the program is installed."""
    return shutil.which(PROGRAM) is not None


def run_calculix(deck: Path, *, timeout: float = 600.0) -> CalculixResult:
    """Run CalculiX on ``NAME.inp``, beside which it writes, for at most the timeout [s]."""
    if not calculix_available():
        raise CalculixError(f"{PROGRAM} is not installed (Debian: calculix-ccx)")
    before = children_cpu_seconds()
    try:
        run = subprocess.run(
            [PROGRAM, deck.stem],
            cwd=deck.parent,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise CalculixError(f"{deck.name}: no result within {timeout:g} s") from None
    seconds = children_cpu_seconds() - before
    errors = [line.strip() for line in run.stdout.splitlines() if "*ERROR" in line]
    if errors:
        raise CalculixError(f"{deck.name}: {errors[0]}")
    output = deck.with_suffix(".dat")
    if not output.exists():
        raise CalculixError(f"{deck.name}: no printed output")
    return _read(output, seconds)


def _read(path: Path, seconds: float) -> CalculixResult:
    """Last block of displacements, of contact stresses, and of every sum of forces."""
    blocks: dict[str, list[list[float]]] = {}
    current: list[list[float]] = []
    for line in path.read_text("ascii").splitlines():
        words = line.split()
        title = words and words[0][0].isalpha()
        if title:
            # "total force (fx,fy,fz) for set NAME and time …"
            name = words[words.index("set") + 1] if "set" in words else ""
            current = []
            blocks[f"{words[0]} {name}" if words[0] == "total" else words[0]] = current
        elif words:
            current.append([float(word) for word in words if word != "L"])  # in local axes
    moved = np.array(blocks.get("displacements", [])).reshape(-1, 4)
    if not len(moved):
        raise CalculixError(f"{path.name}: no displacements were printed")
    # Slave node, or slave element and face; pressure and two shear stresses.
    rows = np.array(blocks.get("contact", [])) if "contact" in blocks else np.zeros((0, 4))
    sums = {name: rows for name, rows in blocks.items() if name.startswith("total ")}
    return CalculixResult(
        displacements=moved[np.argsort(moved[:, 0], kind="stable"), 1:],
        slave_nodes=rows[:, 0].astype(np.int64) - 1,
        slave_sides=rows[:, 1].astype(np.int64) * (rows.shape[1] > 4),
        pressures=rows[:, -3],
        reactions={name.removeprefix("total "): np.array(rows[0]) for name, rows in sums.items()},
        cpu_seconds=seconds,
    )
