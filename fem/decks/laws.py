"""Contact laws in the words of decks: written for Abaqus, as a table for CalculiX.

Reference: Abaqus Analysis User's Guide, "Contact pressure-overclosure relationships".
"""

from __future__ import annotations

from math import isfinite

import numpy as np

from fem.contact.law import ContactLaw, ExponentialLaw, LinearPenalty
from fem.contact.own_law import TabularLaw
from fem.decks.keywords import DeckError, real, reals
from geometry.mesh import FloatArray

#: Points of a table that CalculiX reads with NODE TO SURFACE.
TABLE_POINTS = 200

#: A table of the exponential law goes on linearly from this pressure at the latest [MPa].
LAST_PRESSURE = 10.0

#: Overclosure of the last point of a table [mm]: CalculiX holds the pressure beyond.
_FAR = 1.0e3


def law_lines(law: ContactLaw, *, explicit: bool) -> tuple[str, str]:
    """Keyword and data of a law for Abaqus."""
    if isinstance(law, LinearPenalty):
        return "*Surface Behavior, pressure-overclosure=LINEAR", f"{real(law.stiffness_per_area)},"
    if not isinstance(law, ExponentialLaw):
        raise no_lines_for(law)
    values = [law.clearance_at_zero_pressure, law.pressure_at_zero_clearance]
    if explicit and isfinite(law.maximum_stiffness):
        # Abaqus/Standard has no third value; the heading keeps it.
        values.append(law.maximum_stiffness)
    return "*Surface Behavior, pressure-overclosure=EXPONENTIAL", reals(values)


def no_lines_for(law: ContactLaw) -> DeckError:
    """Refusal of a law that a deck cannot state: another one would be exported in its place."""
    return DeckError(
        f"contact.law: got {law.name!r}, which decks have no lines for; expected "
        f"{ExponentialLaw.name!r} or {LinearPenalty.name!r}, for CalculiX also a table"
    )


def _require_lines(law: ContactLaw) -> None:
    """Reject a law that no program has lines for."""
    for one in law.members:
        if not isinstance(one, ExponentialLaw | LinearPenalty | TabularLaw):
            raise no_lines_for(one)


def law_heading(law: ContactLaw) -> str | None:
    """What of a law no data line says in every step, for the heading; None where there is none.

    Raises
    ------
    DeckError
        Pairs with laws of several maximum stiffnesses: a heading has one.
    """
    _require_lines(law)
    caps = {one.maximum_stiffness for one in law.members if isinstance(one, ExponentialLaw)}
    if len(caps) > 1:
        raise DeckError(
            "contact.pairs.maximum_stiffness: got "
            f"{' and '.join(f'{cap:g}' for cap in sorted(caps))} MPa/mm (inf: none); the heading "
            "of a deck has one for all exponential laws: expected the same"
        )
    for cap in caps:
        return f"maximum contact stiffness: {real(cap) if isfinite(cap) else 'none'}"
    return None


def law_notes(law: ContactLaw, *, static: bool) -> list[str]:
    """Where Abaqus takes another law than the one that a scene states; a table is the law itself.

    Abaqus/Explicit has a maximum stiffness where the law has none, Abaqus/Standard none.
    """
    _require_lines(law)
    caps = (one.maximum_stiffness for one in law.members if isinstance(one, ExponentialLaw))
    if not any(isfinite(cap) is static for cap in caps):
        return []
    if static:
        return ["contact: Abaqus/Standard has no maximum stiffness; it is in the heading only"]
    return [
        "contact: the law has no maximum stiffness; Abaqus/Explicit takes one of its own where "
        "penalty contact is given none: contact.maximum_stiffness defines one for both"
    ]


def law_table(law: ContactLaw, clearance: float = 0.0) -> FloatArray:
    """Pressure and overclosure of a contact law as a table for CalculiX, (n <= 200, 2).

    A clearance along every normal [mm] is said here: surfaces press on each other from there on.

    Linear between the points: with the paper's constants pressures between 0.001 and 10 MPa
    differ by less than 0.07 %. The last point lies far outside any overclosure, on the law's
    linear end or on its tangent at 10 MPa.
    """
    overclosure = np.zeros(1)
    if isinstance(law, TabularLaw):
        overclosure = law.table[:, 0]
    else:
        _require_lines(law)
    if isinstance(law, ExponentialLaw):
        c0 = law.clearance_at_zero_pressure
        end = min(law.constants.linear_start, float(law.overclosure(LAST_PRESSURE))) / c0 + 1.0
        overclosure = c0 * (np.linspace(0.0, end, TABLE_POINTS - 1) - 1.0)
    pressure = law.pressure(overclosure)
    slope = float(law.stiffness(overclosure[-1:] + 1e-9)[0])
    table = np.column_stack([pressure, overclosure])
    if overclosure[-1] < _FAR:  # a table that was read may go so far
        table = np.vstack([table, [pressure[-1] + slope * (_FAR - overclosure[-1]), _FAR]])
    table[:, 1] += clearance
    return table
