"""Random lines of the command: any command, any options, scenes and files that are broken.

A line is made in a folder of its own from good specimens (scene, mesh, study, results, checkpoint,
deck), one to three things of it spoilt. The same seed and number give the same line.
"""

from __future__ import annotations

import json
import os
import shutil
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from signal import SIGTERM, raise_signal
from typing import Any

import typer

from validation.cli.app import app
from validation.cli.completion import _keys
from validation.scene.builtin import builtin_names, builtin_text
from validation.scene.read import SCENE_TYPES

#: Scenes that are answered in a blink, by what makes them small.
SMALL: dict[str, tuple[str, ...]] = {
    "tsb1-pipe": ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2"),
    "tsb2-tunnel": ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2"),
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
_WRITES = {"--json": "result.json", "--csv": "rows.csv", "--parquet": "rows.parquet"}
#: How often each command is tried: those that are short, more often.
_WEIGHTS = {
    "mbd": 8.0,
    "fem": 6.0,
    "sweep": 4.0,
    "show": 3.0,
    "import": 4.0,
    "export": 3.0,
    "explode": 2.0,
    "demo": 0.1,
    "cost": 0.3,
    "convergence": 0.2,
    "peaks": 0.2,
    "clearance": 0.3,
    "effects": 0.3,
    "cell": 0.3,
}

#: What commands name, and what files they read, beside those that take a scene.
_NAMED = {"studies": ("paper-480",), "scenes": ("arch",), "reproduce": ("nothing", "--nothing")}
_READS = {
    "sweep": ("small.toml", "damped.toml"),
    "import": ("case.inp", "flat.inp", "block.vtu", "block.msh"),
    "rescue": ("results.sqlite",),
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
    "--accuracy": "p_eff=30%",
    "--max-seconds": "1",
    "--keep": "friction",
    "--flavour": "calculix",
    "--workers": "1",
    "--older": "keep",
    "--only": "coulomb",
    "--store": "cost.sqlite",
    "--resume": "run.npz",
    "--gap": "0.01",
    "--kind": "spacing",
}


def line(seed: int, number: int, folder: Path, specimens: Path) -> list[str]:
    """Words of one line; what it reads is written into its folder.

    Parameters
    ----------
    seed, number
        Decide the line.
    folder
        Empty; the line is run in it.
    specimens
        Of `make_specimens`.
    """
    random = Random(f"{seed}/{number}")
    (command,) = random.choices([*COMMANDS], [_WEIGHTS.get(name, 1.0) for name in COMMANDS])
    words = [command, *_subject(random, command, folder, specimens)]
    if command == "fem" and random.random() < 0.15:
        settings = [word for setting in STOPPED for word in ("--set", setting)]
        kept = _file(random, specimens / "run.npz", folder)
        words = ["fem", "tsb1-pipe", *settings, "--resume", kept]
    for option in _options(command):
        if random.random() < (0.7 if "--json" in option.opts else 0.3):
            words += _option(random, option, folder, specimens)
    if command in ("export", "rescue") and "-o" not in words:
        words += ["-o", "case.inp" if command == "export" else "new.sqlite"]
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
    words = [word for setting in settings for word in ("--set", setting)]
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
    key = random.choice(list(_keys(SCENE_TYPES[data["block"]["type"]])))
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
        name = "run.npz" if option == "--resume" else "results.sqlite"
        return [option, _file(random, specimens / name, folder)]
    good = _GOOD.get(option, "1%")
    return [option, good if random.random() < 0.5 else random.choice((*WORDS, *VALUES[:20]))]


def _output(random: Random, option: str, folder: Path) -> str:
    """Return a place to write to: mostly a good one."""
    if random.random() < 0.6:
        endings = ("out", "picture.png", "picture.svg", "case.inp", "copy.vtu", "rows.sqlite")
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
            f"[load]\ngravity = [0.0, 0.0, {random.choice((-9810.0, -9810.0, -9810.0, 1e8))!r}]",
            random.choice(("", "", "[rigid]\nfriction = 0.6", "[detection]\ntolerance = 1e-320")),
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
    return str(random.choice(_SPOIL)(random, path))


def _flipped(random: Random, path: Path) -> Path:
    """Change a few bytes."""
    text = bytearray(path.read_bytes())
    for _ in range(random.choice((1, 1, 2, 8))):
        if text:
            text[random.randrange(len(text))] = random.choice((0, 255, 10, 45, 48, 57, 101))
    path.write_bytes(bytes(text))
    return path


def _shortened(random: Random, path: Path) -> Path:
    text = path.read_bytes()
    path.write_bytes(text[: random.randrange(len(text) + 1)])
    return path


def _reordered(random: Random, path: Path) -> Path:
    """Take a line away, write one twice, or change a number of one."""
    lines = path.read_bytes().split(b"\n")
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
    path.write_bytes(b"\n".join(lines))
    return path


def _replaced(random: Random, path: Path) -> Path:
    path.write_bytes(
        random.choice((b"", b"\xff\xfe\x00", b"\x00" * 4096, b"{}", b"solid x\n", b"\n" * 5000))
    )
    return path


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


_SPOIL: tuple[Callable[[Random, Path], Path], ...] = (
    _flipped,
    _flipped,
    _shortened,
    _reordered,
    _reordered,
    _replaced,
    _no_file,
    _another_ending,
)


# ---------------------------------------------------------------------------------------------
# Specimens


def make_specimens(folder: Path, tubelock: Callable[[Sequence[str]], object]) -> None:
    """Write one good file of each kind that a command reads; ``tubelock`` runs a line."""
    import numpy as np

    from geometry.files.mesh_io import write_hex_mesh, write_triangles
    from geometry.mesh import HexMesh, boundary_quads, structured_hexahedra
    from geometry.polyhedra.polyhedron import polyhedron_from_quads

    small = [word for value in SMALL["tsb1-pipe"] for word in ("--set", value)]
    grid = np.stack(np.meshgrid(*[[0.0, 50.0, 100.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    solid = HexMesh(grid, structured_hexahedra(2, 2, 2))
    block = polyhedron_from_quads("block", grid, boundary_quads(solid))
    for ending in (".vtu", ".msh", ".inp"):
        write_hex_mesh(folder / f"block{ending}", solid)
    for ending in (".stl", ".obj", ".ply"):
        write_triangles(folder / f"block{ending}", block.points, block.triangles, {})
    upper = block.points.copy()
    upper[:, 2] += 100.0
    points = np.concatenate([block.points, upper])
    both = np.concatenate([block.triangles, block.triangles + len(block.points)])
    write_triangles(folder / "two.stl", points, both, {})
    study = [
        'scene = "tsb1-pipe"',
        "[parameters]",
        '"block.amplitude" = [10, 20]',
        '"load.pressure" = { from = 0.01, to = 0.02, step = 0.01 }',
        "[settings]",
    ]
    known = (setting.partition("=") for setting in SMALL["tsb1-pipe"])
    sizes = [f'"{key}" = {value}' for key, _, value in known]
    (folder / "small.toml").write_text("\n".join([*study, *sizes]), "utf-8")
    damped = '"contact.clearance" = [0.0, 0.01]'
    text = ['scene = "tsb1-pipe"', 'quantity = "fem"', "[parameters]", damped, "[settings]", *sizes]
    (folder / "damped.toml").write_text("\n".join(text), "utf-8")
    results = ["-o", str(folder / "results.sqlite"), "--workers", "1"]
    tubelock(["sweep", str(folder / "small.toml"), *results])
    for name, flavour in (("case.inp", "general"), ("flat.inp", "calculix")):
        tubelock(["export", "tsb1-pipe", *small, "--flavour", flavour, "-o", str(folder / name)])
    _interrupt(folder / "run.npz")


def _interrupt(checkpoint: Path) -> None:
    """Run `STOPPED` and stop it at its first sample."""
    from validation.run.solve import run_explicit
    from validation.scene.read import load_scene, require_deformable

    scene = require_deformable(load_scene("tsb1-pipe", STOPPED), "fem")
    run_explicit(
        "tsb1-pipe", scene, checkpoint=checkpoint, progress=lambda _: raise_signal(SIGTERM)
    )
