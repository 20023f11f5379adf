"""Rigid blocks: contact Jacobian, equilibrium by LP and QP, mechanism classes, measures.

What most need::

    from mbd import Rigid, analyse

    answer = analyse(problem, Rigid(collapse=True))
    print(answer)
    answer["p_max_facet"], answer.report["mechanism"], answer.contacts["pressure"]

| | |
|---|---|
| `analyse` | the rigid answer to a problem, or to blocks and a load: a `geometry.Answer` |
| `rigid_result`, `RigidResult` | the same with certificates, forces and equilibrium as objects |
| `Rigid` | the method: what contact forces minimise, what is found beside |
| `Norm`, `Solver` | its options by name |
| `contact_jacobian`, `Contacts` | velocities of gaps by motions of blocks |
| `PairJacobian`, `MatrixJacobian` | the Jacobian by pairs of blocks, and as a matrix |
| `generalized_force`, `block_wrenches` | loads as forces and moments on blocks |
| `classify`, `Classification`, `MechanismClass` | locked, activated or suppressed, certified |
| `SelfStress`, `Mechanism` | the certificates |
| `solve_linear_programs`, `LinearPrograms` | the linear programs behind them |
| `equilibrium`, `Equilibrium` | contact forces that balance a load |
| `newton_equilibrium`, `clarabel_equilibrium` | the two solvers of it |
| `column_weights`, `EQUILIBRIUM_TOLERANCE` | weights of its norm; its largest residual |
| `measures`, `Measures` | the paper's measures of contact pressures |
| `block_measures`, `BlockMeasures` | the same of each block |
"""

from geometry.measures import BlockMeasures, Measures, block_measures, measures
from mbd.analysis import RigidResult, rigid_result
from mbd.answer import analyse
from mbd.contact_jacobian import (
    Contacts,
    MatrixJacobian,
    PairJacobian,
    block_wrenches,
    contact_jacobian,
    generalized_force,
)
from mbd.equilibrium import (
    EQUILIBRIUM_TOLERANCE,
    Equilibrium,
    clarabel_equilibrium,
    column_weights,
    equilibrium,
    newton_equilibrium,
)
from mbd.mechanism import (
    Classification,
    LinearPrograms,
    Mechanism,
    MechanismClass,
    SelfStress,
    classify,
    solve_linear_programs,
)
from mbd.options import Norm, Rigid, Solver

__all__ = [
    "EQUILIBRIUM_TOLERANCE",
    "BlockMeasures",
    "Classification",
    "Contacts",
    "Equilibrium",
    "LinearPrograms",
    "MatrixJacobian",
    "Measures",
    "Mechanism",
    "MechanismClass",
    "Norm",
    "PairJacobian",
    "Rigid",
    "RigidResult",
    "SelfStress",
    "Solver",
    "analyse",
    "block_measures",
    "block_wrenches",
    "clarabel_equilibrium",
    "classify",
    "column_weights",
    "contact_jacobian",
    "equilibrium",
    "generalized_force",
    "measures",
    "newton_equilibrium",
    "rigid_result",
    "solve_linear_programs",
]


def __dir__() -> list[str]:
    return __all__
