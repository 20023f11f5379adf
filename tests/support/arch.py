"""A circular arch of rigid blocks."""

from __future__ import annotations

from tests.support.face import PolyhedralRun, run_polyhedra
from validation import load_case

ARCH = (
    "block.thickness=200.0",
    "block.depth=200.0",
    "assembly.voussoirs=7",
    "assembly.embrace=140.0",
)


def arch_run(friction: float) -> PolyhedralRun:
    file = load_case("arch", [*ARCH, f"rigid.friction={friction}"])
    return run_polyhedra(file, file.scene)  # type: ignore[arg-type]
