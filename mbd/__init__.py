"""Rigid blocks: contact Jacobian, equilibrium by LP and QP, mechanism classes, measures."""

from geometry.measures import BlockMeasures, Measures, block_measures, measures
from mbd.analysis import RigidResult, analyse
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
from mbd.options import Norm, Solver

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
    "solve_linear_programs",
]
