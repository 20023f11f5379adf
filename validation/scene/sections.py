"""Sections that several kinds of scenes share, and the numbers they are made of."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from fem.contact.law import LAWS, ContactLaw
from geometry.loads import CASES
from geometry.parts.options import option_fields
from mbd.options import ORDER, Rigid, Stages, is_order
from validation.errors import InputError, one_line
from validation.scene.keys.quantities import (
    CLEARANCE,
    FRICTION,
    OF_LAWS,
    PRESSURE,
    Unit,
    converted,
    field_docstrings,
    leaves,
    parse_unit,
    unit_of,
)

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]


def _no_angle(value: Any) -> Any:
    """Reject an angle of friction that comes with its unit, and say the coefficient."""
    radian = parse_unit("rad")
    assert radian is not None
    try:
        angle = converted(value, radian) if isinstance(value, str) else None
    except ValueError:
        return value
    if angle is None:
        return value
    raise ValueError(f"an angle φ is given as its coefficient, tan φ = {math.tan(angle):.6g}")


#: Reads a coefficient of friction.
NoAngle = BeforeValidator(_no_angle)


def _known_load(name: str) -> str:
    if name not in CASES:
        raise ValueError(f"expected one of {', '.join(CASES)}")
    return name


#: Name of a load case, one of the records of `geometry.loads`.
LoadName = Annotated[str, AfterValidator(_known_load), Field(json_schema_extra={"enum": [*CASES]})]


def _as_number(value: Any, unit: Unit) -> Any:
    number = converted(value, unit) if isinstance(value, str) else None
    return value if number is None else number


def entries(value: Any) -> Iterator[Any]:
    """Return what nested lists are made of, or the value itself."""
    if not isinstance(value, list | tuple):
        yield value
        return
    for entry in value:
        yield from entries(entry)


class Section(BaseModel):
    """Base of all sections: frozen, and unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True, allow_inf_nan=False)

    #: Dataclass and field of keys that are fields of dataclasses: their words are read when a
    #: message or a page needs them, for reading sources takes long.
    documented_by: ClassVar[Mapping[str, tuple[type, str]]] = {}

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """Reject true and false where a number is meant; they would be read as 1 and 0."""
        kinds = leaves(cls.model_fields[str(info.field_name)].annotation)
        if (
            kinds & {int, float}
            and bool not in kinds
            and any(isinstance(v, bool) for v in entries(value))
        ):
            raise ValueError("expected a number")
        return value

    @field_validator("*", mode="before")
    @classmethod
    def _in_the_unit_of_the_key(cls, value: Any, info: ValidationInfo) -> Any:
        """Read ``"2400 kg/m3"`` as a number in the unit that the key's docstring names."""
        name = str(info.field_name)
        given = value if isinstance(value, list | tuple) else (value,)
        # Names are text as well: sources are read for the few numbers with a unit alone.
        numeric = float in leaves(cls.model_fields[name].annotation)
        if not numeric or not any(isinstance(v, str) for v in given):
            return value
        unit = unit_of(field_docstrings(cls).get(name, ""))
        if unit is None:
            return value
        numbers = [_as_number(v, unit) for v in given]
        return numbers if isinstance(value, list | tuple) else numbers[0]

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return a copy with other values, checked as those of a file are.

        Parameters
        ----------
        values
            By place, such as ``fem.method``; a mapping changes the keys of a section, a section
            stands in its place.
        """
        result = {name: self.__dict__[name] for name in self.model_fields_set}
        inside: dict[str, dict[str, Any]] = {}
        for place, value in values.items():
            key, _, rest = place.partition(".")
            if rest or isinstance(value, Mapping):
                inside.setdefault(key, {}).update({rest: value} if rest else value)
            else:
                result[key] = value
        for key, inner in inside.items():
            section = result.get(key, self.__dict__.get(key))
            result[key] = section.changed(inner) if isinstance(section, Section) else inner
        try:
            return type(self).model_validate(result)
        except ValidationError as error:
            raise InputError(one_line(error, type(self))) from None


_Named = TypeVar("_Named", bound=Section)


def unset(section: type[_Named]) -> _Named:
    """Return a section that a scene does not name: the defaults need no check."""
    return section.model_construct()


def section_of(
    *kinds: type,
    keys: Collection[str] | None = None,
    absent: Collection[str] = (),
    about: Mapping[str, Any] | None = None,
    base: type[Section] = Section,
    name: str = "",
    **more: Any,
) -> Any:
    """Section whose keys are fields of dataclasses, with their ranges, units and words.

    Parameters
    ----------
    kinds
        Dataclasses; the first one that has a field says what its key is.
    keys, absent
        Fields that are keys, by default all; fields that are none.
    about
        What keys of scenes have beside, such as plausible ranges.
    base, name
        Class that the section is made from, and its name in the schema.
    more
        Annotations and defaults of further keys, before the others.
    """
    result: dict[str, Any] = more
    documented: dict[str, tuple[type, str]] = {}
    for kind in kinds:
        for key, (hint, default) in option_fields(kind).items():
            if key in result or key in absent or (keys is not None and key not in keys):
                continue
            beside = (about or {}).get(key)
            ranged = hint if beside is None else Annotated[hint, beside]
            result[key], documented[key] = (ranged, Field(default)), (kind, key)
    name = name or f"{kinds[0].__name__}Keys"
    made = create_model(name, __base__=base, **result)
    made.documented_by = documented
    return made


def fewer(count: int, share: float, multiple: int = 1) -> int:
    """About a share of a number of elements, a multiple of another, at least one of those."""
    if count % multiple:
        return count
    return max(1, round(share * count / multiple)) * multiple


class TubeLoadSection(Section):
    """``[load]`` of a tube: one of the five load cases."""

    case: LoadName
    pressure: Annotated[Finite, PRESSURE]
    """Load pressure [MPa]."""
    as_printed: bool = False
    """Load of the paper's tables instead of the physically consistent one."""
    layer: Annotated[int, Field(ge=1)] | None = None
    """Loaded layer of beam and shaft; by default the middle one, ⌊L/2⌋ + 1."""

    @property
    def words(self) -> str:
        """The load with its size."""
        layer = "" if self.layer is None else f" (layer {self.layer})"
        printed = ", as printed" if CASES[self.case].force_as_printed and self.as_printed else ""
        return f"{self.case_words} {self.pressure:g} MPa{layer}{printed}"

    @property
    def case_words(self) -> str:
        """The load without its size."""
        return CASES[self.case].words


