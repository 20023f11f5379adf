"""What is off is absent: no compiled form of its own is left, and the bits are the same."""

from __future__ import annotations

from pathlib import Path

from validation import load_case
from validation.study.effects.costs import bare, effect_costs

TINY = ["assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2"]


def test_base_has_no_effect() -> None:
    file = load_case("tsb1-pipe", [*TINY, "effects.friction.coefficient=0.3"])
    effects = bare(file.scene).effects
    assert not any(getattr(effects, name) for name in type(effects).model_fields)


def test_effects_leave_no_trace_when_off(tmp_path: Path) -> None:
    # The base runs before and after each effect: bit for bit the same, nothing compiled anew.
    file = load_case("tsb1-pipe", TINY)
    store = tmp_path / "rows.jsonl"
    report = effect_costs(file.scene, file.name, store, answers=False)
    assert len(report["costs"]) == 9
    for cost in report["costs"]:
        assert cost["off_compiles"] == 0
        assert cost["same_bits"]
    found = {cost["name"]: cost for cost in report["costs"]}
    # Damping and viscosity shrink the critical step; arrays of their own take memory.
    for name in ("Rayleigh stiffness", "bulk viscosity"):
        assert found[name]["time_step"] < 1.0
        assert found[name]["memory"] > 1.0
    # A second call measures nothing.
    told: list[str] = []
    assert effect_costs(file.scene, file.name, store, answers=False, told=told.append) == report
    assert not told
