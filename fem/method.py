"""How deformable blocks are solved: a static state, or explicit dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le, Lt

from fem.system.effects import (
    LEAST_FACTOR,
    SAFETY_FACTOR,
    AdaptiveMassDamping,
    BulkViscosity,
    Effects,
    RayleighDamping,
    paper_rayleigh,
)
from geometry.mesh import FloatArray
from geometry.parts.options import OptionError, check

#: Largest number of load steps, and of frames.
_MOST = 10_000


@dataclass(frozen=True, kw_only=True)
class Static:
    """Static state by Newton's method."""

    name: ClassVar[str] = "static"

    mesh: Literal["converged", "scene"] | None = None
    """Converged: finer and finer meshes until error bars are narrow; the mesh of the problem then
    gives the facets of p_eff, p_max and p_max_facet. Scene: the elements of the problem. None:
    converged, unless the problem states an element or a degree, or cannot be refined."""
    accuracy: Mapping[str, Annotated[float, Gt(0), Lt(1)]] | None = None
    """Relative error bars [-] by measure, such as ``{"p_max_point": 0.03}``; by default 5 % of
    displacement, p_eff, pressure at a point and averaged tension, with friction 10 % of all but the
    pressure at a point, within ``max_work``."""
    max_work: Annotated[float, Gt(0)] | None = None
    """Work at most, counted in operations and stated as seconds on the reference machine [s]: the
    same meshes on every machine. By default 15 where contact is conforming, without friction or
    gaps, 40 elsewhere, and 0.12 for each free block at least; no limit with an accuracy, nor for
    the state of mesh = "scene"."""
    max_seconds: Annotated[float, Gt(0)] | None = None
    """CPU time at most by the clock, on which meshes then depend [s]; the first mesh is finished
    whatever it takes. By default no limit."""
    max_memory: Annotated[float, Gt(0)] = 4.0
    """Memory that the matrices of one computation may take [GB]: what needs more is not started.
    The program itself, meshes and results come on top."""
    error_estimate: bool = True
    """Whether measures on the mesh of the problem have error bars, from two coarser meshes: a
    quarter more time."""
    max_meshes: Annotated[int, Ge(1)] | None = None
    """Meshes at most, from coarse to fine: designs that are compared have the same ones with an
    accuracy that these do not reach. One has no error bars. By default no limit."""
    load_steps: Annotated[int, Ge(1), Le(_MOST)] | None = None
    """Number of equal load steps; with friction their load factors are squares. By default one;
    with friction doubled until p_max, p_eff and the displacement change by less than 1 %."""
    motion_steps: Annotated[int, Ge(1), Le(_MOST)] = 20
    """Number of steps of supports that move, after the load."""
    symmetry: Literal["auto", "none", "sector"] = "auto"
    """Sector: cyclic symmetry, exact for cyclic loads. Auto: sector where exact."""
    frames: Annotated[int, Ge(0), Le(_MOST)] = 0
    """Frames written for ParaView: states under parts of the load, with friction those of its load
    steps."""

    def __post_init__(self) -> None:
        check(self)
        for name in ("accuracy", "max_meshes"):
            if self.mesh == "scene" and getattr(self, name) is not None:
                raise OptionError(
                    f'{name}: got one beside mesh = "scene", which is one mesh; expected one of '
                    "the two"
                )


@dataclass(frozen=True, kw_only=True)
class Explicit:
    """Explicit dynamics by central differences."""

    name: ClassVar[str] = "explicit"

    end_time: Annotated[float, Gt(0)] | None = None
    """End of the run [s], with damping = "static" the latest end; by default from the lowest
    excited frequency."""
    ramp_time: Annotated[float, Ge(0)] | None = None
    """Duration of the smooth step of the load [s]; 0: at once; by default from the lowest excited
    frequency."""
    damping: Literal["none", "paper", "static"] | None = None
    """Static: adaptive mass damping, a numerical device; stops on the force residual. Paper: α = 2
    /s, β = 1e-8 s and bulk viscosity, as the paper's Abaqus runs. By default static, unless an end,
    a start motion or mass-proportional damping is stated: then none."""
    residual: Annotated[float, Gt(0)] = 1.0e-4
    """Relative force residual at which a run with damping = "static" stops [-]."""
    time_step: Annotated[float, Gt(0)] | None = None
    """Time step [s]; by default safety_factor times the critical time step."""
    safety_factor: Annotated[float, Ge(LEAST_FACTOR), Le(1)] = SAFETY_FACTOR
    """Time step over the critical one [-]."""
    threads: Annotated[int, Ge(1)] = 1
    """Of the loops; the bits of the answer do not depend on it."""
    symmetry: Literal["auto", "none", "sector"] = "auto"
    """Sector: cyclic symmetry, exact for cyclic loads. Auto: sector where exact."""
    frames: Annotated[int, Ge(0), Le(_MOST)] = 0
    """Frames written for ParaView, spread over what was run, the first and the end included."""
    sample_interval: Annotated[int, Ge(1)] = 50
    """Increments between two samples of the energies."""
    max_work: Annotated[float, Gt(0)] | None = None
    """Work of the run, counted in operations and stated as seconds on the reference machine [s]: it
    ends at a checkpoint, at the same step on every machine. By default no limit."""
    max_seconds: Annotated[float, Gt(0)] | None = None
    """CPU time of the run [s], at which it ends at a checkpoint; by default no limit."""
    max_memory: Annotated[float, Gt(0)] = 4.0
    """Memory that the run may take [GB]: what needs more is not started."""
    rayleigh: RayleighDamping | None = None
    """Rayleigh damping; in scenes ``[effects.rayleigh]``."""
    bulk_viscosity: BulkViscosity | None = None
    """Bulk viscosity; in scenes ``[effects.bulk_viscosity]``."""

    def __post_init__(self) -> None:
        check(self)

    def damped(self, *, moves: bool = False) -> Literal["none", "paper", "static"]:
        """Its damping, stated or by default; ``moves``: whether blocks move at the start."""
        if self.damping is not None:
            return self.damping
        by_mass = self.rayleigh is not None and self.rayleigh.mass_proportional is not None
        return "none" if moves or by_mass or self.end_time is not None else "static"

    def effects(
        self,
        *,
        moves: bool = False,
        finite_rotation: bool = False,
        gravity: FloatArray | None = None,
    ) -> Effects:
        """Its effects of time integration, beside finite rotation and gravity (3,) [mm/s²]."""
        damping, rayleigh, viscosity = self.damped(moves=moves), self.rayleigh, self.bulk_viscosity
        if damping == "paper":
            rayleigh, viscosity = rayleigh or paper_rayleigh(), viscosity or BulkViscosity()
        return Effects(
            rayleigh=rayleigh,
            bulk_viscosity=viscosity,
            finite_rotation=finite_rotation,
            gravity=gravity,
            adaptive_mass_damping=AdaptiveMassDamping() if damping == "static" else None,
        )


def require_method(given: object, kind: type, call: str) -> None:
    """Reject another method than the one that a call solves by.

    Raises
    ------
    OptionError
        What was got.
    """
    if not isinstance(given, kind):
        raise OptionError(
            f"{call}: got a {type(given).__name__}; expected a method {kind.__name__}(...)"
        )