class WallLoadSection(TubeLoadSection):
    """``[load]`` of a planar wall: a load case of tubes, on the face of the same name."""

    @property
    def case_words(self) -> str:
        """The load without its size: a wall has two sides, no inside."""
        sides = {"pipe": "pressure on the inner side", "tunnel": "pressure on the outer side"}
        return sides.get(self.case, super().case_words)


_RigidKeys: Any = section_of(Rigid, absent={"stages"})
_StagesKeys: Any = section_of(Stages)


class RigidSection(_RigidKeys):  # type: ignore[misc]
    """``[rigid]``: rigid-block analysis."""


class StagesSection(_StagesKeys):  # type: ignore[misc]
    """``[stages]``: order of construction, judged stage by stage under its weight."""

    @field_validator("order", mode="before")
    @classmethod
    def _an_order(cls, value: Any) -> Any:
        if not is_order(value):
            raise ValueError(ORDER)
        return value


class PlausibilitySection(Section):
    """``[plausibility]``: implausible values to accept."""

    accept: tuple[str, ...] = ()
    """Their keys, such as "material.density"."""


class PicturesSection(Section):
    """``[pictures]``: what pictures show; results do not depend on it."""

    footer: bool = True
    """Whether a line at the foot names program, version and day."""
    mises: bool = False
    """Von Mises stress beside σ₁ and σ₃, of deformable blocks."""
    labels: Literal["none", "numbers", "names"] = "none"
    """Labels on the blocks of a drawn assembly: their ``numbers``, as in tables and JSON, or the
    ``names`` of their shapes."""


class CutSection(Section):
    """``[[sections]]``: plane through which normal force, shear forces and moments are computed."""

    point: Vector
    """A point of the plane [mm]."""
    normal: Vector
    """Normal of any length: forces are those of the part it points to on the part behind."""
    name: str = ""
    """Name in tables and files; by default its number, from 1."""
    blocks: Annotated[tuple[int | str, ...] | None, Field(min_length=1)] = None
    """Numbers or names of the blocks that are cut; by default all."""


class LimitsSection(Section):
    """``[limits]``: what can be built; results do not depend on it."""

    least_wall: Positive | None = None
    """Smallest wall that can be cast [mm]."""
    steepest_joint: Annotated[float, Field(gt=0.0, le=90.0)] | None = None
    """Largest angle of a joint to its mean plane that can be cast [degrees]."""


def vector_words(values: Sequence[float]) -> str:
    """Components in parentheses."""
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"


def _law_section() -> Any:
    """Section with the keys of all contact laws.

    None is the default where a law has no finite constant of its own.
    """
    keys: dict[str, Any] = {"law": (Literal[tuple(LAWS)], "exponential")}
    documented: dict[str, tuple[type, str]] = {}
    for law in LAWS.values():
        for constant in fields(law):
            own = constant.default is not MISSING and math.isfinite(constant.default)
            kind, default = (Positive, constant.default) if own else (Positive | None, None)
            key = law.keys.get(constant.name, constant.name)
            keys[key] = Annotated[kind, OF_LAWS[key]] if key in OF_LAWS else kind, Field(default)
            documented[key] = cast("type", law), constant.name
    made = create_model("_LawKeys", __base__=Section, **keys)
    made.documented_by = documented
    return made


_LawKeys: Any = _law_section()


def law_keys(name: str) -> tuple[str, ...]:
    """Keys of the constants of a law."""
    law = LAWS[name]
    return tuple(law.keys.get(constant.name, constant.name) for constant in fields(law))


