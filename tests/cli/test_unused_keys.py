"""What is named as ignored changes nothing, and what is not named changes something."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geometry import RefusedError
from tests.support.coarse_tubes import coarse
from tests.support.commands import answered, set_words
from validation import Case, builtin_names, load_case, solve, sweep
from validation.scene.read import apply_overrides, scene_data

COARSE = coarse(2, 2)
#: Keys that methods tell apart, each with a value that would matter where it acts.
EVERYTHING = (
    *("effects.rayleigh.mass_proportional=2.0", "effects.bulk_viscosity={}"),
    *("effects.elastic_frame=false", "fem.mesh='scene'", "fem.error_estimate=false"),
    *("fem.load_steps=2", "rigid.friction_law='pyramid'", "rigid.margin=false"),
)


def other(value: object) -> object:
    """Another value of the same kind that a scene takes."""
    words = {"newton": "clarabel", "force": "pressure", "static": "paper", "cone": "pyramid"}
    words |= {"incompatible": "full", "pyramid": "cone"}
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return 0.7 * value if value else 0.01
    return words.get(str(value), value)


def leaves(data: dict[str, object], place: str = "") -> list[tuple[str, object]]:
    """Keys of a scene with their values."""
    found: list[tuple[str, object]] = []
    for key, value in data.items():
        inner = isinstance(value, dict)
        found += leaves(value, f"{place}{key}.") if inner else [(f"{place}{key}", value)]  # type: ignore[arg-type]
    return found


def rigid(case: Case) -> np.ndarray:
    return solve(case.with_method("rigid")).details.contact_pressures


def static(case: Case) -> np.ndarray:
    return solve(case).contacts["pressure"]


@pytest.mark.parametrize("answer", [rigid, static])
def test_what_is_idle_does_not_change_a_bit(answer: Callable[[Case], np.ndarray]) -> None:
    settings = (*COARSE, *EVERYTHING)
    case = load_case("tsb1-pipe", settings)
    expected, idle = answer(case), case.key_use(answer.__name__).idle
    assert "effects.rayleigh.mass_proportional" in idle
    data = apply_overrides(scene_data("tsb1-pipe")[1], settings)
    changed = []
    for key in idle:
        value = data
        for part in key.split("."):
            value = value[part]
        new = other(value)
        if new == value or key == "fem.method":  # another method has another answer
            continue
        assert np.array_equal(answer(load_case(data, {key: new})), expected), key
        changed.append(key)
    assert len(changed) > 2


LINEAR = {"law": "linear", "stiffness": 200.0}
WITH_OTHERS = {
    "clearance_at_zero_pressure": LINEAR,
    "pressure_at_zero_clearance": LINEAR,
    "maximum_stiffness": LINEAR,
    "stiffness": {"law": "exponential"},
}


@pytest.mark.quick
@pytest.mark.parametrize("key", WITH_OTHERS)
def test_constants_of_another_contact_law_are_named_or_rejected(key: str) -> None:
    section, data = WITH_OTHERS[key] | {key: 0.1}, scene_data("column")[1]
    pairs = {"pairs": [{"between": [0, 1], **section}]}
    with pytest.raises(RefusedError, match=rf"contact\.pairs.*{key}"):
        load_case(data | {"contact": pairs})
    own = data | {"contact": section}
    if key in ("maximum_stiffness", "stiffness"):  # none by default
        with pytest.raises(RefusedError, match=rf"contact\.{key} belongs to law"):
            load_case(own)
        return
    case = load_case(own)
    for method in ("rigid", "static", "explicit", "static deck"):
        assert f"contact.{key}" in case.key_use(method).idle
    assert f"contact.{key}" in case.key_use("static").ignored


@pytest.mark.quick
def test_the_thickness_of_a_ball_is_named() -> None:
    for name, named in (("hertz-ball", True), ("hertz-roller", False)):
        use = load_case(name, {"block.thickness": 3.0}).key_use("static")
        assert ("block.thickness" in use.ignored) is named


def test_what_is_used_is_not_named() -> None:
    settings = (*COARSE, "effects.friction=0.2", "effects.gravity=[0, 0, -9.81e6]")
    case = load_case("tsb1-pipe", settings)
    for method in ("rigid", "static", "explicit"):
        idle = case.key_use(method).idle
        for key in ("effects.gravity", "load.pressure", "effects.friction.coefficient"):
            assert key not in idle
        assert "material.density" not in idle


@pytest.mark.quick
def test_effects_with_all_their_defaults_are_named_by_methods_without_them() -> None:
    """An effect that is switched on by `{}`, or by a share, states no key below it."""
    case = load_case("tsb1-pipe", {"effects.bulk_viscosity": {}, "effects.rayleigh": {}})
    for method in ("rigid", "static", "static deck"):
        assert "effects.bulk_viscosity" in case.key_use(method).ignored
        assert "rayleigh" not in case.key_use(method).ignored  # switches nothing on
    for method in ("explicit", "explicit deck"):
        assert "bulk_viscosity" not in case.key_use(method).ignored
    limits = load_case("tsb1-pipe", {"rigid.collapse": True, "rigid.solver": "clarabel"})
    assert limits.key_use("compare").ignored == "rigid.collapse"
    use = load_case("tsb1-pipe", {"effects.auto": 0.01}).key_use("rigid")
    assert use.ignored == "effects.auto"


@pytest.mark.quick
@pytest.mark.parametrize("key", ["material.tensile_strength", "material.compressive_strength"])
def test_strengths_are_named_by_explicit_runs_which_have_no_load_factors(key: str) -> None:
    case = load_case("column", {key: 3.0})
    assert case.key_use("explicit").ignored == key
    assert not case.key_use("static").ignored


@pytest.mark.parametrize("name", builtin_names())
def test_nothing_is_said_to_be_ignored_of_built_in_scenes(name: str) -> None:
    case = load_case(name)
    for method in ("rigid", case.method.name):
        assert not case.key_use(method).ignored


def test_commands_name_effects_of_time_integration() -> None:
    data, out = answered("mbd", "tsb1-pipe", *set_words((*COARSE, *EVERYTHING[:2])))
    keys = "effects.rayleigh.mass_proportional, effects.bulk_viscosity (not used by this method)"
    assert f"ignored {keys}" in " ".join(out.replace("│", "").split())
    assert {"material.young_modulus", "contact.law"} <= set(data["unused_keys"])
    assert "block.height" not in data["unused_keys"]


def test_a_study_of_the_strength_of_rigid_blocks_has_their_crushing_factor() -> None:
    """Pressures of rigid blocks do not depend on it: the factor is proportional to it."""
    rows = sweep("tsb1-pipe", {"material.compressive_strength": [10.0, 30.0]}, COARSE).rows
    assert not any(row["message"] for row in rows)
    weak, strong = (row["crushing_factor"] for row in rows)
    assert strong == pytest.approx(3.0 * weak, rel=1e-14)


def swept(tubelock, key: str, values: list[float]) -> tuple[int, str, str]:
    """What `tubelock sweep` says of a study of rigid blocks."""
    words = set_words(COARSE)
    Path("study.toml").write_text(
        f'scene = "tsb1-pipe"\nquantity = "rigid"\n[parameters]\n"{key}" = {values}\n'
    )
    return tubelock("sweep", "study.toml", *words, "-o", "a.jsonl", "--workers", "1")


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("material.young_modulus", [1e4, 3e4]),
        ("effects.rayleigh.mass_proportional", [0.1, 0.2]),
    ],
)
def test_a_rigid_study_of_what_rigid_blocks_do_not_have_is_refused(
    tubelock, key: str, values: list[float]
) -> None:
    status, _, line = swept(tubelock, key, values)
    assert status == 2
    assert f"{key}: no answer of rigid blocks depends on it" in line
    assert not Path("a.jsonl").exists()
    # In Python, rows that say so.
    for row in sweep("tsb1-pipe", {key: values}, COARSE).rows:
        assert row["status"] == "ok"
        assert row["message"] == f"{key}: not used by this method"


def test_a_study_of_combinations_is_refused(tubelock) -> None:
    """Its rows were those of all loads together, whatever the factors."""
    status, _, line = swept(tubelock, "combinations.all.load", [1.0, 1.5])
    assert status == 2
    assert "combinations.all.load: no row of a study depends on it" in line


def test_a_study_of_what_matters_goes_on(tubelock) -> None:
    assert swept(tubelock, "load.pressure", [0.01, 0.02])[0] == 0
    assert not any(r["message"] for r in sweep("tsb1-pipe", {"load.pressure": [0.01]}, COARSE).rows)


@pytest.mark.parametrize(
    ("name", "settings"),
    [("tsb1-shaft", coarse(2, 2))],
)
def test_every_key_that_is_read_changes_the_rigid_answer(
    name: str, settings: tuple[str, ...]
) -> None:
    """A key is named unused, or another value of it is refused or gives another answer."""

    def answer(data: dict[str, object]) -> tuple[str, bytes]:
        run = solve(load_case(data, method="rigid"))
        blocks = run.details.blocks
        found = blocks.interfaces
        numbers = (run.details.contact_forces, blocks.centroids, found.centroids)
        return str(run.details.mechanism), b"".join(np.ascontiguousarray(n) for n in numbers)

    data = apply_overrides(scene_data(name)[1], settings)
    idle = load_case(name, settings).key_use("rigid").idle
    base, changed = answer(data), 0
    for key, value in leaves(data):
        new = other(value)
        if key in idle or new == value:
            continue
        try:
            found = answer(apply_overrides(data, [f"{key}={json.dumps(new)}"]))
        except RefusedError:
            continue
        assert found != base, key
        changed += 1
    assert changed > 8
