"""Sections of what holds, moves and loads parts of the surfaces of blocks."""

from __future__ import annotations

from itertools import permutations
from typing import Annotated, Literal, get_args

from pydantic import Field, field_validator, model_validator

from validation.scene.keys.quantities import PRESSURE
from validation.scene.sections import Finite, Positive, Section, Vector, vector_words

Axis = Literal["x", "y", "z"]
#: Axes along which a support may hold, in any order.
_AXES = tuple(few for n in (1, 2, 3) for few in permutations(get_args(Axis), n))
#: What all combinations share, and keys by which others are tried.
SAME_SUPPORTS = (
    "combinations differ in factors of loads alone; expected the same supports and motions in all "
    "of them: state other supports in a scene of their own"
)
#: Names of the weight and of ``[load]`` in combinations.
WEIGHT, LOAD = "weight", "load"
NOT_LOADS = ("supports", "fixed", "push", "move")
#: A number counted from 0, or a name from the file.
BlockName = Annotated[int, Field(ge=0)] | str


class PlaneSection(Section):
    """A plane, by a coordinate such as ``{z = 0.0}`` or by a point and a normal."""

    x: Finite | None = None
    """[mm]"""
    y: Finite | None = None
    """[mm]"""
    z: Finite | None = None
    """[mm]"""
    point: Vector | None = None
    """[mm]"""
    normal: Vector | None = None

    @model_validator(mode="after")
    def _one_way(self) -> PlaneSection:
        given = [name for name in "xyz" if getattr(self, name) is not None]
        both = self.point is not None and self.normal is not None
        if (len(given) == 1) == both or (self.point is None) != (self.normal is None):
            raise ValueError(
                "plane: expected one coordinate, such as {z = 0.0}, or point and normal"
            )
        if self.normal is not None and not any(self.normal):
            raise ValueError("plane.normal: got [0, 0, 0], expected a direction")
        return self


class RegionSection(Section):
    """Part of the surface of some blocks: by name, by a plane or in a box."""

    blocks: Annotated[tuple[BlockName, ...] | None, Field(min_length=1)] = None
    """Numbers, or names from the file; by default all blocks that have the region and are not
    fixed."""
    face: str | None = None
    """Name of a face, such as ``inner`` or ``z+``."""
    plane: PlaneSection | None = None
    """What of the surface lies on a plane."""
    box: tuple[Vector, Vector] | None = None
    """What of the surface lies in a box: its least and its largest coordinates [mm]."""

    @property
    def regions(self) -> list[str]:
        """Keys that say where."""
        return [name for name in ("face", "plane", "box") if getattr(self, name) is not None]


class SupportSection(RegionSection):
    """``[[supports]]``: a part of the surface that is held, moved or on springs."""

    name: str = ""
    """In the table of reactions; by default the region."""
    hold: tuple[Axis, ...] | Literal["normal"] = ("x", "y", "z")
    """Directions that are held: axes in a list, or the ``normal`` of a flat region (a roller)."""
    spring: Positive | None = None
    """Springs to the ground along these directions, stiffness per area [N/mm³]."""
    move: Vector | None = None
    """By which the held directions move, after the load; a part across them is rejected [mm]."""
    path: tuple[tuple[Finite, Finite], ...] = ()
    """Times [s] and shares of ``move``, straight between; by default from 0 to 1."""

    @field_validator("hold", mode="before")
    @classmethod
    def _are_directions(cls, hold: object) -> object:
        axes = list(hold) if isinstance(hold, list | tuple) else []
        if hold != "normal" and not any(axes == list(few) for few in _AXES):
            raise ValueError('expected some of "x", "y", "z" in a list, each once, or "normal"')
        return hold

    @property
    def moved_words(self) -> str:
        """By how much it moves, and which; empty where it stays."""
        if not (self.move and any(self.move)):
            return ""
        where = self.name or self.face or f"on {'a plane' if self.plane else 'a box'}"
        return f"support {where} moved by {vector_words(self.move)} mm"

    @model_validator(mode="after")
    def _one_statement(self) -> SupportSection:
        if len(self.regions) != 1:
            raise ValueError(
                f"supports: got {' and '.join(self.regions) or 'no region'}; expected one of face, "
                "plane, box"
            )
        if self.spring is not None and self.move is not None:
            raise ValueError("supports: got spring and move; expected one of the two")
        if self.path and self.move is None:
            raise ValueError("supports.path: got a path without move; expected both")
        times = [time for time, _ in self.path]
        late = bool(times) and (times[0] < 0.0 or self.path[0][1] != 0.0)
        if late or len(times) == 1 or times != sorted(set(times)):
            raise ValueError(
                f"supports.path: got {[list(row) for row in self.path]}; expected two rows at "
                "least, increasing times and a first share of 0"
            )
        return self


