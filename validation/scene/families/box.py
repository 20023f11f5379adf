"""Single boxes, ``[block] type = "box"``: an assembly whose blocks do not meet."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from validation.scene.family import AssemblyScene, family
from validation.scene.keys.quantities import SIZE
from validation.scene.sections import Finite, Section, Vector, vector_words

if TYPE_CHECKING:
    from fem.problem import Motion
    from geometry.assembly import Assembly
    from geometry.loads import FaceLoad, LoadCase
    from geometry.mesh import IntArray

FaceName = Literal["x-", "x+", "y-", "y+", "z-", "z+"]


class FaceLoadSection(Section):
    """Load on one face of a box."""

    pressure: Finite | None = None
    """Pressure, positive towards the inside [MPa]."""
    traction: Vector | None = None
    """Force per area in world axes [MPa]."""

    @model_validator(mode="after")
    def _one_of_two(self) -> FaceLoadSection:
        if (self.pressure is None) == (self.traction is None):
            raise ValueError("expected either pressure or traction, one of the two")
        return self

    @property
    def words(self) -> str:
        """The load with its size."""
        if self.traction is None:
            return f"pressure {self.pressure:g} MPa"
        return f"traction {vector_words(self.traction)} MPa"


class InitialSection(Section):
    """``[initial]``: motion at time 0."""

    velocity: Vector = (0.0, 0.0, 0.0)
    """[mm/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """About the centroid [rad/s]."""


class BoxScene(AssemblyScene):
    """One deformable box, or several uncoupled copies of it."""

    meets: ClassVar[bool] = False

    load: dict[FaceName, FaceLoadSection] = Field(default_factory=dict)
    initial: InitialSection | None = None

    @model_validator(mode="after")
    def _no_contact(self) -> BoxScene:
        for name in ("contact", "rigid"):
            if name in self.model_fields_set:
                raise ValueError(f"{name}: a single box touches none; remove it")
        if self.effects.auto is not None:
            raise ValueError(
                "effects.auto compares contact pressures, and a single box has no contact; remove "
                "it"
            )
        for name in ("friction", "finite_sliding", "elastic_frame"):
            if getattr(self.effects, name):
                raise ValueError(
                    f"effects.{name} acts between blocks, and a single box touches none; remove it"
                )
        if self.fem.symmetry not in ("auto", "none"):
            raise ValueError(
                f'fem.symmetry: got "{self.fem.symmetry}", which is one of tubes; expected "auto" '
                "or nothing"
            )
        if self.initial is not None and self.fem.method == "static":
            raise ValueError(
                'initial: got a motion beside fem.method = "static", which has none; remove it or '
                'set fem.method = "explicit"'
            )
        return self

    @property
    def motion(self) -> Motion | None:
        """Motion at time 0; None: at rest."""
        from fem.problem import Motion

        given = self.initial
        if given is None or not any((*given.velocity, *given.angular_velocity)):
            return None
        return Motion(np.array(given.velocity), np.array(given.angular_velocity))

    def build_load(self, assembly: Assembly) -> LoadCase:
        """Load the faces that are named, of every copy."""
        from geometry.loads import LoadCase

        blocks = np.arange(assembly.n_blocks)
        faces = tuple(self._face_load(blocks, face) for face in self.load)
        return LoadCase(assembly, "faces", faces, assembly.fixed)

    def _face_load(self, blocks: IntArray, face: FaceName) -> FaceLoad:
        from geometry.loads import PressureLoad, TractionLoad

        load = self.load[face]
        if load.pressure is None:
            return TractionLoad(blocks, face, np.array(load.traction))
        return PressureLoad(blocks, face, load.pressure, self.effects.finite_rotation)


family(
    BoxScene,
    "box",
    "geometry.families.boxes:SeparateBoxes",
    assembly="copies",
    mesh="divisions",
    default={"divisions": (8, 4, 4)},
    about={"size": SIZE},
)
