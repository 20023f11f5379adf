"""Sections of scenes with deformable blocks: material, contact, effects, and how to solve."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, cast

from pydantic import (
    Field,
    GetJsonSchemaHandler,
    create_model,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue

from fem.contact.law import LAWS, ContactLaw
from fem.element.hexahedron import ElementType
from fem.problem.formulation import Formulation
from validation.scene.docstrings import field_docstrings
from validation.scene.sections import (
    NoAngle,
    NonNegative,
    Positive,
    Section,
    Vector,
    WholeScene,
    fewer,
)
from validation.scene.usage import uncounted

if TYPE_CHECKING:
    from fem.assembly.statement import Motion
    from geometry.assembly import Assembly


class MaterialSection(Section):
    """``[material]``: isotropic linear elasticity."""

    density: Positive
    """[t/mm³]"""
    young_modulus: Positive
    """[MPa]"""
    poisson_ratio: Annotated[float, Field(gt=-1.0, lt=0.5, allow_inf_nan=False)]
    """[-]"""
    averaging_radius: Positive = 10.0
    """Radius of the ball over which tension is averaged, for concrete of the order of its
    aggregate [mm]."""


def _law_keys() -> dict[str, Any]:
    """Keys of all contact laws: None where a law has no finite constant of its own."""
    keys: dict[str, Any] = {"law": (Literal[tuple(LAWS)], "exponential")}
    for law in LAWS.values():
        about = field_docstrings(cast("type", law))
        for constant in fields(law):
            own = constant.default is not MISSING and math.isfinite(constant.default)
            kind, default = (Positive, constant.default) if own else (Positive | None, None)
            field = Field(default, description=about[constant.name])
            keys[law.keys.get(constant.name, constant.name)] = (kind, field)
    return keys


_LawKeys: Any = create_model("_LawKeys", __base__=Section, **_law_keys())


class ContactSection(_LawKeys):  # type: ignore[misc]
    """``[contact]``: soft contact between blocks."""

    clearance: NonNegative = 0.0
    """Gap along the normal of every facet before the load acts [mm]: blocks made too small by
    half of it."""
    spacing: NonNegative = 0.0
    """Distance by which neighbouring blocks are moved apart before the load acts, their size kept
    [mm], as the paper's group did: inclined joints open by less or more. Both add up."""

    @property
    def built(self) -> ContactLaw:
        """The law itself.

        Raises
        ------
        ContactLawError
            For constants that make no law.
        """
        law = LAWS[self.law]
        given = {c.name: getattr(self, law.keys.get(c.name, c.name)) for c in fields(law)}
        return law(**{name: value for name, value in given.items() if value is not None})

    @property
    def opened(self) -> bool:
        """Whether gaps are to be closed before blocks press on each other."""
        return self.clearance > 0.0 or self.spacing > 0.0

    @model_validator(mode="before")
    @classmethod
    def _which_gap(cls, data: Any) -> Any:
        """Refuse the key that meant one gap to the solver and another one to a deck."""
        if isinstance(data, dict) and "initial_clearance" in data:
            value = data["initial_clearance"]
            raise ValueError(
                f"contact.initial_clearance: got {value!r}, which meant two things; write "
                f"contact.clearance = {value} (a gap along every normal, as runs took it) or "
                f"contact.spacing = {value} (blocks moved apart, as decks wrote it)"
            )
        return data

    @model_validator(mode="after")
    def _constants_of_its_law(self) -> ContactSection:
        """Refuse constants that the law lacks, and those of another one."""
        for law in sorted(LAWS.values(), key=lambda law: law.name != self.law):
            for constant in fields(law):
                key = law.keys.get(constant.name, constant.name)
                field = type(self).model_fields[key]
                given = field.default is not None or getattr(self, key) is not None
                if law.name == self.law and not given and constant.default is MISSING:
                    unit = str(field.description).rpartition(" ")[2].rstrip(".")
                    raise ValueError(
                        f'contact.{key} is missing: the law "{law.name}" needs it {unit}'
                    )
                if law.name != self.law and given and field.default is None:
                    raise ValueError(
                        f'contact.{key} belongs to law = "{law.name}"; remove one of the two'
                    )
        return self


class RayleighSection(Section):
    """``[effects.rayleigh]``: viscous damping α M + β K; what is not named is absent."""

    mass_proportional: NonNegative | None = None
    """α [1/s]"""
    stiffness_proportional: NonNegative | None = None
    """β [s]"""


class BulkViscositySection(Section):
    """``[effects.bulk_viscosity]``: as Abaqus/Explicit defines it."""

    linear_bulk_viscosity: NonNegative = 0.06
    quadratic_bulk_viscosity: NonNegative = 1.2


