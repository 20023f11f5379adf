"""The files of a rigid-block result: pressures where the load is carried, the mechanism else."""

from __future__ import annotations

from pathlib import Path

from validation.pictures import draw_mechanism, draw_pressures
from validation.rigid import RigidRun, mechanism_displacements, write_mechanism, write_pressures


def write_rigid(run: RigidRun, folder: Path) -> list[tuple[str, Path]]:
    """Write what the result shows into ``folder``; returns what each file is, and its path."""
    written = []
    if run.result.equilibrium.holds:
        vtu, picture = folder / "contact_pressures.vtu", folder / "contact_pressures.png"
        write_pressures(run, vtu)
        draw_pressures(run, picture)
        written += [("pressures", vtu), ("picture", picture)]
    if mechanism_displacements(run) is not None:
        vtu, picture = folder / "mechanism.vtu", folder / "mechanism.png"
        write_mechanism(run, vtu)
        draw_mechanism(run, picture)
        written += [("mechanism", vtu), ("picture", picture)]
    return written
