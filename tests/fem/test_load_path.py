"""The way to the load with friction: parts, their error, and coming back from beyond."""

from dataclasses import replace

import numpy as np
import pytest

from fem import CoulombFriction, Problem, Static, concrete, solve_static
from fem.explicit.solve import Frame
from fem.static.path import LOAD_TOLERANCE, load_factors
from fem.static.solve import MOST_PARTS, StaticOptions, doubled, path_change, static_state
from geometry.loads import LoadCase, PressureLoad
from tests.support.answers import on_its_mesh
from tests.support.pressed_pipe import column, pipe, sheared_column

TIGHT = StaticOptions(tolerance=1e-10)


@pytest.mark.parametrize("friction", [False, True])
def test_load_factors_rise_to_one(friction):
    for parts in (1, 2, 7):
        factors = (0.0, *load_factors(parts, friction=friction))
        assert len(factors) == parts + 1
        assert factors[-1] == 1.0
        steps = np.diff(factors)
        assert (steps > 0.0).all()
        # Half as many parts end where every second of the others does: step doubling.
        assert np.allclose(load_factors(2 * parts, friction=friction)[1::2], factors[1:])
    assert not np.ptp(np.diff(load_factors(4, friction=False)))
    # With friction short steps come first, where the sliding starts: squares, as documented.
    assert load_factors(4, friction=True) == (1 / 16, 4 / 16, 9 / 16, 1.0)


def test_parts_are_doubled_until_the_answer_stays():
    """The last halving bounds what is left: the change falls at least like the parts, so all
    further ones together are no more than it. Without friction nothing is compared."""
    model = pipe(friction=CoulombFriction(0.3))
    found = static_state(model, StaticOptions(load_tolerance=LOAD_TOLERANCE))
    coarse = found.evidence.coarser
    assert coarse is not None
    assert 2 * coarse.evidence.load_steps == found.evidence.load_steps
    assert path_change(coarse, found) <= LOAD_TOLERANCE
    fine = static_state(model, StaticOptions(load_steps=2 * found.evidence.load_steps))
    left = abs(found.pressures.max() - fine.pressures.max())
    assert left <= abs(found.pressures.max() - coarse.pressures.max())
    # Work lost counts with the mean of both ends of a step. That is of second order: halving the
    # steps takes away less than half of it, where the traction at the end alone takes a half.
    assert fine.evidence.frictional_dissipation < found.evidence.frictional_dissipation
    assert found.evidence.frictional_dissipation < 2.0 * fine.evidence.frictional_dissipation
    plain = static_state(pipe(), StaticOptions(load_tolerance=LOAD_TOLERANCE))
    assert plain.evidence.coarser is None
    assert plain.evidence.load_steps == 1


def test_states_that_are_nearly_known_are_no_history():
    """Load steps start near states that are wrong by a tenth, as those of another mesh may be: the
    answer and the work lost are the same, to the residual."""
    model = pipe(friction=CoulombFriction(0.3))
    options = replace(TIGHT, load_tolerance=LOAD_TOLERANCE)
    direct = static_state(model, options)
    path = (*direct.evidence.path, direct)
    near = tuple((one.load_factor, tuple(1.1 * u for u in one.displacements)) for one in path)
    found = static_state(model, options, known=near)
    assert near
    assert found.evidence.load_steps == direct.evidence.load_steps
    moved = direct.displacements[0]
    assert np.abs(found.displacements[0] - moved).max() < 1e-7 * np.abs(moved).max()
    assert found.evidence.frictional_dissipation == pytest.approx(
        direct.evidence.frictional_dissipation, rel=1e-6
    )


def test_the_finest_parts_that_converge_are_the_answer():
    """Parts that find no equilibrium are no reference for others."""
    good = static_state(sheared_column(0.2, CoulombFriction(0.3)))
    bad = replace(good, evidence=replace(good.evidence, converged=False))
    found = doubled({1: bad, 2: good, 4: good}.__getitem__, 1, 0.1)
    assert found.evidence.converged
    assert found.evidence.coarser is good
    assert doubled(lambda parts: good if parts == 1 else bad, 1, 0.1) is good
    assert doubled(lambda parts: good if parts == MOST_PARTS else bad, 1, 0.1) is good
    assert doubled(lambda _: bad, 1, 0.1) is bad


def test_a_state_is_not_compared_with_itself():
    """Where one and two parts find no equilibrium and four do, four of them are no measure of what
    finer steps change: that are eight."""
    good = static_state(sheared_column(0.2, CoulombFriction(0.3)))
    asked = []

    def solve(parts: int):
        asked.append(parts)
        return replace(good, evidence=replace(good.evidence, load_steps=max(parts, 4)))

    found = doubled(solve, 1, 0.1)
    coarser = found.evidence.coarser
    assert asked == [1, 8]
    assert coarser is not None
    assert (coarser.evidence.load_steps, found.evidence.load_steps) == (4, 8)


