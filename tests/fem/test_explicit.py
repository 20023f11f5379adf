"""The run around the step: input, stops, frames, checkpoints."""

import math
import signal
import subprocess
import sys
import textwrap
from dataclasses import replace

import numpy as np
import pytest

from fem.explicit.output.checkpoint import CheckpointError, content_digest
from fem.explicit.run import Status
from fem.explicit.solve import Output, UnstableRun
from fem.explicit.state import StateError
from fem.explicit.timed import TimedSystem
from fem.system.body import ModelError, placed_body
from fem.system.effects import (
    AdaptiveMassDamping,
    BulkViscosity,
    Effects,
    RayleighDamping,
)
from fem.system.rows import LoadError, SmoothStepAmplitude
from fem.system.time_step import TimeStepError
from geometry.errors import RefusedError
from tests.support.blocks import random_rotation
from tests.support.cantilever import EVERYTHING, HELD, MESH, cantilever
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import CONCRETE, degrees_of_freedom, static_displacement
from tests.support.lone_bodies import fixed_nodes, lone_bodies, nodal_load

pytestmark = pytest.mark.quick


def static_answer(model: TimedSystem) -> np.ndarray:
    group, force = model.bodies[0], model.system.nodal_forces()[model.system.nodes_of(0)]
    u = static_displacement(group.stiffness, force.ravel(), degrees_of_freedom(HELD))
    return u.reshape(-1, 3)


@pytest.mark.parametrize("n_copies", [1, 3])
def test_adaptive_damping_arrives_at_the_static_state(n_copies):
    # Stopped at a force residual r: the error in displacement is at most cond(K) r, in the
    # slowest mode it is about r; measured against the linear solution.
    model = cantilever(Effects(adaptive_mass_damping=AdaptiveMassDamping()), n_copies=n_copies)
    result = explicit_run(model, end_time=2e-2, settled=2e-4, residual=1e-6)
    assert result.run.status is Status.CONVERGED
    assert result.residual <= 1e-6
    assert result.run.n_steps < 5000
    expected = static_answer(model)
    for copy in range(n_copies):
        error = np.abs(result.displacements[0][copy] - expected).max()
        assert error < 1e-4 * np.abs(expected).max()
    assert result.run.energies.mass_damping_dissipation > 0.0
    assert result.run.energy_balance < 1e-10


def interrupting(step: int):
    def progress(told) -> None:
        if told.step >= step:
            signal.raise_signal(signal.SIGINT)

    return progress


@pytest.mark.parametrize("effects", [Effects(), EVERYTHING], ids=["none", "everything"])
def test_interrupted_run_continues_to_the_same_bits(tmp_path, effects):
    model = cantilever(effects)
    options = {"end_time": 3e-4, "sample_interval": 20}
    whole = explicit_run(model, **options)
    file = tmp_path / "run.npz"
    output = Output(checkpoint=file, progress=interrupting(100))
    first = explicit_run(model, output=output, **options)
    assert first.run.status is Status.INTERRUPTED
    assert first.run.n_steps < whole.run.n_steps
    second = explicit_run(model, resume=file, **options)
    assert second.run.status is Status.FINISHED
    np.testing.assert_array_equal(second.displacements[0], whole.displacements[0])
    np.testing.assert_array_equal(
        second.system.expand(second.velocity)[0], whole.system.expand(whole.velocity)[0]
    )
    np.testing.assert_array_equal(second.run.history.table(), whole.run.history.table())
    assert second.run.energy_balance == whole.run.energy_balance


