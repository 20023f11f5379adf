"""Deformable blocks: finite elements, explicit dynamics and statics.

What most need::

    from fem import Problem, concrete, solve_explicit, solve_static

    answer = solve_static(Problem(blocks, pipe(0.01), concrete))
    answer.contact_pressures, answer.principal_stresses, answer.displacements

``fem.solve(model, end_time=...)`` runs explicit dynamics of any model; see
`fem.explicit.solve.solve`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fem.answer import Answer
    from fem.assembly.deformable import Frames
    from fem.assembly.statement import Problem
    from fem.contact.friction import CoulombFriction
    from fem.contact.law import ExponentialLaw, LinearPenalty
    from fem.element.hexahedron import ElementType
    from fem.element.material import Material, concrete
    from fem.explicit.solve import solve
    from fem.solvers import solve_explicit, solve_static
    from fem.static.solve import StaticOptions

__all__ = [
    "Answer",
    "CoulombFriction",
    "ElementType",
    "ExponentialLaw",
    "Frames",
    "LinearPenalty",
    "Material",
    "Problem",
    "StaticOptions",
    "concrete",
    "solve",
    "solve_explicit",
    "solve_static",
]

#: Where each name comes from: imported, and with solvers the compiler, when it is asked for.
_PLACES = {
    "Answer": ("fem.answer", "Answer"),
    "CoulombFriction": ("fem.contact.friction", "CoulombFriction"),
    "ElementType": ("fem.element.hexahedron", "ElementType"),
    "ExponentialLaw": ("fem.contact.law", "ExponentialLaw"),
    "Frames": ("fem.assembly.deformable", "Frames"),
    "LinearPenalty": ("fem.contact.law", "LinearPenalty"),
    "Material": ("fem.element.material", "Material"),
    "Problem": ("fem.assembly.statement", "Problem"),
    "StaticOptions": ("fem.static.solve", "StaticOptions"),
    "concrete": ("fem.element.material", "concrete"),
    "solve": ("fem.explicit.solve", "solve"),
    "solve_explicit": ("fem.solvers", "solve_explicit"),
    "solve_static": ("fem.solvers", "solve_static"),
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'fem' has no attribute {name!r}")
    module, there = _PLACES[name]
    return getattr(import_module(module), there)
