"""Disassembly test: whether all blocks of a tube can move outward, to first order and how far."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly, as_polyhedral
from geometry.polyhedra.explosion import FiniteExplosion, follow_explosion, outward_directions
from mbd import MechanismClass, contact_jacobian
from mbd.margin import FirstOrderExplosion, first_order_explosion
from mbd.mechanism import classify
from validation.build.problem import build_assembly, require_assembly
from validation.case import Case
from validation.errors import InputError
from validation.scene.family import RoundScene, round_types

#: Displacements looked at, in wall thicknesses.
STEPS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 0.75, 1.0)
#: Depth that counts as touching, in wall thicknesses.
TOLERANCE = 1e-3


@dataclass(frozen=True)
class Explosion:
    """Everything that the disassembly test computed."""

    name: str
    assembly: Assembly
    surfaces: PolyhedralAssembly
    """The blocks of the finite motion: three layers, for they repeat."""
    directions: FloatArray
    """Outward unit vector of each of those, (n_blocks, 3)."""
    thickness: float
    """Wall thickness [mm]."""
    first: FirstOrderExplosion
    held: MechanismClass
    """Class of the outward push with the frame held."""
    finite: FiniteExplosion
    cpu_seconds: float

    @property
    def explodes(self) -> bool:
        """Whether nothing stops the outward motion, to the last step looked at."""
        return self.first.admissible and self.finite.first_overlap is None

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        overlap = self.finite.first_overlap
        return {
            "explodes": self.explodes,
            "first_order": {
                "admissible": self.first.admissible,
                "smallest_gap_rate": self.first.smallest_gap_rate,
                "closing_area_percent": self.first.closing_area_percent,
                "opening_area_percent": self.first.opening_area_percent,
            },
            "outward_push": {
                "frame_held": str(self.held),
                "nothing_held": "carried" if self.first.held_together else "drives a motion",
            },
            "finite": {
                "free_distance": self.finite.free_distance,
                "tolerance": self.finite.tolerance,
                "distances": self.finite.distances.tolist(),
                "depths": self.finite.depths.tolist(),
                "first_overlap": None if overlap is None else [overlap.block_a, overlap.block_b],
            },
            "cpu_seconds": self.cpu_seconds,
        }


def _surface_scene(scene: RoundScene) -> RoundScene:
    """Return three layers with a mesh fine enough for surfaces, coarse enough for many distances.

    Layers repeat with period two, so more of them show no other pair of neighbours.
    """
    layers = min(scene.assembly.layers, 3)
    return scene.changed({"mesh": scene.coarse_mesh(12, 6, 8), "assembly.layers": layers})


def run_explosion(file: Case) -> Explosion:
    """Judge the explosion of a tube."""
    start = time.process_time()
    scene = require_assembly(file.scene, file.name, "mbd --disassemble")
    if not isinstance(scene, RoundScene):
        raise InputError(
            f"{file.name}: block.type {scene.block.type!r} makes no tube; --disassemble needs "
            f"one: block.type = {round_types()}"
        )
    assembly = build_assembly(scene)
    directions = outward_directions(assembly)
    first = first_order_explosion(assembly, directions)
    contacts = contact_jacobian(assembly)
    push = np.zeros((len(contacts.free_blocks), 6))
    push[:, :3] = directions[contacts.free_blocks]
    held = classify(contacts.jacobian, push.ravel()).mechanism
    short = build_assembly(_surface_scene(scene))
    surfaces, outward = as_polyhedral(short), outward_directions(short)
    thickness = scene.thickness
    finite = follow_explosion(surfaces, outward, thickness * np.array(STEPS), TOLERANCE * thickness)
    seconds = time.process_time() - start
    return Explosion(
        file.name, assembly, surfaces, outward, thickness, first, held, finite, seconds
    )
