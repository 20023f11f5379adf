"""Each key of a scene, set to another value: the answer changes, names the key, or is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.support.keys import leaves, other
from validation import sweep
from validation.scene.read import apply_overrides, scene_data

TUBE = ("mesh.around=12", "mesh.radial=2", "mesh.axial=2", "assembly.layers=1")
EFFECTS = (
    *("effects.rayleigh.stiffness_proportional=1e-8", "effects.finite_rotation=false"),
    "effects.bulk_viscosity.linear_bulk_viscosity=0.1",
)
#: Coarser meshes of a tube take as long as its own; boxes have error bars.
WITHOUT_BARS = ("fem.error_estimate=false",)
STATIC = ("fem.method='static'", "fem.load_steps=2")
EXPLICIT = (
    *("fem.method='explicit'", "fem.end_time=2e-5", "fem.ramp_time=1e-5", "fem.residual=0.5"),
    *("fem.time_step=1e-6", "fem.safety_factor=0.5", "fem.threads=1"),
    "fem.sample_interval=3",
)
JOINTS = (
    *("contact.maximum_stiffness=100.0", "effects.finite_sliding=false"),
    *("effects.friction.coefficient=0.2", "effects.elastic_frame=false"),
    "effects.friction.stick_stiffness=50.0",
    *("rigid.friction_law='cone'", "rigid.margin=false"),
)

#: Of an answer: what differs from run to run, and what only repeats the scene.
TOLD = {"cpu_seconds", "peak_memory_mb", "provenance", "unused_keys", "load", "scene"}
TOLD |= {"element_updates_per_cpu_second"}


@dataclass(frozen=True)
class Walk:
    """A method and what its scene sets."""

    command: tuple[str, ...]
    scene: str
    settings: tuple[str, ...]
    same_by_law: frozenset[str] = frozenset()
    """Keys that are used though the answer of this small scene is the same with them."""
    least: int = 6
    """Number of keys that change the answer, at least."""


def plain(data: Any) -> Any:
    """Return what is an answer."""
    if isinstance(data, dict):
        return {key: plain(value) for key, value in data.items() if key not in TOLD}
    if isinstance(data, list):
        return [plain(value) for value in data if not is_of_a_clock(value)]
    return data


def is_of_a_clock(row: Any) -> bool:
    """Whether this is a row of what differs from run to run."""
    return isinstance(row, dict) and row.get("title") in ("CPU seconds", "element updates")


def asked(run: Any, walk: Walk, settings: Iterable[str]) -> tuple[Any, set[str]] | None:
    """Answer and the keys that are named; None where it is refused."""
    words = [w for s in settings for w in ("--set", s)]
    target = () if walk.command[0] == "export" else ("--json", "walk.json")
    status, out, err = run(walk.command[0], walk.scene, *walk.command[1:], *target, *words)
    if status:
        assert err.startswith("error: "), err
        assert err.count("\n") == 1, err
        return None
    if walk.command[0] == "export":
        named = re.search(r"^ignored +(.*?) \(not used", out, re.DOTALL | re.MULTILINE)
        keys = " ".join(named[1].split()).split(", ") if named else []
        return Path(walk.command[2]).read_text(encoding="utf-8"), set(keys)
    data = json.loads(Path(target[1]).read_text(encoding="utf-8"))
    return plain(data), set(data["unused_keys"])


BOX = ("mesh.divisions=[2,1,1]",)
ON_SCENE = "fem.mesh='scene'"
WALKS = {
    "deck, general": Walk(
        ("export", "-o", "walk.inp", "--flavour", "general"),
        "tsb1-shaft",
        (*TUBE, *EFFECTS, *JOINTS, *EXPLICIT, "load.layer=1"),
    ),
    "deck, pairs": Walk(
        ("export", "-o", "walk.inp", "--flavour", "standard"),
        "tsb1-shaft",
        (*TUBE, *EFFECTS, *JOINTS, *STATIC),
    ),
    "deck, calculix": Walk(
        ("export", "-o", "walk.inp", "--flavour", "calculix"),
        "column",
        (*EFFECTS, *JOINTS, *STATIC),
    ),
    "blocks of a tube": Walk(
        ("export", "-o", "walk.obj"), "tsb1-shaft", (*TUBE, *EFFECTS, *JOINTS, *STATIC)
    ),
    "blocks of a wall": Walk(
        ("export", "-o", "walk.json"),
        "wall",
        (*JOINTS, *STATIC, "mesh.divisions=1"),
        least=3,  # its size, columns and rows
    ),
    "static box": Walk(("fem",), "cantilever", (*BOX, *EFFECTS, *STATIC, ON_SCENE)),
    "explicit box": Walk(
        ("fem",),
        "cantilever",
        (*BOX, *EFFECTS, *EXPLICIT),
        # The balance of energies is round-off at every step: more samples may find the same.
        frozenset({"fem.threads", "fem.sample_interval"}),
    ),
    "static tube": Walk(
        ("fem",),
        "tsb1-shaft",
        # What friction does to a static answer, `test_what_is_used_is_not_named` knows.
        (
            *TUBE,
            *(s for s in JOINTS if "effects.friction" not in s),
            *STATIC,
            *WITHOUT_BARS,
            ON_SCENE,
        ),
    ),
    "static tube of degree 2": Walk(
        ("fem",),
        "thb0-shaft",
        (
            *("mesh.edge=2", "mesh.radial=1", "assembly.layers=1", "fem.degree=2"),
            "material.averaging_radius=60.0",  # of larger balls fewer are searched
            *(s for s in JOINTS if "effects.friction" not in s),
            *(*STATIC, *WITHOUT_BARS),
        ),
    ),
    "explicit tube": Walk(
        ("fem",),
        "tsb1-pipe",
        (*TUBE, *JOINTS, *EXPLICIT, "fem.damping='static'"),
        frozenset({"fem.threads", "fem.sample_interval"}),  # the run ends at the same step
    ),
    "compare": Walk(
        ("compare", "--explicit"),
        "column",
        (
            *("effects.friction=0.3", "fem.symmetry='none'", "fem.mesh='scene'"),
            *("rigid.norm='force'", "rigid.friction_law='cone'", "rigid.margin=true"),
        ),
    ),
}


def alike(a: Any, b: Any) -> bool:
    """Whether two answers are one to what iterations leave, 1e-8 of the forces, with room."""
    if isinstance(a, dict) and isinstance(b, dict):
        keys = (a.keys() | b.keys()) - {"status", "residual", "newton_iterations"}
        return all(key in a and key in b and alike(a[key], b[key]) for key in keys)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return a == pytest.approx(b, rel=1e-6, abs=1e-6)
    return bool(a == b)


#: Values by which coarse scenes tell what is between them.
FAR = {"fem.residual": 1e-6}


def listed(value: list[Any]) -> list[Any]:
    """Lists with every number changed, whole numbers kept."""
    return [item if isinstance(item, dict) else other(item) for item in value]


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.quick] if n == "static box" else []) for n in WALKS],
)
def test_every_key_changes_the_answer_is_named_or_refused(tubelock, name: str) -> None:
    """What is named changes nothing, and what is not named changes something."""
    walk = WALKS[name]
    found = asked(tubelock, walk, walk.settings)
    assert found is not None
    base, named = found
    data = apply_overrides(scene_data(walk.scene)[1], walk.settings)
    changed, silent, loud = 0, [], []
    for key, value in leaves(data):
        new = FAR.get(key, listed(value) if isinstance(value, list) else other(value))
        if key in (*walk.same_by_law, "fem.method", "fem.frames") or new == value:
            continue
        found = asked(tubelock, walk, (*walk.settings, f"{key}={json.dumps(new)}"))
        if found is None:
            continue
        changed += found[0] != base
        section = f"[{key.partition('.')[0]}]"
        if {key, section} & (named | found[1]):
            loud += [] if alike(found[0], base) else [key]
        elif found[0] == base:
            silent.append(key)
    assert not silent
    assert not loud
    assert changed >= walk.least


@pytest.mark.parametrize("case", ["pipe", "tunnel", "pillar", "beam"])
def test_a_load_that_is_printed_as_it_is_names_the_key(tubelock, case: str) -> None:
    words = [w for s in (*TUBE, f"load.case={case}", "load.as_printed=true") for w in ("--set", s)]
    status, out, _ = tubelock("mbd", "tsb1-pipe", *words, "--json", "a.json")
    assert status == 0
    assert "load.as_printed" in json.loads(Path("a.json").read_text())["unused_keys"]
    assert "as printed" not in out


SWEPT = {
    "effects.friction": (0.05, 0.5),
    "rigid.friction_law": ("cone", "pyramid"),
    "rigid.norm": ("force", "pressure"),
    "rigid.margin": (False, True),
    "load.pressure": (0.01, 0.02),
    "load.layer": (1, 2),
    "effects.gravity": ([0.0, 0.0, -9810.0], [0.0, 0.0, -98100.0]),
    "material.density": (2.4e-9, 1.2e-9),
    "block.amplitude": (20.0, 15.0),
}


@pytest.mark.parametrize("key", SWEPT)
def test_every_parameter_of_a_rigid_study_changes_rows_or_is_named(key: str) -> None:
    """Rows over friction are those with friction, not two of the frictionless answer."""
    settings = [*TUBE[:3], "assembly.layers=2", "effects.friction=0.2"]
    others = [setting for setting in settings if setting.split("=")[0] != key]
    first, second = sweep("tsb1-shaft", {key: SWEPT[key]}, others).rows
    assert first["status"] == second["status"] == "ok", first["message"]
    own = {"number", "message", "cpu_seconds", key}
    one, other = ({name: row[name] for name in row if name not in own} for row in (first, second))
    assert (one != other) != ("not used by this method" in second["message"])
