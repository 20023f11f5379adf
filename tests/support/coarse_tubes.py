"""Tubes on coarse meshes."""

from __future__ import annotations

from tests.support.face import DeformableScene
from validation import load_case

#: Words of a command: a tube of one layer.
SMALL = ["--set", "assembly.layers=1", "--set", "mesh.around=24", "--set", "mesh.radial=2"]

COARSE = ("assembly.layers=1", "mesh.around=12", "mesh.radial=2", "mesh.axial=4")


def tube(name: str, *settings: str) -> DeformableScene:
    scene = load_case(name, [*COARSE, *settings]).scene
    assert isinstance(scene, DeformableScene)
    return scene
