"""An effect that is off is absent: a step calls nothing of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fem import ElementType
from fem.explicit import block_frame, damping, solve, start, step
from fem.system.body import placed_body, springs_on
from fem.system.effects import AdaptiveMassDamping, BulkViscosity, Effects, RayleighDamping
from fem.system.rows import SmoothStepAmplitude
from geometry.mesh import boundary_quads
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import CONCRETE, distorted_box
from tests.support.lone_bodies import fixed_nodes, lone_bodies, nodal_load

#: Functions of each effect: module, name. All are called from the loop over steps alone.
FUNCTIONS: dict[str, tuple[tuple[Any, str], ...]] = {
    "gravity": ((step, "gravity_at"), (damping, "gravity_at"), (start, "gravity_at")),
    "ramped gravity": ((step, "ramped_gravity_power"),),
    "stiffness damping": ((step, "add_stiffness_damping"),),
    "bulk viscosity": ((step, "add_bulk_viscosity"),),
    "viscosity at supports": ((step, "supported_viscous_power"),),
    "finite rotation": ((block_frame, "fit"),),
    "adaptive mass damping": ((solve, "adapt"),),
    "loads": ((step, "load_factor"), (step, "set_applied_force")),
    "supports": ((step, "enforce_support"),),
}
GRAVITY = np.array([0.0, 0.0, -9810.0])
RAYLEIGH = RayleighDamping(stiffness_proportional=2e-8)
EFFECTS: dict[str, tuple[Effects, set[str]]] = {
    "none": (Effects(), set()),
    "gravity": (Effects(gravity=GRAVITY), {"gravity"}),
    "ramp": (
        Effects(gravity=GRAVITY, gravity_amplitude=SmoothStepAmplitude(1e-4)),
        {"gravity", "ramped gravity"},
    ),
    # The update of velocities has it, where blocks do not turn: only supports take a call.
    "stiffness": (Effects(rayleigh=RAYLEIGH), set()),
    "stiffness, turning": (
        Effects(rayleigh=RAYLEIGH, finite_rotation=True),
        {"stiffness damping", "finite rotation"},
    ),
    "bulk": (Effects(bulk_viscosity=BulkViscosity()), {"bulk viscosity"}),
    "rotation": (Effects(finite_rotation=True), {"finite rotation"}),
    "adaptive": (Effects(adaptive_mass_damping=AdaptiveMassDamping(interval=5)), {"adaptive"}),
}


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often the functions of each effect are called."""
    counted: Counter[str] = Counter()

    def counting(effect: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def counts(*arguments: Any, **options: Any) -> Any:
            counted[effect] += 1
            return function(*arguments, **options)

        return counts

    for effect, functions in FUNCTIONS.items():
        for module, name in functions:
            monkeypatch.setattr(module, name, counting(effect, getattr(module, name)))
    return counted


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("name", EFFECTS)
def test_no_step_calls_an_effect_that_is_off(calls: Counter[str], name: str, loaded: bool) -> None:
    effects, on = EFFECTS[name]
    group = placed_body(distorted_box((2, 2, 2)), CONCRETE, element=ElementType.INCOMPATIBLE)
    force = np.ones(group.mesh.nodes.shape)
    parts: dict[str, Any] = {}
    expected = {"adaptive mass damping" if effect == "adaptive" else effect for effect in on}
    if loaded:
        parts = {
            "loads": (nodal_load(0, force),),
            "supports": (fixed_nodes(0, np.arange(4)),),
        }
        expected |= {"loads", "supports"}
        if name == "stiffness":
            expected.add("viscosity at supports")
    model = lone_bodies((group,), effects=effects, **parts)
    time_step = 0.5 * model.critical.critical_time_step
    explicit_run(
        model,
        time_step=time_step,
        end_time=20.5 * time_step,
        sample_interval=7,
    )
    assert set(calls) == expected


def test_springs_to_the_ground_are_stiffness_of_their_block(calls: Counter[str]) -> None:
    """A step with springs calls what one without them calls: nothing more."""
    mesh = distorted_box((2, 2, 2))
    quads = boundary_quads(mesh)[:2]
    springs = springs_on(mesh, [("bed", quads, 5.0, np.eye(3))])
    model = lone_bodies((placed_body(mesh, CONCRETE, springs=springs),))
    time_step = 0.5 * model.critical.critical_time_step
    explicit_run(model, time_step=time_step, end_time=20.5 * time_step, sample_interval=7)
    assert not calls
