"""Many free-form blocks: ``python -m tests.benchmarks.shell [--rows N] [--json FILE|-]``.

A doubly curved shell in running bond, about N² blocks, no two alike, in one OBJ file; its rim is
fixed, the load is its weight. Each command runs in a process of its own, from the file to verdict,
tables and pictures: CPU time and peak memory. ``--write FILE`` only writes the OBJ file.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console

from geometry.mesh import FloatArray
from validation.output.console import tabled
from validation.output.files import write_json

#: Sides of the plan, rise and thickness of the shell [mm].
_SPAN, _RISE, _THICKNESS = (12_000.0, 10_000.0), 2_400.0, 300.0
#: Depth of the waves on the shell, and the largest shift of a corner over a block's width.
_WAVE, _SHIFT = 60.0, 0.08


def surfaces(rows: int) -> FloatArray:
    """Corners of the blocks below and above, (2, rows + 1, 2 rows + 1, 3) [mm]."""
    rng = np.random.default_rng(1)
    v, u = np.meshgrid(
        np.linspace(-1, 1, rows + 1), np.linspace(-1, 1, 2 * rows + 1), indexing="ij"
    )
    u, v = u.copy(), v.copy()
    inside = (slice(1, -1), slice(1, -1))
    u[inside] += _SHIFT / rows * rng.uniform(-1, 1, u[inside].shape)
    v[inside] += _SHIFT / rows * rng.uniform(-1, 1, v[inside].shape)
    x, y = 0.5 * _SPAN[0] * u, 0.5 * _SPAN[1] * v
    z = _RISE * (1 - u**2) * (1 - v**2) + _WAVE * np.sin(3 * u + 1) * np.cos(4 * v)
    middle = np.stack([x, y, z], axis=-1)
    along, across = np.gradient(middle, axis=1), np.gradient(middle, axis=0)
    normal = np.cross(along, across)
    normal *= 0.5 * _THICKNESS / np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.stack([middle - normal, middle + normal])


def blocks(rows: int) -> Iterator[tuple[bool, list[int], list[tuple[int, ...]]]]:
    """Whether a block is at the rim, its corners in `surfaces`, and its faces, outward.

    Corners stand in six or four places around it, below and above; faces count from 0. Neighbours
    split each side that they share along the same diagonal.
    """
    width = 2 * rows + 1
    for j in range(rows):
        for start in range(-(j % 2), width - 1, 2):
            first, last = max(start, 0), min(start + 2, width - 1)
            columns = list(range(first, last + 1))
            around = [j * width + i for i in columns]
            around += [(j + 1) * width + i for i in reversed(columns)]
            n = len(around)
            faces = [tuple(reversed(range(n))), tuple(range(n, 2 * n))]
            for a in range(n):
                b = (a + 1) % n
                # The diagonal leaves the corner below that has the smaller number.
                if around[a] < around[b]:
                    faces += [(a, b, n + b), (a, n + b, n + a)]
                else:
                    faces += [(a, b, n + a), (b, n + b, n + a)]
            corners = around + [c + (rows + 1) * width for c in around]
            yield j in (0, rows - 1) or first == 0 or last == width - 1, corners, faces


def write_shell(path: Path, rows: int) -> list[int]:
    """Write the blocks as objects of an OBJ file; numbers of those at the rim."""
    points = surfaces(rows).reshape(-1, 3)
    lines, before, rim = [], 1, []
    for number, (held, corners, faces) in enumerate(blocks(rows)):
        lines.append(f"o B{number:04d}")
        lines += ["v " + " ".join(f"{x:.6f}" for x in points[c]) for c in corners]
        lines += ["f " + " ".join(str(before + k) for k in face) for face in faces]
        before += len(corners)
        rim += [number] * held
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return rim


@dataclass(frozen=True)
class ShellRow:
    """One command."""

    command: str
    blocks: int
    contacts: int
    cpu_seconds: float
    peak_memory_mb: float
    verdict: str


def measured(command: str, scene: Path, blocks: int, *words: str) -> ShellRow:
    """Run a command to its pictures."""
    line = [sys.executable, "-m", "validation.cli", "mbd", str(scene), *words]
    line += ["-o", str(scene.parent / "out")]
    process = subprocess.Popen(line, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    answer = json.loads((scene.parent / "out" / "answer.json").read_text("utf-8"))
    friction = answer.get("friction")
    verdict = answer["mechanism"] if friction is None else friction["status"].partition(",")[0]
    cpu = used.ru_utime + used.ru_stime
    return ShellRow(command, blocks, answer["n_contacts"], cpu, used.ru_maxrss / 1024, verdict)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=32)
    parser.add_argument("--write", type=Path, metavar="FILE")
    parser.add_argument("--json", metavar="FILE")
    asked = parser.parse_args()
    if asked.write is not None:
        write_shell(asked.write, asked.rows)
        return
    with TemporaryDirectory() as folder:
        rim = write_shell(Path(folder, "shell.obj"), asked.rows)
        scene = Path(folder, "shell.toml")
        scene.write_text(
            '[block]\ntype = "mesh"\n[[parts]]\nfile = "shell.obj"\n'
            f"[assembly]\nfixed = {rim}\n[effects]\ngravity = [0.0, 0.0, -9810.0]\n",
            "utf-8",
        )
        n = sum(1 for _ in blocks(asked.rows))
        table = [
            measured("mbd", scene, n),
            measured("mbd, friction 0.6", scene, n, "--set", "effects.friction=0.6"),
        ]
    columns = {
        "command": lambda row: row.command,
        "blocks": lambda row: f"{row.blocks}",
        "contact points": lambda row: f"{row.contacts}",
        "CPU [s]": lambda row: f"{row.cpu_seconds:.1f}",
        "peak [MB]": lambda row: f"{row.peak_memory_mb:.0f}",
        "verdict": lambda row: row.verdict,
    }
    Console(width=160).print(tabled("Free-form shell, file to pictures", table, columns))
    write_json(asked.json, [asdict(row) for row in table])


if __name__ == "__main__":
    main()
