"""Random lines of the command: each is answered, or refused in one line and in time.

``python -m tests.fuzz --count 2000 --seed 1`` counts what became of them and shows every line that
was neither. A line is made in a folder of its own from good specimens (scene, mesh, study, results,
checkpoint, deck), one to three things of it spoilt; the same seed and number give the same line.
Each runs in a forked process with ten CPU seconds and 2 GB of memory of its own; ``--apart N``
starts every N-th as a program of its own, as people do.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import json
import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from random import Random
from typing import Any, NamedTuple, NoReturn

import numpy as np
import typer

from geometry import HexMesh
from geometry.files.mesh_io import write_cells, write_hex_mesh
from geometry.mesh import boundary_quads, structured_hexahedra
from geometry.polyhedra.polyhedron import polyhedron_from_quads
from tests.support.answers import on_its_mesh
from tests.support.wrong_input import PLACES
from validation import builtin_names, builtin_text
from validation.cli.app import app
from validation.cli.app import main as tubelock

_TUBE = ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2")
#: Scenes that are answered in a blink, by what makes them small.
SMALL: dict[str, tuple[str, ...]] = {
    "tsb1-pipe": _TUBE,
    "tsb2-tunnel": _TUBE,
    "thb0-shaft": ("assembly.layers=1", "mesh.edge=2", "mesh.radial=1"),
    "brick-stack": ("mesh.divisions=[2,1,1]", "assembly.columns=2", "assembly.layers=2"),
    "planar-sine": ("assembly.columns=1", "assembly.layers=1", "mesh.divisions=[12,2,2]"),
    "osteomorphic": ("assembly.columns=1", "assembly.layers=1", "mesh.divisions=[4,2,2]"),
    "arch": ("assembly.voussoirs=5",),
    "wall": ("assembly.rows=1", "assembly.columns=2"),
    "octahedra": ("assembly.rings=0",),
    "cubes": ("assembly.rings=0",),
    "tetrahedra": ("assembly.rows=1", "assembly.columns=1"),
    "voxel-puzzle": (),
    "column": (),
    "column-nonmatching": (),
    "cantilever": ("mesh.divisions=[4,1,1]", 'fem.method="static"'),
    "spinning-block": ("fem.end_time=1e-5",),
}

#: Settings of the run that the checkpoint belongs to.
STOPPED = (*SMALL["tsb1-pipe"], 'fem.method="explicit"')

#: Every command, with what the command line itself knows of its options.
COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]

#: Options that name files that are written.
_WRITES = {"--json": "result.json", "--csv": "rows.csv"}
#: How often each command is tried: those that are short, more often.
_WEIGHTS = {
    "mbd": 8.0, "fem": 6.0, "sweep": 4.0, "show": 3.0, "deck": 4.0, "export": 3.0, "cost": 0.3,
    "effects": 0.3, "report": 0.3, "explore": 0.0,  # serves until it is interrupted
}  # fmt: skip
#: What commands name, and what files they read, beside those that take a scene.
_NAMED = {"scenes": ("arch",), "reproduce": ("nothing", "--nothing")}
_READS = {
    "sweep": ("small.toml", "damped.toml"),
    "deck": ("case.inp", "flat.inp", "block.vtu", "block.msh"),
}

VALUES = (
    "0", "-0.0", "-1", "1", "2", "0.5", "1e-320", "5e-324", "1e308", "1e309", "-1e308", "1e150",
    "1e-150", "nan", "inf", "-inf", str(10**29), str(2**63), str(10**400), "true", "null", '""',
    "''", "[]", "{}", "[0,0,0]", "[1e308,1e308,1e308]", "[nan,nan,nan]", "[1,2]", '"$x^{2$"',
    '"[/x]"', '"auto"', '"1e400 mm"', '"-9.81 m/s2"', '"2400 kg/m3"', '"\\u0000"', "1979-05-27",
    "07:32:00", "0x7fffffff", "1_000", "1e3", "1e-3", "100", "1000000", "3", "4", "7", "30",
    '"explicit"', '"static"', '"full"', '"clarabel"', "[[1,1,1]]", '"ü\\n"', "9" * 5000,
)  # fmt: skip
WORDS = (
    "", "-", "--", "nan", "1%", "0%", "-5%", "1e400%", "200%", "$x^{2$", "[/x]", "\u2028", "a\nb",
    "x" * 300, "general", "calculix", "gravity", "friction", "keep", "renew", "-1", "0", "1", "2",
    str(10**29), "1e400", "tsb1-pipe", "*", "..", "/dev/null", "/dev/full", "/dev/zero",
)  # fmt: skip
#: Values of options that are not refused.
_GOOD = {
    "--accuracy": "p_eff=30%", "--max-seconds": "1", "--keep": "friction", "--flavour": "calculix",
    "--workers": "1", "--only": "coulomb", "--store": "cost.jsonl", "--resume": "run.npz",
}  # fmt: skip


def line(seed: int, number: int, folder: Path, specimens: Path) -> list[str]:
    """Words of one line; what it reads is written into the empty folder in which it will run."""
    random = Random(f"{seed}/{number}")
    (command,) = random.choices([*COMMANDS], [_WEIGHTS.get(name, 1.0) for name in COMMANDS])
    words = [command, *_subject(random, command, folder, specimens)]
    if command == "fem" and random.random() < 0.15:
        kept = _file(random, specimens / "run.npz", folder)
        words = ["fem", "tsb1-pipe", *_set(STOPPED), "--resume", kept]
    for option in _options(command):
        if random.random() < (0.7 if "--json" in option.opts else 0.3):
            words += _option(random, option, folder, specimens)
    if command == "export" and "-o" not in words:
        words += ["-o", "case.inp"]
    if random.random() < 0.05:
        spoilt = random.randrange(len(words) + 1)
        words.insert(spoilt, random.choice(WORDS))
    # A word that holds a zero byte cannot be typed.
    return [word.replace("\x00", "") for word in words]


def _options(command: str) -> list[Any]:
    """Options of a command; settings belong to its scene, those of `reproduce` to its parts."""
    options = [p for p in COMMANDS[command].params if p.param_type_name == "option"]
    return [] if command == "reproduce" else [p for p in options if p.name != "settings"]


def _subject(random: Random, command: str, folder: Path, specimens: Path) -> list[str]:
    """What a command is about, with the settings of its scene."""
    if command in _NAMED:
        word = random.choice((*WORDS, *_NAMED[command]))
        return [word if word.strip("-") else "nothing"]  # `reproduce` alone writes the report
    if command in _READS:
        return [_file(random, specimens / random.choice(_READS[command]), folder)]
    if "argument" not in {parameter.param_type_name for parameter in COMMANDS[command].params}:
        return ["--list"] if command == "stability" else []
    if random.random() < 0.25 and command in ("mbd", "show", "fem", "compare", "export"):
        return [_own_scene(random, folder, specimens)]
    name = random.choice(list(SMALL) if random.random() < 0.97 else builtin_names())
    settings = list(SMALL.get(name, ()))
    for _ in range(random.choice((0, 1, 1, 1, 2, 3))):
        settings.append(_setting(random, name))
    words = _set(settings)
    if random.random() < 0.3:
        scene = folder / random.choice(("scene.toml", "$x^{2$.toml", "[/x] ü.toml", "no-ending"))
        scene.parent.mkdir(exist_ok=True)
        scene.write_text(builtin_text(name), "utf-8")
        return [_file(random, scene, folder), *words]
    return [name, *words]


def _setting(random: Random, name: str) -> str:
    """Return a value at a key of a scene, now and then at none."""
    data = tomllib.loads(builtin_text(name))
    if random.random() < 0.05:
        return random.choice(WORDS) + random.choice(("=", "", ".x=")) + random.choice(VALUES)
    key = random.choice([".".join(path) for scene, path in PLACES if scene == name and path[1:]])
    section, _, inner = key.partition(".")
    return f"{key}={_value(random, data.get(section, {}).get(inner))}"


def _value(random: Random, known: object) -> str:
    """Return a value: some ten times what is known, a number of any size, or anything."""
    if isinstance(known, float) and random.random() < 0.5:
        return repr(known * 10.0 ** random.uniform(-1.5, 1.5))
    if random.random() < 0.3:
        return repr(random.choice((1.0, 1.0, -1.0)) * 10.0 ** random.uniform(-12, 12))
    return random.choice(VALUES)


def _option(random: Random, known: Any, folder: Path, specimens: Path) -> list[str]:
    option = random.choice((known.opts[0], *known.secondary_opts))
    if known.is_flag:
        return [option]
    if option in _WRITES or option == "-o":
        return [option, _output(random, option, folder)]
    if option in ("--resume", "--store") and random.random() < 0.7:
        name = "run.npz" if option == "--resume" else "results.jsonl"
        return [option, _file(random, specimens / name, folder)]
    good = _GOOD.get(option, "1%")
    return [option, good if random.random() < 0.5 else random.choice((*WORDS, *VALUES[:20]))]


def _output(random: Random, option: str, folder: Path) -> str:
    """Return a place to write to: mostly a good one."""
    if random.random() < 0.6:
        endings = ("out", "picture.png", "picture.svg", "case.inp", "copy.vtu", "rows.jsonl")
        return _WRITES.get(option) or random.choice(endings)
    present = [str(path) for path in folder.iterdir()]
    if not (folder / "pipe").exists():
        os.mkfifo(folder / "pipe")
    return random.choice(
        (*present, str(folder), "pipe", "-", "", "/dev/full", "/dev/null", "no/such/folder/x.json",
         "$x^{2$.json", "[/x].png", "x" * 300, "a\nb.json", "/proc/x", ".", "..", "result.json/x")
    )  # fmt: skip


def _own_scene(random: Random, folder: Path, specimens: Path) -> str:
    """Return a scene of blocks from a file that may be broken."""
    meshes = [path for path in sorted(specimens.iterdir()) if path.stem in ("block", "two")]
    mesh = _file(random, random.choice(meshes), folder)
    scale = random.choice((1.0, 1.0, 1.0, 1e-3, 1e6, 0.0, 1e300))
    apart = random.choice((100.0, 100.0, 100.0, 99.0, 101.0, 1e300, 0.0))
    units = random.choice(("mm", "mm", "mm", "m", "inch"))
    text = "\n".join(
        (
            f'[block]\ntype = "mesh"\nunits = "{units}"',
            f"[[parts]]\nfile = {json.dumps(mesh)}",
            "[[parts.places]]\nfixed = true",
            f"[[parts.places]]\nat = [{scale - 1.0!r}, 0.0, {apart!r}]",
            f"[effects]\ngravity = [0.0, 0.0, {random.choice((-9810.0, -9810.0, -9810.0, 1e8))!r}]",
            random.choice(
                ("", "", "[effects.friction]\ncoefficient = 0.6", "[detection]\ntolerance = 1e-320")
            ),
        )
    )
    path = folder / "own.toml"
    path.write_text(text, "utf-8")
    return _file(random, path, folder) if random.random() < 0.1 else str(path)


# ---------------------------------------------------------------------------------------------
# Files that are broken


def _file(random: Random, good: Path, folder: Path) -> str:
    """Return the path of a copy of a good file; every second one is no longer what it was."""
    path = folder / good.name
    if path != good:
        if os.path.lexists(path):  # named twice by one line
            return str(path)
        shutil.copy(good, path)
    if random.random() < 0.45:
        return str(path)
    spoil = random.choice((*_CONTENT, *_PLACE))
    if spoil in _PLACE:
        return str(spoil(random, path))
    path.write_bytes(spoil(random, path.read_bytes()))
    return str(path)


def _flipped(random: Random, text: bytes) -> bytes:
    """Change a few bytes."""
    found = bytearray(text)
    for _ in range(random.choice((1, 1, 2, 8))):
        if found:
            found[random.randrange(len(found))] = random.choice((0, 255, 10, 45, 48, 57, 101))
    return bytes(found)


def _shortened(random: Random, text: bytes) -> bytes:
    return text[: random.randrange(len(text) + 1)]


def _reordered(random: Random, text: bytes) -> bytes:
    """Take a line away, write one twice, or change a number of one."""
    lines = text.split(b"\n")
    place = random.randrange(len(lines))
    what = random.randrange(4)
    if what == 0:
        del lines[place]
    elif what == 1:
        lines.insert(place, random.choice(lines))
    else:
        words = lines[place].split(b" ")
        words[random.randrange(len(words))] = random.choice(VALUES).encode()
        lines[place] = b" ".join(words)
    return b"\n".join(lines)


def _replaced(random: Random, _: bytes) -> bytes:
    return random.choice((b"", b"\xff\xfe\x00", b"\x00" * 4096, b"{}", b"solid x\n", b"\n" * 5000))


def _no_file(random: Random, path: Path) -> Path:
    """Put something else in the place of a file: a folder, a pipe, a device, a link."""
    path.unlink()
    what = random.randrange(6)
    if what == 0:
        path.mkdir()
    elif what == 1:
        os.mkfifo(path)
    elif what == 2:
        path.symlink_to(path.name)
    elif what == 3:
        path.symlink_to("/dev/zero" if random.random() < 0.5 else "/dev/null")
    elif what == 4:
        return path / "below"
    return path


def _another_ending(random: Random, path: Path) -> Path:
    ending = random.choice((".h5m", ".stl", ".vtu", ".e", ".xdmf", ".med", ".cgns", ".toml", ""))
    return path.rename(path.with_suffix(ending))


#: Ways to break a file, by its content or its place.
_CONTENT = (_flipped, _flipped, _shortened, _reordered, _reordered, _replaced)
_PLACE = (_no_file, _another_ending)


# ---------------------------------------------------------------------------------------------
# Specimens


def make_specimens(folder: Path) -> None:
    """Write one good file of each kind that a command reads."""
    grid = np.stack(np.meshgrid(*[[0.0, 50.0, 100.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    solid = HexMesh(grid, structured_hexahedra(2, 2, 2))
    block = polyhedron_from_quads("block", grid, boundary_quads(solid))
    for ending in (".vtu", ".msh", ".inp"):
        write_hex_mesh(folder / f"block{ending}", solid)
    for ending in (".stl", ".obj", ".ply"):
        write_cells(folder / f"block{ending}", block.points, "triangle", block.triangles)
    points = np.concatenate([block.points, block.points + np.array([0.0, 0.0, 100.0])])
    both = np.concatenate([block.triangles, block.triangles + len(block.points)])
    write_cells(folder / "two.stl", points, "triangle", both)
    sizes = (setting.partition("=") for setting in _TUBE)
    settings = "\n".join(["[settings]", *(f'"{key}" = {value}' for key, _, value in sizes)])
    for name, asked in (
        ("small", '[parameters]\n"block.amplitude" = [10, 20]\n'
         '"load.pressure" = { from = 0.01, to = 0.02, step = 0.01 }'),
        ("damped", 'quantity = "fem"\n[parameters]\n"contact.clearance" = [0.0, 0.01]'),
    ):  # fmt: skip
        study = f'scene = "tsb1-pipe"\n{asked}\n{settings}'
        (folder / f"{name}.toml").write_text(study, "utf-8")
    results = ["-o", str(folder / "results.jsonl"), "--workers", "1"]
    _run(["sweep", str(folder / "small.toml"), *results])
    for name, flavour in (("case.inp", "general"), ("flat.inp", "calculix")):
        where = ["--flavour", flavour, "-o", str(folder / name)]
        _run(["export", "tsb1-pipe", *_set(_TUBE), *where])
    _interrupt(folder / "run.npz")


def _set(settings: Sequence[str]) -> list[str]:
    return [word for setting in settings for word in ("--set", setting)]


def _interrupt(checkpoint: Path) -> None:
    """Run `STOPPED` and stop it at its first sample."""
    stop = lambda _: signal.raise_signal(signal.SIGTERM)  # noqa: E731
    on_its_mesh("tsb1-pipe", STOPPED, method="explicit", checkpoint=checkpoint, progress=stop)


# ---------------------------------------------------------------------------------------------
# Fates

#: What a refusal may take: CPU time [s] and memory beyond that of the program [bytes].
LONGEST, MOST_MEMORY = 10, 2 * 2**30
#: A line that waits this long without computing waits for nothing [s].
_PATIENCE = 120.0
#: Where lines that passed the door work: a stop there is honest work that is not awaited.
_WORKSHOPS = re.compile(
    r"/(fem/(static|explicit|system|contact|element)|mbd|validation/(output/pictures|effects))/"
    r"|/validation/(run|compare|cost)/|/(numba|matplotlib|pyvista)/"
)


class Fate(StrEnum):
    """What became of a line.

    Right: exit status 0 or 1, nothing odd on standard error, JSON that is JSON. At work: stopped by
    its limits while it computed an answer. Hung: stopped before. Odd: several lines, a warning,
    another exit status, broken JSON, half a file left.
    """

    RIGHT = "right"
    REFUSED = "refused in one line"
    WORKING = "at work"
    ODD = "odd"
    TRACEBACK = "traceback"
    CRASHED = "crashed"
    HUNG = "hung"


#: Fates that are no defect.
FINE = (Fate.RIGHT, Fate.REFUSED, Fate.WORKING)


class Tried(NamedTuple):
    """A line, what became of it, the end of standard error or where it was stopped, wall time."""

    words: tuple[str, ...]
    fate: Fate
    said: str
    seconds: float


def try_line(words: Sequence[str], folder: Path, *, apart: bool = False) -> Tried:
    """Run the words after ``tubelock`` in a folder, in a process of its own with limits.

    With ``apart`` that is a new interpreter, else a fork of this one.
    """
    out, err = folder / ".stdout", folder / ".stderr"
    start = time.monotonic()
    sys.stdout.flush()
    child = os.fork()
    if not child:
        _child(words, folder, out, err, apart=apart)
    status = _awaited(child, start + _PATIENCE)
    said = err.read_text("utf-8", errors="replace")
    return Tried(tuple(words), *judge(status, out, said, folder), time.monotonic() - start)


def _child(words: Sequence[str], folder: Path, out: Path, err: Path, *, apart: bool) -> NoReturn:
    """Become the line: nothing of this process is left afterwards."""
    status = 1
    try:
        os.chdir(folder)
        for number, path in ((1, out), (2, err)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST + 2))
        faulthandler.register(signal.SIGXCPU, all_threads=False, chain=True)
        faulthandler.register(signal.SIGALRM, all_threads=False, chain=True)
        if apart:
            program = [sys.executable, "-m", "validation.cli", *words]
            os.execve(sys.executable, program, {**os.environ, "MPLBACKEND": "Agg"})
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        present = pages * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (present + MOST_MEMORY,) * 2)
        status = _run(words)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
        os._exit(status)


def _run(words: Sequence[str]) -> int:
    """Exit status of the command in this process."""
    sys.argv = ["tubelock", *words]
    sys.stdout = os.fdopen(os.dup(1), "w", encoding="utf-8")
    sys.stderr = os.fdopen(os.dup(2), "w", encoding="utf-8")
    try:
        tubelock()
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        print(end.code, file=sys.stderr)
    return 1


def _awaited(child: int, deadline: float) -> int:
    """Wait status of a process; one that waits for something that never comes is stopped."""
    asked = False
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        if time.monotonic() > deadline + (2.0 if asked else 0.0):
            os.kill(child, signal.SIGKILL if asked else signal.SIGALRM)
            asked = True
        time.sleep(0.005)


def judge(status: int, out: Path, said: str, folder: Path) -> tuple[Fate, str]:
    """What a wait status, what was printed and what was left behind say of a line."""
    end = "\n".join(said.strip().splitlines()[-12:])
    if os.WIFSIGNALED(status):
        if os.WTERMSIG(status) not in (signal.SIGXCPU, signal.SIGALRM, signal.SIGKILL):
            return Fate.CRASHED, end
        return (Fate.WORKING if _WORKSHOPS.search(said) else Fate.HUNG), end
    if "Traceback" in said:
        return Fate.TRACEBACK, end
    odd = next(_oddities(out, said, folder), "")
    if odd:
        return Fate.ODD, f"{odd}: {end}"
    if os.WEXITSTATUS(status) in (0, 1) and "error:" not in said.lower():
        return Fate.RIGHT, end
    return _refusal(os.WEXITSTATUS(status), said.strip()), end


def _refusal(status: int, said: str) -> Fate:
    """Judge what is said of a line that was not answered."""
    if "more memory than there is" in said:
        return Fate.WORKING
    usage = said.startswith("Usage: ") and said.splitlines()[-1].startswith("Error: ")
    # What a command says on its way may stand before it; the refusal itself is the last line.
    lines = [line.startswith("error: ") for line in said.splitlines()]
    one = sum(lines) == 1 and lines[-1]
    return Fate.REFUSED if status == 2 and (usage or one) else Fate.ODD


def _oddities(out: Path, said: str, folder: Path) -> Iterator[str]:
    """What no line may leave behind: half a file, JSON with NaN or Infinity, a warning."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    yield from (f"left {path.name}" for path in folder.rglob(".partial-*"))
    for path in (out, *folder.glob("result.json"), *folder.glob("out/*.json")):
        text = path.read_text("utf-8", errors="replace") if path.is_file() else ""
        if text.startswith("{") or (path != out and path.is_file()):
            try:
                json.loads(text, parse_constant=refuse)
            except ValueError as error:
                yield f"{path.name}: {error}"
    if "Warning" in said:
        yield "a warning"


