"""For every built-in scene: what a command prints and what Python gives are one answer.

Its text, measures with error bars and remarks, or the line that rejects.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fem import Explicit, Static, solve_explicit, solve_static
from geometry import Answer, RefusedError
from mbd import analyse
from tests.fixtures.commands import small_meshes
from tests.support.coarse_tubes import keys
from tests.support.commands import command
from validation import builtin_names, load_case, solve

#: Fewer and coarser blocks, by names or their beginnings: the law holds for any scene.
SINE = keys(1, 4)
FEWER: dict[str, dict[str, Any]] = {
    "tsb": SINE,
    "thb": {"assembly.layers": 1, "mesh.edge": 4, "mesh.radial": 1},
    "osteomorphic": {
        "mesh.divisions": [6, 3, 2],
        "assembly.layers": 2,
        "assembly.columns": 2,
    },
    "planar-sine": {
        "mesh.divisions": [12, 2, 3],
        "assembly.layers": 2,
        "assembly.columns": 2,
    },
    "hertz": {"mesh.elements": 2},
    "cattaneo": {"mesh.elements": 2},
    "cantilever": {"mesh.divisions": [8, 2, 2]},
    "arch": {"assembly.voussoirs": 5, "block.thickness": 200.0},
    "brick-stack": {"mesh.divisions": [2, 1, 1], "assembly.columns": 2, "assembly.layers": 1},
    "wall-with-roller": {},
    "wall": {"assembly.rows": 2, "assembly.columns": 2},
    "tetrahedra": {"assembly.rows": 3, "assembly.columns": 3},
    "cubes": {"assembly.rings": 1},
    "octahedra": {"assembly.rings": 1},
}
#: Both doors solve one problem to a residual of 1e-8 or less of its load; this share of the
#: largest measure of a unit is far above what two such solutions may differ by.
SAME = 1e-6

#: Deformable blocks that are not refined here: solved on the mesh of the scene, without error bars.
UNREFINED = ("arch", "cubes", "shifted-boxes", "wall", "wall-with-roller")
#: Deformable blocks that take 5 CPU s to minutes on their coarsest meshes, and the second of two
#: tubes of one family: left out.
LEFT_OUT = (
    *("cattaneo-mindlin", "hertz-ball", "hertz-roller", "octahedra", "pushed-panel", "thb0-beam"),
    *("thb0-pillar", "thb0-shaft", "tsb2", "versatile"),
)


def deformable() -> list[str]:
    return [name for name in builtin_names() if not name.startswith(LEFT_OUT)]


def fewer(name: str) -> dict[str, Any]:
    return next((settings for key, settings in FEWER.items() if name.startswith(key)), {})


def printed(method: str, name: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Answer of a command as JSON, with its text; "rejected" where it is a line."""
    words = [w for k, v in settings.items() for w in ("--set", f"{k}={json.dumps(v)}")]
    status, out, err = command(method, name, *words, "--json", "-")
    if status == 2:
        line = err.removeprefix("error: ").removesuffix("\n")
        return {"rejected": line.removeprefix(f"{name}: ")}
    assert status == 0, err
    return json.loads(out) | {"text": err}


def timeless(table: str) -> str:
    """Text of a table but its last rows, which are CPU times."""
    return table.rpartition("├")[0]


def given(kind: str, name: str, settings: dict[str, Any]) -> dict[str, Any]:
    """The same of Python: the text is that of ``print(answer)``."""
    return _data(name, lambda: solve(load_case(name, settings).with_method(kind)))


def below(name: str, settings: dict[str, Any]) -> dict[str, Any]:
    """The same of the solver below it."""

    def solved() -> Answer:
        case = load_case(name, settings, method="rigid")
        return analyse(case.problem, case.method)

    return _data(name, solved)


def _data(name: str, solved: Callable[[], Answer]) -> dict[str, Any]:
    try:
        answer = solved()
        return json.loads(json.dumps(answer.as_dict() | {"text": str(answer)}))
    except RefusedError as error:
        return {"rejected": str(error).removeprefix(f"{name}: ")}


def agree(one: dict[str, Any], other: dict[str, Any]) -> None:
    if one.get("title") == other.get("title") and "text" in other:
        assert timeless(other["text"]) in one["text"]
    # A command names the key of a scene; what a problem is refused for is a field of its own.
    assert (answer := one.get("rejected", "")).endswith(line := other.get("rejected", ""))
    assert bool(answer) is bool(line)
    assert one.get("mechanism") == other.get("mechanism")
    measures, expected = (answer.get("measures", {}) for answer in (one, other))
    assert list(measures) == list(expected)
    sizes: dict[str, float] = {}
    for measure in expected.values():
        unit = measure["unit"]
        sizes[unit] = max(sizes.get(unit, 0.0), abs(measure["value"] or 0.0))
    for measure, reference in zip(measures.values(), expected.values(), strict=True):
        for key in ("unit", "resolved", "remark"):
            assert measure.get(key) == reference.get(key)
        for key in ("value", "error"):
            size = SAME * sizes[reference["unit"]]
            value = reference[key]
            same = value if value is None else pytest.approx(value, rel=SAME, abs=size)
            assert measure[key] == same


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.thorough] * (name == "pushed-panel"))
        for name in builtin_names()
    ],
)
def test_rigid_answers_of_command_and_python_are_one(name: str) -> None:
    one, other = printed("mbd", name, fewer(name)), given("rigid", name, fewer(name))
    assert one.get("title") == other.get("title")
    agree(one, other)