def test_much_friction_converges_in_every_load_step():
    """Limits that follow the pressures at once swing for ever with a coefficient of 0.6, at a
    residual of a tenth."""
    found = static_state(pipe(friction=CoulombFriction(0.6)), StaticOptions(once=True))
    assert found.evidence.converged


def test_what_sticks_does_not_remember_the_way():
    """All points stick at 0.8 mu of the pressure, and on the way past by a fifth: an elastic body,
    whose state is its load's whatever came before, without any work lost."""
    friction = CoulombFriction(0.3, 50.0)
    direct = static_state(sheared_column(0.2, friction), TIGHT)
    past, last = (sheared_column(0.2, friction, pressure=p) for p in (0.12, 0.1))
    back = static_state(last, TIGHT, before=[past])
    moved = direct.displacements[0]
    assert np.abs(back.displacements[0] - moved).max() < 1e-7 * np.abs(moved).max()
    assert back.evidence.frictional_dissipation == direct.evidence.frictional_dissipation == 0.0


def test_what_slid_stays_behind_the_load():
    """Some points slide at 0.95 mu and more on the way past: back at the load the block lies
    further along than straight up, and more work is lost."""
    friction = CoulombFriction(0.3, 50.0)
    model = sheared_column(0.285, friction)
    direct = static_state(model, replace(TIGHT, load_steps=4))
    past = sheared_column(0.285, friction, pressure=0.103)
    back = static_state(model, TIGHT, before=[past])
    assert back.displacements[0][0][:, 0].mean() > direct.displacements[0][0][:, 0].mean()
    assert back.evidence.frictional_dissipation > direct.evidence.frictional_dissipation > 0.0


@pytest.mark.parametrize("searched", [False, True], ids=["matched", "searched"])
def test_a_stage_that_is_cut_in_two_goes_on_with_its_slips(searched):
    """Pressed, where all sticks, sheared until points slide, and halfway back: a stage of ten steps
    is two of five, under the same loads one after the other."""
    friction, ratios = CoulombFriction(0.3, 50.0), (0.0, 0.145, 0.29, 0.195, 0.1)
    stages = [sheared_column(ratio, friction, finite_sliding=searched) for ratio in ratios]
    whole, cut = (
        static_state(last, replace(TIGHT, load_steps=steps), before=before)
        for steps, (*before, last) in ((10, stages[::2]), (5, stages))
    )
    moved = whole.displacements[0]
    assert np.abs(cut.displacements[0] - moved).max() < 1e-7 * np.abs(moved).max()
    assert cut.evidence.frictional_dissipation == pytest.approx(
        whole.evidence.frictional_dissipation, rel=1e-6
    )
    straight = static_state(stages[-1], replace(TIGHT, load_steps=10)).displacements[0]
    assert np.abs(moved - straight).max() > 1e-2 * np.abs(moved).max()


def test_frames_of_supports_that_move_have_their_times() -> None:
    """At time 0 the loads act; the block that is pushed then goes on in proportion to time."""
    frames: list[Frame] = []
    settings = {"fem.mesh": "scene", "fem.frames": 6, "fem.error_estimate": False}
    on_its_mesh("shifted-boxes", {**settings, "fem.method": "static"}, on_frame=frames.append)
    times = np.array([frame.time for frame in frames])
    assert times == pytest.approx(np.linspace(0.0, 1.0, 6))
    ways = np.array([max(np.abs(u).max() for u in f.displacements) for f in frames])
    assert ways[0] < 0.1 * ways[-1]
    assert np.abs(ways - times * ways[-1]).max() <= 2.0 * ways[0]


def test_frames_of_a_problem_after_another_begin_at_its_state():
    """The first is the state of the problem before, the last the answer."""
    blocks = column()
    loads = (
        LoadCase(blocks, "press", (PressureLoad([2], "z+", p),), blocks.fixed)
        for p in (0.005, 0.01)
    )
    past, last = (Problem(blocks, load, concrete) for load in loads)
    last = replace(last, after=past)
    frames = []
    method = Static(mesh="scene", frames=3)
    found = solve_static(last, method, on_frame=frames.append).details
    before = static_state(past.system, StaticOptions(symmetry=1)).displacements[0]
    first, *_, end = (frame.displacements[0] for frame in frames)
    size = np.abs(before).max()
    # Both are found to a residual of 1e-8; what contact leaves soft moves more.
    assert np.abs(first - before).max() < 1e-5 * size
    assert np.abs(end - first).max() > 0.1 * size
    np.testing.assert_array_equal(end, found.displacements[0])


def test_the_last_frame_of_a_load_path_says_that_it_is_the_last() -> None:
    """Of four frames the first has no load; displacements of a linear problem grow with it."""
    frames: list[Frame] = []
    on_its_mesh("column", {"fem.method": "static", "fem.frames": 4}, on_frame=frames.append)
    assert [frame.number for frame in frames] == [0, 1, 2, 3]
    assert [frame.time for frame in frames] == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
    assert [frame.last for frame in frames] == [False, False, False, True]
    assert not any(u.any() for u in frames[0].displacements)
