"""What the rigid answers of all scenes have in common, whatever their blocks are made of."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geometry.assembly import AnyBlocks
from geometry.loads import LoadCase
from geometry.measures import JointResultants, joint_resultants
from geometry.mesh import FloatArray
from mbd import Mechanism, RigidResult, SelfStress
from mbd.margin import held_against
from validation.run.rigid.further import Carried, Further, carried, further_json
from validation.run.stages import summed
from validation.scene.family import AssemblyScene
from validation.scene.polyhedra import PolyhedralScene


@dataclass(frozen=True, kw_only=True)
class RigidAnswer(ABC):
    """A scene, what was built from it, and the rigid-block result."""

    name: str
    scene: AssemblyScene | PolyhedralScene
    assembly: AnyBlocks
    load: LoadCase
    result: RigidResult
    further: Further | None
    """Friction, collapse load, margin, where the scene asks for them."""
    cpu_seconds: dict[str, float]
    """CPU time of each stage, building and checks included [s]."""

    @cached_property
    def carried(self) -> Carried:
        """Contact forces of the answer that was asked for."""
        return carried(self.result, self.further, self._normals, self.scene.rigid.friction)

    @property
    def normal_forces(self) -> FloatArray:
        """Normal part of those forces, (n_contacts,) [N]."""
        return self.carried.normal_forces(self._normals)

    @property
    def _normals(self) -> FloatArray:
        normals: FloatArray = self.assembly.interfaces.normals[self.result.contact_index]
        return normals

    @cached_property
    def held(self) -> dict[str, bool] | None:
        """Which pushes beside the load are held; None where the class or friction says it all."""
        asked = self.further is not None and self.further.friction is not None
        if asked or self.result.supported_classification.locked:
            return None
        return held_against(self.assembly, self.load) if self.result.equilibrium.holds else None

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the forces between each two blocks."""
        return joint_resultants(
            self.assembly.interfaces, self.result.contact_index, self.carried.forces
        )

    @cached_property
    def motion(self) -> FloatArray | None:
        """(δt [mm], δθ [rad]) of each block under the certified mechanism, (n_blocks, 6).

        None if locked, or where friction was asked for and holds the blocks. Prefers the mechanism
        that the load drives; blocks held by the certificate's supports stay.
        """
        driven = self.carried.mechanism
        if self.carried.holds and self.scene.rigid.friction is not None:
            return None
        certificate = self.result.classification.certificate
        if driven is not None:
            motion, held = driven.reshape(-1, 6), self.load.fixed
        elif isinstance(certificate, Mechanism):
            motion, held = certificate.virtual_displacement, self.assembly.fixed
        else:
            return None
        moving = np.zeros((self.assembly.n_blocks, 6))
        moving[~held] = motion
        moving[:, 3:] /= self.assembly.characteristic_length
        return moving

    def json(self) -> dict[str, Any]:
        """Return the answer as plain data, numbers in full precision."""
        result = self.result
        return {
            "scene": self.name,
            "mechanism": str(result.mechanism),
            "certificate": _certificate_json(result),
            "equilibrium": {
                "holds": result.equilibrium.holds,
                "residual": result.equilibrium.residual,
                "iterations": result.equilibrium.iterations,
                "status": result.equilibrium.status,
            },
            "held_against": self.held,
            "answer": self.carried.words,
            "carried": self.carried.holds,
            "joints": self.joints.as_json() if self.carried.holds else [],
            "n_blocks": result.n_blocks,
            "n_contacts": result.n_contacts,
            **further_json(self.further),
            "cpu_seconds": self.cpu_seconds,
        }


def spent(
    built: dict[str, float], result: RigidResult, further: Further | None
) -> dict[str, float]:
    """CPU time of each stage and of all [s], building and what was asked for beside included."""
    seconds = summed({"build": 0.0, **result.cpu_seconds}, built)
    if further is None:
        return seconds
    return summed(seconds, {"further": further.cpu_seconds, "total": further.cpu_seconds})


def _certificate_json(result: RigidResult) -> dict[str, Any] | None:
    """Return the proof of the mechanism class as plain data."""
    certificate = result.classification.certificate
    if isinstance(certificate, SelfStress):
        return {
            "kind": "self-stress",
            "smallest_force": float(certificate.forces.min()),
            "residual": certificate.residual,
            "smallest_singular_value": certificate.smallest_singular_value,
        }
    if isinstance(certificate, Mechanism):
        return {
            "kind": "mechanism",
            "virtual_displacement": certificate.virtual_displacement.tolist(),
            "smallest_gap_rate": certificate.smallest_gap_rate,
            "work": certificate.work,
        }
    return None
