"""A scene solved by the method that it names."""

from __future__ import annotations

from fem.explicit.solve import Status
from validation.build.deformable import fem_section
from validation.errors import InputError
from validation.run.deformable import DeformableRun
from validation.run.explicit import run_explicit
from validation.run.static import run_static
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene


def run_scene(name: str, scene: DeformableScene) -> DeformableRun:
    """Solve a scene by its own method.

    Raises
    ------
    InputError
        A scene that cannot be solved, or a run that was interrupted.
    """
    if fem_section(scene, name).method is Method.STATIC:
        return run_static(name, scene)
    run = run_explicit(name, scene)
    if run.explicit is not None and run.explicit.status is Status.INTERRUPTED:
        raise InputError(f"{name}: interrupted")
    return run
