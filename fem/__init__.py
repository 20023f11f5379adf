"""Deformable blocks: finite elements, explicit dynamics and statics.

``fem.solve(model, end_time=...)`` runs explicit dynamics; see `fem.explicit.solve.solve`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fem.explicit.solve import solve

__all__ = ["solve"]


def __getattr__(name: str) -> Any:
    """Import the solver, and with it the compiler, only when it is asked for."""
    if name == "solve":
        from fem.explicit.solve import solve

        return solve
    raise AttributeError(f"module 'fem' has no attribute {name!r}")
