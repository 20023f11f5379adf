"""Sections of scenes with deformable blocks: material, contact, effects, and how to solve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    Field,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue

from fem.element.hexahedron import ElementType
from fem.element.material import Material
from fem.method import Explicit, Static
from fem.system.effects import BulkViscosity, RayleighDamping
from geometry.errors import is_number
from geometry.parts.options import OptionError
from mbd.options import Rigid, Stages
from validation.errors import InputError
from validation.scene.keys.quantities import (
    ACCELERATION,
    DENSITY,
    END_TIME,
    FRICTION,
    YOUNG_MODULUS,
)
from validation.scene.sections import (
    ContactSection,
    CutSection,
    Finite,
    LimitsSection,
    NoAngle,
    PicturesSection,
    PlausibilitySection,
    Positive,
    RigidSection,
    Section,
    StagesSection,
    Vector,
    gap_words,
    section_of,
    unset,
    vector_words,
)
from validation.scene.supports import (
    NOT_LOADS,
    SAME_SUPPORTS,
    PushSection,
    SupportSection,
    SurfaceLoadSection,
)

if TYPE_CHECKING:
    from fem.problem import Motion
    from geometry.assembly import Assembly


#: Loads that words on the load of a scene name.
_MOST_LOADS = 3

#: Materials that a scene can name.
MATERIALS: Mapping[str, Mapping[str, float]] = {
    "concrete": {"density": 2.4e-9, "young_modulus": 33000.0, "poisson_ratio": 0.2},
    "steel": {"density": 7.85e-9, "young_modulus": 210000.0, "poisson_ratio": 0.3},
}


def _known_material(name: str) -> str:
    if name not in MATERIALS:
        raise ValueError(f"expected one of {', '.join(MATERIALS)}, or constants in [material]")
    return name


#: Name of a material.
MaterialName = Annotated[
    str, AfterValidator(_known_material), Field(json_schema_extra={"enum": [*MATERIALS]})
]


_ABOUT = {"density": DENSITY, "young_modulus": YOUNG_MODULUS}
_MaterialKeys: Any = section_of(Material, about=_ABOUT)


class MaterialSection(_MaterialKeys):  # type: ignore[misc]
    """``[material]``: isotropic linear elasticity.

    ``material = "concrete"``, above the first section of a scene, is short for its constants.
    """

    name: MaterialName | None = None
    """A material whose constants are known; those that the scene gives replace its own."""

    @model_validator(mode="wrap")
    @classmethod
    def _by_name(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Take the constants of a material by its name; only given keys count as set."""
        given = {"name": data} if isinstance(data, str) else data
        name = given.get("name") if isinstance(given, Mapping) else None
        if name is None:
            return handler(given)
        known = MATERIALS.get(str(name), MATERIALS["concrete"])  # another name is wrong itself
        section = handler({**known, **given})
        object.__setattr__(section, "__pydantic_fields_set__", set(given))
        return section

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: Any, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Accept a name in place of the section, and require either a name or all constants."""
        section = handler(core)
        result = handler.resolve_ref_schema(section)
        constants = result.pop("required")
        result["anyOf"] = [{"required": ["name"]}, {"required": constants}]
        return {"anyOf": [{"enum": [*MATERIALS]}, section]}

    @property
    def words(self) -> str:
        """Its constants."""
        constants = f"{self.young_modulus:g} MPa, {self.poisson_ratio:g}, {self.density:g} t/mm³"
        return f"{self.name or 'material'} ({constants})"


class NamedMaterialSection(MaterialSection):
    """``[materials.NAME]``: a material of some blocks; the others are of ``[material]``.

    A known name, such as ``[materials.steel]``, has its constants.
    """

    blocks: tuple[Annotated[int, Field(ge=0)] | str, ...] = ()
    """Its blocks: numbers, counted from 0, or names of the files' objects; parts of files name
    their material themselves (``[[parts]] material``)."""

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: Any, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Constants of known names need not be given; which those are is checked by the scene."""
        section = handler(core)
        handler.resolve_ref_schema(section).pop("required")
        return section


_RayleighKeys: Any = section_of(RayleighDamping)
_BulkViscosityKeys: Any = section_of(BulkViscosity)


