"""What commands answer by default, beside what they answered before: ``first-answers``.

Each command runs in a process of its own, start and compilation included, without pictures. Old
values are those that were measured before static answers refined by default.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fem.accuracy.converge import TARGETS
from geometry.answer import WIDEST

TWO_LAYERS = ("--set", "assembly.layers=2")
#: A tube of a user: six blocks, five layers, a wall of 60 mm.
_SIZES = ("block.blocks_per_layer=6", "block.thickness=60", "assembly.layers=5")
USERS_TUBE = ("tsb1-tunnel", *(word for size in _SIZES for word in ("--set", size)))
#: Built-in scenes of the paper state its norm; a user's scene has the default.
RIGID = ("--set", "rigid.norm=pressure")
_EXPLICIT = ("fem.method=explicit", "mesh.around=24", "mesh.radial=4", "mesh.axial=10")
EXPLICIT = (*TWO_LAYERS, *(word for key in _EXPLICIT for word in ("--set", key)))

#: Command, and what it took and answered before.
COMMANDS: tuple[tuple[tuple[str, ...], str], ...] = (
    (("mbd", *USERS_TUBE, *RIGID), "p_max 0.0528 MPa (+6 % on half the facets)"),
    (("fem", "tsb1-pipe", *TWO_LAYERS), "58 s, 2.1 GB: σ₁ 1.5 ± 1.7 MPa, p at a point 1.60 ± 0.19"),
    (("fem", "tsb1-pipe"), "143 s, 2.6 GB"),
    (("fem", "thb0-tunnel", *TWO_LAYERS), "63 s: p_max 0.61 ± 0.38 MPa"),
    (("fem", "planar-sine"), "227 s: p at a point 77 ± 68 MPa"),
    (("fem", "osteomorphic"), "no answer in 240 s"),
    (("fem", "tsb1-beam", *TWO_LAYERS), "no answer in 240 s"),
    (("compare", "tsb1-pipe", *TWO_LAYERS), "147 s, 2.5 GB"),
    (("fem", *USERS_TUBE), "σ₁ 0.035 ± 0.077 MPa"),
    (("fem", "tsb1-pipe", *EXPLICIT), "p_max 0.55 ± 0.70 MPa, at a point 1.2 ± 3.7"),
)


def rows() -> Iterator[dict[str, Any]]:
    """CPU time, memory and error bars of each command, and what was before."""
    for command, before in COMMANDS:
        yield {"command": " ".join(command).replace("--set ", ""), "before": before, **ran(command)}


def ran(command: tuple[str, ...]) -> dict[str, Any]:
    """Run a command; its costs and the error bars of its answer."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "answer.json")
        words = [sys.executable, "-m", "validation.cli", *command, "--json", str(path)]
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        found = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return {
        "exit": process.returncode,
        "CPU s": used.ru_utime + used.ru_stime,
        "MB": used.ru_maxrss / 1024.0,
        **bars(found.get("measures", {})),
    }


def bars(measures: Mapping[str, Any]) -> dict[str, str]:
    """Values with their error bars in per cent of what an answer refines for, in words."""
    found = {}
    for name in (*TARGETS, "p_max_facet"):
        measure = measures.get(name)
        if not isinstance(measure, Mapping):  # rigid answers have the paper's means as numbers
            continue
        value, error = measure["value"], measure.get("error")
        share = None if error is None or not value else error / abs(value)
        wide = " (not resolved)" if share is not None and share > WIDEST else ""
        found[name] = f"{value:.4g}" + ("" if share is None else f" ± {100 * share:.2g} %{wide}")
    return found
