"""Limit analysis that has closed forms.

- A block on an incline slides at atan μ.
- A prism in a groove of angle β tips out when gravity leans by β, with friction by β + atan μ.
- A semicircular arch stands without sliding down to t/R = 0.1075 (Milankovitch 1907; Couplet's
  problem in Heyman, "The safety of masonry arches", Int. J. Mech. Sci. 11 (1969), whose
  approximate thrust line gives 0.106).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geometry import (
    CircularArch,
    PolyhedralAssembly,
    Polyhedron,
    convex_polyhedron,
)
from geometry.families.masonry import box
from geometry.polyhedra.assembly import polyhedral_assembly
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import Equilibrium, frictional_equilibrium
from mbd.limits.collapse import collapse_load

#: Minimum thickness of a semicircular arch over its centre-line radius, four digits.
ARCH_LIMIT = 0.1075


def body_force(assembly: PolyhedralAssembly, direction: np.ndarray) -> np.ndarray:
    """Generalized force of unit specific weight along a direction, (6 n_free,)."""
    force = np.zeros((len(assembly.free_blocks), 6))
    force[:, :3] = assembly.volumes[assembly.free_blocks, None] * direction
    return force.ravel()


def tilt_limit(assembly: PolyhedralAssembly, friction: float) -> float:
    """Largest lean of gravity from -z towards +x that is carried [rad].

    Gravity leaning by φ is, up to a factor, -z plus tan φ times x: a collapse load.
    """
    contacts = frictional_contacts(assembly, contact_jacobian(assembly), friction)
    down, aside = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
    found = collapse_load(contacts, body_force(assembly, down), body_force(assembly, aside))
    return float(np.arctan(found.factor))


def incline() -> PolyhedralAssembly:
    """A flat block on a fixed plate [mm]."""
    plate, block = box((100.0, 100.0, 10.0)), box((20.0, 20.0, 4.0))
    places = [(plate, np.eye(3), np.zeros(3)), (block, np.eye(3), np.array([40.0, 40.0, 10.0]))]
    return polyhedral_assembly("incline", places, np.array([True, False]))


def groove(angle: float) -> PolyhedralAssembly:
    """A long prism in a fixed groove whose sides rise at an angle [rad]."""
    t, length = np.tan(angle), 400.0
    wedge = [(0.0, 0.0), (10.0, 10 * t), (-10.0, 10 * t)]
    side = [(0.0, 0.0), (40.0, 40 * t), (40.0, 40 * t - 60.0), (0.0, -60.0)]

    def prism(
        name: str, outline: list[tuple[float, float]], half: float, sign: float
    ) -> Polyhedron:
        return convex_polyhedron(
            name, [[sign * x, y, z] for x, z in outline for y in (-half, half)]
        )

    shapes = [
        prism("right", side, 2 * length, 1.0),
        prism("left", side, 2 * length, -1.0),
        prism("wedge", wedge, length, 1.0),
    ]
    blocks = [(shape, np.eye(3), np.zeros(3)) for shape in shapes]
    return polyhedral_assembly("groove", blocks, np.array([True, True, False]))


def arch_answer(ratio: float, voussoirs: int, friction: float = 1.0) -> Equilibrium:
    """Semicircular arch of radius 1 m under its weight: does it stand at t/R = ``ratio``."""
    arch = CircularArch(1000.0, 1000.0 * ratio, 300.0, voussoirs).build()
    contacts = frictional_contacts(arch, contact_jacobian(arch), friction)
    return frictional_equilibrium(contacts, body_force(arch, np.array([0.0, 0.0, -1.0])))


def bisect(holds: Callable[[float], bool], low: float, high: float, steps: int) -> float:
    """Where ``holds`` changes from false (low) to true (high)."""
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return 0.5 * (low + high)


def arch_limit(voussoirs: int, *, steps: int = 14) -> float:
    """Smallest t/R at which the semicircular arch stands without sliding."""
    return bisect(lambda ratio: arch_answer(ratio, voussoirs).holds, 0.09, 0.13, steps)
