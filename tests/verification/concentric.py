"""Two concentric shells that press on each other: closed forms of Lamé beside curved blocks.

Quarters of two thick rings under plane stress, and patches of two thick spherical shells between
four planes through the centre. Normals of the cuts are held, so each patch moves as the whole. The
joint is frictionless, and its pressure p is uniform: the overclosure that the contact law needs for
p is the interference plus the displacement of the inner shell minus that of the outer one.

Reference: S. P. Timoshenko and J. N. Goodier, Theory of Elasticity, 3rd ed. (1970), articles 28
(rings) and 136 (spheres).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from fem import Material, Problem
from fem.contact.law import ContactLaw
from geometry import Assembly, Block, HeldFace, LoadCase, PressureLoad
from geometry.block import mapped_block

X, Y, Z = np.eye(3)
#: Names of the sides of a patch: through the shell, along it and up.
SIDES = {"u-": "inner", "u+": "outer", "v-": "start", "v+": "end", "w-": "bottom", "w+": "top"}
DIRECTIONS = ("across", "along", "upward")


@dataclass(frozen=True)
class Shells:
    """Two shells about one centre."""

    radii: tuple[float, float, float]
    """Of the inner shell, of the joint and of the outer shell [mm]."""
    material: Material
    law: ContactLaw
    extent: float
    """Height of the rings [mm]; half the angle of the patch of spheres [rad]."""
    spherical: bool = False
    inner_pressure: float = 0.0
    """On the inner face of the inner shell [MPa]."""
    interference: float = 0.0
    """Of the unloaded shells at the joint [mm]."""

    # ---- the problem

    def problem(self) -> Problem:
        """State the problem on a coarse mesh."""
        shapes = (self._patch(0, "outer"), self._patch(1, "inner"))
        blocks = Assembly(
            name="shells",
            shapes=shapes,
            shape_of=np.arange(2),
            rotations=np.tile(np.eye(3), (2, 1, 1)),
            translations=np.zeros((2, 3)),
            layer=np.arange(2),
            fixed=np.zeros(2, dtype=np.bool_),
            unmatched_allowed=True,
        )
        held = tuple(
            HeldFace(block, face, normal[None])
            for block in (0, 1)
            for face, normal in self._cuts().items()
        )
        faces = (PressureLoad(np.array([0]), "inner", self.inner_pressure),)
        load = LoadCase(
            blocks, "shells", faces if self.inner_pressure else (), blocks.fixed, held=held
        )
        clearance = -self.interference
        return Problem(blocks, load, self.material, law=self.law, clearance=clearance)

    def _cuts(self) -> dict[str, np.ndarray]:
        """Normal of each side that is held."""
        if not self.spherical:
            return {"start": Y, "end": X, "bottom": Z}
        sine, cosine = np.sin(self.extent), np.cos(self.extent)
        signs = {"start": (-1.0, X), "end": (1.0, X), "bottom": (-1.0, Y), "top": (1.0, Y)}
        return {face: sign * cosine * axis - sine * Z for face, (sign, axis) in signs.items()}

    def _patch(self, number: int, contact: str) -> Block:
        around = (-self.extent, self.extent) if self.spherical else (0.0, 0.5 * np.pi)
        upward = around if self.spherical else (0.0, self.extent)
        lines = (
            np.linspace(*self.radii[number : number + 2], 3),
            np.linspace(*around, 7),
            np.linspace(*upward, 4),
        )
        shape = _on_spheres if self.spherical else _on_cylinders
        name = ("inner shell", "outer shell")[number]
        return mapped_block(name, lines, shape, SIDES, (contact,), directions=DIRECTIONS)

    # ---- the closed form

    def exact(self) -> dict[str, float]:
        """Pressure of the joint, largest displacement and extremes of the stresses."""
        pressure = self.joint_pressure()
        inner, outer = self._fields(pressure)
        _, joint, last = self.radii
        at = [(inner, self.radii[0]), (inner, joint), (outer, joint), (outer, last)]
        stresses = np.array([self._principal(field(r)[:2]) for field, r in at])
        first, second, third = stresses.T
        mises = np.sqrt(
            0.5 * ((first - second) ** 2 + (second - third) ** 2 + (third - first) ** 2)
        )
        moved = [np.hypot(field(r)[2], self._rise(field(r))) for field, r in at]
        return {
            "max_displacement": float(max(moved)),
            "sigma_1_max": float(first.max()),
            "sigma_3_min": float(third.min()),
            "mises_max": float(mises.max()),
            **dict.fromkeys(("p_eff", "p_max", "p_max_facet", "p_max_point"), pressure),
        }

    def joint_pressure(self) -> float:
        """Root of the compatibility of both shells [MPa]."""
        joint = self.radii[1]

        def beyond(pressure: float) -> float:
            inner, outer = self._fields(pressure)
            closed = inner(joint)[2] - outer(joint)[2] + self.interference
            return float(self.law.overclosure(np.array([pressure]))[0]) - closed

        modulus = self.material.young_modulus
        return float(brentq(beyond, 1e-9 * modulus, 0.1 * modulus, xtol=1e-18, rtol=1e-14))

    def _fields(
        self, pressure: float
    ) -> tuple[Callable[[float], np.ndarray], Callable[[float], np.ndarray]]:
        first, joint, last = self.radii
        return (
            self._shell(first, joint, self.inner_pressure, pressure),
            self._shell(joint, last, pressure, 0.0),
        )

    def _shell(self, a: float, b: float, within: float, without: float) -> Callable[[float], Any]:
        """Radial and circumferential stress [MPa] and radial displacement [mm] at a radius."""
        n = 3 if self.spherical else 2
        mean = (within * a**n - without * b**n) / (b**n - a**n)
        part = (within - without) * a**n * b**n / (b**n - a**n)
        modulus, ratio = self.material.young_modulus, self.material.poisson_ratio
        others = ratio if self.spherical else 0.0

        def field(r: float) -> np.ndarray:
            radial, around = mean - part / r**n, mean + part / ((n - 1) * r**n)
            moved = r * ((1.0 - others) * around - ratio * radial) / modulus
            return np.array([radial, around, moved])

        return field

    def _principal(self, stress: np.ndarray) -> np.ndarray:
        radial, around = stress
        found = [radial, around, around if self.spherical else 0.0]
        return np.sort(found)[::-1]

    def _rise(self, field: np.ndarray) -> float:
        """Displacement of the top of a ring, whose bottom is held [mm]."""
        if self.spherical:
            return 0.0
        material = self.material
        strain = -material.poisson_ratio * (field[0] + field[1]) / material.young_modulus
        return float(strain) * self.extent


def _on_cylinders(at: np.ndarray) -> np.ndarray:
    radius, angle, height = at.T
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])


def _on_spheres(at: np.ndarray) -> np.ndarray:
    radius, first, second = at.T
    ray = np.column_stack([np.tan(first), np.tan(second), np.ones(len(at))])
    found: np.ndarray = radius[:, None] * ray / np.linalg.norm(ray, axis=1, keepdims=True)
    return found