def try_lines(numbers: Sequence[int], seed: int, *, apart: int = 0) -> Iterator[Tried]:
    """Make and try lines of a seed, every ``apart``-th as a program of its own; 0: none."""
    with tempfile.TemporaryDirectory() as workshop:
        specimens = Path(workshop) / "specimens"
        specimens.mkdir()
        streams = sys.stdout, sys.stderr
        with _quiet(1), _quiet(2):
            make_specimens(specimens)
            _warm(specimens)
        sys.stdout, sys.stderr = streams
        for number in numbers:
            folder = Path(workshop) / "line"
            folder.mkdir()
            words = line(seed, number, folder, specimens)
            yield try_line(words, folder, apart=bool(apart) and number % apart == 0)
            subprocess.run(["rm", "-rf", str(folder)], check=True)


@contextlib.contextmanager
def _quiet(number: int) -> Iterator[None]:
    """Hide what is printed to a stream of the process, 1 or 2."""
    stream = (sys.stdout, sys.stderr)[number - 1]
    stream.flush()
    saved, null = os.dup(number), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, number)
    try:
        yield
    finally:
        stream.flush()
        os.dup2(saved, number)
        os.close(null)
        os.close(saved)


def _warm(folder: Path) -> None:
    """Import and load what lines need, once, so that each is tried in a blink."""
    import matplotlib.pyplot  # noqa: F401
    import pyvista  # noqa: F401

    for name, settings in SMALL.items():
        for command in ("mbd", "fem"):
            _run([command, name, *_set(settings), "--json", str(folder / "warm.json")])