class RayleighSection(_RayleighKeys):  # type: ignore[misc]
    """``[effects.rayleigh]``: Rayleigh damping α M + β K; unlisted terms are inactive."""


class BulkViscositySection(_BulkViscosityKeys):  # type: ignore[misc]
    """``[effects.bulk_viscosity]``: as Abaqus/Explicit defines it."""


class FrictionSection(Section):
    """``[effects.friction]``: Coulomb friction with regularised stick."""

    coefficient: Annotated[Positive, NoAngle, FRICTION]
    """μ [-]"""
    stick_stiffness: Positive | None = None
    """Tangential stiffness while sticking [MPa/mm]; by default 30 E / length of a block."""


class EffectName(StrEnum):
    """Effects that can be decided, by the names that scenes use."""

    FRICTION = "friction"
    GRAVITY = "gravity"
    CLEARANCE = "clearance"
    """``contact.clearance``"""
    SPACING = "spacing"
    """``contact.spacing``"""
    ELASTIC_FRAME = "elastic_frame"
    FINITE_ROTATION = "finite_rotation"
    FINITE_SLIDING = "finite_sliding"
    RAYLEIGH = "rayleigh"
    BULK_VISCOSITY = "bulk_viscosity"


def parse_share(value: object) -> float | None:
    """Read ``1%``, ``"0.01"`` or 0.01 as a share between 0 and 1; None for anything else."""
    text = str(value).strip()
    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        return None
    return share if 0.0 < share < 1.0 and not isinstance(value, bool) else None


def stated_share(option: str, text: str) -> float:
    """Share that an option states."""
    share = parse_share(text)
    if share is None:
        raise InputError(f"{option} {text}: expected a share between 0 and 100 %, such as 1%")
    return share


class EffectsSection(Section):
    """``[effects]``: unlisted effects are inactive."""

    auto: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Share of p_max, p_eff and the largest displacement [-]; effects that change them by less are
    left out of the run."""

    rayleigh: RayleighSection | None = None
    bulk_viscosity: BulkViscositySection | None = None
    finite_rotation: bool = False
    """Blocks may turn by any angle, in explicit runs; static runs reject it."""
    gravity: Annotated[Vector | None, ACCELERATION] = None
    """Uniform acceleration [mm/s²]."""
    friction: FrictionSection | None = None
    finite_sliding: bool = False
    """General (segment-to-segment) contact: blocks may slide by more than a facet. Automatic for
    non-matching meshes."""
    elastic_frame: bool = False
    """Blocks of the boundary ring deform and are fixed at their outer faces; otherwise they are
    rigid."""

    @field_validator("friction", mode="before")
    @classmethod
    def _by_its_coefficient(cls, value: Any) -> Any:
        """Read ``friction = 0.4``."""
        return {"coefficient": value} if isinstance(value, int | float | str) else value

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: Any, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Accept a coefficient in place of the section of friction."""
        result = handler.resolve_ref_schema(handler(core))
        keys = result["properties"]
        keys["friction"] = {"anyOf": [keys["friction"], {"type": ["number", "string"]}]}
        return result


#: Methods by their names.
METHODS: Mapping[str, type[Static | Explicit]] = {"static": Static, "explicit": Explicit}


#: Keys of ``[fem]`` that say of which elements blocks are, whatever the method.
_ELEMENTS = ("element", "degree")
#: Fields of `Explicit` that sections of their own state.
EFFECTS_IN_TIME = ("rayleigh", "bulk_viscosity")
_FemKeys: Any = section_of(Static, Explicit, about={"end_time": END_TIME}, absent=EFFECTS_IN_TIME)


