"""Deck of MacNeal and Harder's straight cantilever beam: 6 × 0.2 × 0.1, six elements."""

from __future__ import annotations

import numpy as np

#: Shift of the inner lines of nodes by shape, at the lower and at the upper side, of every second.
_LEAN = {"regular": (0.0, 0.0), "trapezoids": (-0.1, 0.1), "parallelograms": (-0.1, -0.1)}


def beam_lines(
    shape: str = "regular", kind: str = "C3D8I", load: tuple[int, float] = (2, 1.0)
) -> list[str]:
    """Lines of the deck, clamped at x = 0 with a force at the end: component 1 to 3, size."""
    lower, upper = _LEAN[shape]
    sign = np.array([0.0, 1.0, -1.0, 1.0, -1.0, 1.0, 0.0])
    sign = np.abs(sign) if shape == "parallelograms" else sign
    places = [
        (x + sign[k] * (lower if y == 0.0 else upper if shape == "trapezoids" else -upper), y, z)
        for k, x in enumerate(np.arange(7.0))
        for y, z in ((0.0, 0.0), (0.2, 0.0), (0.2, 0.1), (0.0, 0.1))
    ]
    members = [
        [4 * i + 1, 4 * i + 5, 4 * i + 6, 4 * i + 2, 4 * i + 4, 4 * i + 8, 4 * i + 7, 4 * i + 3]
        for i in range(6)
    ]
    component, size = load
    return [
        "*Node, nset=ALL",
        *(f"{n}, {', '.join(f'{v:.12g}' for v in at)}" for n, at in enumerate(places, start=1)),
        f"*Element, type={kind}, elset=BEAM",
        *(f"{n}, {', '.join(map(str, row))}" for n, row in enumerate(members, start=1)),
        *("*Nset, nset=ROOT", "1, 2, 3, 4", "*Nset, nset=TIP", "25, 26, 27, 28"),
        *("*Material, name=M", "*Elastic", "1e7, 0.3", "*Solid Section, elset=BEAM, material=M"),
        *("*Boundary", "ROOT, 1, 3", "*Step", "*Static", "*Cload"),
        *(f"TIP, {component}, {size / 4.0}", "*Node Print, nset=ALL", "U", "*End Step"),
    ]
