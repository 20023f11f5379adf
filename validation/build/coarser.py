"""The same scene on a coarser mesh, for estimates of what the mesh leaves out."""

from __future__ import annotations

from validation.scene.polyhedra import MeshScene
from validation.scene.read import DeformableScene


def coarser(scene: DeformableScene, share: float) -> DeformableScene | None:
    """Scene with about that share of the elements along every edge; None where it has no fewer.

    Meshes that the scene gives node by node have no coarser one.
    """
    return None if isinstance(scene, MeshScene) else scene.coarser(share)