@pytest.mark.thorough
def test_killed_process_continues_to_the_same_bits(tmp_path):
    file = tmp_path / "run.npz"
    script = """
        import os, sys, pathlib
        from tests.support.cantilever import cantilever, EVERYTHING
        from tests.support.explicit_runs import explicit_run
        from fem.explicit.solve import Output

        def die(told):
            if told.step > 150:
                os._exit(9)

        output = Output(checkpoint=pathlib.Path(sys.argv[1]), checkpoint_seconds=0.0, progress=die)
        explicit_run(cantilever(EVERYTHING), end_time=3e-4, output=output)
    """
    command = [sys.executable, "-c", textwrap.dedent(script), str(file)]
    assert subprocess.run(command, check=False).returncode == 9
    model = cantilever(EVERYTHING)
    resumed = explicit_run(model, end_time=3e-4, resume=file)
    whole = explicit_run(model, end_time=3e-4)
    np.testing.assert_array_equal(resumed.displacements[0], whole.displacements[0])
    np.testing.assert_array_equal(resumed.run.history.table(), whole.run.history.table())


def kept_run(file):
    """A checkpoint after a few steps, and the run that goes on from it."""
    options = {"end_time": 6e-5, "sample_interval": 10}
    explicit_run(cantilever(), output=Output(checkpoint=file, progress=interrupting(20)), **options)
    return lambda: explicit_run(cantilever(), resume=file, **options)


def test_a_flipped_bit_of_a_checkpoint_is_refused_or_changes_nothing(tmp_path):
    file = tmp_path / "run.npz"
    go_on = kept_run(file)
    raw, end = file.read_bytes(), go_on().displacements[0]
    refused = 0
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(raw), 80).tolist():
        flipped = bytearray(raw)
        flipped[place] ^= 1 << int(rng.integers(8))
        file.write_bytes(flipped)
        try:
            found = go_on().displacements[0]
        except CheckpointError as error:
            refused += 1
            assert "\n" not in str(error)  # noqa: PT017 - either is right
        else:
            # Names and times of the archive's entries are no content.
            np.testing.assert_array_equal(found, end)
    assert refused > 60


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a[..., :1], "expected"),  # would be broadcast
        (lambda a: a.astype(np.float32), "float32, expected"),
        (lambda _: None, "is nothing, expected"),
    ],
    ids=["shape", "type", "missing"],
)
def test_an_array_that_does_not_fit_is_never_put_into_the_state(tmp_path, change, message):
    file = tmp_path / "run.npz"
    go_on = kept_run(file)
    with np.load(file) as kept:
        contents = dict(kept)
    name = next(n for n in contents if n.startswith("array/") and contents[n].ndim > 1)
    contents[name] = change(contents[name])
    contents = {n: a for n, a in contents.items() if a is not None and n != "digest"}
    np.savez(file, **contents, digest=np.array(content_digest(contents)))
    with pytest.raises(CheckpointError, match=message):
        go_on()
    contents.pop("history")
    np.savez(file, **contents, digest=np.array("other"))
    with pytest.raises(CheckpointError, match="is damaged"):
        go_on()


def test_unstable_run_stops_before_anything_not_finite_is_passed_on():
    # A stiffer block than the critical time step was computed for: ω Δt = 4.
    group = placed_body(MESH, CONCRETE)
    force = np.zeros((group.n_nodes, 3))
    force[-1] = 1.0
    model = lone_bodies((group,), loads=(nodal_load(0, force),))
    frames = []
    dt = model.critical.critical_time_step
    stiffer = placed_body(MESH, replace(CONCRETE, young_modulus=4.0 * CONCRETE.young_modulus))
    wild = lone_bodies((stiffer,), loads=(nodal_load(0, force),))
    output = Output(on_frame=frames.append, frame_interval=10 * dt, progress=frames.append)
    patched = pytest.MonkeyPatch()
    patched.setattr(TimedSystem, "critical", model.critical)
    with patched.context(), pytest.raises(UnstableRun, match=r"block\[0\].*safety_factor"):
        explicit_run(wild, end_time=2000 * dt, time_step=dt, output=output)
    patched.undo()
    told = [f for f in frames if hasattr(f, "displacements")]
    assert told
    assert all(np.isfinite(f.displacements[0]).all() for f in told)


