"""The study of effects switches off those of the scene; what is off leaves no form and no bit."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.support.coarse_tubes import coarse
from validation import InputError, load_case
from validation.study.effects.costs import effect_costs, ready, take_steps, to_rest

TINY = list(coarse(1, 2))
EFFECTS = [
    "effects.friction.coefficient=0.5",
    "effects.rayleigh.stiffness_proportional=1e-8",
    "effects.bulk_viscosity={}",
    "contact.clearance=0.01",
]


def compiled_forms() -> frozenset[tuple[str, str]]:
    """Compiled functions of the solver and the signatures they have been compiled for so far."""
    return frozenset(
        (value.__name__, str(form))
        for name, module in list(sys.modules.items())
        if name.startswith("fem.")
        for value in list(vars(module).values())
        for form in getattr(value, "nopython_signatures", ())
    )


def test_effects_of_the_scene_are_switched_off_one_at_a_time(tmp_path: Path) -> None:
    file = load_case("tsb1-pipe", [*TINY, *EFFECTS])
    store = tmp_path / "rows.jsonl"
    report = effect_costs(file, store, answers=False)
    changed = [(c["key"], c["from"], c["to"]) for r in report["costs"] for c in r["changes"]]
    assert changed == [
        ("effects.friction.coefficient", 0.5, None),
        ("contact.clearance", 0.01, 0.0),
        ("effects.rayleigh.stiffness_proportional", 1e-8, None),
        ("effects.bulk_viscosity.linear_bulk_viscosity", 0.06, None),
        ("effects.bulk_viscosity.quadratic_bulk_viscosity", 1.2, None),
    ]
    # Also what the study changes for its own sake is named.
    assert {c["key"] for c in report["changes"]} == {"fem.method", "fem.damping", "fem.ramp_time"}
    # Damping and viscosity shrink the critical step; arrays of their own take memory.
    for row in report["costs"][2:]:
        assert row["time_step"] < 1.0
        assert row["memory"] > 1.0
    # A second call measures nothing.
    told: list[str] = []
    assert effect_costs(file, store, answers=False, told=told.append) == report
    assert not told


def test_a_scene_without_effects_has_none_to_switch_off(tmp_path: Path) -> None:
    file = load_case("tsb1-pipe", TINY)
    with pytest.raises(InputError, match="got a scene without effects"):
        effect_costs(file, tmp_path / "rows.jsonl", answers=False)


def test_effects_leave_no_trace_when_off() -> None:
    """The scene without effects runs before and after one with all: equal bits, no new form."""
    bare, full = (to_rest(load_case("tsb1-pipe", [*TINY, *e])) for e in ([], EFFECTS))

    def bits() -> bytes:
        loop = ready(bare)
        take_steps(loop)
        return b"".join(body.now.displacement.tobytes() for body in loop.bodies)

    first = bits()
    take_steps(ready(full))
    forms = compiled_forms()
    assert bits() == first
    assert compiled_forms() == forms
