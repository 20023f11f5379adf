"""Robustness cases of the contact law, by itself and between deformable blocks."""

from __future__ import annotations

import math

import numpy as np

from fem.contact.law import ContactLaw, ExponentialLaw
from fem.contact.surfaces import ContactError
from fem.static.solve import StaticOptions, static_state
from validation.stability.case import CaseVerdict, case, case_verdict, rejected
from validation.stability.problems import (
    BRICK,
    COLUMN,
    deformable,
    pressed,
    relative_difference,
    stack,
)

#: The usual law a hundred times stiffer.
STIFF_LAW = ExponentialLaw(1e-5, 1e-4, maximum_stiffness=1e5)
#: Newton's bound on the residual: then pressures of a column are exact to about as much.
TOLERANCE = 1e-10


def pressed_column(pressure: float, law: ContactLaw | None = None) -> CaseVerdict:
    """Two bricks and a third on a fixed one, pressed from above [MPa].

    Every joint carries the pressure; the top sinks by the bricks' and the joints' shares.
    """
    law, assembly = ExponentialLaw() if law is None else law, stack(2)
    # What double precision can reach: the overclosure moves bricks rigidly; K u of that motion
    # cancels to eps E ℓ u, some hundred terms of it, which is compared with a load of p ℓ².
    u = float(np.abs(law.overclosure(pressure))) + 1e-3
    noise = 100 * float(np.finfo(np.float64).eps) * COLUMN.young_modulus * BRICK[0] * u
    reachable = max(TOLERANCE, noise / (pressure * BRICK[0] * BRICK[1]))
    stated = deformable(assembly, pressed(assembly, pressure), law=law)
    result = static_state(stated, StaticOptions(tolerance=reachable, symmetry=1))
    n_bricks = n_joints = assembly.n_blocks - 1
    sunk = pressure * n_bricks * BRICK[2] / COLUMN.young_modulus
    sunk += n_joints * float(law.overclosure(pressure))
    top = -float(result.displacements[0][-1, :, 2].min())
    # The imbalance of a joint's four points is at most the norm of all imbalances, twice the
    # residual where few points carry it.
    off, bound = relative_difference(result.pressures, np.array(pressure)), max(1e-6, 2 * reachable)
    return case_verdict(
        ("residual", result.evidence.residual, reachable),
        ("joint pressures against the load", off, bound),
        ("top against the closed form", relative_difference(top, sunk), 1e-6),
    )


@case("pressure-1e-8")
def low_pressure() -> CaseVerdict:
    """Contact pressure of 1e-8 MPa: a pressed column has its closed form."""
    return pressed_column(1e-8)


@case("pressure-1e3")
def high_pressure() -> CaseVerdict:
    """Contact pressure of 1e3 MPa: a pressed column has its closed form."""
    return pressed_column(1e3)


@case()
def law_100_times_stiffer() -> CaseVerdict:
    """Law a hundred times stiffer (c0/100, cap × 100): a pressed column has its closed form."""
    return pressed_column(0.01, STIFF_LAW)


@case()
def law_inverse() -> CaseVerdict:
    """Law and inverse from 1e-8 to 1e3 MPa: round trip; slope is dp/dx."""
    law = ExponentialLaw(maximum_stiffness=math.inf)
    pressure = np.logspace(-8, 3, 100)
    overclosure = law.overclosure(pressure)
    step = 1e-6 * law.clearance_at_zero_pressure
    slope = (law.pressure(overclosure + step) - law.pressure(overclosure - step)) / (2 * step)
    # Central differences: (step/c0)² ≈ 1e-12 by truncation, eps c0/step ≈ 2e-10 by round-off,
    # a hundred times that where the overclosure is 1e-2 of c0.
    back = float(np.abs(law.pressure(overclosure) / pressure - 1.0).max())
    off = float(np.abs(law.stiffness(overclosure) / slope - 1.0).max())
    return case_verdict(("round trip", back, 1e-10), ("slope", off, 1e-5))


@case("overclosure-1-mm")
def overclosed() -> CaseVerdict:
    """Blocks 1 mm inside each other at the start: rejected, pair named."""
    assembly = stack(2)
    load, words = pressed(assembly, 0.01), ("overlap at the start", "between blocks")
    return rejected(lambda: deformable(assembly, load, clearance=-1.0), ContactError, *words)