class SurfaceLoadSection(RegionSection):
    """``[[loads]]``: a load on a part of the surface, along an edge or on a block."""

    name: str = ""
    """For ``[combinations]``."""
    pressure: Annotated[Finite | None, PRESSURE] = None
    """Towards the inside [MPa]."""
    traction: Vector | None = None
    """Force per area [MPa]."""
    force: Vector | None = None
    """Force in all, spread evenly over the region; without a region on the block as a whole, at
    ``point`` [N]."""
    point: Vector | None = None
    """Where a force on a block acts [mm]; by default its centre of mass."""
    line: tuple[Vector, Vector] | None = None
    """Ends of an edge that carries ``per_length`` [mm]."""
    per_length: Vector | None = None
    """Force per length along the line [N/mm]."""

    @field_validator("name")
    @classmethod
    def _a_factor_of_its_own(cls, value: str) -> str:
        if value in (WEIGHT, LOAD):
            of = "effects.gravity" if value == WEIGHT else "[load] and of loads without a name"
            raise ValueError(
                f"the factor {value} of combinations is that of {of}; expected another name"
            )
        return value

    @model_validator(mode="after")
    def _one_load(self) -> SurfaceLoadSection:
        kinds = ("pressure", "traction", "force", "per_length")
        given = [name for name in kinds if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"loads: got {' and '.join(given) or 'no load'}; expected one of {', '.join(kinds)}"
            )
        if (self.line is None) != (self.per_length is None):
            raise ValueError("loads: line and per_length belong together; expected both")
        regions = len(self.regions) + (self.line is not None)
        whole = self.force is not None and regions == 0
        if not whole and regions != 1:
            raise ValueError(
                f"loads: got {' and '.join(self.regions) or 'no region'}; expected one of face, "
                "plane, box, line"
            )
        if self.point is not None and not whole:
            raise ValueError(
                "loads.point: a force at a point acts on a block as a whole; remove the region"
            )
        if whole and (self.blocks is None or len(self.blocks) != 1):
            raise ValueError("loads.force: without a region: expected blocks = [one block]")
        return self

    @property
    def words(self) -> str:
        """The load with its size."""
        if self.pressure is not None:
            size = f"pressure {self.pressure:g} MPa"
        elif self.traction is not None:
            size = f"traction {vector_words(self.traction)} MPa"
        elif self.force is not None:
            size = f"force {vector_words(self.force)} N"
            size += "" if self.regions or self.blocks is None else f" on block {self.blocks[0]}"
        else:
            assert self.per_length is not None
            size = f"line load {vector_words(self.per_length)} N/mm"
        return f"{self.name}: {size}" if self.name else size


class PushSection(Section):
    """``[load] push``: a block that a flat punch pushes, by displacement."""

    block: BlockName
    """Number, or name from the file."""
    direction: Vector = (0.0, 0.0, -1.0)
    distance: Positive
    """[mm]"""

    @model_validator(mode="after")
    def _a_direction(self) -> PushSection:
        if not any(self.direction):
            raise ValueError("load.push.direction: got [0, 0, 0], expected a direction")
        return self

    @property
    def words(self) -> str:
        """What is pushed how far."""
        return f"block {self.block} pushed by {self.distance:g} mm"
