"""Tubes on coarse meshes."""

from __future__ import annotations

from validation import Case, load_case

#: Words of a command: a tube of one layer.
SMALL = ["--set", "assembly.layers=1", "--set", "mesh.around=24", "--set", "mesh.radial=2"]

COARSE = ("assembly.layers=1", "mesh.around=12", "mesh.radial=2", "mesh.axial=4")


def tube(name: str, *settings: str) -> Case:
    return load_case(name, [*COARSE, *settings])
