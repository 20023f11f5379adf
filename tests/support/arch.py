"""A circular arch of rigid blocks."""

from __future__ import annotations

from geometry import Answer
from validation import load_case, solve

ARCH = (
    "block.thickness=200.0",
    "block.depth=200.0",
    "assembly.voussoirs=7",
    "assembly.embrace=140.0",
)


def arch_run(friction: float) -> Answer:
    file = load_case("arch", [*ARCH, f"effects.friction={friction}"])
    return solve(file.with_method("rigid"))  # type: ignore[arg-type]
