"""*tunnel*: pressure on the outer faces of all free blocks."""

from __future__ import annotations

from geometry.loads.named import Load, NamedLoad

CASE = NamedLoad(
    name="tunnel",
    words="external pressure",
    face="outer",
    blocks=lambda assembly, _: assembly.free_blocks,
    every_layer=True,
)


def tunnel(pressure: float) -> Load:
    """Pressure on the outer faces of all free blocks [MPa]."""
    return Load(case=CASE, pressure=pressure)
