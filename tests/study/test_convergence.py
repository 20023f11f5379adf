"""Second order in space and in time, measured against scikit-fem and the discrete eigenvalue."""

from __future__ import annotations

import pytest

from validation.study.convergence import mesh_curves, time_step_curve


@pytest.mark.slow
def test_elements_converge_in_second_order() -> None:
    for curve in mesh_curves(levels=(1, 2)):
        # From one element through the thickness to two the elements are not yet in their
        # asymptotic range (2 is approached from both sides): the error must fall by half at least.
        assert curve["order"] > 1.0, curve
        assert curve["errors"][-1] < 0.12


def test_time_integration_is_of_second_order() -> None:
    curve = time_step_curve()
    # ω of central differences is ω (1 + (ω Δt)² / 24): the next term is smaller by (ω Δt)².
    assert curve["order"] == pytest.approx(2.0, abs=0.01)