class _LawSection(_LawKeys):  # type: ignore[misc]
    """A contact law: its name and its constants."""

    place: ClassVar[str] = "contact"
    """Of the keys, for messages."""

    @property
    def built(self) -> ContactLaw:
        """The law itself."""
        law = LAWS[self.law]
        given = {c.name: getattr(self, law.keys.get(c.name, c.name)) for c in fields(law)}
        return law(**{name: value for name, value in given.items() if value is not None})

    @property
    def words(self) -> str:
        """The law and its constants."""
        given = {key: getattr(self, key) for key in law_keys(self.law)}
        shown = [f"{k.replace('_', ' ')} {v:g}" for k, v in given.items() if v is not None]
        return f"{self.law} ({', '.join(shown)}; mm, MPa)"

    @model_validator(mode="after")
    def _constants_of_its_law(self) -> Self:
        """Reject constants that the law lacks, and those of another one."""
        for law in sorted(LAWS.values(), key=lambda law: law.name != self.law):
            for constant in fields(law):
                key = law.keys.get(constant.name, constant.name)
                field = type(self).model_fields[key]
                given = field.default is not None or getattr(self, key) is not None
                if law.name == self.law and not given and constant.default is MISSING:
                    about = field_docstrings(cast("type", law))[constant.name]
                    unit = about.rpartition(" ")[2].rstrip(".")
                    raise ValueError(
                        f'{self.place}.{key} is missing: the law "{law.name}" needs it {unit}'
                    )
                if law.name != self.law and given and field.default is None:
                    raise ValueError(
                        f'{self.place}.{key} belongs to law = "{law.name}"; remove one of the two'
                    )
        return self


class ContactPairSection(_LawSection):
    """``[[contact.pairs]]``: joints between some blocks with their own friction, law or both.

    Other joints have the friction of ``[effects.friction]`` and the law of ``[contact]``.
    """

    place: ClassVar[str] = "contact.pairs"

    between: tuple[Annotated[int, Field(ge=0)] | str, Annotated[int, Field(ge=0)] | str]
    """Two blocks, by number or name, or materials: of all joints between their blocks."""
    friction: Annotated[NonNegative | None, NoAngle, FRICTION] = None
    """Coefficient of friction μ [-]; 0: frictionless."""

    @property
    def has_law(self) -> bool:
        """Whether the pair has a law of its own."""
        return "law" in self.model_fields_set

    @model_validator(mode="after")
    def _friction_or_law(self) -> Self:
        """Reject a pair that states nothing, and constants of no law."""
        constants = self.model_fields_set - {"between", "friction", "law"}
        others = sorted(constants.difference(law_keys(self.law)))
        if others and self.has_law:
            raise ValueError(
                f"contact.pairs: got {', '.join(others)} beside law = {self.law!r}, which has "
                f"{', '.join(law_keys(self.law))}; remove one of the two"
            )
        if constants and not self.has_law:
            raise ValueError(
                f"contact.pairs: got {', '.join(sorted(constants))} without law; expected "
                f"law = {' or '.join(repr(name) for name in LAWS)} too"
            )
        if self.friction is None and not self.has_law:
            raise ValueError("contact.pairs: got a pair without friction and law; expected one")
        return self


class ContactSection(_LawSection):
    """``[contact]``: soft contact between blocks."""

    pairs: tuple[ContactPairSection, ...] = ()
    """Friction and contact law of some joints; rigid blocks have no law, methods and answers
    without friction ignore that."""

    clearance: Annotated[Finite, CLEARANCE] = 0.0
    """Gap along the normal of every facet before the load acts [mm]: blocks made too small by
    half of it. Negative: an interference fit, blocks made too large."""
    spacing: Annotated[NonNegative, CLEARANCE] = 0.0
    """Distance by which neighbouring blocks are moved apart before the load acts, their size kept
    [mm], as the paper's group did: inclined joints open by less or more. Both add up."""

    @property
    def opened(self) -> bool:
        """Whether gaps are to be closed before blocks press on each other."""
        return self.clearance > 0.0 or self.spacing > 0.0

    @model_validator(mode="before")
    @classmethod
    def _which_gap(cls, data: Any) -> Any:
        """Reject the key that meant one gap to the solver and another one to a deck."""
        if isinstance(data, dict) and "initial_clearance" in data:
            value = data["initial_clearance"]
            raise ValueError(
                f"contact.initial_clearance: got {value!r}, which meant two things; write "
                f"contact.clearance = {value} (a gap along every normal, as runs took it) or "
                f"contact.spacing = {value} (blocks moved apart, as decks wrote it)"
            )
        return data


def gap_words(gaps: Any) -> str:
    """``clearance`` and ``spacing`` in words, to follow others; nothing where there are none."""
    given = ((name, getattr(gaps, name)) for name in ("clearance", "spacing"))
    return "".join(f", {name} {value:g} mm" for name, value in given if value)