class FrictionSection(Section):
    """``[effects.friction]``: Coulomb friction with regularised stick."""

    coefficient: Annotated[Positive, NoAngle]
    """μ [-]"""
    stick_stiffness: Positive | None = None
    """Tangential slope while sticking [MPa/mm]; None: the solver's default."""


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


class AutoSection(Section):
    """``[effects.auto]``: leave out what changes the answer by less than a tolerance."""

    tolerance: Annotated[float, Field(gt=0, lt=1)] = 0.01
    """Of p_max, p_eff and the largest displacement, relative [-]; also "1%"."""
    decide: tuple[EffectName, ...] | None = None
    """What is decided; None: every effect with a value, and those that need none and are not
    written in the scene."""
    keep: tuple[EffectName, ...] = ()
    """What stays as the scene says, whatever a probe finds."""

    @field_validator("tolerance", mode="before")
    @classmethod
    def _share(cls, value: object) -> object:
        share = parse_share(value)
        return value if share is None else share

    @model_validator(mode="after")
    def _either_or(self) -> AutoSection:
        both = set(self.decide or ()) & set(self.keep)
        if both:
            raise ValueError(
                f"effects.auto: {', '.join(sorted(both))} is in decide and in keep; expected one"
            )
        return self


class EffectsSection(Section):
    """``[effects]``: each absent unless named here."""

    auto: AutoSection | None = None
    """Decide which effects matter before the run; ``auto = 0.01`` is short for a tolerance."""

    rayleigh: RayleighSection | None = None
    bulk_viscosity: BulkViscositySection | None = None
    finite_rotation: bool = False
    gravity: Vector | None = None
    """Uniform acceleration [mm/s²]."""
    friction: FrictionSection | None = None
    finite_sliding: bool = False
    """Blocks may slide by more than a facet: a search finds opposing faces. On by itself
    where joints do not match."""
    elastic_frame: bool = False
    """Frame blocks deform and are held at their outer faces; else they are rigid."""

    @model_validator(mode="before")
    @classmethod
    def _written_as_auto(cls, data: Any) -> Any:
        """Read ``auto = 0.01``, ``elastic_frame = "auto"`` and ``when = "auto"`` beside values."""
        if not isinstance(data, dict):
            return data
        data = dict(data)
        given = data.get("auto")
        if isinstance(given, bool):
            given = {} if given else None
        elif isinstance(given, int | float | str):
            given = {"tolerance": given}
        named = []
        for key, value in list(data.items()):
            if key in set(EffectName) and value == "auto":
                named.append(key)
                del data[key]
            elif key in set(EffectName) and isinstance(value, dict) and "when" in value:
                if value["when"] != "auto":
                    raise ValueError(f'{key}.when: got {value["when"]!r}; expected "auto"')
                named.append(key)
                data[key] = {k: v for k, v in value.items() if k != "when"}
        if named:
            given = dict(given or {}) if isinstance(given, dict | None) else given
            if isinstance(given, dict):
                given["decide"] = [*(given.get("decide") or ()), *named]
        data["auto"] = given
        return data

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: Any, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Add the short ways of writing to the schema that editors use."""
        found = handler.resolve_ref_schema(handler(core))
        keys = found["properties"]
        when = {"type": "object", "required": ["when"], "properties": {"when": {"const": "auto"}}}
        for name in set(EffectName) & set(keys):
            keys[name] = {"anyOf": [keys[name], {"const": "auto"}, when]}
        keys["auto"] = {"anyOf": [keys["auto"], {"type": ["number", "string", "boolean"]}]}
        return found


class Method(StrEnum):
    """How a scene is solved."""

    EXPLICIT = "explicit"
    STATIC = "static"


class Damping(StrEnum):
    """Damping mode of an explicit run towards a static state."""

    PAPER = "paper"
    """α = 2 /s, β = 1e-8 s and bulk viscosity, as the paper's Abaqus runs."""
    STATIC = "static"
    """Adaptive mass damping, a numerical device; stops on the force residual."""


