"""*shaft*: tangential traction, towards larger θ, on the outer faces of all blocks of a layer.

The paper's tables have its resultant force alone, at the mean of each block's surface nodes.
"""

from __future__ import annotations

from geometry.loads.case import CircumferentialLoad
from geometry.loads.named import Load, NamedLoad, layer_blocks

CASE = NamedLoad(
    name="shaft",
    words="tangential traction",
    face="outer",
    blocks=layer_blocks,
    acts=CircumferentialLoad,
    one_layer=True,
    force_as_printed=True,
)


def shaft(pressure: float, layer: int | None = None) -> Load:
    """Tangential traction on the outer faces of a layer, by default of the middle one [MPa]."""
    return Load(case=CASE, pressure=pressure, layer=layer)
