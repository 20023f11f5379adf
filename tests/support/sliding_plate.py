"""A plate that is pushed with friction."""

from __future__ import annotations

from tests.support.floor import GRAVITY
from validation import Case, load_case


def plate(method: str, damping: str = "static", *, rough: bool = True) -> Case:
    """A plate on a held one, gravity leaning by 0.8 of the angle of friction, 0.3, or not rough."""
    friction = {"friction": {"coefficient": 0.3, "stick_stiffness": 100.0}} if rough else {}
    boxes = [{"size": [50.0, 50.0, 10.0], "divisions": [2, 2, 1]}] * 2
    return load_case(
        {
            "block": {"type": "boxes", "boxes": boxes},
            "load": {"pressure": 1e-6},
            "material": {"density": 2.4e-9, "young_modulus": 33e3, "poisson_ratio": 0.2},
            "contact": {"law": "linear", "stiffness": 200.0},
            "fem": {"method": method} | ({"damping": damping} if method == "explicit" else {}),
            "effects": {
                "gravity": [0.8 * 0.3 * GRAVITY if rough else 0.0, 0.0, -GRAVITY],
                **friction,
            },
        }
    )
