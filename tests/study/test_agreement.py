"""How well two fields of pressures agree, and where one of them acts."""

from __future__ import annotations

import numpy as np
import pytest

from geometry import effective_facets
from tests.support.coarse_tubes import tube
from validation import InputError, compare, load_case
from validation.study.comparison.answers import agreement
from validation.study.comparison.scene import compared_runs

pytestmark = pytest.mark.quick


def test_agreement_of_a_field_with_itself_is_perfect() -> None:
    rng = np.random.default_rng(0)
    pressure, areas = rng.uniform(0, 1, 50), rng.uniform(1, 2, 50)
    centroids, block = rng.uniform(0, 100, (50, 3)), np.repeat([0, 1], 25)
    same = agreement("all", pressure, 2 * pressure, centroids=centroids, areas=areas, block=block)
    assert same["correlation"] == pytest.approx(1.0)
    assert same["overlap"] == same["peaks_found"] == 1.0
    assert same["force_ratio"] == pytest.approx(2.0)
    assert effective_facets(np.array([0.0, 5.0, 0.0])).tolist() == [False, True, False]


def test_uniform_pressures_agree_whatever_their_round_off() -> None:
    """A joint under uniform pressure carries round-off of 1e-8; it is no pattern to compare."""
    rng = np.random.default_rng(1)
    uniform = 0.2 * np.ones((2, 60)) * (1.0 + 1e-8 * rng.standard_normal((2, 60)))
    centroids, areas = rng.uniform(0.0, 1.0, (60, 3)), np.ones(60)
    block = np.repeat([0, 1], 30)
    found = agreement("all", uniform[0], uniform[1], centroids=centroids, areas=areas, block=block)
    assert found["correlation"] == 1.0
    assert found["overlap"] == 1.0
    assert effective_facets(uniform[0]).all()
    sloped = np.linspace(0.1, 0.3, 60)
    found = agreement("all", uniform[0], sloped, centroids=centroids, areas=areas, block=block)
    assert found["correlation"] == 0.0


def test_rigid_blocks_of_a_comparison_have_their_limit_of_memory() -> None:
    case = load_case("tsb1-pipe", {"rigid.max_memory": 0.01})
    with pytest.raises(InputError, match=r"points of rigid blocks need .* the limit is 0\.01 GB"):
        compared_runs(case)


def test_solids_are_compared_and_a_column_presses_by_its_weight() -> None:
    """Joints of one column carry what stands above them, however blocks deform."""
    column = load_case("wall", {"assembly.columns": 1, "assembly.rows": 2})
    for (whole,) in compare(*compared_runs(column)).agreement.values():
        # Both are in equilibrium to 1e-8; sums over the facets of a coarse mesh differ by more.
        assert whole["force_ratio"] == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("gap", [0.001, -0.001])
def test_rigid_blocks_are_compared_without_gaps(gap: float) -> None:
    """Rigid blocks have no gap to close; the last step of the explanation is that gap."""
    closed, gapped = (
        compare(*compared_runs(tube("tsb1-pipe", f"contact.clearance={value}", 'fem.mesh="scene"')))
        for value in (0.0, gap)
    )
    rigid = ("rigid (force)", "rigid (pressure)")
    for name in ("p_max", "p_eff"):
        assert [gapped.rows[name][k] for k in rigid] == [closed.rows[name][k] for k in rigid]
        assert gapped.rows[name]["static"] != closed.rows[name]["static"]
    *_, before, last = gapped.why().steps
    assert last["words"] == f"with the initial gaps, clearance {gap:g} mm"
    # The step before is the static answer without the gap, to the tolerance of the steps.
    assert before["p_max"] == pytest.approx(closed.static["p_max"].value, rel=1e-3)
