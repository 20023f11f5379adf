"""Answers of rigid blocks: printed, drawn and written, those of meshes and those of solids."""

from types import ModuleType

from validation.scene.polyhedra import PolyhedralScene


def shown(scene: object) -> ModuleType:
    """Return what shows the answers to a scene: ``FILES``, ``print_rigid`` and its likes."""
    if isinstance(scene, PolyhedralScene):
        from validation.output.rigid import polyhedra

        return polyhedra
    from validation.output.rigid import assembly

    return assembly
