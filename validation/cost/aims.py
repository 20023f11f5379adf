"""What an accuracy on demand costs: ``python -m validation.cost.aims [--json FILE|-]``.

Each row is a command as people type it, ``tubelock fem tsb1-pipe --accuracy … --json``, in a
process of its own: CPU time from the start of the program to the answer beside its aim, the error
bar it gives, and its true error against `validation.cost.references`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from validation.cost.references import references
from validation.output.console import listing, measuring
from validation.output.files import write_json
from validation.run.curved.accuracy import parse_targets
from validation.run.stages import children_cpu_seconds

TWO, TWELVE = "assembly.layers = 2", "assembly.layers = 12"
#: Layers, what is asked, and CPU seconds that it should take on one core.
AIMS = (
    (TWO, ("u=1%", "p_eff=1%"), 2.0),
    (TWO, ("sigma_1_averaged=2%",), 5.0),
    (TWO, ("p_max_point=3%",), 5.0),
    (TWO, ("p_max_point=1%", "sigma_1_max=5%"), 15.0),
    (TWELVE, ("p_max_point=3%",), 60.0),
)


@dataclass(frozen=True)
class Reached:
    """One quantity of one command."""

    layers: str
    quantity: str
    asked: float
    """Relative error bar [-]."""
    bar: float
    """The one that was given [-]."""
    error: float | None
    """True relative error [-]; None without a reference."""
    known_to: float | None
    """Of the reference [-]."""
    aim: float
    """CPU time it should take [s]."""
    cpu_seconds: float
    """CPU time of the whole process [s]."""
    memory_mb: float


def reached(layers: str, targets: tuple[str, ...], aim: float) -> list[Reached]:
    """Run a command and judge what it says."""
    options = [part for target in targets for part in ("--accuracy", target)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "answer.json"
        scene = ["tsb1-pipe", "--set", layers.replace(" ", "")]
        before = children_cpu_seconds()
        subprocess.run(
            [sys.executable, "-m", "validation.cli", "fem", *scene, *options, "--json", str(file)],
            check=True,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
        )
        spent = children_cpu_seconds() - before
        answer = json.loads(file.read_text())
    known = references().get(f"tsb1-pipe, {layers}", {})
    rows = []
    for name, asked in parse_targets(list(targets)).items():
        measure, reference = answer["measures"][name], known.get(name)
        rows.append(
            Reached(
                layers,
                name,
                asked,
                measure["error"] / abs(measure["value"]),
                None if reference is None else abs(reference.error(measure["value"])),
                None if reference is None else reference.known_to,
                aim,
                spent,
                answer["peak_memory_mb"],
            )
        )
    return rows


def _share(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2g} %"


def main() -> None:
    """Run the benchmark from the command line."""
    asked, console = measuring(__doc__, 118)
    rows = [row for aim in AIMS for row in reached(*aim)]
    heads = ("asked", "bar", "error", "reference", "aim, CPU s", "CPU s", "peak [MB]")
    table = listing("an accuracy on demand, start included", "TSB1 pipe", "of", numbers=heads)
    for row in rows:
        shares = map(_share, (row.asked, row.bar, row.error, row.known_to))
        spent = (f"{row.aim:g}", f"{row.cpu_seconds:.1f}", f"{row.memory_mb:.0f}")
        table.add_row(row.layers, row.quantity, *shares, *spent)
    console.print(table)
    write_json(asked.json, [asdict(row) for row in rows])


if __name__ == "__main__":
    main()
