"""What may be asked of the rigid answer, by name; scenes are read without what answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from numbers import Integral
from typing import Annotated, ClassVar, Literal

from annotated_types import Gt

from geometry.parts.options import OptionError, check


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


class Along(StrEnum):
    """Which way props push."""

    UP = "up"
    """Upward, at corners of the free underside of a block."""
    NORMAL = "normal"
    """Along the normals of the free faces of the underside: a centering."""


#: What an order of construction may be.
ORDER = "expected a list of blocks by number or name, of one stage in a list; 'layers' or 'found'"


def is_order(value: object) -> bool:
    """Whether a value may be an order of construction, of any blocks."""
    if isinstance(value, str):
        return value in {"layers", "found"}
    if not isinstance(value, list | tuple):
        return False
    every = [one for each in value for one in (each if isinstance(each, list | tuple) else [each])]
    return all(isinstance(one, Integral | str) and not isinstance(one, bool) for one in every)


@dataclass(frozen=True, kw_only=True)
class Stages:
    """In which order blocks are placed, and what may be propped."""

    order: Literal["layers", "found"] | tuple[int | str | tuple[int | str, ...], ...] = "layers"
    """Blocks by number or name, each a stage, or a list of them for one stage; fixed blocks that it
    does not name are there from the start. ``layers``: blocks of one layer of a tube, of one height
    else, the lowest first. ``found``: the reverse of the order in which they come out."""
    props: tuple[int | str, ...] | None = None
    """Numbers or names of the blocks that may be propped; by default any."""
    along: Along = Along.UP
    """``up`` or ``normal``."""

    def __post_init__(self) -> None:
        if not is_order(self.order):
            raise OptionError(f"order: got {self.order!r}; {ORDER}")
        check(self)


@dataclass(frozen=True, kw_only=True)
class Rigid:
    """Rigid-block analysis: what it minimises, and what it finds beside the equilibrium."""

    name: ClassVar[str] = "rigid"

    norm: Norm = Norm.PRESSURE
    """``pressure`` does not depend on the mesh; ``force`` is the paper's, and does."""
    solver: Solver = Solver.NEWTON
    """``newton`` (ours) or ``clarabel``."""
    friction_law: FrictionLaw = FrictionLaw.CONE
    """``cone`` (exact) or ``pyramid`` (linear, inside the cone)."""
    collapse: bool = False
    """Limit analysis: collapse load factor of the variable load (associated friction)."""
    sliding: bool = False
    """Non-associated limit load: joints slide without opening."""
    ranges: bool = False
    """Smallest and largest normal force of each joint over all admissible states."""
    margin: bool = False
    """Interlocking margin: the load on a single block that is carried worst."""
    take_out: bool = False
    """Which block comes out by a straight motion, and in which order all do."""
    stages: Stages | None = None
    """Whether each stage of the construction stands, and its least propping; None: not judged."""
    max_work: Annotated[float, Gt(0)] = 60.0
    """Work at most of what is computed beside the equilibrium, counted in operations and stated as
    seconds on the reference machine [s]: the same rows on every machine."""
    max_seconds: Annotated[float, Gt(0)] | None = None
    """The same by the clock, CPU time [s]; by default no limit."""
    max_memory: Annotated[float, Gt(0)] = 4.0
    """Memory that the answer may take, pictures apart: what needs more is not started [GB]."""

    def __post_init__(self) -> None:
        check(self)

    @property
    def asks_more(self) -> bool:
        """Whether anything is to be found beside the equilibrium."""
        return self.collapse or self.sliding or self.ranges or self.margin
