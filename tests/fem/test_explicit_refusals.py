"""What rejects an explicit run of an assembly rejects one of a single body and of a sector too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from fem.explicit import solve as explicit
from geometry import RefusedError
from validation import load_case, solve

TUBE = ["fem.method='explicit'", "fem.end_time=2e-4", "assembly.layers=1"]
TUBE += ["mesh.around=12", "mesh.radial=1", "mesh.axial=2"]
BODIES = {
    "single body": ("cantilever", ["mesh.divisions=[4,1,1]", "fem.end_time=2e-4"]),
    "assembly": ("tsb1-pipe", [*TUBE, "fem.symmetry='none'"]),
    "sector": ("tsb1-pipe", [*TUBE, "fem.symmetry='sector'"]),
}
Spoiling = tuple[Callable[[Path], object], str | None, str]
#: Of a checkpoint: what is done before it is used, the setting with it, and the line.
CHECKPOINTS: dict[str, Spoiling] = {
    "another load": (lambda _: None, "effects.gravity=[0,0,-9810]", "belongs to another model"),
    "another step": (lambda _: None, "fem.safety_factor=0.5", "belongs to another model"),
    "damaged": (lambda file: file.write_bytes(b"no"), None, "not a readable checkpoint"),
    "none": (Path.unlink, None, "no such file"),
}


@pytest.fixture(params=BODIES)
def body(request: pytest.FixtureRequest) -> tuple[str, list[str]]:
    return BODIES[request.param]


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_checkpoint_that_does_not_fit_is_one_line(
    body: tuple[str, list[str]], name: str, tmp_path: Path
) -> None:
    spoil, setting, line = CHECKPOINTS[name]
    scene, settings = body
    file = tmp_path / "run.npz"
    stopped = solve(load_case(scene, [*settings, "fem.max_work=1e-6"]), checkpoint=file)
    assert stopped.report["status"] == "stopped"
    spoil(file)
    case = load_case(scene, [*settings, *([] if setting is None else [setting])])
    with pytest.raises(RefusedError, match=line) as found:
        solve(case, resume=file)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("name", ["RUNAWAY", "LARGEST_IMBALANCE"])
def test_an_unstable_run_is_one_line(
    body: tuple[str, list[str]], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No run meets a bound of nothing.
    monkeypatch.setattr(explicit, name, 1e-30)
    scene, settings = body
    with pytest.raises(RefusedError, match="unstable") as found:
        solve(load_case(scene, [*settings, "fem.sample_interval=5"]))
    assert "\n" not in str(found.value)


def test_a_step_beyond_the_critical_one_is_one_line(body: tuple[str, list[str]]) -> None:
    scene, settings = body
    with pytest.raises(RefusedError, match="at most the critical time step"):
        solve(load_case(scene, [*settings, "fem.time_step=1.0"]))


def test_blocks_that_are_thrown_apart_end_in_one_line():
    """Pushed by millimetres in 10 µs: the last steps overflow, which is no warning of its own."""
    fast = {"fem.method": "explicit", "fem.end_time": 2e-4, "fem.ramp_time": 1e-5}
    with pytest.raises(RefusedError, match=r"a smaller fem\.safety_factor or set contact"):
        solve(load_case("pushed-panel", fast))
