"""Arches and domes beside linear programs of lunes and voussoirs that use nothing of ours."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.families.masonry import CircularArch
from geometry.polyhedra.assembly import PolyhedralAssembly
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.limits.collapse import collapse_load
from tests.support.dome import hemisphere
from tests.support.limit_programs import arch, least, lune, sideways, stands
from tests.verification.closed_forms import body_force

DOWN, ASIDE = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
#: Thickness beside the least one at which an answer must be the other.
BESIDE = 2e-3


def carried(assembly: PolyhedralAssembly, friction: float) -> bool:
    bearing = assembly.bearing()
    contacts = frictional_contacts(bearing, contact_jacobian(bearing), friction)
    found = frictional_equilibrium(contacts, body_force(bearing, DOWN))
    assert found.holds or found.mechanism is not None
    return found.holds


def own_arch(thickness: float, voussoirs: int, pieces: int = 1, **more: float):
    return CircularArch(1000.0, 1000.0 * thickness, 300.0, voussoirs, **more).build(pieces=pieces)


@pytest.mark.quick
@pytest.mark.parametrize(("voussoirs", "pieces", "printed"), [(60, 16, 0.10746), (11, 1, 0.10459)])
def test_the_least_thickness_of_a_semicircle(voussoirs: int, pieces: int, printed: float) -> None:
    limit = least(lambda t: stands(arch(t, voussoirs, pieces=pieces), 5.0), 0.05, 0.3)
    assert limit == pytest.approx(printed, abs=6e-6)
    assert carried(own_arch((1.0 + BESIDE) * limit, voussoirs, pieces), 5.0)
    assert not carried(own_arch((1.0 - BESIDE) * limit, voussoirs, pieces), 5.0)


@pytest.mark.quick
@pytest.mark.parametrize(("friction", "printed"), [(0.39, 0.1122), (0.35, 0.1518), (0.31, 0.1976)])
def test_the_least_thickness_where_voussoirs_slide(friction: float, printed: float) -> None:
    """Sliding with turning: printed for joints anywhere, here at every third degree."""
    limit = least(lambda t: stands(arch(t, 60), friction), 0.05, 0.3)
    assert limit == pytest.approx(printed, rel=1e-3)
    assert carried(own_arch((1.0 + BESIDE) * limit, 60), friction)
    assert not carried(own_arch((1.0 - BESIDE) * limit, 60), friction)


@pytest.mark.quick
def test_no_semicircle_stands_where_friction_is_too_small() -> None:
    assert np.isnan(least(lambda t: stands(arch(t, 60), 0.305), 0.05, 0.9))
    assert not carried(own_arch(0.3, 60), 0.305)
    assert not carried(own_arch(0.9, 60), 0.305)


@pytest.mark.quick
def test_the_acceleration_that_oppenheim_s_arch_carries() -> None:
    """Seven voussoirs over 157.5°, 0.15 R thick: 0.370 g (Oppenheim 1992)."""
    limit = sideways(arch(0.15, 7, embrace=157.5, pieces=16), 5.0)
    assert limit == pytest.approx(0.370, abs=5e-4)
    ours = own_arch(0.15, 7, 16, embrace=157.5)
    contacts = frictional_contacts(ours, contact_jacobian(ours), 5.0)
    found = collapse_load(contacts, body_force(ours, DOWN), body_force(ours, ASIDE))
    assert found.certified
    assert found.factor == pytest.approx(limit, rel=1e-6)


def test_the_least_thickness_of_a_hemisphere_is_that_of_its_lunes() -> None:
    """Hoops press the lunes against each other. Corners where four voussoirs meet would tie them:
    by those the dome stands at 0.6 of this thickness. Faces are flat; with curved ones the lune
    has 0.042 (Heyman 1967)."""
    limit = least(lambda t: stands(lune(t, 16, 18), 0.25), 0.03, 0.06)
    assert limit == pytest.approx(0.0426, abs=2e-4)
    assert carried(hemisphere((1.0 + BESIDE) * limit, 16, 18), 0.25)
    assert not carried(hemisphere((1.0 - BESIDE) * limit, 16, 18), 0.25)
