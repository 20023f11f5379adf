"""Friction in the static problem: more rows of the same kind as the contact points.

The slip of a point along two tangents is linear in the displacement, like its overclosure; the
friction traction stands for the pressure. The sliding limit mu p is that of the last pressures,
which follows from iteration to iteration (its feedback is of order mu). Within one load step the
anchors are those of the step's start; at its end they move.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from fem.assembly.local_system import LocalSystem
from fem.contact.friction import CoulombFriction, friction_tractions
from fem.static.linear_step.linearisation import Linearisation
from geometry.mesh import FloatArray

#: Stiffness along the sliding direction relative to sticking: the law has none, and with none
#: the constant traction would be lost from the linear problem.
_SLIDING = 1e-6


@dataclass(frozen=True)
class FrictionRows:
    """Slip of every contact point of a system."""

    system: LocalSystem
    """Blocks and facets."""
    friction: CoulombFriction
    """The law."""
    tangents: FloatArray
    """Orthonormal reference tangents, (n_facets, n_points, 2, 3), world axes."""
    gradient: FloatArray
    """∂(slip)/∂u in block frames, (n_facets, 2 n_points, nodes of both facets, 3)."""

    def slip(self, displacement: FloatArray) -> FloatArray:
        """Slip along the tangents, (n_facets, n_points, 2) [mm]."""
        slip = self.system.gather(self.gradient, displacement)
        return slip.reshape(*self.tangents.shape[:3])

    def linearise(
        self,
        displacement: FloatArray,
        anchor: FloatArray,
        pressure: FloatArray,
        stiffness: FloatArray | None = None,
    ) -> Linearisation:
        """Tangent of the tractions along the sliding direction and across it.

        Parameters
        ----------
        displacement
            (n_nodes, 3) [mm].
        anchor
            (n_facets, n_points, 2) [mm].
        pressure
            What limits friction, (n_facets, n_points) [MPa].
        stiffness
            Its slope by the overclosure [MPa/mm], which the limit follows; None: it is frozen.
        """
        slip = self.slip(displacement)
        traction, moved = friction_tractions(self.friction, slip, anchor, pressure)
        stick = self.friction.stick_stiffness
        size = np.linalg.norm(slip - anchor, axis=2)
        length = np.maximum(size, np.finfo(np.float64).tiny)
        along = np.where((size > 0.0)[:, :, None], (slip - anchor) / length[:, :, None], [1.0, 0.0])
        across = np.stack([-along[:, :, 1], along[:, :, 0]], axis=2)
        slides = (moved != anchor).any(axis=2)
        pressed = pressure > 0.0
        stiff_along = stick * np.where(slides, _SLIDING, 1.0) * pressed
        secant = np.linalg.norm(traction, axis=2) / length
        stiff_across = np.where(slides, secant, stick) * pressed
        turn = np.stack([along, across], axis=2)
        gradient = np.einsum("fpki,fpiax->fpkax", turn, self._by_tangent())
        at = np.einsum("fpki,fpi->fpk", turn, slip)
        rows = self.gradient.shape[:2]
        coupling = None
        if stiffness is not None:
            follows = np.where(slides, self.friction.coefficient * stiffness, 0.0)
            coupling = np.stack([follows, np.zeros_like(follows)], axis=2).reshape(rows)
        return Linearisation(
            weights=np.repeat(self.system.surfaces.weights, 2, axis=1),
            gradient=gradient.reshape(self.gradient.shape),
            constant=np.zeros(rows),
            at=at.reshape(rows),
            pressure=np.einsum("fpki,fpi->fpk", turn, traction).reshape(rows),
            stiffness=np.stack([stiff_along, stiff_across], axis=2).reshape(rows),
            coupling=coupling,
        )

    def _by_tangent(self) -> FloatArray:
        return self.gradient.reshape(*self.tangents.shape[:3], *self.gradient.shape[2:])

    def forces(
        self, displacement: FloatArray, anchor: FloatArray, pressure: FloatArray
    ) -> FloatArray:
        """Nodal forces of the friction, (n_nodes, 3) [N]."""
        traction, _ = friction_tractions(self.friction, self.slip(displacement), anchor, pressure)
        weighted = self.system.surfaces.weights[:, :, None] * traction
        return self.system.scatter(self.gradient, weighted.reshape(self.gradient.shape[:2]))


def friction_rows(system: LocalSystem, friction: CoulombFriction) -> FrictionRows:
    """Slips of all contact points of a system."""
    surfaces = system.surfaces
    first = surfaces.tangents[:, :, 0]
    first = first / np.linalg.norm(first, axis=2, keepdims=True)
    tangents = np.stack([first, np.cross(surfaces.normals, first)], axis=2)
    world = np.einsum("fpa,fpki->fpkai", surfaces.difference, tangents)
    world = world.reshape(len(tangents), -1, *world.shape[3:])
    return FrictionRows(system, friction, tangents, system.local_gradient(world))


def joined(normal: Linearisation, tangential: Linearisation) -> Linearisation:
    """Both kinds of rows in one linear problem."""
    names = (f.name for f in fields(normal) if f.name not in {"load_factor", "coupling"})
    both: dict[str, Any] = {
        name: np.concatenate([getattr(normal, name), getattr(tangential, name)], axis=1)
        for name in names
    }
    return replace(normal, coupling=tangential.coupling, **both)