@pytest.mark.parametrize("name", deformable())
def test_deformable_answers_of_command_and_python_are_one(name: str) -> None:
    settings = fewer(name)
    if name in UNREFINED:
        settings = settings | {"fem.mesh": "scene", "fem.error_estimate": False}
    with small_meshes(1, 2):  # refined once, as both doors refine unless told otherwise
        one = printed("fem", name, settings)
        other = given(one.get("method", "static"), name, settings)
    assert one.get("title") == other.get("title")
    agree(one, other)


@pytest.mark.parametrize(
    "stated",
    [
        {"fem.mesh": "scene"},
        {"fem.mesh": "scene", "fem.error_estimate": False},
        {"fem.accuracy.u": 0.2, "fem.symmetry": "none", "material.tensile_strength": 3.0},
        {
            "effects.friction.coefficient": 0.3,
            "fem.mesh": "scene",
            "fem.load_steps": 1,
            "contact.clearance": 0.001,
        },
        {"fem.method": "explicit", "fem.end_time": 0.001},
        {
            "fem.method": "explicit",
            "effects.friction": 0.3,
            "fem.symmetry": "none",
            "fem.end_time": 0.001,
        },
        {"fem.method": "explicit", "fem.damping": "paper", "fem.end_time": 0.002},
    ],
    ids=" ".join,
)
def test_how_a_scene_is_to_be_solved_is_read_by_python(stated: dict[str, Any]) -> None:
    """By the command, by `solve`, and by the solver below it; the parts of the answer as well."""
    settings = SINE | stated
    with small_meshes(1, 2):
        one = printed("fem", "tsb1-pipe", settings)
        case = load_case("tsb1-pipe", settings)
        solver = {Static: solve_static, Explicit: solve_explicit}[type(case.method)]
        for answer in (solve(case), solver(case.problem, case.method)):
            other = json.loads(json.dumps(answer.as_dict()))
            agree(one, other)
            for key in PARTS:
                same_numbers(one.get(key), other.get(key))


#: Parts of deformable answers in the report.
PARTS = ("accuracy", "facets")


def same_numbers(one: Any, other: Any) -> None:
    """Plain data whose numbers agree to the residuals, but for times."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one.keys() - {"cpu_seconds"}:
            same_numbers(one[key], other[key])
    elif isinstance(one, list):
        for a, b in zip(one, other, strict=True):
            same_numbers(a, b)
    else:
        assert one == (pytest.approx(other, rel=1e-5, abs=1e-9) if type(one) is float else other)


# ---------------------------------------------------------------------------------------------
# Random scenes

#: Ranges from which values of some keys are drawn, by the beginnings of names of scenes; some of
#: the scenes cannot be built, and are rejected by both.
RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "tsb": {"block.amplitude": (5, 40), "block.thickness": (20, 80), "block.height": (120, 260)},
    "thb": {"block.thickness": (20, 80), "block.inner_radius": (80, 200)},
    "osteomorphic": {"block.amplitude": (2, 30), "block.thickness": (40, 120)},
    "planar-sine": {"block.amplitude": (2, 30), "block.thickness": (40, 120)},
    "arch": {"block.thickness": (60, 300), "assembly.embrace": (60, 180)},
    "wall": {"load.acceleration.0": (0, 6000)},
    "tetrahedra": {"block.thickness": (20, 90)},
    "cubes": {"block.edge": (20, 90)},
    "octahedra": {"block.edge": (20, 90)},
}
SHARED = {
    "effects.friction": (0.05, 1.0),
    "effects.gravity": (-9810.0, 0.0),
    "load.pressure": (-0.02, 0.05),
    "contact.clearance": (-0.01, 0.02),
}
FLAGS = ("rigid.collapse", "rigid.ranges", "effects.finite_sliding")


def drawn(rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    names = [n for n in builtin_names() if n.startswith(tuple(RANGES)) and "roller" not in n]
    name = str(rng.choice(names))
    settings = dict(fewer(name))
    own = next(ranges for key, ranges in RANGES.items() if name.startswith(key))
    for key, (low, high) in {**own, **SHARED}.items():
        if rng.random() > 0.35 + 0.3 * (key in own):
            continue
        value: Any = round(float(rng.uniform(low, high)), 3)
        if key == "effects.gravity":
            value = [0.0, 0.0, value]
        if key.endswith(".0"):
            value = [value, 0.0, 0.0]
        if key != "load.pressure" or name.startswith(("tsb", "thb", "osteo", "planar")):
            settings[key.removesuffix(".0")] = value
    settings |= {key: True for key in FLAGS if rng.random() < 0.1}
    return name, settings


@pytest.mark.parametrize(
    ("seed", "count"), [(48, 18), pytest.param(49, 55, marks=pytest.mark.thorough)]
)
def test_random_scenes_have_one_rigid_answer(seed: int, count: int) -> None:
    rng, answered = np.random.default_rng(seed), 0
    for _ in range(count):
        name, settings = drawn(rng)
        one = printed("mbd", name, settings)
        agree(one, below(name, settings))
        answered += "rejected" not in one
    assert answered >= count // 2


@pytest.mark.thorough
def test_random_scenes_have_one_deformable_answer() -> None:
    """On coarse meshes, static, without error bars."""
    rng, answered, coarse = np.random.default_rng(50), 0, {"fem.mesh": "scene"}
    for _ in range(20):
        name, settings = drawn(rng)
        settings = {k: v for k, v in settings.items() if not k.startswith("rigid.")}
        settings |= coarse | {"fem.method": "static", "fem.error_estimate": False}
        one = printed("fem", name, settings)
        agree(one, given("static", name, settings))
        answered += "rejected" not in one
    assert answered >= 5
