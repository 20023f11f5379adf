"""Disassembly test: whether all blocks of a tube can move outward, to first order and how far.

All blocks, the frame included, move along the direction from the tube axis to their mass centroids,
all by the same distance, without turning (the paper's "explosion of a tubular interlocking").
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from geometry.parts.placed import AssemblyError
from geometry.parts.rows import Row
from geometry.polyhedra.assembly import PolyhedralAssembly, as_polyhedral
from geometry.polyhedra.overlap import Overlap, find_overlaps
from mbd import MechanismClass, contact_jacobian
from mbd.equilibrium import Equilibrium, newton_equilibrium
from mbd.mechanism import classify
from validation.case import Case
from validation.scene.keys.toml_text import flat

#: Displacements looked at, in wall thicknesses.
STEPS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 0.75, 1.0)
#: Depth that counts as touching, in wall thicknesses.
TOLERANCE = 1e-3
#: Halvings between the last free and the first blocked step.
_BISECTIONS = 6
#: Gap rates above minus this fraction of the displacement are round-off of tangential sliding.
_CLOSING = 1e-9


def outward_directions(assembly: Assembly) -> FloatArray:
    """Unit vector from the tube axis to each block's centroid, (n_blocks, 3).

    Raises
    ------
    AssemblyError
        When a block is centred on the axis: outward means nothing there.
    """
    arm = assembly.centroids - assembly.origin
    arm = arm - np.outer(arm @ assembly.axis, assembly.axis)
    length = np.linalg.norm(arm, axis=1, keepdims=True)
    if assembly.unmatched_allowed or (length < 1e-6 * assembly.characteristic_length).any():
        raise AssemblyError(
            f"{assembly.name}: is not a tube round an axis; expected blocks that all lie off the "
            "axis to move outward"
        )
    return arm / length


@dataclass(frozen=True)
class FiniteExplosion:
    """How the explosion goes on beyond first order."""

    distances: FloatArray
    """Outward displacement of every block, growing, (n_steps,) [mm]."""
    depths: FloatArray
    """How deep blocks are in each other there, (n_steps,) [mm]."""
    free_distance: float
    """Largest displacement up to which nothing is deeper than `tolerance` [mm]."""
    tolerance: float
    """Depth that counts as touching [mm]."""
    first_overlap: Overlap | None
    """Deepest overlap at the first step beyond; None if the last step is still free."""


def follow_explosion(
    surfaces: PolyhedralAssembly,
    directions: FloatArray,
    distances: FloatArray,
    tolerance: float,
) -> FiniteExplosion:
    """Move the blocks outward step by step and look how deep they are in each other.

    Parameters
    ----------
    surfaces
        The tube's blocks as closed surfaces.
    directions
        Of `outward_directions`, (n_blocks, 3).
    distances
        Displacements to look at, growing from above zero, (n_steps,) [mm].
    tolerance
        Depth that counts as touching [mm].
    """

    def deepest(distance: float) -> Overlap | None:
        there = replace(surfaces, translations=surfaces.translations + distance * directions)
        overlaps = find_overlaps(there, 1e-9 * surfaces.characteristic_length, by_points=True)
        return overlaps[0] if overlaps else None

    depths = np.zeros(len(distances))
    first: Overlap | None = None
    free, blocked = 0.0, np.inf
    for step, distance in enumerate(distances.tolist()):
        overlap = deepest(distance)
        depths[step] = 0.0 if overlap is None else overlap.depth
        if depths[step] > tolerance and first is None:
            first, blocked = overlap, distance
        if first is None:
            free = distance
    for _ in range(_BISECTIONS if np.isfinite(blocked) else 0):
        middle = 0.5 * (free + blocked)
        overlap = deepest(middle)
        if overlap is not None and overlap.depth > tolerance:
            blocked = middle
        else:
            free = middle
    return FiniteExplosion(distances, depths, free, tolerance, first)


@dataclass(frozen=True)
class FirstOrderExplosion:
    """Is the explosion of a tube admissible: nothing is held, all blocks move outward alike."""

    smallest_gap_rate: float
    """min Gᵀδq for a unit displacement of every block; negative: some contact closes."""
    closing_area_percent: float
    """Share of the contact area that closes [%]."""
    opening_area_percent: float
    """Share of the contact area that opens [%]; the rest slides."""
    push: Equilibrium
    """Contact forces under a unit outward push on every block with nothing held. Where they
    exist no admissible motion moves the blocks outward on the whole, turning and shifting
    allowed (fᵀδq = -λᵀGᵀδq <= 0); else the mechanism that the push drives."""

    @property
    def admissible(self) -> bool:
        """Whether no contact closes."""
        return self.smallest_gap_rate >= -_CLOSING

    @property
    def held_together(self) -> bool:
        """Whether contacts alone carry an outward push, whatever accompanies the motion."""
        return self.push.holds


def first_order_explosion(assembly: Assembly, directions: FloatArray) -> FirstOrderExplosion:
    """Judge the simultaneous outward motion of a tube with the frame released.

    Along the outward unit vector of each block, (n_blocks, 3).
    """
    contacts = contact_jacobian(assembly, np.zeros(assembly.n_blocks, dtype=bool))
    motion = np.zeros((assembly.n_blocks, 6))
    motion[:, :3] = directions
    rates = contacts.jacobian.gap_rates(motion.ravel())
    total = contacts.areas.sum()
    closing = float(contacts.areas[rates < -_CLOSING].sum() / total)
    opening = float(contacts.areas[rates > _CLOSING].sum() / total)
    return FirstOrderExplosion(
        smallest_gap_rate=float(rates.min()) if len(rates) else 0.0,
        closing_area_percent=100 * closing,
        opening_area_percent=100 * opening,
        push=newton_equilibrium(contacts.jacobian, motion.ravel()),
    )


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

    @property
    def rows(self) -> list[Row]:
        """Its verdict and its numbers."""
        first, finite = self.first, self.finite
        last = finite.distances[-1]
        motion = f"free up to {last:g} mm (one wall thickness), the largest distance computed"
        if finite.first_overlap is not None:
            motion = (
                f"free up to {finite.free_distance:.3g} mm, then blocks overlap by more than "
                f"{finite.tolerance:g} mm; {finite.depths[-1]:.3g} mm at {last:g} mm"
            )
        rate = (
            f"{'' if first.admissible else 'not '}admissible: smallest gap rate "
            f"{first.smallest_gap_rate:.4g} mm per mm outward; {first.closing_area_percent:.1f} % "
            f"of the contact area closes, {first.opening_area_percent:.1f} % opens"
        )
        held = "drives a mechanism (twist and elongation of the tube included)"
        held = "carried by the contacts alone" if first.held_together else held
        verdict = f"{'disassembles' if self.explodes else 'does not disassemble'} radially"
        return [
            Row("disassembly, end rings released", verdict, group="verdict"),
            Row("disassembly, first order", rate, first.smallest_gap_rate),
            Row("disassembly, finite motion", motion, finite.free_distance, "mm"),
            Row("outward push, end rings fixed", str(self.held)),
            Row("outward push, no supports", held),
        ]

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


def _surfaces(case: Case) -> dict[str, Any]:
    """Keys of three layers with a mesh fine enough for surfaces, coarse enough for many distances.

    Layers repeat with period two, so more of them show no other pair of neighbours.
    """
    layers = min(case.values["assembly.layers"], 3)
    mesh = case.scene.coarse_mesh(12, 6, 8)
    return dict(flat({"mesh": mesh, "assembly.layers": layers}))


def run_explosion(case: Case) -> Explosion:
    """Judge the explosion of a tube of rigid blocks."""
    start = time.process_time()
    assembly = case.problem.blocks
    directions = outward_directions(assembly)
    first = first_order_explosion(assembly, directions)
    contacts = contact_jacobian(assembly)
    push = np.zeros((len(contacts.free_blocks), 6))
    push[:, :3] = directions[contacts.free_blocks]
    held = classify(contacts.jacobian, push.ravel()).mechanism
    short = case.changed(_surfaces(case)).problem.blocks
    surfaces, outward = as_polyhedral(short), outward_directions(short)
    thickness = case.values["block.thickness"]
    finite = follow_explosion(surfaces, outward, thickness * np.array(STEPS), TOLERANCE * thickness)
    seconds = time.process_time() - start
    return Explosion(
        case.name, assembly, surfaces, outward, thickness, first, held, finite, seconds
    )
