"""What an accuracy on demand costs, and whether the error bars hold.

Each row is a command as people type it, ``tubelock fem tsb1-pipe --accuracy … --json``, in a
process of its own: CPU time from the start of the program to the answer beside its aim, the error
bar it gives, and its true error against the values of fine meshes that come with the program.
"""

import json
import os
import subprocess
import sys
import tomllib
from importlib.resources import files

from geometry.answer import ALIASES
from geometry.machine.system import children_cpu_seconds

TWO, TWELVE = "assembly.layers = 2", "assembly.layers = 12"
#: Layers, what is asked [%], and CPU seconds that it should take on one core.
AIMS = (
    (TWO, {"u": 1, "p_eff": 1}, 2.0),
    (TWO, {"sigma_1_averaged": 2}, 5.0),
    (TWO, {"p_max_point": 3}, 5.0),
    (TWO, {"p_max_point": 1, "sigma_1_max": 5}, 15.0),
    (TWELVE, {"p_max_point": 3}, 60.0),
)
#: Values of fine meshes by scene and measure, and half of the interval that holds the exact one.
KNOWN = tomllib.loads((files("validation") / "study/costs/references.toml").read_text("utf-8"))


def reached(layers, targets):
    """Run a command; its rows in percent, one for each quantity that is asked."""
    asked = [f"{name}={share}%" for name, share in targets.items()]
    options = [part for target in asked for part in ("--accuracy", target)]
    scene = ["tsb1-pipe", "--set", layers.replace(" ", "")]
    before = children_cpu_seconds()
    done = subprocess.run(
        [sys.executable, "-m", "validation.cli", "fem", *scene, *options, "--json", "-"],
        check=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
    )
    spent, answer = children_cpu_seconds() - before, json.loads(done.stdout)
    known = KNOWN.get(f"tsb1-pipe, {layers}", {})
    for given, share in targets.items():
        name = ALIASES.get(given, given)
        measure, fine = answer["measures"][name], known.get(name)
        yield {
            "TSB1 pipe": layers,
            "of": name,
            "asked [%]": float(share),
            "bar [%]": 100.0 * measure["error"] / abs(measure["value"]),
            "error [%]": fine and 100.0 * abs(measure["value"] / fine["value"] - 1.0),
            "reference [%]": fine and 100.0 * fine["uncertainty"] / abs(fine["value"]),
            "CPU s": spent,
            "peak [MB]": answer["peak_memory_mb"],
        }


def rows():
    """Every aim."""
    for layers, targets, aim in AIMS:
        yield from (row | {"aim, CPU s": aim} for row in reached(layers, targets))