def main() -> None:
    """Count the fates of random lines; exit status 1 where one is a defect."""
    parser = argparse.ArgumentParser(description=__doc__)
    for flag, default, words in (
        ("--count", 500, "lines to try; Ctrl-C counts what was tried"),
        ("--seed", 0, "decides the lines"),
        ("--first", 0, "number of the first line"),
        ("--apart", 50, "every N-th as its own program"),
    ):
        parser.add_argument(flag, type=int, default=default, help=words)
    parser.add_argument("--show", action="store_true", help="show every line")
    asked = parser.parse_args()
    os.environ.setdefault("MPLBACKEND", "Agg")
    numbers = range(asked.first, asked.first + asked.count)
    counts: Counter[Fate] = Counter()
    with contextlib.suppress(KeyboardInterrupt):
        tried_lines = try_lines(numbers, asked.seed, apart=asked.apart)
        for number, tried in zip(numbers, tried_lines, strict=True):
            counts[tried.fate] += 1
            if asked.show or tried.fate not in FINE:
                command = shlex.join(tried.words)
                print(f"{number} {tried.fate} {tried.seconds:.1f} s: tubelock {command}")
                print("    " + tried.said.replace("\n", "\n    "), flush=True)
    print(f"{counts.total()} lines of seed {asked.seed} tried: ", end="")
    print(", ".join(f"{counts[fate]} {fate}" for fate in Fate))
    raise SystemExit(any(counts[fate] for fate in Fate if fate not in FINE))


if __name__ == "__main__":
    main()
