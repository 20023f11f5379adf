"""Numbers of others: what the tests compare with ours.

- Walls W1, W2 and W3 of Ferris and Tin-Loi, "Limit analysis of frictional block assemblies as a
  mathematical program with complementarity constraints", Int. J. Mech. Sci. 43 (2001): bricks
  0.4 m × 0.175 m, μ = 0.65, their weight, and λ times their weight sideways. With dilation
  (associated) one linear program has one answer. Without (non-associated) the least λ is sought in
  a program with many local minima: a certified state below the printed number is a better minimum.
- A semicircular arch of 27 straight voussoirs, μ = 0.5: least thickness over radius that stands.
- A block on an incline of atan 0.5: stays with μ = 0.50, slides with 0.49.
"""

from __future__ import annotations

import numpy as np

from geometry import CircularArch, PolyhedralAssembly
from geometry.families.masonry import wall_of_rows
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.limits.collapse import collapse_load
from mbd.limits.plane import Reduced, reduced
from mbd.limits.sliding_collapse import SlidingCollapse, sliding_collapse
from tests.verification.closed_forms import bisect, body_force, incline

#: Friction of the walls.
WALL_FRICTION = 0.65
#: Brick of the walls: length, depth (any), height [mm].
BRICK = (400.0, 200.0, 175.0)

_WHOLE, _ENDS = (1, 1, 1, 1, 1), (0.5, 1, 1, 1, 1, 0.5)
_EVEN, _UNEVEN = (1, 1, 1, 1), (0.5, 1, 1, 1, 0.5)
_EVEN_OPEN, _UNEVEN_OPEN = (1, 0.5, -1, 0.5, 1), (0.5, 1, -1, 1, 0.5)
_WINDOW = (_UNEVEN_OPEN, _EVEN_OPEN, _UNEVEN_OPEN, _EVEN_OPEN, _UNEVEN_OPEN)

#: Rows from the bottom, widths in bricks, an opening negative.
WALLS: dict[str, tuple[tuple[float, ...], ...]] = {
    "W1": (_ENDS, _WHOLE) * 3,
    "W2": (_ENDS, _WHOLE) * 5,
    "W3": (_EVEN, _UNEVEN, _EVEN, *_WINDOW, _EVEN, _UNEVEN, _EVEN),
}
#: Printed factors with dilation and without, three digits.
PRINTED = {"W1": (0.643, 0.640), "W2": (0.580, 0.563), "W3": (0.404, 0.356)}

#: Least thickness over radius of the arch of 27 straight voussoirs.
ARCH_OF_27 = 0.106721

_DOWN, _ASIDE = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])


def wall(name: str) -> tuple[Reduced, PolyhedralAssembly]:
    """One of `WALLS` as a plane problem, and its blocks."""
    assembly = wall_of_rows(BRICK, WALLS[name])
    contacts = contact_jacobian(assembly)
    frictional = frictional_contacts(assembly, contacts, WALL_FRICTION)
    return reduced(assembly, contacts, frictional), assembly


def wall_factors(name: str) -> SlidingCollapse:
    """Collapse factors of a wall, with dilation (``associated``) and without (``factor``)."""
    problem, assembly = wall(name)
    dead, live = (body_force(assembly, way)[problem.rows] for way in (_DOWN, _ASIDE))
    return sliding_collapse(problem.contacts, dead, live)


def straight_arch_stands(ratio: float, *, friction: float = 0.5) -> bool:
    """Whether the arch of 27 straight voussoirs of thickness ``ratio`` R stands by itself."""
    arch = CircularArch(10_000.0, 10_000.0 * ratio, 1000.0, 27).build(pieces=1)
    contacts = frictional_contacts(arch, contact_jacobian(arch), friction)
    return frictional_equilibrium(contacts, body_force(arch, _DOWN)).holds


def straight_arch_limit(steps: int = 15) -> float:
    """Least thickness over radius of the arch of 27 straight voussoirs, to 0.01 / 2^steps."""
    return bisect(straight_arch_stands, 0.10, 0.11, steps)


def incline_slope(friction: float) -> float:
    """Steepest slope on which a block stays."""
    assembly = incline()
    contacts = frictional_contacts(assembly, contact_jacobian(assembly), friction)
    return collapse_load(contacts, body_force(assembly, _DOWN), body_force(assembly, _ASIDE)).factor