def test_frames_come_at_their_times():
    frames = []
    output = Output(on_frame=frames.append, frame_interval=2e-5)
    result = explicit_run(cantilever(), end_time=1e-4, output=output)
    assert [f.number for f in frames] == list(range(6))
    times = np.array([f.time for f in frames])
    assert times[0] == 0.0
    assert times[-1] == result.time
    # The first step at or after the time of the frame.
    late = times - 2e-5 * np.arange(6)
    assert (late >= -1e-18).all()
    assert (late < result.run.time_step).all()
    np.testing.assert_array_equal(frames[-1].displacements[0], result.displacements[0])


def test_reported_rates_and_memory():
    model = cantilever()
    result = explicit_run(model, end_time=5e-5)
    assert result.run.cost.element_updates == 2 * 24 * result.run.n_steps
    assert result.run.cost.element_updates_per_cpu_second > 0.0
    # u, v, f and what is applied, two lanes of float64; one side of a symmetric stiffness.
    one_side = (len(model.bodies[0].stiffness.indices) + 63) // 2
    assert result.run.cost.n_bytes >= 3 * 3 * 2 * 63 * 8 + 9 * 8 * one_side


def test_bad_initial_states_are_refused():
    with pytest.raises(StateError, match="expected"):
        explicit_run(cantilever(), end_time=1e-4, velocities=[np.zeros((2, 3, 3))])
    nan = np.full((2, len(MESH.nodes), 3), np.nan)
    with pytest.raises(StateError, match="finite"):
        explicit_run(cantilever(), end_time=1e-4, displacements=[nan])


def test_damping_that_would_make_the_step_vanish_is_refused():
    with pytest.raises(TimeStepError, match="stiffness_proportional"):
        explicit_run(cantilever(Effects(rayleigh=RayleighDamping(None, 1.0))), end_time=1e-4)


@pytest.mark.parametrize(
    "make",
    [
        lambda: AdaptiveMassDamping(interval=0),
        lambda: RayleighDamping(mass_proportional=-1.0),
        lambda: BulkViscosity(linear_bulk_viscosity=math.inf),
        lambda: Effects(gravity=np.array([0.0, np.inf, 0.0])),
        lambda: Effects(gravity_amplitude=SmoothStepAmplitude(1.0)),
        lambda: Effects(RayleighDamping(2.0), adaptive_mass_damping=AdaptiveMassDamping()),
    ],
)
def test_bad_effects_are_refused(make):
    with pytest.raises(RefusedError, match=r"(effects\.)?[a-z_]+: got .*expected"):
        make()


def test_bad_models_are_refused():
    group = placed_body(MESH, CONCRETE)
    with pytest.raises(ModelError, match="not a rotation"):
        placed_body(MESH, CONCRETE, rotations=-np.eye(3)[None])
    jump = fixed_nodes(0, HELD, displacement=np.ones(3))
    with pytest.raises(ModelError, match="jumps at time 0"):
        lone_bodies((group,), supports=(jump,))
    with pytest.raises(LoadError, match="not finite"):
        lone_bodies((group,), loads=(nodal_load(0, np.full((63, 3), np.nan)),))
    moves = fixed_nodes(0, HELD[:1], displacement=np.ones(3), amplitude=SmoothStepAmplitude(1e-5))
    with pytest.raises(ModelError, match="moved in two ways"):
        explicit_run(lone_bodies((group,), supports=(fixed_nodes(0, HELD), moves)), end_time=1e-4)


def test_directions_of_supports_may_be_oblique_or_stated_twice():
    """Along x and along x + y, along x again: as along x and y (rounding of all steps)."""
    group = placed_body(MESH, CONCRETE, rotations=random_rotation(1)[None])
    plain = fixed_nodes(0, HELD, components=(0, 1))
    tilted = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    oblique = fixed_nodes(0, HELD, components=(0, 1), axes=tilted)
    supports = (oblique, fixed_nodes(0, HELD[:2], components=(0,)))
    load = nodal_load(0, np.ones((group.n_nodes, 3)))
    one, two = (
        explicit_run(
            lone_bodies((group,), supports=held, loads=(load,)), end_time=1e-4
        ).displacements[0]
        for held in ((plain,), supports)
    )
    np.testing.assert_allclose(two, one, rtol=0.0, atol=1e-10 * np.abs(one).max())