class FemSection(Section):
    """``[fem]``: how the deformable blocks are solved."""

    method: Method = Method.EXPLICIT
    element: ElementType = ElementType.INCOMPATIBLE
    degree: Annotated[int, Field(ge=1, le=4)] = 1
    """Of the elements: 2, 3 or 4 for static runs, on the exact shape of blocks that have one."""
    formulation: Formulation = Formulation.SHARED_STIFFNESS
    """Of an explicit run on boxes: "shared stiffness", or "rate form", the slow C3D8R reference."""
    end_time: Positive | None = None
    """End of an explicit run [s]; with damping = "static" the latest end."""
    ramp_time: NonNegative | None = None
    """Duration of the smooth step that applies the load [s]; 0: at once; None: recommended."""
    damping: Damping | None = None
    """None: only the effects that ``[effects]`` names."""
    residual: Positive = 1.0e-4
    """Relative force residual at which a run with damping = "static" stops."""
    load_steps: Annotated[int, Field(ge=1)] | None = None
    """Parts in which a static run applies the load, equal ones; with friction, where the way to the
    load matters, their squares. None: one; with friction doubled until that changes p_max, p_eff
    and the displacement by less than 1 %."""
    time_step: Positive | None = None
    """[s]; None: safety_factor times the critical time step."""
    safety_factor: Annotated[float, Field(gt=0, le=1)] = 0.9
    mass_scaling: Annotated[float, Field(ge=1, allow_inf_nan=False)] | None = None
    """Of an explicit run: step that every element is to allow, over the shortest; None: absent."""
    precision: Literal["float64", "float32"] = "float64"
    threads: Annotated[int, Field(ge=1)] = 1
    symmetry: Literal["auto", "none", "sector", "periodic cell"] = "auto"
    """Sector: one block of each layer stands for all; exact for cyclic loads. Auto: where exact.
    Periodic cell: two layers stand for the middle of a long tube."""
    frames: Annotated[int, Field(ge=0)] = 0
    """Frames written for ParaView, spread over what was run, the first and the end included; of a
    static run the load steps, of which there are then at least as many."""
    error_estimate: bool = True
    """Whether `tubelock fem` solves two coarser meshes to estimate the error of every measure: a
    quarter more time."""
    sample_interval: Annotated[int, Field(ge=1)] = 50
    """Steps between two samples of the energies."""


class DeformableSections(WholeScene):
    """Sections of scenes whose blocks may also be deformable; not needed for the rigid answer."""

    material: MaterialSection | None = None
    contact: ContactSection | None = None
    effects: EffectsSection = EffectsSection()
    fem: FemSection | None = None

    #: Whether blocks meet; else they are single bodies, and contact says nothing.
    meets: ClassVar[bool] = True

    @property
    def motion(self) -> Motion | None:
        """Motion at time 0; None: at rest."""
        return None

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:  # noqa: ARG002
        """Values of ``[mesh]`` with at most so many elements; none where meshes are given.

        Parameters
        ----------
        wave
            Along a wave of the joints, or along an edge.
        through
            Through the thickness.
        other
            In the direction that is left.
        """
        return {}

    def fewer_elements(self, share: float) -> dict[str, Any]:  # noqa: ARG002
        """Values of ``[mesh]`` with about that share of the elements along every edge.

        Waves keep whole numbers of elements.
        """
        return {}

    def coarser(self, share: float) -> Self | None:
        """Return the scene with about that share of the elements along every edge.

        None where it has no fewer: meshes that are given node by node have no coarser one.
        """
        mesh, found = getattr(self, "mesh", None), self.fewer_elements(share)
        if mesh is None or all(getattr(mesh, key) == value for key, value in found.items()):
            return None
        return self.changed({"mesh": found})

    @property
    def is_cell(self) -> bool:
        """Whether a periodic cell is asked for."""
        with uncounted((FemSection, "symmetry")):
            return self.fem is not None and self.fem.symmetry == "periodic cell"

    @property
    def gap_words(self) -> str:
        """Gaps before the load acts, to follow other words; nothing where there are none."""
        found = self.contact
        given = (
            () if found is None else (("clearance", found.clearance), ("spacing", found.spacing))
        )
        return "".join(f", {name} {value:g} mm" for name, value in given if value)

    @property
    def weight(self) -> Vector | None:
        """``effects.gravity`` itself."""
        return self.effects.gravity

    def straightened(self, assembly: Assembly) -> bool:  # noqa: ARG002
        """Whether files have nodes between corners that elements of degree 1 leave out."""
        return False

    @property
    def element_counts(self) -> dict[str, Any]:
        """Values of ``[mesh]`` that count elements; none where meshes are given."""
        return {}


class DivisionsSection(Section):
    """``[mesh]`` by elements along x, y, z."""

    divisions: tuple[
        Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]
    ]

    def share(self, share: float, multiple: int) -> dict[str, Any]:
        """Divisions with about a share of the elements, along x a multiple of a number."""
        along, across, up = self.divisions
        return {
            "divisions": (fewer(along, share, multiple), fewer(across, share), fewer(up, share))
        }

    def at_most(self, along: int, across: int, up: int) -> dict[str, Any]:
        """Divisions with no more elements than these; nothing where there are no more."""
        coarse = tuple(min(a, b) for a, b in zip(self.divisions, (along, across, up), strict=True))
        return {} if coarse == self.divisions else {"divisions": coarse}
