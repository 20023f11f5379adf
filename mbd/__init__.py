"""Rigid blocks: contact Jacobian, equilibrium by LP and QP, mechanism classes, measures.

What most need::

    from mbd import Rigid, analyse

    answer = analyse(problem, Rigid(collapse=True))
    print(answer)
    answer["p_max_facet"], answer.report["mechanism"], answer.contacts["pressure"]

| | |
|---|---|
| `analyse` | the rigid answer to a problem, or to blocks and a load: a `geometry.Answer` |
| `Rigid` | the method: what contact forces minimise, what is found beside |
| `Norm`, `Solver`, `FrictionLaw` | its options by name |
| `RigidSystem` | `Answer.details`: certificates, forces and equilibrium as objects |
| `MechanismClass` | locked, activated, suppressed or neutral |
| `stages`, `Stages` | whether each stage of a construction stands, and its least propping |
| `take_out` | which block comes out by a straight motion, and in which order all do |
| `contact_jacobian` | velocities of gaps by motions of blocks: proves certificates |
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mbd.answer import analyse, stages
    from mbd.building.take_out import take_out
    from mbd.contacts.jacobian import contact_jacobian
    from mbd.mechanism import MechanismClass
    from mbd.options import FrictionLaw, Norm, Rigid, Solver, Stages
    from mbd.system import RigidSystem

__all__ = [
    "FrictionLaw",
    "MechanismClass",
    "Norm",
    "Rigid",
    "RigidSystem",
    "Solver",
    "Stages",
    "analyse",
    "contact_jacobian",
    "stages",
    "take_out",
]

#: Where each name comes from: imported, and with solvers scipy, when it is asked for.
_PLACES = {
    "FrictionLaw": "mbd.options",
    "MechanismClass": "mbd.mechanism",
    "Norm": "mbd.options",
    "Rigid": "mbd.options",
    "RigidSystem": "mbd.system",
    "Solver": "mbd.options",
    "Stages": "mbd.options",
    "analyse": "mbd.answer",
    "contact_jacobian": "mbd.contacts.jacobian",
    "stages": "mbd.answer",
    "take_out": "mbd.building.take_out",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'mbd' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return __all__
