"""Built-in scenes of round bodies on plane ones against Hertz, Cattaneo and Mindlin.

Closed forms are those of half-spaces at the *measured* force: with 1/E* = Σ (1 - ν²)/E,

    ball:      a = (3 F R / 4 E*)^(1/3),    p₀ = 3 F / 2π a²
    rollers:   a = (4 P R / π E*)^(1/2),    p₀ = 2 P / π a,     c = a (1 - Q/μP)^(1/2)

with p = p₀ √(1 - r²/a²): K. L. Johnson, *Contact Mechanics* (1985), sections 4.2 and 7.2. Measured
are integrals, for pressures at points carry the noise of chords that cross. With a / h elements
over the contact and k = 3 E*/h the law gives way by a share h/3a of the flattening, and chords that
cross press by up to 3h/4a of p₀.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from fem.answer.forces import reactions_of
from fem.state import State
from tests.support.answers import on_its_mesh
from validation import load_case

POISSON, RADIUS = 0.3, 50.0
STEEL, ALUMINIUM = 210e3, 70e3
THICKNESS = 0.5


def effective_modulus(young: Iterable[float]) -> float:
    """E* of two bodies [MPa]."""
    return 1.0 / sum((1.0 - POISSON**2) / e for e in young)


def check(
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    force: float,
    a: float,
    p0: float,
    moment: float,
    *,
    elements: int,
) -> None:
    """Distances, areas and pressures of points beside Hertz: radius, peak and the whole field.

    The radius is that of the second moment, a² / ``moment``, the peak that of a straight line of p²
    over r² within half the contact.
    """
    wide, high = bounds(elements)
    r, area, p = points
    assert math.sqrt(moment * float(area @ (p * r**2)) / force) == pytest.approx(a, rel=wide)
    inside = r < 0.5 * a
    line = np.polyfit(r[inside] ** 2, p[inside] ** 2, 1, w=np.sqrt(area[inside]))
    assert math.sqrt(float(line[1])) == pytest.approx(p0, rel=high)
    closed = p0 * np.sqrt(np.maximum(1.0 - (r / a) ** 2, 0.0))
    assert area @ (p - closed) ** 2 < high**2 * (area @ closed**2)


def solved(name: str, *settings: str) -> State:
    return on_its_mesh(load_case(name, list(settings))).details


def press(solution: State) -> float:
    """Force of the support that presses [N]."""
    return -float(reactions_of(solution)["press"]["force"][2])


def bounds(elements: int) -> tuple[float, float]:
    """Relative errors of the half width, and of the pressure."""
    return 1.0 / (3.0 * elements), 1.0 / (3.0 * elements) + 3.0 / (4.0 * elements)


def test_a_roller_presses_as_hertz_says() -> None:
    found = solved("hertz-roller", "fem.motion_steps=4")
    state, modulus = found.contact_state, effective_modulus((STEEL, ALUMINIUM))
    force = press(found) / THICKNESS
    a = math.sqrt(4.0 * force * RADIUS / (math.pi * modulus))
    area, p = state.point_areas / THICKNESS, state.point_pressures
    x = state.positions[:, 0] - float(area @ (p * state.positions[:, 0])) / force
    assert a == pytest.approx(2.0, rel=0.02)  # the mesh is made for it
    assert float(area @ p) == pytest.approx(force, rel=(a / RADIUS) ** 2)  # normals lean
    check((np.abs(x), area, p), float(area @ p), a, 2.0 * force / (math.pi * a), 4.0, elements=6)


def test_a_ball_presses_as_hertz_says() -> None:
    """A quarter, on fewer elements than the scene has."""
    words = ["mesh.elements=4", "contact.stiffness=3.5e5", "fem.motion_steps=3"]
    run = on_its_mesh(load_case("hertz-ball", words))
    found = run.details
    state, modulus = found.contact_state, effective_modulus((STEEL, ALUMINIUM))
    force = 4.0 * press(found)
    a = (0.75 * force * RADIUS / modulus) ** (1.0 / 3.0)
    area, p = 4.0 * state.point_areas, state.point_pressures
    r = np.linalg.norm(state.positions[:, :2], axis=1)
    assert float(area @ p) == pytest.approx(force, rel=1e-3)
    check((r, area, p), float(area @ p), a, 1.5 * force / (math.pi * a**2), 2.5, elements=4)
    # What touches is a quarter of Hertz' circle, whose radius is known to half an element: a / 8.
    touching = run.as_dict()["dimensions"]["contact_area"]
    assert touching == pytest.approx(0.25 * math.pi * a**2, rel=1.125**2 - 1.0)
    assert (
        float(state.areas.sum()) > 1.125**2 * 0.25 * math.pi * a**2
    )  # of facets that face another


def test_a_roller_pushed_aside_sticks_in_the_middle() -> None:
    """Slips and pressures of the facets tell traction, and where it sticks.

    Equal materials slip by nothing while they are pressed together, so a point carries the stick
    stiffness times its slip, up to μ p. The half width that sticks is c = a √(1 - Q/μP): from the
    second moment of the traction, (a² + c²)/4, and, to an element, from the points whose traction
    is below the limit.
    """
    found = solved("cattaneo-mindlin", "fem.motion_steps=4")
    state, friction = found.contact_state, found.whole.contact.friction
    assert friction is not None
    modulus, force = effective_modulus((STEEL, STEEL)), press(found) / THICKNESS
    push = float(reactions_of(found)["push"]["force"][0]) / THICKNESS
    a = math.sqrt(4.0 * force * RADIUS / (math.pi * modulus))
    ratio = push / (friction.coefficient * force)
    assert 0.3 < ratio < 0.7
    c = a * math.sqrt(1.0 - ratio)
    area, p = state.point_areas / THICKNESS, state.point_pressures
    slip = np.linalg.norm(state.point_slips, axis=1)
    limit = friction.coefficient * p
    traction = np.minimum(friction.stick_stiffness * slip, limit)
    assert float(area @ traction) == pytest.approx(push, rel=1e-2)
    x = state.positions[:, 0]
    x = x - float(area @ (traction * x)) / push
    spread = float(area @ (traction * x**2)) / push
    wide, high = bounds(6)
    assert math.sqrt(4.0 * spread - a**2) == pytest.approx(c, rel=high)
    sticks = np.abs(x[(traction < limit) & (p > 0.0)])
    assert sticks.max() == pytest.approx(c, abs=2.0 / 6.0 + wide * a)
