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
| `RigidResult` | `Answer.details`: certificates, forces and equilibrium as objects |
| `MechanismClass` | locked, activated, suppressed or neutral |
| `contact_jacobian` | velocities of gaps by motions of blocks: proves certificates |
"""

from mbd.analysis import RigidResult
from mbd.answer import analyse
from mbd.contact_jacobian import contact_jacobian
from mbd.mechanism import MechanismClass
from mbd.options import FrictionLaw, Norm, Rigid, Solver

__all__ = [
    "FrictionLaw",
    "MechanismClass",
    "Norm",
    "Rigid",
    "RigidResult",
    "Solver",
    "analyse",
    "contact_jacobian",
]


def __dir__() -> list[str]:
    return __all__
