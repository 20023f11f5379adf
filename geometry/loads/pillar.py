"""*pillar*: pressure on the flat top of the top frame, which is released."""

from __future__ import annotations

import numpy as np

from geometry.loads.named import Load, NamedLoad

CASE = NamedLoad(
    name="pillar",
    words="axial pressure",
    face="top",
    blocks=lambda assembly, _: np.flatnonzero(assembly.layer == assembly.n_layers + 1),
    releases=True,
)


def pillar(pressure: float) -> Load:
    """Pressure on the flat top of the top frame, which is released [MPa]."""
    return Load(case=CASE, pressure=pressure)
