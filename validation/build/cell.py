"""The periodic cell: two layers that a long tube repeats stand for the tube.

The lower face of the lower layer meets the upper face of the upper one, and the cell keeps its
height, as the middle of a tube between fixed frames does when the tube is long. Nothing of the
ends is in it: its answer is that of the middle layers, with an error of the order of one over
the number of layers.
"""

from __future__ import annotations

from geometry.assembly import Assembly
from geometry.loads import CASES
from validation.errors import InputError, named
from validation.scene.family import RoundScene, round_types
from validation.scene.plausibility import check_block_size
from validation.scene.read import DeformableScene


def check_cell_of_scene(scene: DeformableScene, name: str) -> RoundScene:
    """Return the scene if a periodic cell can stand for it."""
    head, remedy = f'{name}: fem.symmetry = "periodic cell"', 'expected that, or "auto"'
    if not isinstance(scene, RoundScene):
        raise InputError(
            f"{head}: got block.type {scene.block.type!r}, whose layers are not those of a tube; "
            f'expected {round_types()} blocks, or symmetry "auto"'
        )
    if not CASES[scene.load.case].every_layer:
        known = " and ".join(case.name for case in CASES.values() if case.every_layer)
        raise InputError(
            f"{head}: got load.case {scene.load.case!r}, which differs from layer to layer; "
            f"the cell takes {known}; {remedy}"
        )
    if scene.assembly.layers < 2:
        raise InputError(
            f"{head}: got assembly.layers = {scene.assembly.layers}, where nothing repeats; the "
            f"cell stands for two layers or more; {remedy}"
        )
    effects = scene.effects
    for key, blocks in (("[materials]", scene.materials), ("contact.pairs", scene.contact.pairs)):
        if blocks:
            raise InputError(
                f"{head} with {key}: its blocks are those of a long tube, all of one material with "
                "one contact law and friction; remove one of the two"
            )
    for given, key, why in (
        (effects.gravity, "gravity", "the weight adds up from layer to layer"),
        (effects.elastic_frame, "elastic_frame", "the cell has no frame"),
        (effects.finite_sliding, "finite_sliding", "blocks could slide on to other images"),
    ):
        if given:
            raise InputError(f"{head} with effects.{key}: {why}; remove one of the two")
    return scene


def build_cell(scene: DeformableScene, name: str) -> Assembly:
    """Two layers of a tube and the images that they meet."""
    tube = check_cell_of_scene(scene, name)
    with named(name):
        assembly = tube.build_cell()
        check_block_size(scene, assembly)
    return assembly