class FemSection(_FemKeys):  # type: ignore[misc]
    """``[fem]``: finite-element analysis of deformable blocks, static or explicit."""

    method: Literal["explicit", "static"] = "static"
    element: ElementType = ElementType.INCOMPATIBLE
    degree: Annotated[int, Field(ge=1, le=4)] = 1
    """Of the elements: 2, 3 or 4 for static runs, on the exact shape of blocks that have one."""
    symmetry: Literal["auto", "none", "sector", "periodic cell"] = "auto"
    """Sector: cyclic symmetry, exact for cyclic loads. Auto: sector where exact. Periodic cell: two
    layers represent the middle of a long tube."""
    max_work: Annotated[float, Field(gt=0)] | None = None
    """Work at most, counted in operations and stated as seconds on the reference machine [s]: the
    same meshes on every machine, and an explicit run ends at a checkpoint at the same step. By
    default 15 where contact is conforming, without friction or gaps, 40 elsewhere; no limit with an
    accuracy, nor for the state of ``mesh = "scene"`` or an explicit run."""
    max_seconds: Annotated[float, Field(gt=0)] | None = None
    """CPU time at most by the clock, on which meshes then depend [s]; the first mesh is finished
    whatever it takes, and an explicit run ends at a checkpoint. By default no limit."""
    frames: Annotated[int, Field(ge=0, le=10_000)] = 0
    """Frames written for ParaView, spread over what was run, the first and the end included; of a
    static run states under parts of the load, with friction those of its load steps."""

    @property
    def words(self) -> str:
        """How the blocks are solved."""
        return self.method

    @model_validator(mode="after")
    def _keys_of_its_method(self) -> Self:
        """Reject keys of the other method."""
        for key in self.model_fields_set & keys_of_other(self.method):
            other = next(name for name, kind in METHODS.items() if name != self.method)
            raise ValueError(f'fem.{key} needs fem.method = "{other}"; remove one of the two')
        try:
            _ = self.solver
        except OptionError as error:
            raise ValueError(f"fem.{error}") from None
        return self

    @property
    def solver(self) -> Static | Explicit:
        """The method itself, without the effects that sections of their own state."""
        kind = METHODS[self.method]
        given = {
            f.name: self.__dict__[f.name] for f in fields(kind) if f.name not in EFFECTS_IN_TIME
        }
        if self.symmetry == "periodic cell":
            given["symmetry"] = "auto"  # of the cell
        states = not self.model_fields_set.isdisjoint(_ELEMENTS)
        refines = self.accuracy is not None or self.max_meshes is not None
        if kind is Static and states and self.mesh is None and not refines:
            given["mesh"] = "scene"  # what states its elements is solved with these
        return kind(**given)


def keys_of_other(method: str) -> set[str]:
    """Keys of ``[fem]`` that a method does not have."""
    mine = {f.name for f in fields(METHODS[method])} | {"method", *_ELEMENTS}
    return set(FemSection.model_fields) - mine


