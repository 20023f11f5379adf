"""*pipe*: pressure on the inner faces of all free blocks."""

from __future__ import annotations

from geometry.loads.named import Load, NamedLoad

CASE = NamedLoad(
    name="pipe",
    words="internal pressure",
    face="inner",
    blocks=lambda assembly, _: assembly.free_blocks,
    every_layer=True,
)


def pipe(pressure: float) -> Load:
    """Pressure on the inner faces of all free blocks [MPa]."""
    return Load(case=CASE, pressure=pressure)
