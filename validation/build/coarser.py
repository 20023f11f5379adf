"""The same scene on a coarser mesh, for estimates of what the mesh leaves out."""

from __future__ import annotations

from typing import Any

from validation.scene.families import BoxesScene, HexagonTubeScene, PlanarSineScene
from validation.scene.polyhedra import MeshScene
from validation.scene.read import DeformableScene, TubeScene


def coarser(scene: DeformableScene, share: float) -> DeformableScene | None:
    """Scene with about that share of the elements along every edge; None where it has no fewer.

    Waves keep whole numbers of elements, hexagon edges even ones. Meshes that the scene gives node
    by node have no coarser one.
    """
    if isinstance(scene, MeshScene):
        return None
    if isinstance(scene, BoxesScene):
        boxes = tuple(
            box.model_copy(update={"divisions": tuple(_fewer(n, share) for n in box.divisions)})
            for box in scene.block.boxes
        )
        if boxes == scene.block.boxes:
            return None
        return scene.model_copy(update={"block": scene.block.model_copy(update={"boxes": boxes})})
    found = _values(scene, share)
    if all(getattr(scene.mesh, key) == value for key, value in found.items()):
        return None
    return scene.model_copy(update={"mesh": scene.mesh.model_copy(update=found)})


def _values(scene: Any, share: float) -> dict[str, Any]:
    mesh = scene.mesh
    if isinstance(scene, TubeScene):
        waves = round(2 * scene.block.frequency)
        return {
            "around": max(_fewer(mesh.around, share, waves), min(mesh.around, 2 * waves)),
            "radial": _fewer(mesh.radial, share),
            "axial": _fewer(mesh.axial, share),
        }
    if isinstance(scene, HexagonTubeScene):
        return {"edge": _fewer(mesh.edge, share, 2), "radial": _fewer(mesh.radial, share)}
    along, depth, height = mesh.divisions
    waves = round(2 * scene.block.frequency) if isinstance(scene, PlanarSineScene) else 2
    few = _fewer(along, share, waves), _fewer(depth, share), _fewer(height, share)
    return {"divisions": few}


def _fewer(count: int, share: float, multiple: int = 1) -> int:
    """About a share of a number of elements, a multiple of another, at least one of those."""
    if count % multiple:
        return count
    return max(1, round(share * count / multiple)) * multiple
