"""Files of blocks in a folder: which are answered, repaired or rejected, and why: ``folder``.

Files that are numbered from 0 or 1 on, one block in each, are one assembly. Supports are those of
the file; an assembly without any stands on its lowest blocks, a panel is held by its rim. The load
is the weight, the coefficient of friction 0.6, the unit that `tubelock check` suggests.

Each command runs in a process of its own. The deformable answer is that of one coarse mesh, without
error bars: two elements along each edge of blocks with six flat sides, tetrahedra of the size of
the block, each split into four hexahedra, in others. It is stopped after half a CPU minute.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from geometry.files.block_files import diagnosed_blocks
from geometry.mesh import MeshError

SUFFIXES = {".stl", ".obj", ".ply", ".off", ".step", ".stp", ".json", ".glb", ".gltf", ".3mf"}
SUFFIXES |= {".3dm"}
#: CPU time after which a command is stopped, and a deformable answer [s].
LIMIT, DEFORMABLE_LIMIT = 600, 30
#: Fewer numbered files are files of their own.
_SEVERAL = 8
#: Blocks are lowest, or outermost, to this share of the size of the assembly.
_LEVEL = 1e-3


@dataclass(frozen=True)
class Ran:
    """A command that ended."""

    status: int
    cpu: float
    """[s]"""
    answer: dict[str, Any]
    """What it wrote as JSON."""
    error: str
    """Its last line on standard error."""
    memory: float
    """Peak resident memory [MB]."""


def ran(*command: str, limit: int = LIMIT) -> Ran:
    """Run `tubelock` with JSON output."""
    with TemporaryDirectory() as folder:
        path, errors = Path(folder, "answer.json"), Path(folder, "errors")
        words = [sys.executable, "-m", "validation.cli", *command, "--json", str(path)]
        with errors.open("w") as stream:
            process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=stream)
            resource.prlimit(process.pid, resource.RLIMIT_CPU, (limit, limit))
            _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        lines = errors.read_text("utf-8").strip().splitlines()
        answer = json.loads(path.read_text("utf-8")) if path.exists() else {}
    cpu = used.ru_utime + used.ru_stime
    stopped = f"stopped after {limit} CPU s" if process.returncode < 0 else ""
    error = stopped or (lines[-1] if lines else "")
    return Ran(process.returncode, cpu, answer, error, used.ru_maxrss / 1024)


def rows(folder: Path) -> Iterator[dict[str, Any]]:
    """One row for each file of blocks in a folder and its folders."""
    for name, files in assemblies(folder).items():
        if len(files) == 1:
            yield {"file": name, **fate(files[0])}
            continue
        with TemporaryDirectory() as place:
            together = Path(place, "together.obj")
            try:
                _unite(files, together)
            except MeshError as error:
                yield {"file": name, "fate": "rejected", "why": str(error)}
            else:
                yield {"file": name, **fate(together)}


def assemblies(folder: Path) -> dict[str, list[Path]]:
    """Files of each assembly in a folder and its folders, by name."""
    result: dict[str, list[Path]] = {}
    numbered: dict[str, dict[int, Path]] = {}
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES):
        name = str(path.relative_to(folder))
        result[name] = [path]
        number = re.search(r"(\d+)$", path.stem)
        if number is not None:
            family = f"{name.removesuffix(path.name)}{path.stem[: number.start()]}*{path.suffix}"
            numbered.setdefault(family, {})[int(number[1])] = path
    for family, files in numbered.items():
        if len(files) >= _SEVERAL and min(files) <= 1 and max(files) < 2 * len(files):
            for path in files.values():
                del result[str(path.relative_to(folder))]
            result[family] = [files[k] for k in sorted(files)]
    return dict(sorted(result.items()))


def _unite(files: list[Path], output: Path) -> None:
    """Write the blocks of some files, faulty ones too, as objects of one OBJ file."""
    lines, first = [], 1
    for path in files:
        for block, _ in diagnosed_blocks(path):
            lines.append(f"o {path.stem}")
            lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in block.points.tolist()]
            lines += [f"f {a} {b} {c}" for a, b, c in (block.triangles + first).tolist()]
            first += len(block.points)
    output.write_text("\n".join(lines), "utf-8")


def fate(path: Path) -> dict[str, Any]:
    """What becomes of a file: as it is, repaired or rejected; rigid and deformable answers."""
    checked = ran("check", str(path))
    units = checked.answer.get("likely_unit", "mm")
    if units != "mm":
        checked = ran("check", str(path), "--units", units)
    if not checked.answer:
        return {"fate": "rejected", "why": checked.error}
    found: dict[str, Any] = {"blocks": len(checked.answer["blocks"]), "unit": units}
    with TemporaryDirectory() as folder:
        if not checked.answer["clean"]:
            mended = Path(folder, "repaired.obj")
            repaired = ran("check", str(path), "--units", units, "--repair", str(mended))
            again = ran("check", str(mended)) if mended.exists() else repaired
            if not again.answer.get("clean"):
                return found | {"fate": "rejected", "why": _fault(again) or _fault(checked)}
            # Blocks with faults have no size to tell the unit by.
            path, unit = mended, again.answer.get("likely_unit", "mm")
            found |= {"fate": "repaired", "unit": units if unit == "mm" else unit}
            units = unit
        else:
            found["fate"] = "as it is"
        if found["blocks"] == 1:
            return found | {"why": "a single block"}
        scene = Path(folder, "scene.toml")
        scene.write_text(_scene(path, units), "utf-8")
        return found | _answers(scene)


def _fault(checked: Ran) -> str:
    """The first thing that is wrong with a file, and how many more."""
    faults = [f"{b['name']}: {f}" for b in checked.answer.get("blocks", ()) for f in b["faults"]]
    for pair in checked.answer.get("overlaps", ()):
        faults.append(f"blocks {pair['blocks']} overlap by {pair['depth']:.3g} mm")
    more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
    return faults[0] + more if faults else checked.error


def _scene(path: Path, units: str) -> str:
    """Scene of the blocks of a file under their weight."""
    blocks = [block for block, _ in diagnosed_blocks(path, units=units)]
    fixed = ""
    if not any(block.held for block in blocks):
        low = np.array([block.points.min(axis=0) for block in blocks])
        high = np.array([block.points.max(axis=0) for block in blocks])
        fixed = f"[assembly]\nfixed = {np.flatnonzero(_stand(low, high)).tolist()}\n"
    return (
        f'[block]\ntype = "mesh"\nunits = "{units}"\n[[parts]]\nfile = "{path.resolve()}"\n'
        f"{fixed}[effects]\ngravity = [0.0, 0.0, -9810.0]\n"
        "[effects.friction]\ncoefficient = 0.6\n"
        '[mesh]\ndivisions = 2\n[fem]\nmesh = "scene"\nerror_estimate = false\n'
    )


def _stand(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Which blocks are fixed, by the ends of each, (n, 3): the lowest, or the rim of a panel."""
    near = _LEVEL * (high.max(axis=0) - low.min(axis=0))
    lowest = low[:, 2] <= low[:, 2].min() + near[2]
    if not lowest.all():
        return lowest
    first, last = low <= low.min(axis=0) + near, high >= high.max(axis=0) - near
    return (first | last)[:, :2].any(axis=1)


def _answers(scene: Path) -> dict[str, Any]:
    """Rigid and deformable answers to a scene."""
    rigid = ran("mbd", str(scene))
    deformable = ran("fem", str(scene), limit=DEFORMABLE_LIMIT)
    friction = rigid.answer.get("friction")
    verdict = rigid.error if friction is None else friction["status"].partition(":")[0]
    moved = deformable.answer.get("measures", {}).get("max_displacement")
    words = deformable.error
    if moved is not None:
        bar = f" ± {moved['error']:.2g}" if moved.get("error") is not None else ""
        words = f"u {moved['value']:.3g}{bar} mm"
    return {
        "joints' points": rigid.answer.get("n_contacts"),
        "rigid": verdict,
        "rigid CPU s": rigid.cpu,
        "deformable": words,
        "deformable CPU s": deformable.cpu,
        "MB": max(rigid.memory, deformable.memory),
    }
