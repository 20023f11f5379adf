"""Cases that change nothing but the point of view: far away, turned, in metres, renumbered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.families.masonry import circular_arch, running_bond_wall
from geometry.families.platonic_layers import octahedra_layer, tetrahedra_layer
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.polyhedron import Polyhedron
from mbd import classify, contact_jacobian
from mbd.friction import frictional_contacts, frictional_equilibrium
from validation.stability.case import Cases, Check, Finding

CASES = Cases("invariance")

_FRICTION = 0.6
#: Specific weight [N/mm³] of the assemblies in millimetres.
_WEIGHT = 2.4e-9 * 9810.0


@dataclass(frozen=True)
class _View:
    """x becomes scale · turn · x + offset; blocks in another order."""

    name: str
    offset: float = 0.0
    angle: float = 0.0
    scale: float = 1.0
    reverse: bool = False


_VIEWS = (
    _View("1e6 mm away", offset=1e6),
    _View("turned", angle=0.7),
    _View("in metres", scale=1e-3),
    _View("renumbered", reverse=True),
    _View("all at once", offset=1e6, angle=0.7, scale=1e-3, reverse=True),
)


@dataclass(frozen=True)
class _Answer:
    mechanism: str
    carried: bool
    forces: FloatArray
    """Size of the contact force on each free block's joints, by block; (n_blocks,) [N]."""


def _seen(assembly: PolyhedralAssembly, view: _View) -> tuple[PolyhedralAssembly, FloatArray]:
    """Assembly from another point of view, and the direction that is downward there."""
    turn = Rotation.from_rotvec(view.angle * np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)).as_matrix()
    order = np.arange(assembly.n_blocks)
    order = order[::-1] if view.reverse else order
    shift = view.scale * view.offset * np.array([1.0, -1.0, 1.0])
    blocks = []
    for b in order:
        shape = assembly.shape(int(b))
        own = Polyhedron(shape.name, view.scale * shape.points, shape.triangles)
        place = view.scale * turn @ assembly.translations[b] + shift
        blocks.append((own, turn @ assembly.rotations[b], place))
    seen = polyhedral_assembly(assembly.name, blocks, assembly.fixed[order])
    return seen, turn @ np.array([0.0, 0.0, -1.0])


def _answer(assembly: PolyhedralAssembly, down: FloatArray, view: _View) -> _Answer:
    contacts = contact_jacobian(assembly)
    weight = np.zeros((len(contacts.free_blocks), 6))
    mass = _WEIGHT / view.scale**3 * assembly.volumes[contacts.free_blocks]
    weight[:, :3] = mass[:, None] * down
    found = frictional_equilibrium(
        frictional_contacts(assembly, contacts, _FRICTION), weight.ravel()
    )
    size = np.linalg.norm(found.forces, axis=1)
    total = np.zeros(assembly.n_blocks)
    np.add.at(total, contacts.block_m, size)
    np.add.at(total, contacts.block_s, size)
    mechanism = classify(contacts.jacobian, weight.ravel()).mechanism
    return _Answer(str(mechanism), found.holds, total[::-1] if view.reverse else total)


def _same_from_everywhere(assembly: PolyhedralAssembly) -> Finding:
    """Class and verdict are the same, forces to what single steps of the way are rounded to.

    Corners 1e6 mm away are rounded to 1e-10 mm, 1e-12 of a block; the cone program is solved to
    1e-11 of the load; the forces are the smallest ones, which are unique.
    """
    here = _View("here")
    base = _answer(*_seen(assembly, here), here)
    checks = []
    for view in _VIEWS:
        found = _answer(*_seen(assembly, view), view)
        same = found.mechanism == base.mechanism and found.carried == base.carried
        checks.append(Check(f"{view.name}: same class and verdict", same, least=1))
        if base.carried and found.carried:
            apart = np.abs(found.forces - base.forces).max() / base.forces.max()
            checks.append(Check("forces apart", float(apart), 1e-7))
    return Finding(tuple(checks))


def _add(name: str, law: str, build: Callable[[], PolyhedralAssembly]) -> None:
    CASES.add(name, law)(lambda: _same_from_everywhere(build()))


_add(
    "view-arch",
    "An arch that stands by friction: far away, turned, in metres, renumbered: the same answer",
    lambda: circular_arch(1000.0, 200.0, 200.0, 7, embrace=140.0),
)
_add(
    "view-thin-arch",
    "An arch too thin to stand: the same from everywhere",
    lambda: circular_arch(1000.0, 100.0, 300.0, 16, pieces=1),
)
_add(
    "view-wall",
    "A wall in running bond, blocks that touch half and half: the same from everywhere",
    lambda: running_bond_wall((240.0, 115.0, 71.0), 3, 3),
)
_add(
    "view-tetrahedra",
    "Tetrahedra whose edges cross in points: locked from everywhere",
    lambda: tetrahedra_layer(100.0, 2, 2),
)
_add(
    "view-octahedra",
    "Octahedra on their faces: the same from everywhere",
    lambda: octahedra_layer(80.0, 1),
)
