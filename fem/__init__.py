"""Deformable blocks: finite elements, statics and explicit dynamics.

What most need::

    from fem import Problem, concrete, solve_explicit, solve_static

    answer = solve_static(Problem(blocks, pipe(0.01), concrete))
    print(answer)
    answer["p_max_point"], answer.fields["principal_stress"], answer.contacts["pressure"]

| | |
|---|---|
| `Problem` | blocks, load, material and what acts between blocks, stated once |
| `Material`, `concrete` | isotropic elasticity and density; the paper's concrete |
| `ExponentialLaw`, `LinearPenalty`, `TabularLaw` | contact pressure over overclosure |
| `PairLaws` | contact laws of pairs of blocks |
| `CoulombFriction` | friction of all joints |
| `Frames`, `ElementType` | how fixed blocks are modelled; hexahedra of degree 1 |
| `Static`, `Explicit` | the methods: how accurate, in how many steps, how damped |
| `RayleighDamping`, `BulkViscosity` | damping and bulk viscosity of explicit runs |
| `solve_static` | the static state by Newton's method |
| `Static` | mesh, accuracy, load steps and symmetry of a static state |
| `solve_explicit` | explicit dynamics, to the static state or in time |
| `Explicit` | damping, times, time step and threads of a run |
| `write_deck` | the problem as an input deck for Abaqus or CalculiX |
| `read_deck` | an input deck of Abaqus or CalculiX, and its problem |

Both solvers return a `geometry.Answer`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fem.accuracy.statics import solve_static
    from fem.contact.friction import CoulombFriction
    from fem.contact.law import ExponentialLaw, LinearPenalty
    from fem.contact.own_law import TabularLaw
    from fem.contact.pair_laws import PairLaws
    from fem.decks.problem import write_deck
    from fem.decks.read.deck import read_deck
    from fem.dynamics import solve_explicit
    from fem.element.hexahedron import ElementType
    from fem.element.material import Material, concrete
    from fem.method import Explicit, Static
    from fem.problem import Frames, Problem
    from fem.system.effects import BulkViscosity, RayleighDamping

__all__ = [
    "BulkViscosity",
    "CoulombFriction",
    "ElementType",
    "Explicit",
    "ExponentialLaw",
    "Frames",
    "LinearPenalty",
    "Material",
    "PairLaws",
    "Problem",
    "RayleighDamping",
    "Static",
    "TabularLaw",
    "concrete",
    "read_deck",
    "solve_explicit",
    "solve_static",
    "write_deck",
]

#: Where each name comes from: imported, and with solvers the compiler, when it is asked for.
_PLACES = {
    "BulkViscosity": "fem.system.effects",
    "CoulombFriction": "fem.contact.friction",
    "ElementType": "fem.element.hexahedron",
    "Explicit": "fem.method",
    "ExponentialLaw": "fem.contact.law",
    "Frames": "fem.problem",
    "LinearPenalty": "fem.contact.law",
    "PairLaws": "fem.contact.pair_laws",
    "Material": "fem.element.material",
    "Problem": "fem.problem",
    "RayleighDamping": "fem.system.effects",
    "TabularLaw": "fem.contact.own_law",
    "Static": "fem.method",
    "read_deck": "fem.decks.read.deck",
    "concrete": "fem.element.material",
    "solve_explicit": "fem.dynamics",
    "solve_static": "fem.accuracy.statics",
    "write_deck": "fem.decks.problem",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'fem' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return __all__
