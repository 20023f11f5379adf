"""A limit of operations ends an analysis, which says how far it came."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from geometry import Assembly
from geometry.families.masonry import RunningBondWall
from geometry.families.platonic_layers import OctahedraLayer
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import LoadCase, named_load
from geometry.machine.work import (
    SECONDS,
    LimitError,
    Operation,
    budget,
    count,
    memory_limit,
    unlimited,
)
from mbd import Rigid, analyse, contact_jacobian
from mbd.answer import _CONTACT_BYTES
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium, newton_equilibrium
from mbd.limits.force_range import force_ranges
from mbd.limits.plane import in_space
from mbd.limits.pushes import interlocking_margin
from mbd.limits.sliding_collapse import sliding_collapse
from mbd.loading import squeeze
from mbd.programs import Work
from tests.support.blocks import tsb
from tests.verification import printed_numbers
from tests.verification.closed_forms import body_force

pytestmark = pytest.mark.quick

#: Reference seconds of one operation of the simplex method.
EACH = SECONDS[Operation.SIMPLEX]
DOWN, ASIDE = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def wall():
    assembly = RunningBondWall((240.0, 115.0, 71.0), 2, 2).build()
    contacts = contact_jacobian(assembly)
    return assembly, contacts, frictional_contacts(assembly, contacts, 0.7)


def test_work_is_iterations_times_entries_and_ends_at_its_limit() -> None:
    told: list[int] = []
    work = Work(1000.0 * EACH, progress=told.append)
    assert work.simplex_iterations(100) == 10
    work.simplex(4, 100)
    assert work.simplex_iterations(100) == 6
    assert not work.spent
    work.simplex(7, 100)
    assert work.spent
    assert told == [1, 2]
    assert work.simplex_iterations(100) == 0


def _tube(*divisions: int) -> tuple[Assembly, LoadCase]:
    blocks = SineTube(tsb(), SineBlockDivisions(*divisions), 30).build()
    return blocks, named_load("pipe", 0.01).on(blocks)


def test_rigid_answer_needs_no_more_memory_than_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("geometry.loads", "geometry.parts.measures"):
        monkeypatch.setattr(f"{module}._AT_ONCE", 1000)
    small, load = _tube(12, 2, 2)
    analyse(small, load=load)  # loads what answers need
    blocks, load = _tube(48, 8, 8)
    tracemalloc.start()
    answer = analyse(blocks, load=load)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert answer.details.n_contacts > 40_000
    bound = float(blocks.eligible_facets().sum()) / 2.0
    # A tenth for what does not grow with the contacts: blocks and pairs.
    least = 1.1 * _CONTACT_BYTES * bound / 2**30
    assert peak / 2**30 <= least
    # More than that is refused before contacts are looked for; contacts alone take more than this.
    again, load = _tube(48, 8, 8)
    with pytest.raises(LimitError, match=r"GB of memory, and the limit is 0\.01 GB"):
        analyse(again, Rigid(max_memory=0.01), load=load)
    assert "interfaces" not in vars(again)


@pytest.mark.parametrize("limited", [Rigid(max_work=1e-9), Rigid(max_seconds=1e-9)])
def test_the_search_for_contact_forces_asks_the_limits(limited: Rigid) -> None:
    """Each of its steps is counted: a wall of 10 000 blocks went on for minutes after 5 s."""
    tube, load = _tube(12, 2, 2)
    with pytest.raises(LimitError, match="no state within the limit of"):
        analyse(tube, limited, load=load)


def test_ranges_known_at_the_limit_are_those_without_one(wall) -> None:
    assembly, contacts, frictional = wall
    load = body_force(assembly, DOWN)
    shown = newton_equilibrium(contacts.jacobian, load).forces
    every = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    assert every is not None
    assert every.unanswered == 0
    # All least forces and no largest one: HiGHS needs some iterations for each.
    few = force_ranges(
        contacts, load, shown, frictional=in_space(frictional), work=Work(2e5 * EACH)
    )
    assert few is not None
    assert 0 < few.unanswered <= len(few.least)
    assert few.unanswered == np.isnan(few.width).sum()
    for found, whole in ((few.least, every.least), (few.largest, every.largest)):
        known = np.isfinite(found)
        np.testing.assert_allclose(found[known], whole[known], atol=1e-6 * every.load)


def test_a_search_for_sliding_says_where_it_stopped() -> None:
    """No smaller factor than the one it starts from, which the whole search finds."""
    problem, assembly = printed_numbers.wall("W1")
    loads = [body_force(assembly, way)[problem.rows] for way in (DOWN, ASIDE)]
    found = sliding_collapse(problem.contacts, *loads, Work(EACH))
    assert found.stopped
    assert f"limit of work, {found.programs} linear programs" in found.status
    whole = sliding_collapse(problem.contacts, *loads)
    assert not whole.stopped
    assert whole.factor < found.factor <= found.associated * (1.0 + 1e-9)


def test_a_squeeze_that_is_not_decided_says_so(wall) -> None:
    assembly, contacts, frictional = wall
    load = body_force(assembly, DOWN)
    forces = frictional_equilibrium(frictional, load).forces
    told: list[int] = []
    work = Work(EACH, progress=told.append)
    found = squeeze(contacts, frictional, load, 0.5 * forces, work=work)
    assert found.needed is None
    assert found.reason().startswith("limit of work or time after")
    assert told == list(range(1, found.programs + 1))


def test_unit_loads_left_at_the_limit_are_counted() -> None:
    contacts = contact_jacobian(OctahedraLayer(50.0, 0).build())
    every = interlocking_margin(contacts)
    found = interlocking_margin(contacts, Work(EACH))
    assert every.unasked == 0
    assert found.unasked == every.areas.size - 1
    assert found.bearing_area == every.areas[0, 0, 0] >= every.bearing_area


def test_what_a_finished_answer_needs_has_no_limit_of_work_but_that_of_memory() -> None:
    with budget(work=2.0 * EACH, memory=0.5) as outer:
        least = memory_limit()
        with unlimited():
            count(Operation.SIMPLEX, 3.0)
            assert memory_limit() == least
        assert outer.seconds == pytest.approx(3.0 * EACH)
