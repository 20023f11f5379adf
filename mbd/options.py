"""What may be asked of the rigid answer, by name; scenes are read without what answers."""

from __future__ import annotations

from enum import StrEnum


class Solver(StrEnum):
    """Names of the equilibrium solvers."""

    NEWTON = "newton"
    CLARABEL = "clarabel"


class Norm(StrEnum):
    """Norm that the force distribution minimises.

    ``force``: Σ λ², as the paper prints it; depends on the mesh. ``pressure``: Σ λ²/A, the rigid
    limit of a uniform elastic foundation; does not.
    """

    FORCE = "force"
    PRESSURE = "pressure"


class FrictionLaw(StrEnum):
    """How the Coulomb cone is represented."""

    CONE = "cone"
    """Second-order cone, exact."""
    PYRAMID = "pyramid"
    """Four-sided pyramid inside the cone: linear, a little weaker."""
