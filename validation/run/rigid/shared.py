"""Rigid-block results of scenes that differ in their loads alone: the blocks are built once."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

from validation.build.blocks import BuiltScene, build_scene
from validation.run.rigid.assembly import RigidRun, analyse_rigid
from validation.scene.family import RoundScene
from validation.scene.read import SceneFile


@dataclass
class SharedTubes:
    """Tubes built so far, by what their blocks are."""

    _built: dict[str, BuiltScene] = field(default_factory=dict)

    def run(self, file: SceneFile) -> RigidRun:
        """Build the blocks of a scene, unless another scene has the same, and analyse them.

        The CPU time of building is that of the first of them: what the scene alone would take.

        Raises
        ------
        InputError
            When it describes nothing that can be built.
        """
        scene = file.scene
        if not isinstance(scene, RoundScene):
            return analyse_rigid(build_scene(file))
        sections = (scene.block, scene.assembly, scene.mesh)
        key = "\n".join(section.model_dump_json() for section in sections)
        if key not in self._built:
            built = build_scene(file)
            start = time.process_time()
            _ = built.assembly.interfaces  # found once and kept
            seconds = built.cpu_seconds + time.process_time() - start
            self._built[key] = replace(built, cpu_seconds=seconds)
        known = self._built[key]
        load = scene.build_load(known.assembly)
        return analyse_rigid(replace(known, name=file.name, scene=scene, load=load))
