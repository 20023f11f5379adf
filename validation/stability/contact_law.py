"""Robustness cases of the contact law, by itself and between deformable blocks."""

from __future__ import annotations

import math

import numpy as np

from fem.contact.law import ContactLaw, ExponentialLaw
from fem.contact.surfaces import ContactError
from fem.state import State
from fem.static.solve import StaticOptions, solve_static
from validation.stability.case import Cases, Check, Finding, refusal
from validation.stability.problems import BRICK, COLUMN, deformable, pressed, relative, stack

CASES = Cases("contact-law")

#: Newton's bound on the residual: then pressures of a column are exact to about as much.
TOLERANCE = 1e-10


def reachable(pressure: float, law: ContactLaw) -> float:
    """Relative residual that double precision can reach in a pressed column [-].

    The overclosure moves bricks rigidly; K u of that motion cancels to eps E ℓ u, some hundred
    terms of it, which is compared with a load of p ℓ².
    """
    u = float(np.abs(law.overclosure(pressure))) + 1e-3
    noise = 100 * float(np.finfo(np.float64).eps) * COLUMN.young_modulus * BRICK[0] * u
    return max(TOLERANCE, noise / (pressure * BRICK[0] * BRICK[1]))


def solved_column(pressure: float, law: ContactLaw | None = None) -> State:
    """Static state of two bricks and a third on a fixed one, pressed from above [MPa]."""
    assembly = stack(2)
    law = ExponentialLaw() if law is None else law
    stated = deformable(assembly, pressed(assembly, pressure), law=law)
    return solve_static(stated, StaticOptions(tolerance=reachable(pressure, law), symmetry=1))


def column_checks(result: State, pressure: float, law: ContactLaw) -> tuple[Check, ...]:
    """Every joint carries the pressure; the top sinks by the bricks' and the joints' shares."""
    n_bricks = n_joints = result.deformable.assembly.n_blocks - 1
    sunk = pressure * n_bricks * BRICK[2] / COLUMN.young_modulus
    sunk += n_joints * float(law.overclosure(pressure))
    # The imbalance of a joint's four points is at most the norm of all imbalances, twice the
    # residual where few points carry it.
    bound = max(1e-6, 2 * reachable(pressure, law))
    top = -float(result.displacements[0][-1, :, 2].min())
    return (
        Check("residual", result.evidence.residual, reachable(pressure, law)),
        Check(
            "joint pressures against the load",
            relative(result.pressures, np.array(pressure)),
            bound,
        ),
        Check("top against the closed form", relative(top, sunk), 1e-6),
    )


def pressed_column(pressure: float, law: ContactLaw | None = None) -> Finding:
    """What a pressed column shows of a law."""
    law = ExponentialLaw() if law is None else law
    result = solved_column(pressure, law)
    return Finding(*column_checks(result, pressure, law))


COLUMN_LAW = "joint pressures and sinking of a pressed column are those of the closed form"


CASES.case("pressure-1e-8", f"Contact pressure of 1e-8 MPa: {COLUMN_LAW}", pressed_column, 1e-8)
CASES.case("pressure-1e3", f"Contact pressure of 1e3 MPa: {COLUMN_LAW}", pressed_column, 1e3)
CASES.case(
    "law-100-times-stiffer",
    f"Law a hundred times stiffer (c0/100, cap × 100): {COLUMN_LAW}",
    pressed_column,
    0.01,
    ExponentialLaw(1e-5, 1e-4, maximum_stiffness=1e5),
)


@CASES.add("law-inverse", "Law and inverse from 1e-8 to 1e3 MPa: round trip; slope is dp/dx")
def _inverse() -> Finding:
    law = ExponentialLaw(maximum_stiffness=math.inf)
    pressure = np.logspace(-8, 3, 100)
    overclosure = law.overclosure(pressure)
    step = 1e-6 * law.clearance_at_zero_pressure
    slope = (law.pressure(overclosure + step) - law.pressure(overclosure - step)) / (2 * step)
    # Central differences: (step/c0)² ≈ 1e-12 by truncation, eps c0/step ≈ 2e-10 by round-off,
    # a hundred times that where the overclosure is 1e-2 of c0.
    back = float(np.abs(law.pressure(overclosure) / pressure - 1.0).max())
    off = float(np.abs(law.stiffness(overclosure) / slope - 1.0).max())
    return Finding(Check("round trip", back, 1e-10), Check("slope", off, 1e-5))


@CASES.add("overclosure-1-mm", "Blocks 1 mm inside each other at the start: rejected, pair named")
def _overclosed() -> Finding:
    assembly = stack(2)
    load = pressed(assembly, 0.01)
    return refusal(
        lambda: deformable(assembly, load, clearance=-1.0),
        ContactError,
        "overlap at the start",
        "between blocks",
    )
