"""The contact laws: closed form, slope, energy, inverse, continuation, no overflow."""

import math

import numpy as np
import pytest

from fem import ExponentialLaw, LinearPenalty

pytestmark = pytest.mark.quick

UNCAPPED = ExponentialLaw()
CAPPED = ExponentialLaw(maximum_stiffness=1000.0)
LAWS = [
    UNCAPPED,
    CAPPED,
    ExponentialLaw(1e-2, 1e-3, 50.0),
    LinearPenalty(800.0),
]
IDS = ["uncapped", "capped", "soft", "linear"]


def sample(law):
    """Overclosures on every branch of a law, none within 1e-5 mm of a branch point."""
    c = law.constants
    inside = np.linspace(c.start, min(c.linear_start, 0.02), 203)[1:-1]
    beyond = c.linear_start + np.array([1e-4, 0.01, 1.0, 30.0])
    before = c.start - np.array([1e-4, 0.5, 100.0])
    return np.concatenate([before, inside, beyond if c.linear_start < 1.0 else []])


def test_the_table_of_the_law():
    """Overclosure and stiffness at six pressures, computed independently to three digits."""
    pressure = np.array([1e-4, 0.01, 0.1, 0.47, 1.0, 10.0])
    overclosure = np.array([0.0, 2.83, 4.71, 6.05, 6.71, 8.77])
    stiffness = np.array([0.258, 12.8, 118.0, 537.0, 1130.0, 11000.0])
    x = UNCAPPED.overclosure(pressure)
    # Three printed digits: half a unit of the third, 0.005 µm and 0.5 % of the leading digit.
    assert np.abs(x * 1e3 - overclosure).max() < 0.0051
    assert np.abs(UNCAPPED.stiffness(x) / stiffness - 1.0).max() < 0.005


def test_the_law_of_the_text_has_no_cap_unless_one_is_named():
    """p = p_c0/(e - 1) X (eˣ - 1) far above 0.883 MPa, where a cap of 1000 MPa/mm would begin."""
    x = np.array([7e-3, 9e-3, 15e-3])
    exponent = x / 1e-3 + 1.0
    expected = 1e-4 / (math.e - 1.0) * exponent * np.expm1(exponent)
    # X carries a rounding of X itself, eˣ then one of X times it: 16 eps.
    assert np.allclose(ExponentialLaw().pressure(x), expected, rtol=1e-14, atol=0)
    assert (CAPPED.pressure(x) < 0.95 * expected).all()
    assert CAPPED.constants.linear_pressure == pytest.approx(0.883, abs=5e-4)


def test_blocks_may_start_as_deep_as_ten_megapascal():
    """An exponential presses with 10 MPa at 8.8 µm; capped, it ends at 6.6 µm."""
    deepest = ExponentialLaw().largest_initial_overclosure
    assert ExponentialLaw().pressure(deepest) == pytest.approx(10.0, rel=1e-12)
    assert CAPPED.largest_initial_overclosure == CAPPED.constants.linear_start
    assert LinearPenalty(800.0).largest_initial_overclosure == 1e-3


def test_pressure_at_zero_clearance_is_the_datum():
    law = ExponentialLaw(2e-3, 7e-4)
    # One rounding in each of X, expm1, the product and p_c0/(e - 1).
    assert law.pressure(0.0) == pytest.approx(7e-4, rel=8e-16)
    assert law.pressure(-2e-3) == 0.0
    assert law.stiffness(-2e-3) == 0.0


@pytest.mark.parametrize("law", LAWS, ids=IDS)
def test_stiffness_is_the_slope_and_pressure_the_slope_of_energy(law):
    """Central differences of step d err by d²/6 f''' / f' and by round-off eps x f / (d f')."""
    x = sample(law)
    d = 1e-4 * law.constants.length if isinstance(law, ExponentialLaw) else 1e-4
    slope = (law.pressure(x + d) - law.pressure(x - d)) / (2 * d)
    work = (law.stored_energy(x + d) - law.stored_energy(x - d)) / (2 * d)
    # With X > 0.1: f'''/f' <= 2/(X c0)² = 200/c0², so 1e-8/6 · 200 = 3.3e-7; round-off of x ± d
    # is eps |x|/d <= 7e-11. Below, the values are checked by the integral test.
    c = law.constants
    clear = (x - c.start > 0.1 * c.length) | (x > c.linear_start)
    assert np.allclose(slope[clear], law.stiffness(x)[clear], rtol=5e-7, atol=0)
    assert np.allclose(work[clear], law.pressure(x)[clear], rtol=5e-7, atol=0)
    assert clear.sum() >= 4
    assert (law.pressure(x[:3]) == 0).all()
    assert (law.stored_energy(x[:3]) == 0).all()


@pytest.mark.parametrize("law", LAWS, ids=IDS)
def test_overclosure_inverts_pressure(law):
    pressure = np.geomspace(1e-12, 1e3, 61)
    # p = s X (eˣ - 1): a relative error e of X changes p by (1 + X eˣ/(eˣ-1)) e <= 25 e, and X
    # is (x - x_start)/c0 with one rounding of x: eps (|x| + c0)/(c0 X); X >= 1e-4 at p = 1e-12.
    assert np.allclose(law.pressure(law.overclosure(pressure)), pressure, rtol=5e-12, atol=0)
    assert law.overclosure(0.0) == law.constants.start
    assert law.overclosure(-1.0) == law.constants.start


def test_the_cap_is_met_smoothly():
    law = CAPPED
    c = law.constants
    before, after = np.nextafter(c.linear_start, 0.0), c.linear_start
    # Neighbouring floats: the pressure may change by stiffness · spacing, the rest is rounding.
    for function in (law.pressure, law.stiffness, law.stored_energy):
        assert function(before) == pytest.approx(function(after), rel=1e-13)
    assert c.linear_stiffness == pytest.approx(1000.0, rel=1e-14)
    # Up to the cap the two laws are the same function.
    x = np.linspace(-2e-3, 0.999 * c.linear_start, 50)
    assert (law.pressure(x) == UNCAPPED.pressure(x)).all()


@pytest.mark.parametrize("law", LAWS, ids=IDS)
def test_no_overclosure_overflows(law):
    x = np.array([-np.inf, -1e308, -1.0, 0.0, 1e-300, 1e-3, 1.0, 1e3, 1e90, 1e300, 1e308, np.inf])
    with np.errstate(all="raise"):
        for values in (law.pressure(x), law.stiffness(x), law.stored_energy(x)):
            assert np.isfinite(values).all()
            assert (values >= 0).all()
        assert (np.diff(law.pressure(x)) >= 0).all()


def test_energy_of_small_exponents_keeps_its_digits():
    """Against the integral of the pressure by Gauss-Legendre of order 20 (exact to round-off)."""
    law = ExponentialLaw()
    nodes, weights = np.polynomial.legendre.leggauss(20)
    for top in (1e-6, 1e-3, 0.1, 0.49, 0.51, 2.0):
        half = 0.5 * top * 1e-3
        points = -1e-3 + half * (nodes + 1.0)
        integral = half * (weights @ law.pressure(points))
        # Points near the start carry the rounding of 1e-3 - x: eps / X relative.
        assert law.stored_energy(-1e-3 + 2 * half) == pytest.approx(
            integral, rel=1e-14 + 1e-15 / top, abs=0.0
        )


def test_shapes_are_kept():
    x = np.zeros((3, 4, 2))
    assert ExponentialLaw().pressure(x).shape == (3, 4, 2)
    assert ExponentialLaw().pressure(0.0).shape == ()
