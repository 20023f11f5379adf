"""Error bars of a run on the mesh of its scene, from coarser meshes solved by its own method."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from fem.accuracy.one_mesh import SHARES
from fem.accuracy.one_mesh import estimated_errors as errors_of
from fem.solution import Solution
from geometry.errors import RefusedError
from validation.run.deformable import DeformableRun
from validation.run.solve import run_scene


def estimated_errors(run: DeformableRun) -> dict[str, float]:
    """Estimate the error of each measure, in its unit; empty where no coarser mesh can be solved.

    Coarser meshes are solved by the method of the run.
    """
    fem, less = run.scene.fem, None
    if fem.degree > 1:
        less = run_scene(run.name, run.scene.changed({"fem.degree": fem.degree - 1})).solution
    return errors_of(run.solution, _on_coarser(run), less)


def _on_coarser(run: DeformableRun) -> Iterator[Solution]:
    scenes = [run.scene.coarser(share) for share in SHARES]
    for k, scene in enumerate(scenes):
        if scene is not None and scene not in scenes[:k]:
            with suppress(RefusedError):
                yield run_scene(run.name, scene).solution
