"""Friction in the static problem: more rows of the same kind as the contact points.

The slip of a point along two tangents is linear in the displacement, like its overclosure; the
friction traction stands for the pressure. A sliding point has no stiffness along its slip; its
traction mu p follows the pressure within the linear problem, so the force of one unit of pressure
leans by mu (`Linearisation.push`). Within one load step the anchors are those of the step's start;
at its end they move.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from fem.assembly.local_system import LocalSystem
from fem.contact.friction import CoulombFriction, friction_tractions
from fem.static.linear_step.linearisation import Linearisation
from geometry.mesh import FloatArray


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
    coefficient: float | FloatArray
    """μ of all points, or of those of each facet, (n_facets, 1) [-]."""

    def tractions(
        self, slip: FloatArray, anchor: FloatArray, pressure: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Tractions [MPa] and new anchors [mm] at slips and pressures: `friction_tractions`."""
        return friction_tractions(self.friction, slip, anchor, pressure, self.coefficient)

    def slip(self, displacement: FloatArray) -> FloatArray:
        """Slip along the tangents, (n_facets, n_points, 2) [mm]."""
        slip = self.system.gather(self.gradient, displacement)
        return slip.reshape(*self.tangents.shape[:3])

    def linearise(
        self, normal: Linearisation, slip: FloatArray, anchor: FloatArray
    ) -> Linearisation:
        """Join the tangent of the tractions, along the slip and across it, to that of the law.

        Parameters
        ----------
        normal
            Of the law: its pressures limit friction.
        slip, anchor
            (n_facets, n_points, 2) [mm].
        """
        pressure, stick = normal.pressure, self.friction.stick_stiffness
        traction, moved = self.tractions(slip, anchor, pressure)
        size = np.linalg.norm(slip - anchor, axis=2)
        length = np.maximum(size, np.finfo(np.float64).tiny)
        along = np.where((size > 0.0)[:, :, None], (slip - anchor) / length[:, :, None], [1.0, 0.0])
        across = np.stack([-along[:, :, 1], along[:, :, 0]], axis=2)
        slides, pressed = (moved != anchor).any(axis=2), pressure > 0.0
        stiff_along = np.where(slides, 0.0, stick) * pressed
        secant = np.linalg.norm(traction, axis=2) / length
        stiff_across = np.where(slides, secant, stick) * pressed
        turn = np.stack([along, across], axis=2)
        by_tangent = self.gradient.reshape(*self.tangents.shape[:3], *self.gradient.shape[2:])
        gradient = np.einsum("fpki,fpiax->fpkax", turn, by_tangent)
        leans = np.where(slides & pressed, self.coefficient, 0.0)
        push = normal.gradient + leans[:, :, None, None] * gradient[:, :, 0]
        rows = self.gradient.shape[:2]
        gradient = gradient.reshape(self.gradient.shape)
        tangential = replace(
            normal,
            weights=np.repeat(normal.weights, 2, axis=1),
            gradient=gradient,
            constant=np.zeros(rows),
            at=np.einsum("fpki,fpi->fpk", turn, slip).reshape(rows),
            pressure=np.einsum(
                "fpki,fpi->fpk", turn, np.where(slides[:, :, None], 0.0, traction)
            ).reshape(rows),
            stiffness=np.stack([stiff_along, stiff_across], axis=2).reshape(rows),
        )
        return replace(
            _joined(normal, tangential),
            push=np.concatenate([push, gradient], axis=1) if leans.any() else None,
        )

    def softened(self, share: float) -> FrictionRows:
        """The same with a share of the stick stiffness."""
        stick = share * self.friction.stick_stiffness
        return replace(self, friction=replace(self.friction, stick_stiffness=stick))

    def with_traction_of(
        self,
        slip: FloatArray,
        anchor: FloatArray,
        pressure: FloatArray,
        other: FrictionRows,
        own: FloatArray,
    ) -> FloatArray:
        """Slips, (n, p, 2) [mm], at which points that stick have their tractions by other rows.

        Slips, anchors and ``own`` anchors of the other rows are (n_facets, n_points, 2) [mm],
        pressures (n_facets, n_points) [MPa].
        """
        traction, moved = self.tractions(slip, anchor, pressure)
        sticks = (moved == anchor).all(axis=2, keepdims=True)
        return np.where(sticks, own + traction / other.friction.stick_stiffness, slip)

    def next_slip(
        self, slip: FloatArray, at: FloatArray, anchor: FloatArray, pressure: FloatArray
    ) -> FloatArray:
        """Slip at which friction is linearised after a full step to ``slip``, (n, p, 2) [mm].

        Stick is so stiff that a point whose slip turns back passes through all of it in one step:
        there it sticks first, and the step after shows whether it slides, and where to.

        Parameters
        ----------
        slip, at, anchor
            After the step, where friction was linearised, and the anchor, (n_facets, n_points, 2)
            [mm].
        pressure
            At which it was linearised, (n_facets, n_points) [MPa].
        """
        _, moved = self.tractions(at, anchor, pressure)
        slid = (moved != anchor).any(axis=2)
        back = ((slip - anchor) * (at - anchor)).sum(axis=2) < 0.0
        return np.where((slid & back)[:, :, None], anchor, slip)

    def on_block_s(
        self, displacement: FloatArray, anchor: FloatArray, pressure: FloatArray
    ) -> FloatArray:
        """Friction on block s in world axes, (n_facets, n_points, 3) [MPa]."""
        traction, _ = self.tractions(self.slip(displacement), anchor, pressure)
        return -np.einsum("fpk,fpki->fpi", traction, self.tangents)

    def forces(
        self, displacement: FloatArray, anchor: FloatArray, pressure: FloatArray
    ) -> FloatArray:
        """Nodal forces of the friction, (n_nodes, 3) [N]."""
        traction, _ = self.tractions(self.slip(displacement), anchor, pressure)
        weighted = self.system.surfaces.weights[:, :, None] * traction
        return self.system.scatter(self.gradient, weighted.reshape(self.gradient.shape[:2]))


def friction_rows(system: LocalSystem, friction: CoulombFriction) -> FrictionRows:
    """Slips of all contact points of a system."""
    surfaces = system.surfaces
    first = surfaces.tangents[:, :, 0]
    first = first / np.linalg.norm(first, axis=2, keepdims=True)
    tangents = np.stack([first, np.cross(surfaces.normals, first)], axis=2)
    world = np.einsum("fpa,fpki->fpkai", surfaces.difference, tangents)
    # Without points, too: a load may have opened all contacts.
    world = world.reshape(len(world), world.shape[1] * world.shape[2], *world.shape[3:])
    result = friction.on(surfaces.block_m, surfaces.block_s)
    coefficient = result if isinstance(result, float | int) else result[:, None]
    return FrictionRows(system, friction, tangents, system.local_gradient(world), coefficient)


def _joined(normal: Linearisation, tangential: Linearisation) -> Linearisation:
    """Both kinds of rows in one linear problem."""
    names = (f.name for f in fields(normal) if f.name not in {"load_factor", "push", "time"})
    both: dict[str, Any] = {
        name: np.concatenate([getattr(normal, name), getattr(tangential, name)], axis=1)
        for name in names
    }
    return replace(normal, **both)
