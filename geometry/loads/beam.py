"""*beam*: pressure on the outer face of one block of a layer."""

from __future__ import annotations

from geometry.loads.named import Load, NamedLoad, layer_blocks

CASE = NamedLoad(
    name="beam",
    words="pressure on one block",
    face="outer",
    blocks=lambda assembly, layer: layer_blocks(assembly, layer)[:1],
    one_layer=True,
)


def beam(pressure: float, layer: int | None = None) -> Load:
    """Pressure on the outer face of one block of a layer, by default of the middle one [MPa]."""
    return Load(case=CASE, pressure=pressure, layer=layer)