class DeformableSections(Section):
    """Sections that every scene may have."""

    #: Whether frames at both ends may lock a short assembly whose blocks alone would not be.
    frames_may_lock: ClassVar[bool] = False

    plausibility: PlausibilitySection = unset(PlausibilitySection)
    pictures: PicturesSection = unset(PicturesSection)
    limits: LimitsSection = unset(LimitsSection)
    sections: tuple[CutSection, ...] = ()
    """Planes whose section forces are printed and written."""
    material: MaterialSection = MaterialSection.model_validate("concrete")
    materials: dict[str, NamedMaterialSection] = Field(default={})
    """Materials of some blocks by name."""
    contact: ContactSection = unset(ContactSection)
    effects: EffectsSection = unset(EffectsSection)
    fem: FemSection = unset(FemSection)
    rigid: RigidSection = unset(RigidSection)
    stages: StagesSection | None = None
    supports: tuple[SupportSection, ...] = ()
    """``[[supports]]``: parts of the surfaces that are held, moved or on springs."""
    loads: tuple[SurfaceLoadSection, ...] = ()
    """``[[loads]]``: on parts of the surfaces, along edges, on single blocks."""
    combinations: dict[str, dict[str, Finite]] = Field(default_factory=dict)
    """``[combinations.NAME]``: factors of loads by name; `fem --combinations` solves them."""

    @field_validator("combinations", mode="before")
    @classmethod
    def _factors_of_loads(cls, value: Any) -> Any:
        """Reject combinations that state supports of their own, and truth for a factor."""
        for name, factors in value.items() if isinstance(value, Mapping) else ():
            for key, factor in factors.items() if isinstance(factors, Mapping) else ():
                if key in NOT_LOADS and not is_number(factor):
                    raise ValueError(f"combinations.{name}.{key}: {SAME_SUPPORTS}")
                if isinstance(factor, bool):
                    raise ValueError(f"combinations.{name}.{key}: got {factor}; expected a number")
            if isinstance(factors, Mapping) and not factors:
                raise ValueError(
                    f"combinations.{name}: got no factors, so that nothing acts; expected some, "
                    "such as weight = 1.35, load = 1.5"
                )
        return value

    @field_validator("materials", mode="wrap")
    @classmethod
    def _known_by_their_name(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        """Give a section of a known name its constants; only given keys count as set."""
        given = value if isinstance(value, Mapping) else {}
        unnamed = {
            name: data
            for name, data in given.items()
            if isinstance(data, Mapping) and name in MATERIALS and "name" not in data
        }
        named = {name: {"name": name, **data} for name, data in unnamed.items()}
        result = handler({**given, **named} if named else value)
        for name, data in unnamed.items():
            object.__setattr__(result[name], "__pydantic_fields_set__", set(data))
        return result

    #: Whether blocks meet; else they are single bodies, and contact says nothing.
    meets: ClassVar[bool] = True

    #: Whether blocks stand on the bottom face of the first one, as boxes do: none is ground. To
    #: rigid blocks the first one counts as fixed, and what acts on it as what its support takes.
    stands: ClassVar[bool] = False

    @property
    def held_at_faces(self) -> bool:
        """Whether fixed blocks deform and are held at their outer faces; else they are rigid."""
        return self.stands or self.effects.elastic_frame

    @property
    def motion(self) -> Motion | None:
        """Motion at time 0; None: at rest."""
        return None

    @property
    def push(self) -> PushSection | None:
        """Block that is pushed; None: none."""
        return getattr(self.load, "push", None)  # type: ignore[attr-defined]

    @property
    def moves(self) -> bool:
        """Whether a support moves."""
        return self.push is not None or any(s.move and any(s.move) for s in self.supports)

    @property
    def method(self) -> Static | Explicit:
        """How deformable blocks are solved, with the effects of time integration."""
        solver = self.fem.solver
        return solver if isinstance(solver, Static) else self._with_effects(solver)

    @property
    def in_time(self) -> Explicit:
        """How they would be solved in time."""
        method = self.method
        return self._with_effects(Explicit()) if isinstance(method, Static) else method

    def _with_effects(self, solver: Explicit) -> Explicit:
        effects = self.effects
        rayleigh, bulk = effects.rayleigh, effects.bulk_viscosity
        return replace(
            solver,
            rayleigh=None if rayleigh is None else RayleighDamping(**rayleigh.model_dump()),
            bulk_viscosity=None if bulk is None else BulkViscosity(**bulk.model_dump()),
        )

    @property
    def damping(self) -> str:
        """Damping of an explicit run, stated or by default; "none" of a static one."""
        method = self.method
        if isinstance(method, Static):
            return "none"
        return method.damped(moves=self.motion is not None)

    @property
    def rigid_method(self) -> Rigid:
        """What is asked of rigid blocks: ``[rigid]``, and ``[stages]``."""
        stages = None if self.stages is None else Stages(**self.stages.model_dump())
        return Rigid(**self.rigid.model_dump(), stages=stages)

    @property
    def is_cell(self) -> bool:
        """Whether a periodic cell is asked for."""
        return self.fem.symmetry == "periodic cell"

    @property
    def gap_words(self) -> str:
        """Gaps before the load acts, to follow other words; nothing where there are none."""
        return gap_words(self.contact) if self.meets else ""

    @property
    def caution(self) -> str | None:
        """What of the scene is unusual though it has an answer; None where nothing is."""
        return None

    @property
    def load_words(self) -> str:
        """The load with its size."""
        load: Any = self.load  # type: ignore[attr-defined]
        weight = self.effects.gravity
        if isinstance(load, dict):
            parts = [f"{part.words} on {face}" for face, part in load.items()]
        else:
            parts = [load.words]
        if weight is not None:
            parts.append(f"weight {vector_words(weight)} mm/s²")
        parts += [one.words for one in self.loads[:_MOST_LOADS]]
        if len(self.loads) > _MOST_LOADS:
            parts.append(f"{len(self.loads) - _MOST_LOADS} more loads")
        parts += filter(None, (one.moved_words for one in self.supports))
        return " + ".join(filter(None, parts)) or "no load"

    def straightened(self, assembly: Assembly) -> bool:  # noqa: ARG002
        """Whether files have nodes between corners that elements of degree 1 leave out."""
        return False
