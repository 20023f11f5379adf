"""Every key of a scene is used by the method at hand, named as unused, or refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.face import (
    Flavour,
    FloatArray,
    InputError,
    KeyUse,
    RefusedError,
    apply_overrides,
    build_deck,
    builtin_names,
    check_scene,
    load_study,
    recording,
    refuse_idle_parameters,
    run_design,
    run_explicit,
    run_static,
    scene_case,
    scene_data,
)
from tests.support.keys import leaves, other
from validation import Case, load_case, solve

COARSE = ("mesh.around=12", "mesh.radial=2", "mesh.axial=2", "assembly.layers=1")
#: Keys that methods tell apart, each with a value that would matter where it acts.
EVERYTHING = (
    *("effects.rayleigh.mass_proportional=2.0", "effects.friction.coefficient=0.2"),
    *("effects.bulk_viscosity={}", "fem.end_time=1e-4", "fem.ramp_time=1e-5", "fem.threads=2"),
    *("fem.mass_scaling=1.5", "fem.load_steps=2", "fem.residual=1e-3", "fem.time_step=1e-7"),
    *("rigid.friction_law='pyramid'", "fem.safety_factor=0.5"),
)


def rigid(file: Case) -> FloatArray:
    return solve(file.with_method("rigid")).details.contact_pressures


def static(file: Case) -> FloatArray:
    return run_static(file.name, file.scene).solution.contact_state.pressures  # type: ignore[arg-type]


def explicit(file: Case) -> FloatArray:
    run = run_explicit(file.name, file.scene)  # type: ignore[arg-type]
    return run.solution.contact_state.pressures


@pytest.mark.parametrize(("answer", "method"), [(rigid, "static"), (static, "static")])
def test_what_is_named_unused_does_not_change_a_bit(
    answer: Callable[[Case], FloatArray], method: str
) -> None:
    settings = (*COARSE, *EVERYTHING, f"fem.method={method}")
    file = load_case("tsb1-pipe", settings)
    with recording(file.scene) as use:
        expected = answer(file)
    assert "fem.threads" in use.unused
    assert "fem.mass_scaling" in use.unused
    data = apply_overrides(scene_data("tsb1-pipe")[1], settings)
    changed = []
    for key in use.unused:
        section, _, name = key.partition(".")
        value = data[section]
        for part in name.split("."):
            value = value[part]
        new = other(value)
        if key == "fem.method" or new == value:
            continue
        scene = check_scene(apply_overrides(data, [f"{key}={json.dumps(new)}"]))
        assert np.array_equal(answer(scene_case(name="changed", scene=scene)), expected), key
        changed.append(key)
    assert len(changed) > 6


def test_what_is_used_is_not_named() -> None:
    """Friction and gravity change the answers of the methods that have them, and of no other."""
    settings = (*COARSE, "effects.friction.coefficient=0.2", "effects.gravity=[0, 0, -9.81e6]")
    found = {}
    for answer in (rigid, static):
        file = load_case("tsb1-pipe", settings)
        with recording(file.scene) as use:
            answer(file)
        found[answer] = use.unused
    assert "effects.friction.coefficient" in found[rigid]
    assert "effects.friction.coefficient" not in found[static]
    for unused in found.values():
        assert "effects.gravity" not in unused
        assert "load.pressure" not in unused
    assert "material.density" not in found[rigid]


def test_explicit_runs_and_decks_name_what_only_others_have() -> None:
    settings = (*COARSE, "fem.method=explicit", "fem.load_steps=4", "fem.end_time=1e-5")
    file = load_case("tsb1-pipe", (*settings, "fem.threads=2", "fem.damping=paper"))
    with recording(file.scene) as use:
        explicit(file)
    assert use.words == "fem.load_steps, [rigid]"
    with recording(file.scene) as use:
        build_deck(file, Flavour.GENERAL)
    assert {"fem.threads", "fem.load_steps"} <= set(use.unused)
    assert "fem.end_time" not in use.unused


@pytest.mark.parametrize("name", builtin_names())
def test_nothing_read_is_everything_unused(name: str) -> None:
    """All that a scene sets is found, with the places that its file has."""
    scene = load_case(name).scene
    given = KeyUse(scene).unused
    data = scene_data(name)[1]
    for key in given:
        places: list[object] = [data]
        for part in key.split("."):
            entries = [
                e for place in places for e in (place if isinstance(place, list) else [place])
            ]
            places = [entry[part] for entry in entries if isinstance(entry, dict) and part in entry]
            assert places, key
    assert any(key.startswith("block.") for key in given)


def test_commands_name_unused_keys_in_words_and_data(tubelock, tmp_path: Path) -> None:
    words = [w for s in (*COARSE, "fem.threads=2") for w in ("--set", s)]
    status, out, _ = tubelock("mbd", "tsb1-pipe", *words, "--json", str(tmp_path / "a.json"))
    assert status == 0
    assert "ignored   [material], [contact], [fem] (not used by this method)" in out
    data = json.loads((tmp_path / "a.json").read_text())
    assert {"material.density", "contact.law", "fem.threads"} <= set(data["unused_keys"])
    assert "block.height" not in data["unused_keys"]


def study_of(tmp_path: Path, quantity: str, key: str, values: str) -> Path:
    path = tmp_path / "study.toml"
    settings = "".join(f'"{k}" = {v}\n' for k, v in (s.split("=") for s in COARSE))
    path.write_text(
        f'scene = "tsb1-pipe"\nquantity = "{quantity}"\n[parameters]\n"{key}" = {values}\n'
        f"[settings]\n{settings}"
    )
    return path


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("material.young_modulus", "[1e4, 3e4]"),
        ("effects.friction.coefficient", "[0.1, 0.2]"),
    ],
)
def test_a_rigid_study_of_what_rigid_blocks_do_not_have_is_refused(
    tmp_path: Path, key: str, values: str
) -> None:
    study = load_study(str(study_of(tmp_path, "rigid", key, values)))
    with pytest.raises(InputError, match=f"{key}: no answer of rigid blocks depends on it"):
        refuse_idle_parameters(study)
    row = run_design(study, 0)
    assert row.status == "ok"
    assert row.message == f"{key}: not used by this method"


def test_a_study_of_what_matters_goes_on(tmp_path: Path) -> None:
    study = load_study(str(study_of(tmp_path, "rigid", "load.pressure", "[0.01, 0.02]")))
    refuse_idle_parameters(study)
    assert not run_design(study, 0).message


@pytest.mark.parametrize(
    ("name", "settings"),
    [("tsb1-shaft", ("mesh.around=12", "mesh.radial=2", "mesh.axial=2", "assembly.layers=1"))],
)
def test_every_key_that_is_read_changes_the_rigid_answer(
    name: str, settings: tuple[str, ...]
) -> None:
    """A key is named unused, or another value of it is refused or gives another answer."""

    def answer(data: dict[str, object]) -> tuple[str, bytes]:
        run = solve(scene_case(name=name, scene=check_scene(data)).with_method("rigid"))
        found = run.assembly.interfaces
        numbers = (run.details.contact_forces, run.assembly.centroids, found.centroids)
        return str(run.details.mechanism), b"".join(np.ascontiguousarray(n) for n in numbers)

    data = apply_overrides(scene_data(name)[1], settings)
    file = load_case(name, settings)
    with recording(file.scene) as use:
        solve(file.with_method("rigid"))
    base, changed = answer(data), 0
    for key, value in leaves(data):
        new = other(value)
        if key in use.unused or new == value:
            continue
        try:
            found = answer(apply_overrides(data, [f"{key}={json.dumps(new)}"]))
        except RefusedError:
            continue
        assert found != base, key
        changed += 1
    assert changed > 8
